//! Where a vehicle is, where it shall be, and what it is told.

use quantity::{Body, Rotation, Time, Vector, World};
use reflect::{Enumeration, Message};
use serde::{Deserialize, Serialize};

/// Position, velocity, attitude and body rate at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/Kinematics")]
pub struct Kinematics {
    /// Centre of mass.
    pub position_m: Vector<World>,
    /// Velocity of the centre of mass.
    pub velocity_m_s: Vector<World>,
    /// Attitude.
    pub orientation: Rotation<Body, World>,
    /// Angular rate.
    pub rate_rad_s: Vector<Body>,
}

/// What an estimate rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum Tracking {
    /// No usable estimate: nothing may be flown on it.
    #[default]
    Invalid = 0,
    /// Fresh motion capture, inside the gate.
    Tracking = 1,
    /// No accepted pose for more than one frame: predicted by the model, degrading.
    Coasting = 2,
    /// A maneuver runs: commands are ignored by the vehicle, so the filter follows the cameras with wide
    /// gates.
    Ballistic = 3,
}

/// The estimator's word on one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/VehicleState")]
pub struct VehicleState {
    /// The vehicle.
    pub vehicle: u8,
    /// What the estimate rests on.
    pub tracking: Tracking,
    /// Consecutive accepted motion-capture frames, saturating.
    pub accepted_frames: u16,
    /// The instant `estimate` describes: the exposure of the newest frame used, or now when coasting.
    pub estimated_for: Time,
    /// When the newest motion-capture frame used reached this host: the beginning of the way to a radio frame.
    pub frame_received_at: Time,
    /// Filtered state at `estimated_for`.
    pub estimate: Kinematics,
    /// The instant `prediction` describes: when a command sent in the next radio slot takes effect.
    pub predicted_for: Time,
    /// State predicted through the commands already sent.
    pub prediction: Kinematics,
    /// Acceleration the model does not explain (thrust error, drag, draught), averaged by the filter.
    pub disturbance_m_s2: Vector<World>,
    /// Nobody may act on this state after this instant.
    pub valid_until: Time,
}

/// What a command asks of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum CommandMode {
    /// Motors off.
    #[default]
    Disarmed = 0,
    /// Fly the rates and the collective acceleration.
    Fly = 1,
    /// Emergency descent, level, on the vehicle's own sensors.
    Descend = 2,
}

/// A command to one vehicle, from whoever holds its lease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/VehicleCommand")]
pub struct VehicleCommand {
    /// The vehicle.
    pub vehicle: u8,
    /// What is asked.
    pub mode: CommandMode,
    /// Lease epoch of the commanding controller; after a higher one was seen a lower one is never sent.
    pub lease_epoch: u32,
    /// The bridge sends this command in no slot after this instant.
    pub valid_until: Time,
    /// When the newest motion-capture frame behind it reached this host.
    pub frame_received_at: Time,
    /// Collective acceleration: total thrust by mass, along the body's z axis.
    pub collective_m_s2: f64,
    /// Angular rate to hold.
    pub rate_rad_s: Vector<Body>,
    /// Attitude the ground believes in, for the vehicle's own levelling should the link fail.
    pub orientation: Rotation<Body, World>,
    /// Height above the floor the ground believes in.
    pub height_m: f64,
    /// Vertical speed the ground believes in, up positive.
    pub vertical_speed_m_s: f64,
}

/// What the radio bridge sent to one vehicle in one slot, as the link's resolution let it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/CommandSent")]
pub struct CommandSent {
    /// The vehicle.
    pub vehicle: u8,
    /// What was asked.
    pub mode: CommandMode,
    /// Lease epoch of the command.
    pub lease_epoch: u32,
    /// The slot, counted from the bridge's start.
    pub slot: u64,
    /// When the newest motion-capture frame behind the command reached this host.
    pub frame_received_at: Time,
    /// When the command had reached the bridge: from here on it waited for its slot.
    pub commanded_at: Time,
    /// When the slot was to begin, by its schedule.
    pub slot_at: Time,
    /// When the slot did begin.
    pub sent_at: Time,
    /// When the next slot begins.
    pub next_slot_at: Time,
    /// Measured time from the slot to the vehicle acting on the frame; the setting's value until measured.
    pub link_delay_s: f64,
    /// Collective acceleration sent.
    pub collective_m_s2: f64,
    /// Angular rate sent.
    pub rate_rad_s: Vector<Body>,
}

/// What a vehicle's firmware is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum FlightMode {
    /// Motors off, waiting.
    #[default]
    Disarmed = 0,
    /// Flies the commands it receives.
    Flying = 1,
    /// Flies a maneuver from its stored parameters and ignores commands.
    Maneuver = 2,
    /// Link lost: holds level.
    LevelHold = 3,
    /// Link lost for longer, or told so: descends.
    Descend = 4,
    /// Motors off after a landing nobody commanded; latched.
    Landed = 5,
    /// Motors off by emergency stop; latched.
    Stopped = 6,
}

/// How far the vehicle's last maneuver got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum ManeuverPhase {
    /// None was ordered since the vehicle started.
    #[default]
    None = 0,
    /// It runs.
    Running = 1,
    /// It ran to its planned end.
    Completed = 2,
    /// It was ended early.
    Aborted = 3,
    /// It was not begun.
    Refused = 4,
}

/// A vehicle's report of itself, its clock already turned into the arena's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/VehicleTelemetry")]
pub struct VehicleTelemetry {
    /// The vehicle.
    pub vehicle: u8,
    /// What its firmware is doing.
    pub mode: FlightMode,
    /// How far its last maneuver got.
    pub maneuver_phase: ManeuverPhase,
    /// The firmware's reason code for an abort or a refusal (`device::vehicle_link`), zero for none.
    pub reason: u8,
    /// The maneuver `maneuver_phase` speaks of.
    pub maneuver_id: u16,
    /// Active parameter set.
    pub set_id: u16,
    /// Digest of the active parameter set, as the vehicle computed it.
    pub set_digest: u64,
    /// When the report reached this host.
    pub received_at: Time,
    /// When the maneuver began, by the bridge's fit of the vehicle's clock.
    pub began_at: Time,
    /// When the maneuver ended, likewise; meaningless while it runs.
    pub ended_at: Time,
    /// How far the fit of the vehicle's clock may be off: half the least round trip seen.
    pub clock_uncertainty_s: f64,
    /// Battery voltage under load.
    pub battery_v: f64,
    /// Age of the newest command when the report was made.
    pub command_age_s: f64,
    /// Measured time from a radio slot to the vehicle acting on its frame.
    pub link_delay_s: f64,
}

/// Where a vehicle shall be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum GoalKind {
    /// On the floor, motors off.
    #[default]
    Ground = 0,
    /// At a place, taking off first if need be.
    Hover = 1,
    /// Down, from wherever it is, then motors off.
    Land = 2,
}

/// What the flip manager wants of the hover controller for one vehicle; repeated, so that a restart learns
/// it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/VehicleGoal")]
pub struct VehicleGoal {
    /// The vehicle.
    pub vehicle: u8,
    /// What is wanted.
    pub kind: GoalKind,
    /// Where to hover; for a landing, above which spot.
    pub position_m: Vector<World>,
    /// Velocity to fly with at that instant, zero for a hover.
    pub velocity_m_s: Vector<World>,
    /// Acceleration to fly with at that instant, zero for a hover.
    pub acceleration_m_s2: Vector<World>,
    /// Heading of the body's x axis.
    pub heading_rad: f64,
}
