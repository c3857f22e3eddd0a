//! The 56-byte header and the topic that follows it.

use core::ops::Range;

use quantity::Time;
use thiserror::Error;

use crate::{BODY_BYTES_MAX, TAG_BYTES};

/// First two bytes of every datagram.
pub const MAGIC: [u8; 2] = *b"FM";
/// Version of the datagram's layout.
pub const VERSION: u8 = 1;
/// Bytes before the topic.
pub const HEADER_BYTES: usize = 56;
/// Most bytes of a topic's name.
pub const TOPIC_BYTES_MAX: usize = u8::MAX as usize;

const FLAG_LATCHED: u8 = 1;

/// What a datagram carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Kind {
    /// A message of the topic.
    #[default]
    Data = 0,
    /// The definition of a message type.
    Schema = 1,
    /// The wish for a definition.
    SchemaRequest = 2,
    /// What a node's core consumed, in which order, and a digest of what it made of it.
    Journal = 3,
}

impl Kind {
    const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0 => Some(Self::Data),
            1 => Some(Self::Schema),
            2 => Some(Self::SchemaRequest),
            3 => Some(Self::Journal),
            _ => None,
        }
    }
}

/// Where the truth in a message comes from. Part of every key: a node of one domain cannot verify another's
/// messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Domain {
    /// Cameras, radios and vehicles.
    Live = 1,
    /// A simulator.
    Sim = 2,
    /// A recording.
    Replay = 3,
}

impl Domain {
    const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            1 => Some(Self::Live),
            2 => Some(Self::Sim),
            3 => Some(Self::Replay),
            _ => None,
        }
    }

    /// The domain's name, lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Live => "live",
            Self::Sim => "sim",
            Self::Replay => "replay",
        }
    }
}

/// What stands before topic and body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// What the datagram carries.
    pub kind: Kind,
    /// Where its truth comes from.
    pub domain: Domain,
    /// Whether it is the last word on its topic, repeated for those who come late.
    pub latched: bool,
    /// Which node instance sent it.
    pub source: u32,
    /// Id of the body's type ([`reflect::Schema::id`]).
    pub schema_id: u64,
    /// The arena's run, random at its start.
    pub run: u64,
    /// Rises at each start of the sending node.
    pub incarnation: u32,
    /// Rises by one per datagram of this source, topic and kind.
    pub sequence: u64,
    /// When it was sent, on the sender's clock; not before that clock's zero.
    pub published_at: Time,
}

/// A topic's name with its hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TopicName<'a> {
    name: &'a str,
    hash: u32,
}

impl<'a> TopicName<'a> {
    /// A topic's name: 1 to 255 bytes, or `None`.
    #[must_use]
    pub const fn new(name: &'a str) -> Option<Self> {
        if name.is_empty() || name.len() > TOPIC_BYTES_MAX {
            return None;
        }
        Some(Self { name, hash: reflect::fnv1a_32(name.as_bytes()) })
    }

    /// The name.
    #[must_use]
    pub const fn name(self) -> &'a str {
        self.name
    }

    /// FNV-1a-32 of the name: what kernel filters compare.
    #[must_use]
    pub const fn hash(self) -> u32 {
        self.hash
    }
}

/// Why bytes are no datagram of ours; each with what was found, and what would have been right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Malformed {
    /// Shorter than header, topic and tag.
    #[error("{length} bytes, needs at least {needed}")]
    Short {
        /// Bytes there are.
        length: usize,
        /// Bytes there must be.
        needed: usize,
    },
    /// A body above the limit.
    #[error("a body of {length} bytes, may have {}", BODY_BYTES_MAX)]
    Long {
        /// Bytes of its body.
        length: usize,
    },
    /// Other first bytes.
    #[error("begins with {found:02x?}, ours with {:02x?}", MAGIC)]
    Magic {
        /// The first bytes.
        found: [u8; 2],
    },
    /// Another version.
    #[error("version {found}, known is {}", VERSION)]
    Version {
        /// The version.
        found: u8,
    },
    /// A field with a value outside its set.
    #[error("{field} {found} is none of the known ones")]
    Unknown {
        /// The field.
        field: &'static str,
        /// Its value.
        found: u8,
    },
    /// Bytes that must be zero.
    #[error("reserved bytes are not zero")]
    Reserved,
    /// A topic that is not UTF-8.
    #[error("the topic is not UTF-8")]
    TopicText,
    /// A hash that is not that of the topic.
    #[error("topic hash {found:08x}, that of the topic is {computed:08x}")]
    TopicHash {
        /// The hash in the header.
        found: u32,
        /// The hash of the topic.
        computed: u32,
    },
    /// A publish time beyond what an integer instant can hold.
    #[error("publish time {found} ns is out of range")]
    PublishTime {
        /// The time.
        found: u64,
    },
}

