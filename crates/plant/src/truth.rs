//! What only a simulator can know: true states, true ends of maneuvers, and pictures of them.

use std::collections::VecDeque;

use quantity::{Body, Rotation, Span, Time, Vector, World, math};

use crate::floor::{Contact, Touchdown};
use crate::rigid_body::Motion;
use crate::rotor::ROTORS;

/// A vehicle's true state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// The vehicle.
    pub vehicle: u8,
    /// The instant described.
    pub at: Time,
    /// Position, velocity, attitude and rate.
    pub motion: Motion,
    /// Static thrust of each rotor: front, back, left, right.
    pub thrust_n: [f64; ROTORS],
    /// The motor commands in force, 0 to 200.
    pub motor_commands: [u8; ROTORS],
    /// Charge left.
    pub battery_ratio: f64,
    /// Voltage at the battery's terminals.
    pub battery_v: f64,
    /// Between it and the floor.
    pub contact: Contact,
    /// How it last met the floor.
    pub touchdown: Option<Touchdown>,
}

impl Truth {
    /// Whether every motor is commanded off.
    #[must_use]
    pub fn motors_off(&self) -> bool {
        self.motor_commands == [0; ROTORS]
    }
}

/// How far a maneuver's end is from its start, in the vertical plane of the heading at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlipError {
    /// Forward, along the heading.
    pub x_m: f64,
    /// Up.
    pub z_m: f64,
    /// Forward speed at the end.
    pub vx_m_s: f64,
    /// Upward speed at the end.
    pub vz_m_s: f64,
    /// Pitch at the end beyond whole turns, in (-π, π].
    pub theta_rad: f64,
}

/// The bounds of a flight or of a part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Lowest height.
    pub height_m_min: f64,
    /// Greatest height.
    pub height_m_max: f64,
    /// Greatest pitch rate, either way.
    pub pitch_rate_rad_s_max: f64,
    /// Whether it was outside the hall.
    pub left_hall: bool,
    /// Hardest meeting with the floor, zero for none.
    pub touchdown_m_s_max: f64,
    /// Whether it met the floor.
    pub touched_floor: bool,
    /// Whether it broke.
    pub crashed: bool,
}

impl Default for Extremes {
    fn default() -> Self {
        Self {
            height_m_min: f64::INFINITY,
            height_m_max: f64::NEG_INFINITY,
            pitch_rate_rad_s_max: 0.0,
            left_hall: false,
            touchdown_m_s_max: 0.0,
            touched_floor: false,
            crashed: false,
        }
    }
}

impl Extremes {
    pub(crate) fn include(&mut self, motion: &Motion, inside: bool, touchdown: Option<&Touchdown>) {
        self.height_m_min = self.height_m_min.min(motion.position_m.z);
        self.height_m_max = self.height_m_max.max(motion.position_m.z);
        self.pitch_rate_rad_s_max = self.pitch_rate_rad_s_max.max(motion.rate_rad_s.y.abs());
        self.left_hall |= !inside;
        if let Some(touchdown) = touchdown {
            self.touched_floor = true;
            self.touchdown_m_s_max = self.touchdown_m_s_max.max(touchdown.vertical_m_s);
            self.crashed |= touchdown.crashed;
        }
    }
}

/// How a maneuver truly went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ManeuverTruth {
    /// The vehicle.
    pub vehicle: u8,
    /// The vehicle's identity for the maneuver.
    pub maneuver_id: u16,
    /// Flown to its planned end; else aborted.
    pub completed: bool,
    /// When it began.
    pub began_at: Time,
    /// When it ended.
    pub ended_at: Time,
    /// Motion at its begin.
    pub start: Motion,
    /// Motion at its end.
    pub end: Motion,
    /// Pitch turned through from level, whole turns included.
    pub turned_rad: f64,
    /// How far the end is from the start.
    pub error: FlipError,
    /// Its bounds.
    pub extremes: Extremes,
}

/// One moment of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectorySample {
    /// Since the maneuver's begin; negative before.
    pub after_s: f64,
    /// Where.
    pub position_m: Vector<World>,
    /// Pitch in the maneuver's plane, from level before it, whole turns included.
    pub pitch_rad: f64,
}

/// The way through a maneuver, in steps of [`Trajectory::STEP`].
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The vehicle.
    pub vehicle: u8,
    /// The vehicle's identity for the maneuver.
    pub maneuver_id: u16,
    /// Heading of the maneuver's plane.
    pub heading_rad: f64,
    /// When it ended, since its begin.
    pub duration_s: f64,
    /// From a little before to a little after.
    pub samples: Vec<TrajectorySample>,
}

