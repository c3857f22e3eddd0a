//! Which poses to believe.
//!
//! Two tests must both hold. *Continuity* compares a pose with the last one believed: no vehicle is faster
//! than so many metres or radians per second, while a swap of markers or a symmetry of the marker triangle
//! (90, 120, 180 degrees) jumps within one frame. *Innovation* compares it with what the filter predicts.
//!
//! A filter can be wrong too: pushed, carried, or flying a maneuver nobody reported. So a run of refused
//! poses that agree with each other starts the filter anew, on conditions. A run that began without a jump
//! continues what was believed before: the filter is what is wrong. A run that began with a jump must wait
//! until the state has become invalid, and then still be plausible. A run that looks like another vehicle's
//! is never believed.

use quantity::{Body, Rotation, Span, Time, Vector, World};
use settings::Hall;

use crate::trail::Trail;
use crate::tuning::GateTuning;

/// One vehicle's pose in one exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// When the shutters were open.
    pub at: Time,
    /// Centre of the vehicle.
    pub position_m: Vector<World>,
    /// Attitude of the vehicle.
    pub orientation: Rotation<Body, World>,
}

/// What the filter expects to see.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Expectation {
    /// Predicted position.
    pub position_m: Vector<World>,
    /// Predicted attitude.
    pub orientation: Rotation<Body, World>,
    /// One sigma of it per axis.
    pub position_sigma_m: f64,
    /// One sigma of it per axis.
    pub attitude_sigma_rad: f64,
}

/// The last pose believed, and how far it can be relied on since.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Belief {
    /// That pose.
    pub pose: Pose,
    /// Whether it is so fresh that a state may rest on it.
    pub valid: bool,
    /// Whether the vehicle may since have turned far: it was in a maneuver or far from level.
    pub turning: bool,
}

/// Another vehicle, at the instant of the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Neighbour {
    /// Where it is predicted to be, or was last seen.
    pub position_m: Vector<World>,
    /// Whether it is tracked at this moment.
    pub tracked: bool,
}

/// Why a pose is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// Not finite, below the floor, or far outside the hall.
    Absurd,
    /// Bit for bit the one before, of a vehicle in flight.
    Frozen,
    /// At another vehicle's place.
    Swapped,
    /// Further from the last pose believed than a vehicle can fly.
    JumpOfPosition,
    /// Turned further since the last pose believed than a vehicle can turn.
    JumpOfAttitude,
    /// Too far from where the filter predicts it.
    InnovationOfPosition,
    /// Turned too far from what the filter predicts.
    InnovationOfAttitude,
    /// The filter has lost its way: a pose matched the wrong way round could fit as well as a true one.
    Uncertain,
    /// There is no filter yet, and too few poses to start one.
    Acquiring,
}

impl Refusal {
    /// The refusal in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Absurd => "not a possible pose",
            Self::Frozen => "identical to the one before",
            Self::Swapped => "at another vehicle's place",
            Self::JumpOfPosition => "a jump of position",
            Self::JumpOfAttitude => "a jump of attitude",
            Self::InnovationOfPosition => "position far from the prediction",
            Self::InnovationOfAttitude => "attitude far from the prediction",
            Self::Uncertain => "attitude too uncertain to compare with",
            Self::Acquiring => "not yet enough poses in a row",
        }
    }
}

/// What to do with a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// Fuse it: measured less predicted.
    Accept {
        /// In the hall's axes.
        position_m: Vector<World>,
        /// Rotation vector in the predicted body's axes.
        turn_rad: Vector<Body>,
    },
    /// Start the filter anew from the last two poses of a run.
    Restart {
        /// The last but one.
        previous: Pose,
        /// The last.
        last: Pose,
    },
    /// Do not use it.
    Refuse(Refusal),
}

/// Refused poses that agree with each other.
#[derive(Clone, Copy, Debug)]
struct Run {
    trail: Trail,
    frames: u16,
    /// Its first pose followed the last believed one without a jump.
    continuous: bool,
    /// Some pose of it looked like another vehicle's.
    suspect: bool,
}

/// One vehicle's gate.
#[derive(Clone, Debug)]
pub(crate) struct Gate {
    tuning: GateTuning,
    reach_m: Vector<World>,
    floor_height_m: f64,
    anywhere: Span,
    newest: Option<Pose>,
    run: Option<Run>,
}

