//! The protocols of the equipment around the arena, both directions, without I/O.
//!
//! *Vendors'* protocols are, for motion capture, [`vicon`] (Tracker's UDP object stream) and [`natnet`]
//! (OptiTrack's frames and the questions that go with them); for radios [`xbee`] (the 802.15.4 radio's API
//! frames), [`sbus`] (the hobby receiver's serial frames), [`crsf`] (those of Crossfire and ExpressLRS),
//! [`crtp`] (Crazyflie's packets) and [`mavlink`] (PX4's and ArduPilot's frames; a codec that no bridge speaks
//! yet). The bridges decode what the simulator encodes and the other way round, so each module has both
//! halves, and each half is held by test vectors that do not come from the other, and by an independent
//! implementation where there is one that can be linked.
//!
//! *Ours* is [`vehicle_link`]: what travels inside the channels of an SBUS or a CRSF frame and inside a
//! radio's payload between the radio bridge and the vehicle's firmware. It lives here because both ends of a
//! link need one definition.
//!
//! Nothing here allocates, reads a clock or panics on bytes from outside.
#![no_std]

#[cfg(test)]
extern crate std;

mod bytes;
mod channels;
mod crc;
pub mod crsf;
pub mod crtp;
pub mod mavlink;
pub mod natnet;
pub mod sbus;
pub mod vehicle_link;
pub mod vicon;
pub mod xbee;
