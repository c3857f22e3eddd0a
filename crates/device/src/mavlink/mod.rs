//! MAVLink 2, the protocol of PX4 and ArduPilot autopilots. **A codec that no bridge speaks yet**: nothing in
//! the arena sends or listens to a frame of it. It is here so that a bridge to such an autopilot needs no new
//! bytes, only a state machine.
//!
//! A frame is `FD`, the payload's length, two bytes of flags, a sequence number, the sender's system and
//! component, the message's number in three bytes, the payload without its trailing zeros, a CRC-16/MCRF4XX
//! over all but the `FD`, and, where a flag says so, a signature of 13 bytes. All is little-endian. The CRC
//! takes in one byte more, which stands for the layout of that message: a frame of a message whose layout is
//! not known here cannot be checked, and is none.
//!
//! | Number | Message | Here |
//! | --- | --- | --- |
//! | 0 | HEARTBEAT | [`Heartbeat`] |
//! | 22, 23 | PARAM_VALUE, PARAM_SET | [`ParamValue`], [`ParamSet`], [`ParamNumber`] |
//! | 69 | MANUAL_CONTROL | [`ManualControl`] |
//! | 70 | RC_CHANNELS_OVERRIDE | [`ChannelsOverride`] |
//! | 82 | SET_ATTITUDE_TARGET | [`AttitudeTarget`] |
//! | 111 | TIMESYNC | [`TimeSync`] |
//! | 104, 138, 331 | VICON_POSITION_ESTIMATE, ATT_POS_MOCAP, ODOMETRY | checked, then [`Message::Other`] |
//!
//! Messages may have grown *extension* fields at their end: where one of ours has none for them, they are
//! stepped over. PARAM_ERROR (345) is not known here: its definition is not settled yet. MAVLink 1, which
//! begins with `FE`, is not read.
//!
//! # Frames
//!
//! An autopilot's hall is north, east, down, and its body forward, right, down. Ours are z up. **The hall's x
//! axis counts as north** here, and so both are half a turn about x away: see [`ned`](world_to_ned) and
//! [`frd`](body_to_frd). Which way north really is does not matter to an autopilot that gets its heading from
//! motion capture.
//!
//! # Signatures
//!
//! [`Signer`] and [`Verifier`] hold to the protocol's rules against replay. A signature says who made a frame
//! and that it is not old; the arena's own rule, that nothing from a simulation reaches a radio, is not in it.

mod axes;
mod decoder;
mod frame;
mod messages;
mod parameters;
mod setpoints;
mod signing;

use core::fmt;

pub use axes::{
    attitude_to_frd_ned, body_to_frd, frd_ned_to_attitude, frd_to_body, ned_to_world, world_to_ned,
};
pub use decoder::{Decoder, DecoderErrors};
pub use frame::{Frame, Header};
pub use messages::{Heartbeat, Message, TimeSync};
pub use parameters::{ParamEncoding, ParamId, ParamNumber, ParamSet, ParamValue};
pub use setpoints::{AttitudeTarget, ChannelsOverride, ManualControl};
pub use signing::{
    Key, STREAMS_MAX, Signature, SignatureError, Signer, TIMESTAMP_EPOCH_UNIX_S, Timestamp, Verifier,
};

/// First byte of every frame.
pub const START: u8 = 0xFD;

/// Longest payload.
pub const PAYLOAD_BYTES_MAX: usize = 255;

/// Longest frame, signed.
pub const FRAME_BYTES_MAX: usize = HEADER_BYTES + PAYLOAD_BYTES_MAX + CHECKSUM_BYTES + SIGNATURE_BYTES;

/// Start, length, two flags, sequence, system, component, three bytes of message number.
const HEADER_BYTES: usize = 10;
const CHECKSUM_BYTES: usize = 2;
/// Link, six bytes of timestamp, six of digest.
const SIGNATURE_BYTES: usize = 13;

/// The one flag that changes how a frame is read: a signature follows. A frame with any other is not
/// understood and must be dropped.
const FLAG_SIGNED: u8 = 0x01;

/// What goes into a message's check for its layout; `None` for a message that is not known here.
#[must_use]
pub const fn crc_extra(message_id: u32) -> Option<u8> {
    Some(match message_id {
        messages::ID_HEARTBEAT => 50,
        parameters::ID_PARAM_VALUE => 220,
        parameters::ID_PARAM_SET => 168,
        setpoints::ID_MANUAL_CONTROL => 243,
        setpoints::ID_RC_CHANNELS_OVERRIDE => 124,
        setpoints::ID_SET_ATTITUDE_TARGET => 49,
        ID_VICON_POSITION_ESTIMATE => 56,
        messages::ID_TIMESYNC => 34,
        ID_ATT_POS_MOCAP => 109,
        ID_ODOMETRY => 91,
        _ => return None,
    })
}

const ID_VICON_POSITION_ESTIMATE: u32 = 104;
const ID_ATT_POS_MOCAP: u32 = 138;
const ID_ODOMETRY: u32 = 331;

/// Why bytes are no frame, or a message cannot become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MavlinkError {
    /// A first byte with which no frame begins.
    Start {
        /// As received.
        found: u8,
    },
    /// Fewer bytes than the header says, or more.
    Size {
        /// Bytes given.
        bytes: usize,
        /// Bytes the frame should have.
        expected: usize,
    },
    /// Flags that say the frame is laid out in a way that is not known here.
    Incompatible {
        /// As received.
        flags: u8,
    },
    /// A message whose layout is not known here, so that its check cannot be made.
    UnknownMessage {
        /// Its number.
        id: u32,
    },
    /// The check over the frame does not come out.
    Checksum {
        /// As received.
        received: u16,
        /// As computed over what was received.
        computed: u16,
    },
    /// A value that the message may not have.
    Value {
        /// The field's name.
        field: &'static str,
        /// What it holds.
        value: i64,
    },
    /// A parameter's number that is none of its type, or of a type that is not sent this way.
    Parameter {
        /// The type.
        kind: u8,
        /// The number's four bytes, as a float's.
        value_bits: u32,
    },
    /// A quantity that is not a finite number is not sent.
    NotFinite {
        /// The field's name.
        field: &'static str,
    },
    /// A payload longer than a frame can have.
    TooLong {
        /// Bytes of it.
        bytes: usize,
    },
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for MavlinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Start { found } => {
                write!(f, "no MAVLink 2 frame begins with {found:02X}, but with {START:02X}")
            }
            Self::Size { bytes, expected } => write!(f, "{bytes} bytes of a frame of {expected}"),
            Self::Incompatible { flags } => {
                write!(f, "incompatibility flags {flags:02X}, of which only {FLAG_SIGNED:02X} is known")
            }
            Self::UnknownMessage { id } => {
                write!(f, "message {id} is not known, so its check cannot be made")
            }
            Self::Checksum { received, computed } => {
                write!(f, "checksum received {received:04X}, computed {computed:04X}")
            }
            Self::Value { field, value } => write!(f, "value {value} of {field} outside its range"),
            Self::Parameter { kind, value_bits } => {
                write!(f, "{} cannot be a parameter of type {kind}", f32::from_bits(*value_bits))
            }
            Self::NotFinite { field } => write!(f, "{field} is not a finite number"),
            Self::TooLong { bytes } => write!(f, "{bytes} bytes of payload, at most {PAYLOAD_BYTES_MAX}"),
            Self::NoRoom => write!(f, "buffer too short for the frame"),
        }
    }
}

impl core::error::Error for MavlinkError {}
