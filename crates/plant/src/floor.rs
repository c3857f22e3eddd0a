//! The floor: it holds a vehicle up, brings it to rest, and breaks one that comes down too hard.

use quantity::{Body, Rotation, Vector, math};
use settings::FloorSettings;

use crate::rigid_body::Motion;

/// Below this tilt and speed a vehicle counts as standing still.
const STILL: f64 = 1e-4;

/// How a vehicle met the floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touchdown {
    /// Speed downward.
    pub vertical_m_s: f64,
    /// Speed along the floor.
    pub horizontal_m_s: f64,
    /// Tilt.
    pub tilt_rad: f64,
    /// Whether that was more than the vehicle stands.
    pub crashed: bool,
}

/// Between a vehicle and the floor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// In the air.
    Free,
    /// On its feet, sliding to rest or settling level.
    Settling,
    /// On its feet, level and at rest.
    Standing,
    /// Broken, and lying where it fell.
    Broken,
}

/// The floor under one vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    settings: FloorSettings,
}

impl Floor {
    /// From a vehicle's settings.
    #[must_use]
    pub fn new(settings: &FloorSettings) -> Self {
        Self { settings: settings.clone() }
    }

    /// Height of a standing vehicle's centre of mass.
    #[must_use]
    pub fn gear_height_m(&self) -> f64 {
        self.settings.gear_height_m
    }

    /// Whether a vehicle in the air has reached the floor.
    #[must_use]
    pub fn reached(&self, motion: &Motion) -> bool {
        motion.position_m.z <= self.settings.gear_height_m && motion.velocity_m_s.z <= 0.0
    }

    /// Puts a vehicle that reached the floor onto it.
    pub fn touch(&self, motion: &mut Motion) -> Touchdown {
        let (velocity, tilt_rad) = (motion.velocity_m_s, motion.orientation.tilt_rad());
        let settings = &self.settings;
        let crashed = velocity.norm() > settings.crash_speed_m_s || tilt_rad > settings.crash_tilt_rad;
        motion.position_m.z = settings.gear_height_m;
        motion.velocity_m_s = if crashed { Vector::ZERO } else { velocity.horizontal() };
        motion.rate_rad_s = Vector::ZERO;
        Touchdown {
            vertical_m_s: -velocity.z,
            horizontal_m_s: velocity.horizontal().norm(),
            tilt_rad,
            crashed,
        }
    }

    /// Slides and levels a standing vehicle for a while; tells whether it still moves.
    pub fn settle(&self, motion: &mut Motion, step_s: f64) -> Contact {
        let kept = math::exp(-step_s / self.settings.settle_time_s);
        let level = Rotation::from_yaw_pitch_roll(motion.orientation.yaw_rad(), 0.0, 0.0);
        let tilt_rad: Vector<Body> = (level.inverse() * motion.orientation).rotation_vector();
        let speed_m_s = motion.velocity_m_s.norm();
        if tilt_rad.norm() < STILL && speed_m_s < STILL {
            motion.orientation = level;
            motion.velocity_m_s = Vector::ZERO;
            motion.rate_rad_s = Vector::ZERO;
            return Contact::Standing;
        }
        motion.position_m += motion.velocity_m_s * (self.settings.settle_time_s * (1.0 - kept));
        motion.velocity_m_s = motion.velocity_m_s * kept;
        motion.orientation = level * Rotation::<Body, Body>::from_rotation_vector(tilt_rad * kept);
        motion.rate_rad_s = tilt_rad * (-kept / self.settings.settle_time_s);
        Contact::Settling
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::member;

    fn floor() -> Floor {
        Floor::new(&member().vehicle.plant.floor)
    }

    fn falling(down_m_s: f64, tilt_rad: f64) -> Motion {
        Motion {
            position_m: Vector::new(1.0, 2.0, 0.039),
            velocity_m_s: Vector::new(0.3, 0.4, -down_m_s),
            orientation: Rotation::from_yaw_pitch_roll(0.7, tilt_rad, 0.0),
            ..Motion::default()
        }
    }

    #[test]
    fn a_soft_landing_slides_to_rest_and_settles_level() {
        let mut motion = falling(0.8, 0.2);
        assert!(floor().reached(&motion));
        let touchdown = floor().touch(&mut motion);
        assert_eq!((touchdown.vertical_m_s, touchdown.crashed), (0.8, false));
        assert!((touchdown.horizontal_m_s - 0.5).abs() < 1e-12 && (touchdown.tilt_rad - 0.2).abs() < 1e-9);
        let steps =
            (0..2_000).take_while(|_| floor().settle(&mut motion, 1.25e-3) != Contact::Standing).count();
        assert!(steps < 600, "{steps}");
        // It slid by speed times time constant.
        assert!((motion.position_m - Vector::new(1.0 + 0.015, 2.0 + 0.02, 0.04)).norm() < 1e-4);
        assert!(motion.orientation.tilt_rad() < 1e-7 && (motion.orientation.yaw_rad() - 0.7).abs() < 1e-9);
        assert_eq!(motion.velocity_m_s, Vector::ZERO);
    }

    #[test]
    fn too_fast_or_too_tilted_is_a_crash() {
        assert!(!floor().touch(&mut falling(3.9, 0.0)).crashed);
        assert!(floor().touch(&mut falling(4.1, 0.0)).crashed);
        assert!(!floor().touch(&mut falling(1.0, 0.79)).crashed);
        assert!(floor().touch(&mut falling(1.0, 0.81)).crashed);
    }

    #[test]
    fn a_climbing_vehicle_does_not_touch() {
        assert!(!floor().reached(&falling(-0.1, 0.0)));
    }
}
