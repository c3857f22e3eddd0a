//! Which of the server's axes points up.

use quantity::{Body, Rotation, Vector, World};

/// The axis that Motive streams as pointing up (its streaming setting *Up Axis*).
///
/// With y up, which is its default, x stays, y is our z and z is our negative y: the hall's frame turned by
/// a quarter about x. Bodies turn with it, so that a body whose pose was reset while it stood level has the
/// identity as its attitude in either setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// y up, Motive's default.
    #[default]
    Y,
    /// z up, which is ours.
    Z,
}

impl UpAxis {
    /// A position in the hall.
    #[must_use]
    pub fn position(self, streamed_m: [f32; 3]) -> Vector<World> {
        let [x, y, z] = streamed_m.map(f64::from);
        match self {
            Self::Y => Vector::new(x, -z, y),
            Self::Z => Vector::new(x, y, z),
        }
    }

    /// An attitude in the hall; `None` where the components are not finite or too short to have a direction.
    #[must_use]
    pub fn orientation(self, streamed_xyzw: [f32; 4]) -> Option<Rotation<Body, World>> {
        let [x, y, z, w] = streamed_xyzw.map(f64::from);
        match self {
            Self::Y => Rotation::from_components(w, x, -z, y),
            Self::Z => Rotation::from_components(w, x, y, z),
        }
    }

    /// The position as it is streamed, to the nearest `f32`.
    #[must_use]
    pub fn streamed_position(self, position_m: Vector<World>) -> [f32; 3] {
        let Vector { x, y, z, .. } = position_m;
        match self {
            Self::Y => [x as f32, z as f32, -y as f32],
            Self::Z => [x as f32, y as f32, z as f32],
        }
    }

    /// The attitude as it is streamed, to the nearest `f32`.
    #[must_use]
    pub fn streamed_orientation(self, orientation: Rotation<Body, World>) -> [f32; 4] {
        let Rotation { x, y, z, w, .. } = orientation;
        match self {
            Self::Y => [x as f32, z as f32, -y as f32, w as f32],
            Self::Z => [x as f32, y as f32, z as f32, w as f32],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;
    use proptest::prelude::*;

    #[test]
    fn what_is_up_in_motive_is_up_in_the_hall() {
        assert_eq!(UpAxis::Y.position([1.0, 2.0, 3.0]), Vector::new(1.0, -3.0, 2.0));
        assert_eq!(UpAxis::Z.position([1.0, 2.0, 3.0]), Vector::new(1.0, 2.0, 3.0));
        // A heading: a quarter turn about what is up, given with y up and with z up.
        let (sin, cos) = quantity::math::sin_cos(0.5 * FRAC_PI_2);
        let (sin, cos) = (sin as f32, cos as f32);
        let about_y = UpAxis::Y.orientation([0.0, sin, 0.0, cos]).unwrap();
        let about_z = UpAxis::Z.orientation([0.0, 0.0, sin, cos]).unwrap();
        for heading in [about_y, about_z] {
            assert!((heading.yaw_rad() - FRAC_PI_2).abs() < 1e-7);
            assert!(heading.tilt_rad() < 1e-7);
        }
        assert_eq!(UpAxis::Y.orientation([0.0, 0.0, 0.0, 1.0]), Some(Rotation::IDENTITY));
    }

    #[test]
    fn turning_the_axes_turns_vectors_and_attitudes_alike() {
        // A point of a body, given in the body's streamed axes, lands in the same place either way.
        let (about, point) = ([0.3f32, -0.4, 0.5, 0.7], [0.2f32, 0.9, -0.6]);
        let streamed: Rotation<Body, World> = UpAxis::Z.orientation(about).unwrap();
        let [x, y, z] = point.map(f64::from);
        let placed = streamed * Vector::<Body>::new(x, y, z);
        let by_vector = Vector::<World>::new(placed.x, -placed.z, placed.y);
        let by_attitude = UpAxis::Y.orientation(about).unwrap() * Vector::<Body>::new(x, -z, y);
        assert!((by_vector - by_attitude).norm() < 1e-12);
    }

    #[test]
    fn what_has_no_direction_is_no_attitude() {
        for up in [UpAxis::Y, UpAxis::Z] {
            assert_eq!(up.orientation([0.0; 4]), None);
            assert_eq!(up.orientation([f32::NAN, 0.0, 0.0, 1.0]), None);
            assert_eq!(up.orientation([0.0, f32::INFINITY, 0.0, 1.0]), None);
        }
    }

    proptest! {
        #[test]
        fn poses_survive_the_way_there_and_back(
            x in -20.0..20.0f64, y in -20.0..20.0f64, z in -20.0..20.0f64,
            a in -3.0..3.0f64, b in -3.0..3.0f64, c in -3.0..3.0f64,
        ) {
            let (position, turn) = (Vector::<World>::new(x, y, z), Vector::<Body>::new(a, b, c));
            let attitude = Rotation::<Body, World>::IDENTITY.turned(turn);
            for up in [UpAxis::Y, UpAxis::Z] {
                // Half a unit in the last place of an f32 at 20 m is below a micrometre.
                let back = up.position(up.streamed_position(position));
                prop_assert!((back - position).norm() < 2e-6);
                let back = up.orientation(up.streamed_orientation(attitude)).unwrap();
                prop_assert!(back.angle_to(attitude) < 2e-7);
            }
        }
    }
}
