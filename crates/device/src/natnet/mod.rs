//! OptiTrack's NatNet, bitstream versions 3.0 to 4.1: what Motive streams and how it is asked.
//!
//! Two UDP channels: on the command channel (1510) a client says [`Request::Connect`] and gets a
//! [`ServerInfo`], asks for the [`ModelDefinition`] that gives rigid bodies their names; on the data channel
//! (1511, group 239.255.42.99 or unicast) come [`Frame`]s. Every message begins with two u16, its number and
//! the length of what follows; all is little-endian.
//!
//! | Message | Body |
//! | --- | --- |
//! | 0 connect | nothing, or 264 bytes about the client, a flag, and the version it wants ([`Request`]) |
//! | 1 server info | name, versions, clock frequency, data channel ([`ServerInfo`]) |
//! | 4 request for 5 | nothing |
//! | 5 model definition | what is tracked ([`ModelDefinition`]) |
//! | 7 frame | what was seen at one exposure ([`Frame`]) |
//! | 9 disconnect, 10 keep alive | nothing |
//!
//! The version decides the layout and cannot be seen from a frame: it is what the server info says, or what
//! the client asked for. From 4.1 on every section of a frame says how many bytes it has, so that what is not
//! understood can be stepped over; before, it has to be walked. This module walks it, and keeps only the
//! rigid bodies: everything else is the markers they were computed from, or equipment a hall of ours has not.
//!
//! Positions are **metres**, attitudes quaternions. The axes are as Motive was told to stream them, y up
//! unless said otherwise: see [`UpAxis`]. Times are ticks of the server's clock; see [`Timing`].
//!
//! The layouts of rigid bodies, marker sets, timing and server info have been seen from real servers; those
//! of skeletons, assets, force plates, devices and their descriptions follow the vendor's sample code. Marker
//! names in descriptions came with 4.0.

mod axes;
mod command;
mod frame;
mod model;

use core::fmt;

pub use axes::UpAxis;
pub use command::{NAME_BYTES_MAX, Request, SERVER_INFO_BYTES, ServerInfo};
pub use frame::{
    FLAG_MODELS_CHANGED, FLAG_RECORDING, Frame, FrameHead, PARAM_TRACKED, RIGID_BODY_BYTES, RigidBody,
    Timing, encode_frame, frame_bytes,
};
pub use model::{ModelDefinition, RigidBodyName, encode_model_definition};

use crate::bytes::{Reader, Writer};

/// Where a server listens for requests, unless told otherwise.
pub const COMMAND_PORT: u16 = 1510;

/// Where a server sends its frames, unless told otherwise.
pub const DATA_PORT: u16 = 1511;

/// The multicast group a server sends its frames to, unless told otherwise.
pub const MULTICAST_GROUP: [u8; 4] = [239, 255, 42, 99];

/// Number of a client's first word.
pub const MESSAGE_CONNECT: u16 = 0;
/// Number of the answer to it.
pub const MESSAGE_SERVER_INFO: u16 = 1;
/// Number of the request for a model definition.
pub const MESSAGE_REQUEST_MODEL_DEFINITION: u16 = 4;
/// Number of a model definition.
pub const MESSAGE_MODEL_DEFINITION: u16 = 5;
/// Number of a frame.
pub const MESSAGE_FRAME: u16 = 7;
/// Number of a client's farewell.
pub const MESSAGE_DISCONNECT: u16 = 9;
/// Number of what a unicast client sends every now and then so that it is not forgotten.
pub const MESSAGE_KEEP_ALIVE: u16 = 10;
/// Number of the answer to a request the server does not know.
pub const MESSAGE_UNRECOGNIZED: u16 = 100;

/// A layout of frames and model definitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Version {
    /// 3.0, laid out as 3.1.
    V3_0,
    /// 3.1, of Motive 2.
    V3_1,
    /// 4.0, of Motive 3.0: descriptions of rigid bodies name their markers.
    V4_0,
    /// 4.1, of Motive 3.1: sections say how long they are, frames have assets and a second clock.
    V4_1,
}

impl Version {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::V3_0, Self::V3_1, Self::V4_0, Self::V4_1];

    /// The version of these four bytes (major, minor, build, revision; the last two do not matter).
    ///
    /// # Errors
    /// [`NatNetError::Version`] for one whose layout is not known here. A server of a later one can be asked
    /// for 4.1 ([`Request::Connect`]).
    pub const fn from_bytes(bytes: [u8; 4]) -> Result<Self, NatNetError> {
        match bytes {
            [3, 0, ..] => Ok(Self::V3_0),
            [3, 1, ..] => Ok(Self::V3_1),
            [4, 0, ..] => Ok(Self::V4_0),
            [4, 1, ..] => Ok(Self::V4_1),
            [major, minor, ..] => Err(NatNetError::Version { major, minor }),
        }
    }

    /// The four bytes of this version.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 4] {
        match self {
            Self::V3_0 => [3, 0, 0, 0],
            Self::V3_1 => [3, 1, 0, 0],
            Self::V4_0 => [4, 0, 0, 0],
            Self::V4_1 => [4, 1, 0, 0],
        }
    }

    /// Whether sections and descriptions say how many bytes they have.
    const fn has_sizes(self) -> bool {
        matches!(self, Self::V4_1)
    }

    /// Whether descriptions of rigid bodies name their markers.
    const fn has_marker_names(self) -> bool {
        matches!(self, Self::V4_0 | Self::V4_1)
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, ..] = self.to_bytes();
        write!(f, "{major}.{minor}")
    }
}