impl Header {
    /// The header's bytes, with a publish time that the caller has checked.
    pub(crate) fn to_bytes(self, topic: TopicName<'_>, published_ns: u64) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[0..2].copy_from_slice(&MAGIC);
        bytes[2] = VERSION;
        bytes[3] = self.kind as u8;
        bytes[4] = self.domain as u8;
        bytes[5] = if self.latched { FLAG_LATCHED } else { 0 };
        bytes[6] = topic.name.len() as u8;
        bytes[8..12].copy_from_slice(&topic.hash.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.source.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.schema_id.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.run.to_le_bytes());
        bytes[32..36].copy_from_slice(&self.incarnation.to_le_bytes());
        bytes[40..48].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[48..56].copy_from_slice(&published_ns.to_le_bytes());
        bytes
    }

    /// Takes a datagram apart: header, topic, and where its body lies. Nothing of it is to be believed yet.
    pub(crate) fn parse(datagram: &[u8]) -> Result<(Self, TopicName<'_>, Range<usize>), Malformed> {
        let length = datagram.len();
        let shortest = HEADER_BYTES + 1 + TAG_BYTES;
        let (bytes, rest) =
            datagram.split_first_chunk().ok_or(Malformed::Short { length, needed: shortest })?;
        let header = Self::parse_fixed(bytes)?;
        let start = HEADER_BYTES + usize::from(bytes[6]);
        if length < start + TAG_BYTES {
            return Err(Malformed::Short { length, needed: start + TAG_BYTES });
        }
        let end = length - TAG_BYTES;
        if end - start > BODY_BYTES_MAX {
            return Err(Malformed::Long { length: end - start });
        }
        let name = core::str::from_utf8(&rest[..start - HEADER_BYTES]).map_err(|_| Malformed::TopicText)?;
        let topic =
            TopicName::new(name).ok_or(Malformed::Unknown { field: "topic length", found: bytes[6] })?;
        let found = u32::from_le_bytes(part(bytes, 8));
        if found != topic.hash {
            return Err(Malformed::TopicHash { found, computed: topic.hash });
        }
        Ok((header, topic, start..end))
    }

    fn parse_fixed(bytes: &[u8; HEADER_BYTES]) -> Result<Self, Malformed> {
        let unknown = |field, found| Malformed::Unknown { field, found };
        if bytes[0..2] != MAGIC {
            return Err(Malformed::Magic { found: part(bytes, 0) });
        }
        if bytes[2] != VERSION {
            return Err(Malformed::Version { found: bytes[2] });
        }
        if bytes[7] != 0 || bytes[36..40] != [0; 4] {
            return Err(Malformed::Reserved);
        }
        if bytes[5] & !FLAG_LATCHED != 0 {
            return Err(unknown("flags", bytes[5]));
        }
        let published = u64::from_le_bytes(part(bytes, 48));
        let published_at =
            i64::try_from(published).map_err(|_| Malformed::PublishTime { found: published })?;
        Ok(Self {
            kind: Kind::from_byte(bytes[3]).ok_or(unknown("kind", bytes[3]))?,
            domain: Domain::from_byte(bytes[4]).ok_or(unknown("domain", bytes[4]))?,
            latched: bytes[5] & FLAG_LATCHED != 0,
            source: u32::from_le_bytes(part(bytes, 12)),
            schema_id: u64::from_le_bytes(part(bytes, 16)),
            run: u64::from_le_bytes(part(bytes, 24)),
            incarnation: u32::from_le_bytes(part(bytes, 32)),
            sequence: u64::from_le_bytes(part(bytes, 40)),
            published_at: Time::from_nanos(published_at),
        })
    }
}

/// The `N` bytes at `offset`, which the header's layout keeps inside it.
fn part<const N: usize>(bytes: &[u8; HEADER_BYTES], offset: usize) -> [u8; N] {
    let mut part = [0; N];
    part.copy_from_slice(&bytes[offset..offset + N]);
    part
}
