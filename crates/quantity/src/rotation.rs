//! Rotations between two frames, as unit quaternions with named components.

use core::marker::PhantomData;
use core::ops::Mul;

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

use crate::{Frame, Vector, math};

/// Takes components in frame `A` to components in frame `B`; a unit quaternion in Hamilton's convention.
///
/// `Rotation<Body, World>` is what is usually called a vehicle's attitude. On the wire the order is x, y, z, w, that of
/// `geometry_msgs/Quaternion`; a quaternion further than 1e-3 from unit length is refused there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(bound = "")]
pub struct Rotation<A: Frame, B: Frame> {
    /// First imaginary component.
    pub x: f64,
    /// Second imaginary component.
    pub y: f64,
    /// Third imaginary component.
    pub z: f64,
    /// Real component: the cosine of half the angle.
    pub w: f64,
    #[serde(skip)]
    frames: PhantomData<(A, B)>,
}

impl<A: Frame, B: Frame> Default for Rotation<A, B> {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl<A: Frame, B: Frame> Rotation<A, B> {
    /// The two frames' axes coincide.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0, frames: PhantomData };

    /// From the four components, brought to unit length; `None` where they are not finite or too short to have a
    /// direction.
    #[must_use]
    pub fn from_components(w: f64, x: f64, y: f64, z: f64) -> Option<Self> {
        let norm = math::sqrt(w * w + x * x + y * y + z * z);
        (norm.is_finite() && norm > 1e-6).then(|| Self {
            x: x / norm,
            y: y / norm,
            z: z / norm,
            w: w / norm,
            frames: PhantomData,
        })
    }

    /// Turned by a rotation vector (axis times angle, radians) given in frame `A`.
    #[must_use]
    pub fn from_rotation_vector(turn_rad: Vector<A>) -> Self {
        let angle = turn_rad.norm();
        let (scale, w) = if angle < 1e-8 {
            (0.5, 1.0)
        } else {
            let (sin, cos) = math::sin_cos(0.5 * angle);
            (sin / angle, cos)
        };
        Self { x: turn_rad.x * scale, y: turn_rad.y * scale, z: turn_rad.z * scale, w, frames: PhantomData }
    }

    /// From yaw about z, then pitch about the new y, then roll about the new x, in radians.
    #[must_use]
    pub fn from_yaw_pitch_roll(yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        let (sy, cy) = math::sin_cos(0.5 * yaw_rad);
        let (sp, cp) = math::sin_cos(0.5 * pitch_rad);
        let (sr, cr) = math::sin_cos(0.5 * roll_rad);
        Self {
            w: cy * cp * cr + sy * sp * sr,
            x: cy * cp * sr - sy * sp * cr,
            y: cy * sp * cr + sy * cp * sr,
            z: sy * cp * cr - cy * sp * sr,
            frames: PhantomData,
        }
    }

    /// The rotation vector (axis times angle, radians, in frame `A`), of the shorter way round.
    #[must_use]
    pub fn rotation_vector(self) -> Vector<A> {
        let sign = if self.w < 0.0 { -1.0 } else { 1.0 };
        let imaginary = Vector::new(self.x * sign, self.y * sign, self.z * sign);
        let sin = imaginary.norm();
        let scale = if sin < 1e-8 { 2.0 } else { 2.0 * math::atan2(sin, self.w * sign) / sin };
        imaginary * scale
    }

    /// The opposite rotation.
    #[must_use]
    pub fn inverse(self) -> Rotation<B, A> {
        Rotation { x: -self.x, y: -self.y, z: -self.z, w: self.w, frames: PhantomData }
    }

    /// This rotation after its frame `A` has turned by `turn_rad` (axis times angle, in `A`): the discrete form of
    /// integrating a body rate.
    #[must_use]
    pub fn turned(self, turn_rad: Vector<A>) -> Self {
        (self * Rotation::<A, A>::from_rotation_vector(turn_rad)).renormalised()
    }

    /// Where frame `A`'s z axis points in `B`.
    #[must_use]
    pub fn z_axis(self) -> Vector<B> {
        self * Vector::<A>::Z
    }

    /// Yaw: the heading of `A`'s x axis about `B`'s z axis, in (-π, π].
    #[must_use]
    pub fn yaw_rad(self) -> f64 {
        math::atan2(
            2.0 * (self.w * self.z + self.x * self.y),
            1.0 - 2.0 * (self.y * self.y + self.z * self.z),
        )
    }

