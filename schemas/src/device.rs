//! What crossed a vendor's cable.

use quantity::Time;
use reflect::{Message, Seq};
use serde::{Deserialize, Serialize};

/// Bytes that came from a device or go to one; recorded, so that bridges replay too.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/DeviceBytes")]
pub struct DeviceBytes {
    /// Which of the bridge's device endpoints; for the radios see `settings::Ports`.
    pub port: u16,
    /// When they arrived at this host, or when they were handed to the device.
    pub at: Time,
    /// The bytes, as they were on the cable: a datagram, or a piece of a serial stream.
    pub bytes: Seq<u8, 32768>,
}
