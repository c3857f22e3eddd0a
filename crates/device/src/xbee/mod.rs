//! XBee 802.15.4 modules in API mode.
//!
//! On the serial line a frame is `7E`, two bytes of length (big-endian), the frame data, and a checksum. With
//! AP=2 everything behind `7E` that is `7E`, `7D`, `11` or `13` is sent as `7D` and the byte with bit 5
//! turned over; length and checksum are reckoned without that. [`Decoder`] finds frames in the stream,
//! [`Frame`] is what they say.

mod decoder;
mod frame;

use core::fmt;

pub use decoder::{Decoder, DecoderErrors, FRAME_DATA_BYTES_MAX};
pub use frame::{Frame, TransmitResult};

/// Payload one 802.15.4 frame can carry.
pub const PAYLOAD_BYTES_MAX: usize = 100;

/// 16-bit address of everybody.
pub const BROADCAST_16: u16 = 0xFFFF;

/// Bit of the transmit options: ask for no acknowledgement.
pub const OPTION_NO_ACK: u8 = 0x01;

/// Bit of the receive options: sent to everybody's address.
pub const OPTION_ADDRESS_BROADCAST: u8 = 0x02;

/// Bit of the options: sent to every network.
pub const OPTION_PAN_BROADCAST: u8 = 0x04;

pub(crate) const DELIMITER: u8 = 0x7E;
pub(crate) const ESCAPE: u8 = 0x7D;
pub(crate) const ESCAPE_BIT: u8 = 0x20;

/// How the module was told to frame its serial line (its AP setting).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ApiMode {
    /// AP=1: bytes as they are.
    Plain,
    /// AP=2: the delimiter and three control bytes are escaped, so `7E` always begins a frame.
    #[default]
    Escaped,
}

/// Why a frame cannot be written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum XbeeError {
    /// The frame data ends before its fields do.
    Truncated {
        /// First byte of the frame data.
        id: u8,
    },
    /// Frame data of no bytes.
    Empty,
    /// More data than a frame may have.
    TooLong {
        /// Bytes of frame data.
        bytes: usize,
    },
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for XbeeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated { id } => write!(f, "frame {id:02X} ends before its fields do"),
            Self::Empty => write!(f, "frame without data"),
            Self::TooLong { bytes } => {
                write!(f, "{bytes} bytes of frame data, at most {FRAME_DATA_BYTES_MAX}")
            }
            Self::NoRoom => write!(f, "buffer too short for the frame"),
        }
    }
}

impl core::error::Error for XbeeError {}
