//! From where the thrust shall point, and the heading, to body rates.
//!
//! The thrust axis goes first, by the shortest way; heading is a matter of leisure. So a vehicle that comes
//! out of a flip upside down, or with a rate still in it, first gets its thrust to where it is of use.

use quantity::{Body, Rotation, Vector, World, math};

use crate::tuning::AttitudeTuning;

/// Body rates that turn the thrust axis to `thrust_axis` (a unit vector) and the heading to `heading_rad`,
/// for a vehicle that has `orientation` and `rate_rad_s` when the command takes effect.
pub(crate) fn rates(
    tuning: &AttitudeTuning,
    orientation: Rotation<Body, World>,
    rate_rad_s: Vector<Body>,
    thrust_axis: Vector<World>,
    heading_rad: f64,
) -> Vector<Body> {
    let coming = orientation.turned(rate_rad_s.horizontal() * tuning.lead_s);
    let wanted = coming.inverse() * thrust_axis;
    let tilt = tilt_rates(tuning, wanted, rate_rad_s);
    let upright = coming.z_axis().z;
    let yaw = if upright > math::cos(tuning.yaw_tilt_rad_max) {
        let error = math::wrap_pi(heading_rad - coming.yaw_rad());
        (tuning.yaw_gain_1_s * error).clamp(-tuning.yaw_rate_rad_s_max, tuning.yaw_rate_rad_s_max)
    } else {
        0.0
    };
    Vector::new(tilt.x, tilt.y, yaw)
}

/// Rates about x and y that turn the body's z axis to `wanted`, given in body axes.
fn tilt_rates(tuning: &AttitudeTuning, wanted: Vector<Body>, rate_rad_s: Vector<Body>) -> Vector<Body> {
    // z × wanted
    let axis = Vector::new(-wanted.y, wanted.x, 0.0);
    let sin = axis.norm();
    let angle = math::atan2(sin, wanted.z);
    let direction = if sin > 1e-3 {
        axis * (1.0 / sin)
    } else if wanted.z < 0.0 {
        // Exactly opposite: on the way it already turns, else by pitching.
        rate_rad_s.horizontal().direction().unwrap_or(Vector::new(0.0, 1.0, 0.0))
    } else {
        axis
    };
    // Never faster than it can still be stopped.
    let stoppable = math::sqrt(2.0 * tuning.stopping_rad_s2 * angle);
    let speed = (tuning.tilt_gain_1_s * angle).min(stoppable).min(tuning.rate_rad_s_max);
    // For angles too small to have a direction the axis itself is the angle.
    if sin > 1e-3 || wanted.z < 0.0 { direction * speed } else { axis * tuning.tilt_gain_1_s }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    fn toward(orientation: Rotation<Body, World>, axis: Vector<World>) -> Vector<Body> {
        rates(&AttitudeTuning::default(), orientation, Vector::ZERO, axis, 0.0)
    }

    #[test]
    fn leaning_forward_is_positive_pitch() {
        let axis = Vector::new(0.1, 0.0, 1.0).direction().expect("not zero");
        let rate = toward(Rotation::IDENTITY, axis);
        assert!(rate.y > 0.9 && rate.x.abs() < 1e-12 && rate.z.abs() < 1e-12);
    }

    #[test]
    fn upside_down_turns_the_way_it_already_turns() {
        let over = Rotation::from_yaw_pitch_roll(0.0, 0.0, PI);
        let tuning = AttitudeTuning { lead_s: 0.0, ..AttitudeTuning::default() };
        for spin in [Vector::new(3.0, 0.0, 0.0), Vector::new(0.0, -2.0, 0.0)] {
            let rate = rates(&tuning, over, spin, Vector::Z, 0.0);
            assert!(rate.dot(spin) > 9.0 * spin.norm(), "{rate:?}");
            assert_eq!(rate.z, 0.0);
        }
        assert!(toward(over, Vector::Z).norm() > 9.0);
    }

    #[test]
    fn heading_takes_the_shorter_way() {
        let orientation = Rotation::from_yaw_pitch_roll(3.0, 0.0, 0.0);
        let rate = rates(&AttitudeTuning::default(), orientation, Vector::ZERO, Vector::Z, -3.0);
        assert!(rate.z > 0.0 && rate.z < 1.0);
    }

    proptest! {
        #[test]
        fn rates_are_bounded_and_turn_toward(
            turn in prop::array::uniform3(-3.1..3.1f64), axis in prop::array::uniform3(-1.0..1.0f64),
            spin in prop::array::uniform3(-30.0..30.0f64),
        ) {
            let orientation = Rotation::from_rotation_vector(Vector::new(turn[0], turn[1], turn[2]));
            let axis = Vector::new(axis[0], axis[1], axis[2]).direction().unwrap_or(Vector::Z);
            let tuning = AttitudeTuning::default();
            let rate = rates(&tuning, orientation, Vector::new(spin[0], spin[1], spin[2]), axis, 1.0);
            prop_assert!(rate.horizontal().norm() <= 10.0 + 1e-9 && rate.z.abs() <= 3.0);
            let calm = rates(&tuning, orientation, Vector::ZERO, axis, 1.0).horizontal();
            let after = orientation.turned(calm * 1e-4);
            prop_assert!(after.z_axis().dot(axis) >= orientation.z_axis().dot(axis) - 1e-12);
        }
    }
}
