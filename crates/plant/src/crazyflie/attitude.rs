//! What a simulated Crazyflie knows of its attitude: which way is up, by its gyros and, slowly, its accelerometers.

use onboard::ImuSample;
use quantity::{Body, GRAVITY_M_S2, Vector, math};

/// How fast the accelerometers pull the gyros' idea of up along.
const PULL_1_S: f64 = 0.3;
/// They are believed only while they feel about gravity.
const FORCE_OFF_M_S2_MAX: f64 = 2.0;
/// Rate asked for by angle.
const LEVEL_GAIN_1_S: f64 = 6.0;
/// Greatest rate asked for.
const LEVEL_RATE_RAD_S_MAX: f64 = 6.0;

/// Up, in the body's axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attitude {
    up: Vector<Body>,
}

impl Default for Attitude {
    fn default() -> Self {
        Self { up: Vector::Z }
    }
}

impl Attitude {
    /// Goes on by what the sensors read over a tick; `still` while the motors are off.
    pub(super) fn feel(&mut self, imu: &ImuSample, span_s: f64, still: bool) {
        if !imu.rate_rad_s.is_finite() || !imu.acceleration_m_s2.is_finite() {
            return;
        }
        let turned = self.up - imu.rate_rad_s.cross(self.up) * span_s;
        let force = imu.acceleration_m_s2.norm();
        let believed = (force - GRAVITY_M_S2).abs() < FORCE_OFF_M_S2_MAX;
        let pull = if believed { PULL_1_S * if still { 10.0 } else { 1.0 } } else { 0.0 };
        let felt = imu.acceleration_m_s2.direction().unwrap_or(turned);
        self.up = (turned + (felt - turned) * (pull * span_s)).direction().unwrap_or(Vector::Z);
    }

    /// Whether it lies on its back.
    pub(super) fn tumbled(&self) -> bool {
        self.up.z < 0.0
    }

    /// Roll, and pitch as the vehicle counts it: nose up.
    pub(super) fn roll_pitch_rad(&self) -> (f64, f64) {
        let pitch = math::asin((-self.up.x).clamp(-1.0, 1.0));
        (math::atan2(self.up.y, self.up.z), -pitch)
    }

    /// The rate that turns it to this roll and this pitch, nose up.
    pub(super) fn rate_towards_rad_s(&self, roll_rad: f64, pitch_up_rad: f64) -> Vector<Body> {
        let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) =
            (math::sin_cos(roll_rad), math::sin_cos(-pitch_up_rad));
        let wanted = Vector::new(-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll);
        (wanted.cross(self.up) * LEVEL_GAIN_1_S).limited(LEVEL_RATE_RAD_S_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quantity::{Rotation, World};

    fn tilted(roll_rad: f64, pitch_rad: f64) -> Attitude {
        let attitude = Rotation::<Body, World>::from_yaw_pitch_roll(0.7, pitch_rad, roll_rad);
        Attitude { up: attitude.inverse() * Vector::<World>::Z }
    }

    #[test]
    fn it_turns_to_the_angles_wanted_with_pitch_nose_up() {
        let (roll, pitch) = tilted(0.2, -0.3).roll_pitch_rad();
        assert!((roll - 0.2).abs() < 1e-12 && (pitch - 0.3).abs() < 1e-12);
        assert!(tilted(0.2, -0.3).rate_towards_rad_s(0.2, 0.3).norm() < 1e-12);
        let level = tilted(0.1, 0.0).rate_towards_rad_s(0.0, 0.0);
        assert!(level.x < -0.5 && level.y.abs() < 1e-9);
        // Nose down, it turns the nose up: about negative y.
        assert!(tilted(0.0, 0.2).rate_towards_rad_s(0.0, 0.0).y < -1.0);
    }

    #[test]
    fn gyros_carry_it_and_the_accelerometers_hold_it() {
        let mut attitude = Attitude::default();
        let turning = ImuSample {
            rate_rad_s: Vector::new(1.0, 0.0, 0.0),
            acceleration_m_s2: Vector::ZERO,
            battery_v: 4.0,
        };
        (0..400).for_each(|_| attitude.feel(&turning, 1.25e-3, false));
        assert!((attitude.roll_pitch_rad().0 - 0.5).abs() < 1e-3);
        let resting = ImuSample {
            rate_rad_s: Vector::ZERO,
            acceleration_m_s2: Vector::new(0.0, 0.0, GRAVITY_M_S2),
            battery_v: 4.0,
        };
        (0..4000).for_each(|_| attitude.feel(&resting, 1.25e-3, true));
        assert!(attitude.roll_pitch_rad().0.abs() < 1e-3);
    }
}
