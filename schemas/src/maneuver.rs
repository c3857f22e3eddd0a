//! The flip: its parameters, its upload, its start, and how it ended.

use quantity::Time;
use reflect::{Enumeration, Message, Text};
use serde::{Deserialize, Serialize};

/// The five parameters of the flip primitive (Lupashin 2010, section III).
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/FlipParameters")]
pub struct FlipParameters {
    /// Collective acceleration of the first step.
    pub u1_m_s2: f64,
    /// Duration of the first step.
    pub t1_s: f64,
    /// Duration of the coast.
    pub t3_s: f64,
    /// Collective acceleration of the last step.
    pub u5_m_s2: f64,
    /// Duration of the last step.
    pub t5_s: f64,
}

/// How far from its start a flip ended, in the plane of the flip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/FlipError")]
pub struct FlipError {
    /// Forward, along the heading.
    pub x_m: f64,
    /// Up.
    pub z_m: f64,
    /// Forward speed.
    pub vx_m_s: f64,
    /// Upward speed.
    pub vz_m_s: f64,
    /// Pitch beyond the whole turns asked for, in (-π, π].
    pub theta_rad: f64,
}

/// A parameter set for a vehicle's store: everything its command generator needs, as the link carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ManeuverUpload")]
pub struct ManeuverUpload {
    /// The vehicle.
    pub vehicle: u8,
    /// Whole turns.
    pub flips: u8,
    /// Identity of the set, never used twice in a row.
    pub set_id: u16,
    /// FNV-1a-64 over the items as the link carries them; the vehicle must come to the same.
    pub digest: u64,
    /// Collective acceleration of the first step.
    pub u1_m_s2: f32,
    /// Duration of the first step.
    pub t1_s: f32,
    /// Duration of the coast.
    pub t3_s: f32,
    /// Collective acceleration of the last step.
    pub u5_m_s2: f32,
    /// Duration of the last step.
    pub t5_s: f32,
    /// Rate of the coast.
    pub rate_rad_s_max: f32,
    /// Lower end of the reduced control envelope.
    pub envelope_low_m_s2: f32,
    /// Upper end of the reduced control envelope.
    pub envelope_high_m_s2: f32,
    /// alpha times L: collective acceleration by angular acceleration (Lupashin 2010, eq. (15)).
    pub lever_m: f32,
}

/// The order to begin a maneuver now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ManeuverStart")]
pub struct ManeuverStart {
    /// The vehicle.
    pub vehicle: u8,
    /// Identity of this maneuver; a vehicle begins each at most once.
    pub maneuver_id: u16,
    /// The parameter set to fly, which must be the active one.
    pub set_id: u16,
    /// Digest of that set.
    pub digest: u64,
    /// No start after this instant.
    pub valid_until: Time,
}

/// The order to end a maneuver early.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ManeuverAbort")]
pub struct ManeuverAbort {
    /// The vehicle.
    pub vehicle: u8,
    /// The maneuver to end.
    pub maneuver_id: u16,
}

/// Whether the learner wants another flip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum LearnerVerdict {
    /// Fly these parameters next.
    #[default]
    Fly = 0,
    /// All iterations are flown.
    Finished = 1,
    /// Stopped; the reason says why. A person must look.
    Stopped = 2,
}

/// The learner's parameters for a vehicle's next flip; repeated until its result arrives.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ManeuverParameters")]
pub struct ManeuverParameters {
    /// The vehicle.
    pub vehicle: u8,
    /// Whether to fly them.
    pub verdict: LearnerVerdict,
    /// Counted from zero: the flip these parameters are for.
    pub iteration: u32,
    /// Whole turns.
    pub flips: u8,
    /// The parameters.
    pub parameters: FlipParameters,
    /// Rate of the coast.
    pub rate_rad_s_max: f64,
    /// Lower end of the reduced control envelope.
    pub envelope_low_m_s2: f64,
    /// Upper end of the reduced control envelope.
    pub envelope_high_m_s2: f64,
    /// alpha times L (Lupashin 2010, eq. (15)).
    pub lever_m: f64,
    /// Duration the model gives the whole maneuver.
    pub duration_s: f64,
    /// Height the worst of the perturbed models loses below the start.
    pub height_loss_m: f64,
    /// Why the learner stopped; empty while it goes on.
    pub reason: Text<120>,
}

/// How a flip went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum FlipOutcome {
    /// Flown to its end and measured.
    #[default]
    Completed = 0,
    /// Ended early; the error, if any, is not that of the whole primitive.
    Aborted = 1,
    /// Flown, but motion capture did not see enough of its end.
    Unmeasured = 2,
}

/// A flip's measured end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ManeuverResult")]
pub struct ManeuverResult {
    /// The vehicle.
    pub vehicle: u8,
    /// The flip, counted from zero.
    pub iteration: u32,
    /// How it went.
    pub outcome: FlipOutcome,
    /// The vehicle's identity for it.
    pub maneuver_id: u16,
    /// The parameters flown.
    pub parameters: FlipParameters,
    /// How far from its start it ended.
    pub error: FlipError,
    /// Begin, on the arena's clock.
    pub began_at: Time,
    /// End, on the arena's clock.
    pub ended_at: Time,
    /// Battery voltage at rest before it.
    pub battery_v: f64,
}

/// What the flip manager does with a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum FlipPhase {
    /// On the ground, no order.
    #[default]
    Idle = 0,
    /// On its way to its place, or steadying there.
    Approach = 1,
    /// Steady, but something of the gate is not met; `gate` says what.
    Gate = 2,
    /// The parameter set is on its way.
    Upload = 3,
    /// The start is on its way.
    Start = 4,
    /// The vehicle flies the maneuver.
    Flip = 5,
    /// The maneuver is over; its end is being measured.
    Measure = 6,
    /// The hover controller catches the vehicle.
    Recover = 7,
    /// On its way down.
    Landing = 8,
    /// Down; the work is done or was stopped.
    Done = 9,
}

/// The flip manager's word on one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/FlipStatus")]
pub struct FlipStatus {
    /// The vehicle.
    pub vehicle: u8,
    /// What is being done.
    pub phase: FlipPhase,
    /// The flip it is at, counted from zero.
    pub iteration: u32,
    /// Conditions of the gate not met: 1 place, 2 speed, 4 tilt, 8 data age, 16 battery, 32 clearance, 64
    /// height, 128 telemetry, 256 predicted loss of height.
    pub gate: u16,
    /// Battery voltage at rest.
    pub battery_v: f64,
}