impl Gate {
    /// The gate of a vehicle in that hall; after `anywhere` unseen it may stand any way.
    pub fn new(tuning: &GateTuning, hall: &Hall, floor_height_m: f64, anywhere: Span) -> Self {
        let margin = tuning.hall_margin_m;
        Self {
            tuning: tuning.clone(),
            reach_m: Vector::new(
                0.5 * hall.width_m + margin,
                0.5 * hall.depth_m + margin,
                hall.height_m + margin,
            ),
            floor_height_m,
            anywhere,
            newest: None,
            run: None,
        }
    }

    /// Judges a pose newer than all before it.
    pub fn judge(
        &mut self,
        pose: &Pose,
        expectation: Option<&Expectation>,
        belief: Option<&Belief>,
        neighbours: &[Neighbour],
    ) -> Verdict {
        if self.is_absurd(pose) {
            return Verdict::Refuse(Refusal::Absurd);
        }
        let repeats = self.newest.is_some_and(|newest| {
            newest.position_m == pose.position_m && newest.orientation == pose.orientation
        });
        self.newest = Some(*pose);
        // A vehicle on the floor may well repeat itself.
        if repeats && pose.position_m.z >= self.floor_height_m {
            return Verdict::Refuse(Refusal::Frozen);
        }
        let refusal = match (expectation, belief) {
            (Some(expectation), Some(belief)) => match self.compare(pose, expectation, &belief.pose) {
                // The longer unseen, the wider the gate: it must not come to span two vehicles.
                Ok((position_m, _))
                    if position_m.norm() > self.tuning.position_m
                        && self.looks_swapped(pose, Some(belief), neighbours) =>
                {
                    Refusal::Swapped
                }
                Ok((position_m, turn_rad)) => {
                    self.run = None;
                    return Verdict::Accept { position_m, turn_rad };
                }
                Err(refusal) => refusal,
            },
            _ => Refusal::Acquiring,
        };
        self.extend_run(pose, belief, neighbours, refusal)
    }

    fn is_absurd(&self, pose: &Pose) -> bool {
        let p = pose.position_m;
        let inside = p.x.abs() <= self.reach_m.x
            && p.y.abs() <= self.reach_m.y
            && (self.tuning.height_m_min..=self.reach_m.z).contains(&p.z);
        // Also the exact zero by which some systems report an object they do not see.
        !inside || !pose.orientation.is_finite()
    }

    /// Innovation of a believable pose, or why it is none.
    fn compare(
        &self,
        pose: &Pose,
        expectation: &Expectation,
        believed: &Pose,
    ) -> Result<(Vector<World>, Vector<Body>), Refusal> {
        self.continues(pose, believed)?;
        let tuning = &self.tuning;
        if expectation.attitude_sigma_rad > tuning.attitude_sigma_rad_max {
            return Err(Refusal::Uncertain);
        }
        let position_m = pose.position_m - expectation.position_m;
        let position_limit = tuning.position_m + tuning.sigmas * expectation.position_sigma_m;
        if position_m.norm() > position_limit.min(tuning.position_m_max) {
            return Err(Refusal::InnovationOfPosition);
        }
        let turn_rad = (expectation.orientation.inverse() * pose.orientation).rotation_vector();
        let attitude_limit = tuning.attitude_rad + tuning.sigmas * expectation.attitude_sigma_rad;
        if turn_rad.norm() > attitude_limit.min(tuning.attitude_rad_max) {
            return Err(Refusal::InnovationOfAttitude);
        }
        Ok((position_m, turn_rad))
    }

    /// Whether a vehicle can have come from one pose to the other.
    fn continues(&self, pose: &Pose, earlier: &Pose) -> Result<(), Refusal> {
        let tuning = &self.tuning;
        let span_s = (pose.at - earlier.at).as_secs_f64();
        if (pose.position_m - earlier.position_m).norm() > tuning.speed_m_s_max * span_s + tuning.jump_m {
            return Err(Refusal::JumpOfPosition);
        }
        if angle_between(pose, earlier) > tuning.rate_rad_s_max * span_s + tuning.jump_rad {
            return Err(Refusal::JumpOfAttitude);
        }
        Ok(())
    }

    fn extend_run(
        &mut self,
        pose: &Pose,
        belief: Option<&Belief>,
        neighbours: &[Neighbour],
        refusal: Refusal,
    ) -> Verdict {
        let gap = Span::from_secs_f64(self.tuning.reacquire_gap_s);
        let swapped = self.looks_swapped(pose, belief, neighbours);
        let joined = self.run.filter(|run| {
            let last = run.trail.last();
            pose.at - last.at <= gap && self.continues(pose, last).is_ok()
        });
        let run = match joined {
            Some(mut run) => {
                run.trail.push(*pose);
                run.frames = run.frames.saturating_add(1);
                run.suspect |= swapped;
                run
            }
            None => Run {
                trail: Trail::new(*pose),
                frames: 1,
                continuous: belief.is_none_or(|belief| self.begins_continuous(pose, &belief.pose, gap)),
                suspect: swapped,
            },
        };
        self.run = Some(run);
        if run.frames >= self.tuning.reacquire_frames && !run.suspect && self.may_restart(&run, belief) {
            self.run = None;
            return Verdict::Restart { previous: *run.trail.previous(), last: *run.trail.last() };
        }
        Verdict::Refuse(if run.suspect { Refusal::Swapped } else { refusal })
    }

