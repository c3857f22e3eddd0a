//! What the cameras saw, past the vendor's units and frames.

use quantity::{Body, Rotation, Time, Vector, World};
use reflect::{Message, Seq, Text};
use serde::{Deserialize, Serialize};

/// One motion-capture frame: every vehicle the cameras report at one exposure.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/MocapFrame")]
pub struct MocapFrame {
    /// The vendor's frame number, unwrapped so that it never falls within one start of the bridge.
    pub frame: u64,
    /// When the shutters were open, by the bridge's fit of frame numbers to arrival times less the latency
    /// setting.
    pub exposed_at: Time,
    /// When the last datagram of the frame reached this host.
    pub received_at: Time,
    /// Time from exposure to arrival: as the vendor's system stamped this frame, or the setting where it does not.
    pub latency_s: f64,
    /// The vehicles seen, in the vendor's order; a vehicle not listed was not seen.
    pub bodies: Seq<MocapBody, 16>,
}

/// One vehicle's pose in a motion-capture frame.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/MocapBody")]
pub struct MocapBody {
    /// The vehicle, from the fleet's table of subject names.
    pub vehicle: u8,
    /// The subject's name at the vendor's system.
    pub subject: Text<24>,
    /// Centre of the vehicle.
    pub position_m: Vector<World>,
    /// Attitude of the vehicle.
    pub orientation: Rotation<Body, World>,
}
