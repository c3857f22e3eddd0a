//! What only a simulator can know.

use quantity::Time;
use reflect::Message;
use serde::{Deserialize, Serialize};

use crate::{FlipError, Kinematics};

/// A simulated vehicle's true state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/PlantTruth")]
pub struct PlantTruth {
    /// The vehicle.
    pub vehicle: u8,
    /// The instant described.
    pub at: Time,
    /// The truth.
    pub truth: Kinematics,
    /// Charge left.
    pub battery_ratio: f64,
}

/// How a maneuver truly ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/PlantManeuver")]
pub struct PlantManeuver {
    /// The vehicle.
    pub vehicle: u8,
    /// The vehicle's identity for the maneuver.
    pub maneuver_id: u16,
    /// When it truly began.
    pub began_at: Time,
    /// When it truly ended.
    pub ended_at: Time,
    /// How far from its start it truly ended.
    pub error: FlipError,
}
