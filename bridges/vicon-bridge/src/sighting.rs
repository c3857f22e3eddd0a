//! What a motion-capture system shows of one object at one exposure, whichever system it is.

use core::fmt;

use device::natnet::{RigidBody, UpAxis};
use device::vicon::{Object, euler_to_rotation};
use quantity::{Body, Rotation, Span, Vector, World};

/// Vicon's angles are within a turn either way; what is beyond two is degrees or worse.
const ANGLE_RAD_MAX: f64 = 4.0 * core::f64::consts::PI;

/// One datagram of poses.
#[derive(Clone, Debug)]
pub(crate) struct Exposure {
    /// The vendor's count of exposures.
    pub(crate) number: u32,
    /// From the exposure to the datagram's departure, where the vendor tells.
    pub(crate) latency: Option<Span>,
    /// What was in view.
    pub(crate) sightings: Vec<Sighting>,
}

/// One object of an exposure.
#[derive(Clone, Debug)]
pub(crate) struct Sighting {
    /// Its name at the vendor's system.
    pub(crate) name: Vec<u8>,
    /// How it was shown; `None` where the system says that it did not see it.
    pub(crate) shown: Option<Shown>,
}

/// A pose in the vendor's own numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shown {
    /// As Vicon's object stream has it.
    Vicon {
        /// In the hall's axes.
        translation_mm: [f64; 3],
        /// About the axes of the intermediate frames, x then y then z.
        rotation_rad: [f64; 3],
    },
    /// As OptiTrack's frames have it.
    NatNet {
        /// The body.
        body: RigidBody,
        /// The axes it is streamed in.
        up: UpAxis,
    },
}

impl From<&Object<'_>> for Sighting {
    fn from(object: &Object<'_>) -> Self {
        let (translation_mm, rotation_rad) = (object.translation_mm, object.rotation_rad);
        Self { name: object.name.to_vec(), shown: Some(Shown::Vicon { translation_mm, rotation_rad }) }
    }
}

impl Shown {
    /// Whether all its numbers are finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.numbers().iter().all(|number| number.is_finite())
    }

    /// Its numbers, bit for bit.
    pub(crate) fn bits(&self) -> [u64; 7] {
        self.numbers().map(f64::to_bits)
    }

    /// Where it is.
    pub(crate) fn position_m(&self) -> Vector<World> {
        match self {
            Self::Vicon { translation_mm: [x, y, z], .. } => Vector::new(*x, *y, *z) * 1e-3,
            Self::NatNet { body, up } => up.position(body.position_m),
        }
    }

    /// How it lies; `None` where its numbers are no attitude.
    pub(crate) fn orientation(&self) -> Option<Rotation<Body, World>> {
        match self {
            Self::Vicon { rotation_rad, .. } => {
                let sane = rotation_rad.iter().all(|angle| angle.abs() <= ANGLE_RAD_MAX);
                euler_to_rotation(*rotation_rad).filter(|_| sane)
            }
            Self::NatNet { body, up } => up.orientation(body.orientation_xyzw),
        }
    }

    fn numbers(&self) -> [f64; 7] {
        match self {
            Self::Vicon { translation_mm: [x, y, z], rotation_rad: [a, b, c] } => {
                [*x, *y, *z, *a, *b, *c, 0.0]
            }
            Self::NatNet { body, .. } => {
                let ([x, y, z], [a, b, c, d]) = (body.position_m, body.orientation_xyzw);
                [x, y, z, a, b, c, d].map(f64::from)
            }
        }
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z, a, b, c, d] = self.numbers();
        match self {
            Self::Vicon { .. } => write!(f, "{x:.1} {y:.1} {z:.1} mm, {a:.4} {b:.4} {c:.4} rad"),
            Self::NatNet { .. } => {
                write!(f, "{x:.4} {y:.4} {z:.4} m, quaternion {a:.4} {b:.4} {c:.4} {d:.4}, as streamed")
            }
        }
    }
}