    fn begins_continuous(&self, pose: &Pose, believed: &Pose, gap: Span) -> bool {
        pose.at - believed.at <= gap
            && self.continues(pose, believed).is_ok()
            && angle_between(pose, believed) <= self.tuning.attitude_rad_max
    }

    fn may_restart(&self, run: &Run, belief: Option<&Belief>) -> bool {
        let Some(belief) = belief else { return true };
        if run.continuous {
            return true;
        }
        if belief.valid {
            return false;
        }
        let last = run.trail.last();
        let unseen = last.at - belief.pose.at;
        if unseen >= self.anywhere {
            return true;
        }
        if belief.turning {
            return run.trail.is_plausible(belief.pose.orientation * Vector::<Body>::new(0.0, 1.0, 0.0));
        }
        let turned_max = self.tuning.reacquire_rad + self.tuning.reacquire_rad_s * unseen.as_secs_f64();
        angle_between(last, &belief.pose) <= turned_max
    }

    /// Whether the pose is rather another vehicle's: at the place of one that is tracked, or nearer to where
    /// a lost one was last seen than to where this one was.
    fn looks_swapped(&self, pose: &Pose, belief: Option<&Belief>, neighbours: &[Neighbour]) -> bool {
        neighbours.iter().any(|neighbour| {
            let distance = (pose.position_m - neighbour.position_m).norm();
            if neighbour.tracked {
                distance < self.tuning.neighbour_m
            } else {
                belief.is_some_and(|belief| distance < (pose.position_m - belief.pose.position_m).norm())
            }
        })
    }
}