    /// Angle between the two z axes, in [0, π].
    #[must_use]
    pub fn tilt_rad(self) -> f64 {
        math::acos(self.z_axis().z)
    }

    /// Angle of the rotation that takes `self` to `other`, in [0, π].
    #[must_use]
    pub fn angle_to(self, other: Self) -> f64 {
        (self.inverse() * other).rotation_vector().norm()
    }

    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite() && self.w.is_finite()
    }

    /// Back to unit length after rounding has drifted it.
    #[must_use]
    pub fn renormalised(self) -> Self {
        let scale = 1.0 / math::sqrt(self.w * self.w + self.x * self.x + self.y * self.y + self.z * self.z);
        Self {
            x: self.x * scale,
            y: self.y * scale,
            z: self.z * scale,
            w: self.w * scale,
            frames: PhantomData,
        }
    }
}

impl<A: Frame, B: Frame> Mul<Vector<A>> for Rotation<A, B> {
    type Output = Vector<B>;
    fn mul(self, v: Vector<A>) -> Vector<B> {
        let u = Vector::<B>::new(self.x, self.y, self.z);
        let v = Vector::<B>::new(v.x, v.y, v.z);
        let t = u.cross(v) * 2.0;
        v + t * self.w + u.cross(t)
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Rotation<A, B>> for Rotation<B, C> {
    type Output = Rotation<A, C>;
    fn mul(self, r: Rotation<A, B>) -> Rotation<A, C> {
        Rotation {
            w: self.w * r.w - self.x * r.x - self.y * r.y - self.z * r.z,
            x: self.w * r.x + self.x * r.w + self.y * r.z - self.z * r.y,
            y: self.w * r.y - self.x * r.z + self.y * r.w + self.z * r.x,
            z: self.w * r.z + self.x * r.y - self.y * r.x + self.z * r.w,
            frames: PhantomData,
        }
    }
}

impl<A: Frame, B: Frame> From<nalgebra::UnitQuaternion<f64>> for Rotation<A, B> {
    fn from(raw: nalgebra::UnitQuaternion<f64>) -> Self {
        Self { x: raw.i, y: raw.j, z: raw.k, w: raw.w, frames: PhantomData }
    }
}

impl<'de, A: Frame, B: Frame> Deserialize<'de> for Rotation<A, B> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Components {
            x: f64,
            y: f64,
            z: f64,
            w: f64,
        }
        let Components { x, y, z, w } = Components::deserialize(deserializer)?;
        let norm = math::sqrt(w * w + x * x + y * y + z * z);
        // Not `>`: a norm that is not a number must be refused too.
        if (norm - 1.0).abs() <= 1e-3 {
            Ok(Self { x, y, z, w, frames: PhantomData })
        } else {
            Err(D::Error::custom("quaternion not of unit length"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Body, World};
    use proptest::prelude::*;

    fn close(a: Vector<World>, b: Vector<World>) -> bool {
        (a - b).norm() < 1e-9
    }

    #[test]
    fn positive_pitch_tips_the_thrust_toward_plus_x() {
        let attitude = Rotation::<Body, World>::from_rotation_vector(Vector::new(0.0, 0.3, 0.0));
        assert!(attitude.z_axis().x > 0.29);
        assert!((attitude.tilt_rad() - 0.3).abs() < 1e-12);
    }

    #[test]
    fn yaw_is_read_back() {
        let attitude = Rotation::<Body, World>::from_yaw_pitch_roll(2.5, 0.2, -0.1);
        assert!((attitude.yaw_rad() - 2.5).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn rotation_vector_round_trips(x in -1.7..1.7f64, y in -1.7..1.7f64, z in -1.7..1.7f64) {
            let turn = Vector::<Body>::new(x, y, z);
            let back = Rotation::<Body, World>::from_rotation_vector(turn).rotation_vector();
            prop_assert!((back - turn).norm() < 1e-9);
        }

        #[test]
        fn inverse_undoes(x in -3.0..3.0f64, y in -3.0..3.0f64, z in -3.0..3.0f64) {
            let r = Rotation::<World, World>::from_rotation_vector(Vector::new(x, y, z));
            let v = Vector::new(1.0, -2.0, 3.0);
            prop_assert!(close(r.inverse() * (r * v), v));
        }
    }
}
