//! Their axes and ours.
//!
//! Half a turn about x takes one to the other, for the hall and for the vehicle alike, and back.

use quantity::{Body, Rotation, Vector, World};

/// A vector of the hall as north, east, down.
#[must_use]
pub fn world_to_ned(vector: Vector<World>) -> [f64; 3] {
    [vector.x, -vector.y, -vector.z]
}

/// North, east, down as a vector of the hall.
#[must_use]
pub fn ned_to_world([north, east, down]: [f64; 3]) -> Vector<World> {
    Vector::new(north, -east, -down)
}

/// A vector of the vehicle as forward, right, down; also for its angular rate, whose components are roll,
/// pitch (nose up) and yaw (clockwise from above) then.
#[must_use]
pub fn body_to_frd(vector: Vector<Body>) -> [f64; 3] {
    [vector.x, -vector.y, -vector.z]
}

/// Forward, right, down as a vector of the vehicle.
#[must_use]
pub fn frd_to_body([forward, right, down]: [f64; 3]) -> Vector<Body> {
    Vector::new(forward, -right, -down)
}

/// An attitude as the quaternion from forward, right, down to north, east, down; real part first.
#[must_use]
pub fn attitude_to_frd_ned(attitude: Rotation<Body, World>) -> [f64; 4] {
    let Rotation { w, x, y, z, .. } = attitude;
    [w, x, -y, -z]
}

/// The attitude such a quaternion stands for; `None` where it is not finite or too short to have a direction.
#[must_use]
pub fn frd_ned_to_attitude([w, x, y, z]: [f64; 4]) -> Option<Rotation<Body, World>> {
    Rotation::from_components(w, x, -y, -z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;
    use proptest::prelude::*;

    #[test]
    fn up_is_negative_down_and_left_is_negative_right() {
        assert_eq!(world_to_ned(Vector::new(1.0, 2.0, 3.0)), [1.0, -2.0, -3.0]);
        assert_eq!(body_to_frd(Vector::new(1.0, 2.0, 3.0)), [1.0, -2.0, -3.0]);
        assert_eq!(attitude_to_frd_ned(Rotation::IDENTITY), [1.0, 0.0, 0.0, 0.0]);
    }

    /// Of an autopilot's quaternion: heading, pitch and roll by its own formulas (aerospace sequence, heading
    /// clockwise from north, pitch nose up, roll right side down).
    fn heading_pitch_roll([w, x, y, z]: [f64; 4]) -> [f64; 3] {
        let heading = quantity::math::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        let pitch = quantity::math::asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0));
        let roll = quantity::math::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        [heading, pitch, roll]
    }

    #[test]
    fn a_turn_to_the_left_is_a_falling_heading_and_a_nose_down_turn_a_falling_pitch() {
        for (yaw, pitch, roll) in [(0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.4), (1.0, -0.5, 0.25)] {
            let attitude = Rotation::<Body, World>::from_yaw_pitch_roll(yaw, pitch, roll);
            let theirs = heading_pitch_roll(attitude_to_frd_ned(attitude));
            for (theirs, ours) in theirs.iter().zip([-yaw, -pitch, roll]) {
                assert!((theirs - ours).abs() < 1e-12, "{theirs} is not {ours}");
            }
        }
        // Nose to the left wall: heading west.
        let west = Rotation::from_yaw_pitch_roll(FRAC_PI_2, 0.0, 0.0);
        assert!((heading_pitch_roll(attitude_to_frd_ned(west))[0] + FRAC_PI_2).abs() < 1e-12);
    }

    /// What a quaternion does to a vector, by the definition q v q*.
    fn turned([w, x, y, z]: [f64; 4], [a, b, c]: [f64; 3]) -> [f64; 3] {
        let [tx, ty, tz] = [y * c - z * b, z * a - x * c, x * b - y * a].map(|t| 2.0 * t);
        [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx]
    }

    proptest! {
        #[test]
        fn turning_first_or_changing_axes_first_is_the_same(
            turn in prop::array::uniform3(-3.0..3.0f64), point in prop::array::uniform3(-2.0..2.0f64),
        ) {
            let attitude = Rotation::<Body, World>::from_rotation_vector(Vector::new(turn[0], turn[1], turn[2]));
            let point = Vector::<Body>::new(point[0], point[1], point[2]);
            let ours = world_to_ned(attitude * point);
            let theirs = turned(attitude_to_frd_ned(attitude), body_to_frd(point));
            for (ours, theirs) in ours.iter().zip(theirs) {
                prop_assert!((ours - theirs).abs() < 1e-12);
            }
        }

        #[test]
        fn there_and_back_is_where_it_was(
            x in -9.0..9.0f64, y in -9.0..9.0f64, z in -9.0..9.0f64, w in 0.1..1.0f64,
        ) {
            prop_assert_eq!(ned_to_world(world_to_ned(Vector::new(x, y, z))), Vector::new(x, y, z));
            prop_assert_eq!(frd_to_body(body_to_frd(Vector::new(x, y, z))), Vector::new(x, y, z));
            let attitude = Rotation::from_components(w, x, y, z).unwrap();
            let back = frd_ned_to_attitude(attitude_to_frd_ned(attitude)).unwrap();
            prop_assert!(back.angle_to(attitude) < 1e-9);
        }
    }

    #[test]
    fn what_has_no_direction_is_no_attitude() {
        assert_eq!(frd_ned_to_attitude([0.0; 4]), None);
        assert_eq!(frd_ned_to_attitude([1.0, f64::NAN, 0.0, 0.0]), None);
    }
}
