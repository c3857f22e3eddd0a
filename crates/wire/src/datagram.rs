//! A datagram's way out, [`seal`], and its way in: [`open`], verify, fresh, decode.

use core::ops::Range;

use reflect::Message;
use thiserror::Error;

use crate::{
    BODY_BYTES_MAX, DecodeError, DropReason, Freshness, HEADER_BYTES, Header, Malformed, SigningKey,
    TAG_BYTES, TOPIC_BYTES_MAX, TopicName, VerifyKey, Windows, codec,
};

/// The longest datagram there can be.
pub const DATAGRAM_BYTES_MAX: usize = HEADER_BYTES + TOPIC_BYTES_MAX + BODY_BYTES_MAX + TAG_BYTES;

/// Why no datagram can be made; each is a fault of the sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SealError {
    /// The header names another domain or run than the key is for.
    #[error("the header's domain and run are not the key's")]
    ForeignKey,
    /// A publish time before the clock's zero.
    #[error("publish time {nanos} ns is before the clock's zero")]
    PublishTime {
        /// The time.
        nanos: i64,
    },
    /// A body above the limit.
    #[error("a body of {length} bytes exceeds {}", BODY_BYTES_MAX)]
    BodyTooLong {
        /// Its length.
        length: usize,
    },
}

/// Makes a datagram in `out`, which is emptied first and keeps its memory.
///
/// # Errors
/// A [`SealError`]; `out` is then empty.
pub fn seal(
    header: &Header,
    topic: TopicName<'_>,
    body: &[u8],
    key: &SigningKey,
    out: &mut Vec<u8>,
) -> Result<(), SealError> {
    out.clear();
    if (header.domain, header.run) != (key.domain(), key.run()) {
        return Err(SealError::ForeignKey);
    }
    let nanos = header.published_at.as_nanos();
    let published_ns = u64::try_from(nanos).map_err(|_| SealError::PublishTime { nanos })?;
    if body.len() > BODY_BYTES_MAX {
        return Err(SealError::BodyTooLong { length: body.len() });
    }
    out.extend_from_slice(&header.to_bytes(topic, published_ns));
    out.extend_from_slice(topic.name().as_bytes());
    out.extend_from_slice(body);
    let tag = key.tag(out);
    out.extend_from_slice(&tag);
    Ok(())
}

/// Takes a datagram apart by lengths, magic and version. Allocates nothing, believes nothing.
///
/// # Errors
/// [`Malformed`], with what was found.
pub fn open(datagram: &[u8]) -> Result<Unverified<'_>, Malformed> {
    let (header, topic, body) = Header::parse(datagram)?;
    Ok(Unverified { header, topic, body, datagram })
}

/// A datagram whose sender is not known yet: what it says serves to find the key, and to be recorded.
#[derive(Clone, Debug)]
pub struct Unverified<'a> {
    header: Header,
    topic: TopicName<'a>,
    body: Range<usize>,
    datagram: &'a [u8],
}

impl<'a> Unverified<'a> {
    /// What the header claims.
    #[must_use]
    pub const fn claimed(&self) -> &Header {
        &self.header
    }

    /// The topic it claims, by which to find the key.
    #[must_use]
    pub const fn topic(&self) -> TopicName<'a> {
        self.topic
    }

    /// The body, for recording it as it came; to act on it, verify first.
    #[must_use]
    pub fn body_unverified(&self) -> &'a [u8] {
        &self.datagram[self.body.clone()]
    }

    /// Checks the tag, then domain and run.
    ///
    /// # Errors
    /// [`DropReason::Domain`] or [`DropReason::Run`] where the header claims another domain or run than the
    /// key's: the tag of such a datagram cannot hold, and that is why. [`DropReason::Unauthentic`] for every
    /// other tag that does not hold.
    pub fn verify(self, key: &VerifyKey) -> Result<Authentic<'a>, DropReason> {
        let (signed, tag) = self.datagram.split_last_chunk().ok_or(DropReason::Malformed)?;
        let holds = key.holds(signed, tag);
        if self.header.domain != key.domain() {
            return Err(DropReason::Domain);
        }
        if self.header.run != key.run() {
            return Err(DropReason::Run);
        }
        if !holds {
            return Err(DropReason::Unauthentic);
        }
        Ok(Authentic(Content { header: self.header, topic: self.topic, body: &self.datagram[self.body] }))
    }
}

#[derive(Clone, Copy, Debug)]
struct Content<'a> {
    header: Header,
    topic: TopicName<'a>,
    body: &'a [u8],
}

/// A datagram from a holder of the key, of our domain and run; it may be a copy.
#[derive(Debug)]
pub struct Authentic<'a>(Content<'a>);

impl<'a> Authentic<'a> {
    /// Checks and moves the sequence window.
    ///
    /// # Errors
    /// [`DropReason::Replayed`] for whatever is not certainly new.
    pub fn fresh(self, windows: &mut Windows) -> Result<Fresh<'a>, DropReason> {
        let header = &self.0.header;
        let stream = (header.source, self.0.topic.hash(), header.kind);
        match windows.accept(stream, header.incarnation, header.sequence) {
            Freshness::Fresh => Ok(Fresh(self.0)),
            Freshness::Duplicate | Freshness::TooOld | Freshness::OldIncarnation | Freshness::NoRoom => {
                Err(DropReason::Replayed)
            }
        }
    }
}

/// An authentic datagram that was not seen before.
#[derive(Debug)]
pub struct Fresh<'a>(Content<'a>);

impl<'a> Fresh<'a> {
    /// The header.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.0.header
    }

    /// The topic.
    #[must_use]
    pub const fn topic(&self) -> TopicName<'a> {
        self.0.topic
    }

    /// The body's bytes.
    #[must_use]
    pub const fn body(&self) -> &'a [u8] {
        self.0.body
    }

    /// Decodes the body as `M`, whose schema id is `schema_id`: the caller keeps it, since it takes a text to
    /// compute.
    ///
    /// # Errors
    /// [`DecodeError`] for another schema id, or a body that is not exactly one such message.
    pub fn decode<M: Message>(&self, schema_id: u64) -> Result<M, DecodeError> {
        let found = self.0.header.schema_id;
        if found != schema_id {
            return Err(DecodeError::Schema { message: M::SCHEMA.name, expected: schema_id, found });
        }
        codec::decode(self.0.body)
    }
}
