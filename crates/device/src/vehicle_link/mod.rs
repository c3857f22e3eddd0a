//! Our own frames between the radio bridge and the vehicle's firmware.
//!
//! A vehicle has two radios, as in the paper (Lupashin 2010, section V.A):
//!
//! * the *command link*, one way, 50 Hz, one stream per vehicle: a [`CommandFrame`] in the sixteen channels
//!   of an SBUS or a CRSF frame, or ([`ChannelMap::Compact`]) in what ExpressLRS leaves of them. Each frame
//!   stands for itself; the newest wins.
//! * the *data link*, both ways, slower and lossy: an [`Uplink`] or a [`Downlink`] in one radio payload of at
//!   most [`PAYLOAD_BYTES_MAX`] bytes. Every message may be lost, repeated or overtaken without harm: orders
//!   carry an identity and are obeyed once, reports carry the whole state.
//!
//! A flip's parameters travel on the data link as a [`FlipSet`] and are flown from the vehicle's own store.

mod channels;
mod compact;
mod downlink;
mod flip_set;
mod payload;
mod scale;
mod uplink;

use core::fmt;

pub use channels::{
    CHANNEL_MAX, COMMAND_RESOLUTION, CommandFrame, CommandMode, CommandResolution, LINK_VERSION,
    roll_pitch_rad,
};
pub use downlink::{
    Downlink, FlightMode, ManeuverPhase, Reason, Status, StatusFlags, UploadReply, UploadState,
};
pub use flip_set::{FLIP_SET_LEN, FlipSet, digest_of};
pub use payload::PAYLOAD_BYTES_MAX;
pub use uplink::{ITEMS_PER_PAYLOAD_MAX, Items, SET_LEN_MAX, Uplink};

/// How a command frame lies on the channels of the command link. Both ends must be set to the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChannelMap {
    /// Sixteen channels of eleven bits: wires, and radios that carry SBUS as it is.
    #[default]
    Full,
    /// Eight channels of ten bits and one of one: ExpressLRS.
    Compact,
}

impl ChannelMap {
    /// The channels that bring `frame` to `vehicle`.
    ///
    /// # Errors
    /// As [`CommandFrame::encode`].
    pub fn encode(self, frame: &CommandFrame, vehicle: u8) -> Result<[u16; 16], LinkError> {
        match self {
            Self::Full => frame.encode(vehicle),
            Self::Compact => frame.encode_compact(vehicle),
        }
    }

    /// Whom the frame in these channels is for, and the frame, as `vehicle` reads it. In the compact map
    /// a frame for another vehicle is one with a wrong check.
    ///
    /// # Errors
    /// As [`CommandFrame::decode`] and [`CommandFrame::decode_compact`].
    pub fn decode(self, channels: &[u16; 16], vehicle: u8) -> Result<(u8, CommandFrame), LinkError> {
        match self {
            Self::Full => CommandFrame::decode(channels),
            Self::Compact => CommandFrame::decode_compact(channels, vehicle).map(|frame| (vehicle, frame)),
        }
    }
}

/// Why bytes or channels are not one of our messages, or a message cannot become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LinkError {
    /// Fewer or more bytes than the message has.
    Length {
        /// Bytes given.
        bytes: usize,
    },
    /// The check over the rest does not come out.
    Checksum {
        /// As received.
        received: u16,
        /// As computed over what was received.
        computed: u16,
    },
    /// The sender speaks another version of the channel map.
    Version {
        /// As received.
        received: u16,
    },
    /// A channel above 2047, which eleven bits cannot hold.
    Channel {
        /// Its index, from zero.
        index: usize,
    },
    /// No message has this type.
    UnknownType(u8),
    /// A field holds a value outside its range or list.
    UnknownValue {
        /// The field's name.
        field: &'static str,
    },
    /// A field is not a finite number.
    NotFinite,
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { bytes } => write!(f, "{bytes} bytes are not the length of this message"),
            Self::Checksum { received, computed } => {
                write!(f, "checksum received {received:04X}, computed {computed:04X}")
            }
            Self::Version { received } => {
                write!(f, "channel map version {received}, this side speaks {LINK_VERSION}")
            }
            Self::Channel { index } => write!(f, "channel {index} above {CHANNEL_MAX}"),
            Self::UnknownType(kind) => write!(f, "no message of type {kind:02X}"),
            Self::UnknownValue { field } => write!(f, "value of {field} outside its range"),
            Self::NotFinite => write!(f, "not a finite number"),
            Self::NoRoom => write!(f, "buffer too short for the message"),
        }
    }
}

impl core::error::Error for LinkError {}