impl Trajectory {
    /// Between two samples, to a tick.
    pub const STEP: Span = Span::from_millis(5);
    /// How long before the begin the samples start.
    pub const BEFORE: Span = Span::from_millis(200);
    /// How long after the end they go on.
    pub const AFTER: Span = Span::from_millis(800);
}

/// Pitch of a vehicle in a vertical plane, followed through whole turns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PitchInPlane {
    heading: Vector<World>,
    pitch_rad: f64,
}

impl PitchInPlane {
    pub(crate) fn new(heading_rad: f64, orientation: Rotation<Body, World>) -> Self {
        let (sin, cos) = math::sin_cos(heading_rad);
        let mut plane = Self { heading: Vector::new(cos, sin, 0.0), pitch_rad: 0.0 };
        plane.follow(orientation);
        plane
    }

    pub(crate) fn follow(&mut self, orientation: Rotation<Body, World>) -> f64 {
        let up = orientation.z_axis();
        let wrapped = math::atan2(up.dot(self.heading), up.z);
        self.pitch_rad += math::wrap_pi(wrapped - self.pitch_rad);
        self.pitch_rad
    }

    fn along(&self, vector: Vector<World>) -> f64 {
        vector.dot(self.heading)
    }
}

/// A maneuver being watched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Watch {
    pub(crate) maneuver_id: u16,
    began_at: Time,
    start: Motion,
    plane: PitchInPlane,
    pub(crate) extremes: Extremes,
}

impl Watch {
    pub(crate) fn begin(maneuver_id: u16, began_at: Time, start: Motion) -> Self {
        let plane = PitchInPlane::new(start.orientation.yaw_rad(), start.orientation);
        Self { maneuver_id, began_at, start, plane, extremes: Extremes::default() }
    }

    /// One tick later.
    pub(crate) fn follow(&mut self, motion: &Motion, inside: bool, touchdown: Option<&Touchdown>) {
        self.plane.follow(motion.orientation);
        self.extremes.include(motion, inside, touchdown);
    }

    /// The maneuver is over: it ended at `ended_at` with the motion `end`.
    pub(crate) fn end(mut self, vehicle: u8, ended_at: Time, end: Motion, completed: bool) -> ManeuverTruth {
        let turned_rad = self.plane.follow(end.orientation);
        let error = FlipError {
            x_m: self.plane.along(end.position_m - self.start.position_m),
            z_m: end.position_m.z - self.start.position_m.z,
            vx_m_s: self.plane.along(end.velocity_m_s),
            vz_m_s: end.velocity_m_s.z,
            theta_rad: math::wrap_pi(turned_rad),
        };
        ManeuverTruth {
            vehicle,
            maneuver_id: self.maneuver_id,
            completed,
            began_at: self.began_at,
            ended_at,
            start: self.start,
            end,
            turned_rad,
            error,
            extremes: self.extremes,
        }
    }
}

/// Draws trajectories while it is switched on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recorder {
    recent: VecDeque<(Time, Motion)>,
    last_at: Option<Time>,
    drawing: Option<Drawing>,
}

#[derive(Clone, Debug)]
struct Drawing {
    trajectory: Trajectory,
    plane: PitchInPlane,
    began_at: Time,
    ended_at: Option<Time>,
}

impl Recorder {
    /// One tick; a trajectory when one is finished.
    pub(crate) fn tick(&mut self, now: Time, motion: &Motion) -> Option<Trajectory> {
        // Half a tick of tolerance, so that the steps follow the ticks.
        let due = self.last_at.is_none_or(|last| now - last > Trajectory::STEP - Span::from_micros(625));
        if let Some(drawing) = &mut self.drawing {
            let pitch_rad = drawing.plane.follow(motion.orientation);
            if due {
                let after_s = (now - drawing.began_at).as_secs_f64();
                let sample = TrajectorySample { after_s, position_m: motion.position_m, pitch_rad };
                drawing.trajectory.samples.push(sample);
            }
        }
        if due {
            self.last_at = Some(now);
            self.recent.push_back((now, *motion));
            while self.recent.front().is_some_and(|(at, _)| now - *at > Trajectory::BEFORE) {
                self.recent.pop_front();
            }
        }
        let over = |drawing: &mut Drawing| drawing.ended_at.is_some_and(|at| now - at > Trajectory::AFTER);
        self.drawing.take_if(over).map(|drawing| drawing.trajectory)
    }

