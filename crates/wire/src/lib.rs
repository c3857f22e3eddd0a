//! The datagram: header, body codec, authentication, sequence window. README.md is the one-page format.
//!
//! Sending is [`encode`], then [`seal`]. Receiving is a chain in which each step gives the next only to those
//! who passed it: [`open`] looks at lengths, magic and version; [`Unverified::verify`] at the tag, then at
//! domain and run; [`Authentic::fresh`] at the sequence window; [`Fresh::decode`] at schema and body. Nothing
//! allocates before the tag holds. Whatever fails says why, as a [`DropReason`] for [`Counters`] to count.

mod auth;
mod codec;
mod counters;
mod datagram;
mod header;
mod window;

pub use auth::{Keyring, Role, Secret, SecretError, SigningKey, TAG_BYTES, VerifyKey};
pub use codec::{BODY_BYTES_MAX, DecodeError, EncodeError, decode, encode};
pub use counters::{Counters, DropReason};
pub use datagram::{Authentic, DATAGRAM_BYTES_MAX, Fresh, SealError, Unverified, open, seal};
pub use header::{Domain, HEADER_BYTES, Header, Kind, MAGIC, Malformed, TOPIC_BYTES_MAX, TopicName, VERSION};
pub use window::{Freshness, SequenceCounts, Stream, WINDOW_BITS, Window, Windows};
