//! A datagram's way out, [`seal`], and its way in: [`open`], verify, fresh, decode.

use core::ops::Range;

use reflect::Message;
use thiserror::Error;

use crate::{
    BODY_BYTES_MAX, DecodeError, DropReason, EncodeError, Freshness, HEADER_BYTES, Header, Malformed,
    SigningKey, TAG_BYTES, TopicName, VerifyKey, Windows, codec,
};

/// The longest datagram there can be.
pub const DATAGRAM_BYTES_MAX: usize = HEADER_BYTES + u8::MAX as usize + BODY_BYTES_MAX + TAG_BYTES;

/// Why a message does not go out: each is a fault of the sender.
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
    /// A message without a body.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

/// Makes a datagram of a body: `out` is emptied first and keeps its memory.
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
    seal_with(header, topic, key, out, |out| {
        if body.len() > BODY_BYTES_MAX {
            return Err(SealError::BodyTooLong { length: body.len() });
        }
        out.extend_from_slice(body);
        Ok(())
    })?;
    Ok(())
}

/// Makes a datagram of a message, encoding it in place; gives the range of its body in `out`.
///
/// # Errors
/// A [`SealError`]; `out` is then empty.
pub fn seal_message<M: Message>(
    header: &Header,
    topic: TopicName<'_>,
    message: &M,
    key: &SigningKey,
    out: &mut Vec<u8>,
) -> Result<Range<usize>, SealError> {
    seal_with(header, topic, key, out, |out| Ok(codec::encode(message, out)?))
}

fn seal_with(
    header: &Header,
    topic: TopicName<'_>,
    key: &SigningKey,
    out: &mut Vec<u8>,
    write_body: impl FnOnce(&mut Vec<u8>) -> Result<(), SealError>,
) -> Result<Range<usize>, SealError> {
    out.clear();
    if (header.domain, header.run) != (key.domain(), key.run()) {
        return Err(SealError::ForeignKey);
    }
    if !header.write(topic, out) {
        return Err(SealError::PublishTime {
            nanos: header.published_at.as_nanos(),
        });
    }
    let start = out.len();
    if let Err(error) = write_body(out) {
        out.clear();
        return Err(error);
    }
    let end = out.len();
    let tag = key.tag(out);
    out.extend_from_slice(&tag);
    Ok(start..end)
}

/// Takes a datagram apart by lengths, magic and version. Allocates nothing, believes nothing.
///
/// # Errors
/// [`Malformed`], with what was found.
pub fn open(datagram: &[u8]) -> Result<Unverified<'_>, Malformed> {
    let (header, topic, body) = Header::parse(datagram)?;
    Ok(Unverified {
        header,
        topic,
        body,
        datagram,
    })
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

    /// The body, for recording as it came; for acting on, verify first.
    #[must_use]
    pub fn body_unverified(&self) -> &'a [u8] {
        &self.datagram[self.body.clone()]
    }

    /// Checks the tag, then domain and run.
    ///
    /// # Errors
    /// [`DropReason::Domain`] or [`DropReason::Run`] where the header claims another domain or run than the key's: such a
    /// tag cannot hold, and that is why. [`DropReason::Unauthentic`] for every other tag that does not hold.
    pub fn verify(self, key: &VerifyKey) -> Result<Authentic<'a>, DropReason> {
        let (signed, tag) = self
            .datagram
            .split_last_chunk::<TAG_BYTES>()
            .ok_or(DropReason::Malformed)?;
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
        Ok(Authentic {
            header: self.header,
            topic: self.topic,
            body: &self.datagram[self.body],
        })
    }
}

/// A datagram from a holder of the key, of this domain and run; it may be a copy.
#[derive(Clone, Debug)]
pub struct Authentic<'a> {
    header: Header,
    topic: TopicName<'a>,
    body: &'a [u8],
}

impl<'a> Authentic<'a> {
    /// The header.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The topic.
    #[must_use]
    pub const fn topic(&self) -> TopicName<'a> {
        self.topic
    }

    /// Checks and moves the sequence window.
    ///
    /// # Errors
    /// [`DropReason::Replayed`] for whatever is not certainly new.
    pub fn fresh(self, windows: &mut Windows) -> Result<Fresh<'a>, DropReason> {
        let header = &self.header;
        let stream = (header.source, self.topic.hash(), header.kind);
        match windows.accept(stream, header.incarnation, header.sequence) {
            Freshness::Fresh => Ok(Fresh {
                header: self.header,
                topic: self.topic,
                body: self.body,
            }),
            Freshness::Duplicate | Freshness::TooOld | Freshness::OldIncarnation | Freshness::NoRoom => {
                Err(DropReason::Replayed)
            }
        }
    }
}

/// An authentic datagram that was not seen before.
#[derive(Clone, Debug)]
pub struct Fresh<'a> {
    header: Header,
    topic: TopicName<'a>,
    body: &'a [u8],
}

impl<'a> Fresh<'a> {
    /// The header.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The topic.
    #[must_use]
    pub const fn topic(&self) -> TopicName<'a> {
        self.topic
    }

    /// The body's bytes.
    #[must_use]
    pub const fn body(&self) -> &'a [u8] {
        self.body
    }

    /// Decodes the body as `M`, whose schema id is `schema_id` (the caller keeps it: it takes a text to compute).
    ///
    /// # Errors
    /// [`DecodeError`] for another schema id, or a body that is not exactly one such message.
    pub fn decode<M: Message>(&self, schema_id: u64) -> Result<M, DecodeError> {
        if self.header.schema_id != schema_id {
            return Err(DecodeError::Schema {
                message: M::SCHEMA.name,
                expected: schema_id,
                found: self.header.schema_id,
            });
        }
        codec::decode(self.body)
    }
}
