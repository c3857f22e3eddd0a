//! The protocols of the equipment around the arena, both directions, without I/O.
//!
//! *Vendors'* protocols are [`vicon`] (Tracker's UDP object stream), [`xbee`] (the 802.15.4 radio's API
//! frames) and [`sbus`] (the hobby receiver's serial frames). The bridges decode what the simulator encodes
//! and the other way round, so each module has both halves, and each half is held by test vectors that do not
//! come from the other.
//!
//! *Ours* is [`vehicle_link`]: what travels inside an SBUS frame's channels and inside a radio's payload
//! between the radio bridge and the vehicle's firmware. It lives here because both ends of a link need one
//! definition.
//!
//! Nothing here allocates, reads a clock or panics on bytes from outside.
#![no_std]

#[cfg(test)]
extern crate std;

mod bytes;
mod crc;
pub mod sbus;
pub mod vehicle_link;
pub mod vicon;
pub mod xbee;