fn angle_between(pose: &Pose, other: &Pose) -> f64 {
    let (a, b) = (pose.orientation, other.orientation);
    let cos_half = (a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z).abs();
    2.0 * quantity::math::acos(cos_half)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    const FRAME: Span = Span::from_millis(5);

    fn gate() -> Gate {
        Gate::new(&GateTuning::default(), &testing::arena(1).hall, 0.07, Span::from_secs(10))
    }

    fn pose(frame: i64, x: f64, turn: Vector<Body>) -> Pose {
        Pose {
            at: Time::ZERO + FRAME * frame,
            position_m: Vector::new(x, 0.001 * frame as f64, 4.0),
            orientation: Rotation::from_rotation_vector(turn),
        }
    }

    fn expect(pose: &Pose) -> Expectation {
        Expectation {
            position_m: pose.position_m,
            orientation: pose.orientation,
            position_sigma_m: 0.0003,
            attitude_sigma_rad: 0.002,
        }
    }

    fn belief(pose: Pose) -> Belief {
        Belief { pose, valid: true, turning: false }
    }

    /// A gate that believes the pose of frame 0, shown one of frame 1 when that of frame 0 was expected.
    fn after_one_frame(x: f64, turn: Vector<Body>) -> Verdict {
        let before = pose(0, 0.0, Vector::ZERO);
        gate().judge(&pose(1, x, turn), Some(&expect(&before)), Some(&belief(before)), &[])
    }

    #[test]
    fn table_of_single_frames() {
        let refused = |verdict, refusal| assert_eq!(verdict, Verdict::Refuse(refusal));
        assert!(matches!(after_one_frame(0.01, Vector::new(0.1, 0.0, 0.0)), Verdict::Accept { .. }));
        refused(after_one_frame(0.16, Vector::ZERO), Refusal::JumpOfPosition);
        refused(after_one_frame(0.10, Vector::ZERO), Refusal::InnovationOfPosition);
        for quarter_or_third in [PI / 2.0, 2.0 * PI / 3.0, PI] {
            for axis in [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::Z] {
                refused(after_one_frame(0.0, axis * quarter_or_third), Refusal::JumpOfAttitude);
            }
        }
        refused(after_one_frame(6.1, Vector::ZERO), Refusal::Absurd);
        refused(after_one_frame(f64::NAN, Vector::ZERO), Refusal::Absurd);
    }

    #[test]
    fn a_flip_is_no_jump() {
        // 31 rad/s: the prediction turns along, and so do successive poses.
        let before = pose(0, 0.0, Vector::ZERO);
        let now = pose(1, 0.0, Vector::new(0.0, 31.0 * 0.005, 0.0));
        let verdict = gate().judge(&now, Some(&expect(&now)), Some(&belief(before)), &[]);
        assert!(matches!(verdict, Verdict::Accept { .. }));
    }

    #[test]
    fn zero_and_frozen_poses_are_no_poses() {
        let mut gate = gate();
        let nowhere = Pose { position_m: Vector::ZERO, ..pose(0, 0.0, Vector::ZERO) };
        assert_eq!(gate.judge(&nowhere, None, None, &[]), Verdict::Refuse(Refusal::Absurd));
        let first = pose(1, 1.0, Vector::ZERO);
        let again = Pose { at: first.at + FRAME, ..first };
        assert!(matches!(
            gate.judge(&first, Some(&expect(&first)), Some(&belief(first)), &[]),
            Verdict::Accept { .. }
        ));
        let verdict = gate.judge(&again, Some(&expect(&first)), Some(&belief(first)), &[]);
        assert_eq!(verdict, Verdict::Refuse(Refusal::Frozen));
        let parked = Pose { position_m: Vector::new(1.0, 0.0, 0.04), ..first };
        for k in 0..8 {
            let parked = Pose { at: parked.at + FRAME * k, ..parked };
            let verdict = gate.judge(&parked, Some(&expect(&parked)), Some(&belief(parked)), &[]);
            assert!(matches!(verdict, Verdict::Accept { .. }), "on the floor nothing moves");
        }
    }

    /// Shows frames 1.. of `at(frame)` to a gate that believes in standing still; at which frame it
    /// restarted.
    fn restarts(
        valid: impl Fn(i64) -> bool,
        neighbours: &[Neighbour],
        at: impl Fn(i64) -> Pose,
    ) -> Option<i64> {
        let before = pose(0, 0.0, Vector::ZERO);
        let mut gate = gate();
        (1..400).find(|&frame| {
            let belief = Belief { valid: valid(frame), ..belief(before) };
            let verdict = gate.judge(&at(frame), Some(&expect(&before)), Some(&belief), neighbours);
            matches!(verdict, Verdict::Restart { .. })
        })
    }

    #[test]
    fn a_wrong_filter_gives_way_after_ten_frames() {
        // Carried off at 4 m/s: the third frame is past the gate, nine more follow.
        let frame = restarts(|_| true, &[], |k| pose(k, 0.02 * k as f64, Vector::ZERO));
        assert_eq!(frame, Some(12));
    }

    #[test]
    fn a_jump_waits_until_the_state_is_invalid() {
        let frame = restarts(|k| k < 22, &[], |k| pose(k, 0.5, Vector::new(0.0, 0.0, 0.2)));
        assert_eq!(frame, Some(22));
    }

    #[test]
    fn a_lasting_pose_flip_is_never_believed() {
        for turn in [PI / 2.0, 2.0 * PI / 3.0, PI] {
            for axis in [Vector::new(1.0, 0.0, 0.0), Vector::Z] {
                let frame = restarts(|k| k < 20, &[], |k| pose(k, 0.0, axis * turn));
                assert_eq!(frame, None, "{turn} about {axis:?}");
            }
        }
    }

    #[test]
    fn a_lasting_swap_is_never_believed() {
        for separation in [0.3, 1.0, 3.0] {
            let other = |tracked| Neighbour { position_m: Vector::new(separation, 0.0, 4.0), tracked };
            for neighbour in [other(true), other(false)] {
                let frame = restarts(|k| k < 20, &[neighbour], |k| pose(k, separation, Vector::ZERO));
                assert_eq!(frame, None, "{separation} m");
            }
        }
    }

    proptest! {
        #[test]
        fn an_accepted_pose_is_finite_and_near(
            x in prop::num::f64::ANY, y in prop::num::f64::ANY, z in prop::num::f64::ANY,
            turn in prop::array::uniform3(-3.2..3.2f64),
        ) {
            let before = pose(0, 0.3, Vector::ZERO);
            let shown = Pose {
                at: before.at + FRAME,
                position_m: Vector::new(x, y, z),
                orientation: Rotation::from_rotation_vector(Vector::new(turn[0], turn[1], turn[2])),
            };
            let verdict = gate().judge(&shown, Some(&expect(&before)), Some(&belief(before)), &[]);
            if let Verdict::Accept { position_m, turn_rad } = verdict {
                prop_assert!(position_m.norm() < 0.06 && turn_rad.norm() < 0.4);
            }
        }
    }
}
