//! CRSF, the protocol of Crossfire and ExpressLRS: radio modules, receivers and flight controllers.
//!
//! A frame is at most 64 bytes: a sync byte, the length of what follows it, a type, a payload, and a CRC-8
//! over type and payload. Types from 0x28 on begin their payload with two addresses, whom it is for and whom
//! it is from. Fields are big-endian, except the packed channels, which are as SBUS packs them.
//!
//! | Type | Frame |
//! | --- | --- |
//! | 16 | sixteen channels of eleven bits |
//! | 14 | how the radio link fares ([`LinkStatistics`]) |
//! | 3A, 10 | when the module wants its channels ([`TimingCorrection`]) |
//! | 2C, 2D, 2B | read a parameter, write one, what one is |
//!
//! On a serial line: 400 000 baud half duplex between handset and module, 416 666 (or 420 000) full duplex
//! between receiver and flight controller; 8N1, not inverted. A receiver that has lost its radio just stops
//! sending channels: there is no flag for it as in SBUS.
//!
//! # Our command frame in CRSF channels
//!
//! [`CommandFrame`](crate::vehicle_link::CommandFrame) is sixteen values of 0 to 2047, and a frame of type 16
//! carries any of these as they are: the range of 172 to 1811 (988 to 2012 µs) is what transmitters make use
//! of, not what fits. So what is said over SBUS can be said over CRSF on any line that carries frames whole.
//! An **ExpressLRS radio does not**: on the air it gives the first four channels ten bits, the fifth (our
//! mode and counter) a single one, and the later ones six to ten, so the check in channel 15 does not come
//! out and the vehicle obeys nothing. There the line has to end in radios that pass on bytes instead of
//! channels, which is ExpressLRS' AirPort mode.

mod decoder;
mod frame;

use core::fmt;

pub use decoder::{Decoder, DecoderErrors};
pub use frame::{CHANNELS_FRAME_BYTES, Frame, LinkStatistics, Route, TimingCorrection};

/// Longest frame.
pub const FRAME_BYTES_MAX: usize = 64;

/// Longest payload.
pub const PAYLOAD_BYTES_MAX: usize = FRAME_BYTES_MAX - FRAMING_BYTES;

/// Address of everybody.
pub const ADDRESS_BROADCAST: u8 = 0x00;
/// Address of a flight controller, and the sync byte of a serial line.
pub const ADDRESS_FLIGHT_CONTROLLER: u8 = 0xC8;
/// Address of a handset: whoever the pilot is.
pub const ADDRESS_HANDSET: u8 = 0xEA;
/// Address of a receiver.
pub const ADDRESS_RECEIVER: u8 = 0xEC;
/// Address of a transmitter module.
pub const ADDRESS_MODULE: u8 = 0xEE;

/// The sync byte of a serial line.
pub const SYNC: u8 = ADDRESS_FLIGHT_CONTROLLER;

/// Sync byte, length, type and check.
const FRAMING_BYTES: usize = 4;
/// Type and check: what a length counts besides the payload.
const LENGTH_MIN: usize = 2;
/// Greatest length.
const LENGTH_MAX: usize = FRAME_BYTES_MAX - 2;

/// Whether a frame may begin so. The protocol allows any address; those of the devices on our lines are
/// enough, and every further one would make more of noise look like a beginning.
const fn is_sync(byte: u8) -> bool {
    matches!(byte, ADDRESS_FLIGHT_CONTROLLER | ADDRESS_HANDSET | ADDRESS_RECEIVER | ADDRESS_MODULE)
}

/// Why bytes are no frame, or a frame cannot become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CrsfError {
    /// A first byte with which no frame begins.
    Sync {
        /// As received.
        found: u8,
    },
    /// A length that no frame has.
    Length {
        /// As received.
        found: u8,
    },
    /// Fewer bytes than the length says, or more.
    Size {
        /// Bytes given.
        bytes: usize,
        /// Bytes the frame should have.
        expected: usize,
    },
    /// The check over type and payload does not come out.
    Checksum {
        /// As received.
        received: u8,
        /// As computed over what was received.
        computed: u8,
    },
    /// The payload ends before its fields do.
    Payload {
        /// The frame's type.
        kind: u8,
        /// Bytes of its payload.
        bytes: usize,
    },
    /// A payload longer than a frame can have.
    TooLong {
        /// Bytes of it.
        bytes: usize,
    },
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for CrsfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sync { found } => write!(f, "no CRSF frame begins with {found:02X}"),
            Self::Length { found } => {
                write!(f, "length {found} of a CRSF frame, should be {LENGTH_MIN} to {LENGTH_MAX}")
            }
            Self::Size { bytes, expected } => write!(f, "{bytes} bytes of a frame of {expected}"),
            Self::Checksum { received, computed } => {
                write!(f, "checksum received {received:02X}, computed {computed:02X}")
            }
            Self::Payload { kind, bytes } => {
                write!(f, "{bytes} bytes of payload are too few for a frame of type {kind:02X}")
            }
            Self::TooLong { bytes } => write!(f, "{bytes} bytes of payload, at most {PAYLOAD_BYTES_MAX}"),
            Self::NoRoom => write!(f, "buffer too short for the frame"),
        }
    }
}

impl core::error::Error for CrsfError {}