/// Why bytes are not the message they were taken for, or a message cannot become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NatNetError {
    /// The message ends before what it announces.
    Truncated {
        /// Bytes given.
        bytes: usize,
        /// What was being read.
        part: &'static str,
    },
    /// Another message.
    Message {
        /// Its number.
        found: u16,
        /// The number looked for.
        expected: u16,
    },
    /// A version whose layout is not known here.
    Version {
        /// As received.
        major: u8,
        /// As received.
        minor: u8,
    },
    /// A count or a size below zero.
    Negative {
        /// Of what.
        part: &'static str,
        /// As received.
        value: i32,
    },
    /// A section whose size is not that of what it counts.
    SectionSize {
        /// Which.
        part: &'static str,
        /// What it counts.
        count: usize,
        /// Bytes it says it has.
        bytes: usize,
    },
    /// A frame does not end in zero: it has another version's layout.
    EndMark {
        /// As received.
        value: i32,
    },
    /// More bytes than the message has: it has another version's layout.
    Trailing {
        /// Bytes too many.
        bytes: usize,
    },
    /// A description of a kind that cannot be stepped over.
    Description {
        /// As received.
        kind: i32,
    },
    /// A name is longer than its field, or has a NUL in it.
    Name {
        /// Its length.
        bytes: usize,
    },
    /// More than one datagram can carry.
    TooLong {
        /// Bytes of the message.
        bytes: usize,
    },
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for NatNetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated { bytes, part } => write!(f, "message of {bytes} bytes ends within its {part}"),
            Self::Message { found, expected } => write!(f, "message {found}, not {expected}"),
            Self::Version { major, minor } => {
                write!(f, "NatNet {major}.{minor}, of which only 3.0, 3.1, 4.0 and 4.1 are known")
            }
            Self::Negative { part, value } => write!(f, "{value} as a number of {part}"),
            Self::SectionSize { part, count, bytes } => {
                write!(f, "{count} {part} in a section of {bytes} bytes")
            }
            Self::EndMark { value } => write!(f, "frame ends in {value} instead of 0: another version?"),
            Self::Trailing { bytes } => write!(f, "{bytes} bytes behind the message: another version?"),
            Self::Description { kind } => write!(f, "description of unknown kind {kind}"),
            Self::Name { bytes } => write!(f, "name of {bytes} bytes is too long or has a NUL in it"),
            Self::TooLong { bytes } => write!(f, "{bytes} bytes of message, at most {}", u16::MAX),
            Self::NoRoom => write!(f, "buffer too short for the message"),
        }
    }
}

impl core::error::Error for NatNetError {}

/// Which message a datagram is; `None` for one too short to be any.
#[must_use]
pub fn message_number(bytes: &[u8]) -> Option<u16> {
    Reader::new(bytes).u16()
}

/// Bytes in front of every message's body.
const HEADER_BYTES: usize = 4;

/// A reader over a message's fields, which knows what to say where they are missing.
///
/// The length a message gives for itself is not used: servers are known that do not keep to it, and the
/// datagram has one.
struct Fields<'a> {
    reader: Reader<'a>,
    bytes: usize,
}

impl<'a> Fields<'a> {
    /// The body of a message with that number.
    fn open(bytes: &'a [u8], expected: u16) -> Result<Self, NatNetError> {
        let mut fields = Self { reader: Reader::new(bytes), bytes: bytes.len() };
        let found = fields.get("header", Reader::u16)?;
        fields.get("header", Reader::u16)?;
        if found == expected { Ok(fields) } else { Err(NatNetError::Message { found, expected }) }
    }

    /// One field.
    fn get<T>(
        &mut self,
        part: &'static str,
        read: impl FnOnce(&mut Reader<'a>) -> Option<T>,
    ) -> Result<T, NatNetError> {
        read(&mut self.reader).ok_or(NatNetError::Truncated { bytes: self.bytes, part })
    }

    /// A number of things or of bytes.
    fn count(&mut self, part: &'static str) -> Result<usize, NatNetError> {
        let value = self.get(part, Reader::i32)?;
        usize::try_from(value).map_err(|_| NatNetError::Negative { part, value })
    }

    /// So many things of so many bytes each.
    fn block(&mut self, part: &'static str, count: usize, each: usize) -> Result<&'a [u8], NatNetError> {
        self.get(part, |reader| reader.take(count.checked_mul(each)?))
    }

    /// Refuses a message that is not used up.
    fn finish(&self) -> Result<(), NatNetError> {
        match self.reader.rest().len() {
            0 => Ok(()),
            bytes => Err(NatNetError::Trailing { bytes }),
        }
    }
}

/// Writes a message of `body_bytes` bytes, which `body` writes, and answers its length.
fn seal(
    out: &mut [u8],
    number: u16,
    body_bytes: usize,
    body: impl FnOnce(&mut Writer<'_>),
) -> Result<usize, NatNetError> {
    let length = u16::try_from(body_bytes).map_err(|_| NatNetError::TooLong { bytes: body_bytes })?;
    let mut writer = Writer::new(out);
    writer.u16(number).u16(length);
    body(&mut writer);
    let written = writer.finish().ok_or(NatNetError::NoRoom)?;
    debug_assert_eq!(written, HEADER_BYTES + body_bytes);
    Ok(written)
}