    /// A maneuver begins; one still being drawn is finished as it is.
    pub(crate) fn begin(
        &mut self,
        vehicle: u8,
        maneuver_id: u16,
        now: Time,
        motion: &Motion,
    ) -> Option<Trajectory> {
        let heading_rad = motion.orientation.yaw_rad();
        let first = self.recent.front().map_or(motion.orientation, |(_, motion)| motion.orientation);
        let mut plane = PitchInPlane::new(heading_rad, first);
        let samples = self.recent.iter().map(|(at, motion)| TrajectorySample {
            after_s: (*at - now).as_secs_f64(),
            position_m: motion.position_m,
            pitch_rad: plane.follow(motion.orientation),
        });
        let samples = samples.collect();
        let trajectory = Trajectory { vehicle, maneuver_id, heading_rad, duration_s: 0.0, samples };
        let drawing = Drawing { trajectory, plane, began_at: now, ended_at: None };
        self.drawing.replace(drawing).map(|drawing| drawing.trajectory)
    }

    /// The maneuver being drawn has ended.
    pub(crate) fn end(&mut self, ended_at: Time) {
        if let Some(drawing) = &mut self.drawing {
            drawing.ended_at = Some(ended_at);
            drawing.trajectory.duration_s = (ended_at - drawing.began_at).as_secs_f64();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{PI, TAU};

    fn pitched(heading_rad: f64, pitch_rad: f64) -> Rotation<Body, World> {
        Rotation::from_yaw_pitch_roll(heading_rad, 0.0, 0.0)
            * Rotation::<Body, Body>::from_rotation_vector(Vector::new(0.0, pitch_rad, 0.0))
    }

    #[test]
    fn pitch_is_followed_through_whole_turns_in_any_heading() {
        for heading in [-3.0, -1.0, 0.0, 2.0, PI] {
            let mut plane = PitchInPlane::new(heading, pitched(heading, 0.1));
            let mut last = 0.0;
            for step in 0..1_500 {
                last = plane.follow(pitched(heading, 0.1 + 0.01 * f64::from(step)));
            }
            assert!((last - (0.1 + 14.99)).abs() < 1e-9, "{last}");
        }
    }

    #[test]
    fn errors_are_told_in_the_plane_of_the_heading() {
        let start = Motion::at_rest(Vector::new(1.0, 2.0, 5.0), 0.5 * PI);
        let mut watch = Watch::begin(7, Time::ZERO, start);
        for step in 0..1_000 {
            let motion =
                Motion { orientation: pitched(0.5 * PI, 2.0 * TAU * f64::from(step) / 1e3), ..start };
            watch.follow(&motion, true, None);
        }
        let end = Motion {
            position_m: Vector::new(1.5, 2.3, 4.0),
            velocity_m_s: Vector::new(9.0, -1.0, -2.0),
            orientation: pitched(0.5 * PI, 2.0 * TAU - 0.4),
            ..start
        };
        let truth = watch.end(3, Time::ZERO + Span::from_secs(1), end, true);
        let expected = FlipError { x_m: 0.3, z_m: -1.0, vx_m_s: -1.0, vz_m_s: -2.0, theta_rad: -0.4 };
        let off = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let error = truth.error;
        assert!(off(error.x_m, expected.x_m) && off(error.z_m, expected.z_m), "{error:?}");
        assert!(off(error.vx_m_s, expected.vx_m_s) && off(error.vz_m_s, expected.vz_m_s), "{error:?}");
        assert!(off(error.theta_rad, expected.theta_rad) && off(truth.turned_rad, 2.0 * TAU - 0.4));
    }

    #[test]
    fn a_trajectory_begins_before_and_ends_after_the_maneuver() {
        let mut recorder = Recorder::default();
        let tick = |k: i64| Time::ZERO + Span::from_micros(1_250) * k;
        let motion = |k: i64| Motion {
            position_m: Vector::new(k as f64, 0.0, 1.0),
            orientation: pitched(0.3, 0.005 * (k - 400).max(0) as f64),
            ..Motion::default()
        };
        let mut drawn = None;
        for k in 0..4_000 {
            drawn = drawn.or(recorder.tick(tick(k), &motion(k)));
            if k == 400 {
                assert_eq!(recorder.begin(1, 9, tick(k), &motion(k)), None);
            }
            if k == 1_200 {
                recorder.end(tick(k));
            }
        }
        let trajectory = drawn.expect("a trajectory");
        assert_eq!((trajectory.vehicle, trajectory.maneuver_id), (1, 9));
        assert!((trajectory.duration_s - 1.0).abs() < 1e-9);
        let samples = &trajectory.samples;
        assert!((samples[0].after_s + 0.2).abs() < 0.006 && samples.last().unwrap().after_s > 1.79);
        assert!(samples.windows(2).all(|pair| (pair[1].after_s - pair[0].after_s - 0.005).abs() < 1e-9));
        let last = samples.last().unwrap();
        assert!((last.pitch_rad - 4.0 * last.after_s).abs() < 1e-9 && samples[0].pitch_rad.abs() < 1e-9);
    }
}
