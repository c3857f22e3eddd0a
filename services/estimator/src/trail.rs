//! The last poses of a run, and whether the attitudes in it can be true.
//!
//! A rotor vehicle accelerates along its own z axis, gravity aside. So positions alone tell where that axis
//! points on average, and a marker pattern matched the wrong way round, which shows right positions with
//! wrong attitudes, gives itself away. A turn about the z axis itself does not; for that there is the pitch
//! axis, which flips leave where it was.

use quantity::{Body, GRAVITY_M_S2, Vector, World};

use crate::gate::Pose;

/// Poses kept: three groups of six.
const LEN: usize = 18;
const GROUP: usize = LEN / 3;
/// A specific force below this has no direction worth comparing.
const FORCE_M_S2_MIN: f64 = 4.0;
/// Angle between the specific force and the mean thrust axis that noise, drag and lag explain (its cosine).
const FORCE_COS_MIN: f64 = 0.85;
/// A turn of the pitch axis that stays within this (its cosine) is none of a quarter turn or more.
const PITCH_AXIS_COS_MIN: f64 = 0.75;

/// The last poses of a run, oldest first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trail {
    poses: [Pose; LEN],
    len: usize,
}

impl Trail {
    /// A trail of one pose.
    pub fn new(pose: Pose) -> Self {
        Self { poses: [pose; LEN], len: 1 }
    }

    /// The next pose.
    pub fn push(&mut self, pose: Pose) {
        if self.len == LEN {
            self.poses.copy_within(1.., 0);
            self.len -= 1;
        }
        self.poses[self.len] = pose;
        self.len += 1;
    }

    /// The newest pose.
    pub fn last(&self) -> &Pose {
        &self.poses[self.len - 1]
    }

    /// The one before, or the only one.
    pub fn previous(&self) -> &Pose {
        &self.poses[self.len.saturating_sub(2)]
    }

    /// Whether the attitudes agree with the motion, and with a pitch axis that was `pitch_axis` before; never
    /// before there are enough poses to tell.
    pub fn is_plausible(&self, pitch_axis: Vector<World>) -> bool {
        let sideways = self.last().orientation * Vector::<Body>::new(0.0, 1.0, 0.0);
        self.len == LEN && sideways.dot(pitch_axis) >= PITCH_AXIS_COS_MIN && self.pushes_along_its_axis()
    }

    fn pushes_along_its_axis(&self) -> bool {
        let group = |index: usize| {
            let poses = &self.poses[index * GROUP..(index + 1) * GROUP];
            let mut mean = Vector::<World>::ZERO;
            let mut at_s = 0.0;
            for pose in poses {
                mean += pose.position_m * (1.0 / GROUP as f64);
                at_s += (pose.at - self.poses[0].at).as_secs_f64() / GROUP as f64;
            }
            (mean, at_s)
        };
        let ((first, first_s), (middle, middle_s), (last, last_s)) = (group(0), group(1), group(2));
        let (before_s, after_s) = (middle_s - first_s, last_s - middle_s);
        if before_s <= 0.0 || after_s <= 0.0 {
            return false;
        }
        let change = (last - middle) * (1.0 / after_s) - (middle - first) * (1.0 / before_s);
        let force = change * (2.0 / (before_s + after_s)) + Vector::Z * GRAVITY_M_S2;
        let mut axis = Vector::<World>::ZERO;
        for pose in &self.poses {
            axis += pose.orientation.z_axis();
        }
        let (strength, length) = (force.norm(), axis.norm());
        strength >= FORCE_M_S2_MIN && length > 0.0 && force.dot(axis) >= FORCE_COS_MIN * strength * length
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use quantity::{Rotation, Span, Time};

    use super::*;
    use crate::testing::Dice;

    const PITCH_AXIS: Vector<World> = Vector::new(0.0, 1.0, 0.0);

    /// A vehicle that pitches at `rate` from `tilt` on, pushed along its axis; poses turned by `turn`.
    fn trail(tilt: f64, rate: f64, collective: f64, turn: Vector<Body>, seed: u64) -> Trail {
        let mut dice = Dice::new(seed);
        let (mut position, mut velocity) = (Vector::<World>::new(0.0, 0.0, 4.0), Vector::ZERO);
        let mut trail: Option<Trail> = None;
        for k in 0..20 {
            let at_s = 0.005 * f64::from(k);
            let orientation = Rotation::<Body, World>::from_yaw_pitch_roll(0.0, tilt + rate * at_s, 0.0);
            let pose = Pose {
                at: Time::ZERO + Span::from_secs_f64(at_s),
                position_m: position + dice.vector(0.0005),
                orientation: orientation.turned(dice.vector(0.003)) * Rotation::from_rotation_vector(turn),
            };
            trail = Some(match trail {
                None => Trail::new(pose),
                Some(mut trail) => {
                    trail.push(pose);
                    trail
                }
            });
            let acceleration = orientation.z_axis() * collective - Vector::Z * GRAVITY_M_S2;
            position += velocity * 0.005;
            velocity += acceleration * 0.005;
        }
        trail.expect("twenty poses were pushed")
    }

    #[test]
    fn true_attitudes_are_plausible_and_turned_ones_are_not() {
        for seed in 1..20 {
            for (tilt, rate) in [(0.0, 0.0), (0.5, 0.0), (-0.8, 3.0), (1.2, -5.0)] {
                assert!(
                    trail(tilt, rate, 10.0, Vector::ZERO, seed).is_plausible(PITCH_AXIS),
                    "{tilt} {rate}"
                );
                for turn in [PI / 2.0, 2.0 * PI / 3.0, PI, -PI / 2.0, -2.0 * PI / 3.0] {
                    for axis in [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::Z] {
                        let turned = trail(tilt, rate, 10.0, axis * turn, seed);
                        assert!(!turned.is_plausible(PITCH_AXIS), "{tilt} {rate}: {turn} about {axis:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_is_plausible_in_free_fall_or_too_soon() {
        assert!(!trail(0.0, 0.0, 1.0, Vector::ZERO, 1).is_plausible(PITCH_AXIS));
        let pose = *trail(0.0, 0.0, 10.0, Vector::ZERO, 1).last();
        assert!(!Trail::new(pose).is_plausible(PITCH_AXIS));
    }
}
