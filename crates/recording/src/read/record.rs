//! MCAP's records, taken from bytes that may be anything. Nothing here allocates more than it was given.

use std::collections::BTreeMap;

pub(crate) use mcap::records::op;

/// Bytes being taken from the front; `None` where there are too few.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    pub rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub(crate) const fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    pub(crate) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        Some(*taken)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(crate) fn bytes_u32(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(usize::try_from(length).ok()?)
    }

    pub(crate) fn bytes_u64(&mut self) -> Option<&'a [u8]> {
        let length = self.u64()?;
        self.take(usize::try_from(length).ok()?)
    }

    pub(crate) fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes_u32()?).ok()
    }

    /// A map of texts; `None` also for a key that comes twice.
    pub(crate) fn texts(&mut self) -> Option<BTreeMap<String, String>> {
        let mut pairs = Cursor::new(self.bytes_u32()?);
        let mut map = BTreeMap::new();
        while !pairs.rest.is_empty() {
            let (key, value) = (pairs.text()?, pairs.text()?);
            if map.insert(key.to_owned(), value.to_owned()).is_some() {
                return None;
            }
        }
        Some(map)
    }
}

/// A definition as MCAP has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Schema {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

impl Schema {
    pub(crate) fn parse(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        let (id, name, encoding) = (cursor.u16()?, cursor.text()?.to_owned(), cursor.text()?.to_owned());
        let data = cursor.bytes_u32()?.to_vec();
        (id != 0 && cursor.rest.is_empty()).then_some(Self { id, name, encoding, data })
    }
}

/// A channel as MCAP has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RawChannel {
    pub id: u16,
    pub schema: u16,
    pub topic: String,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

impl RawChannel {
    pub(crate) fn parse(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        let (id, schema) = (cursor.u16()?, cursor.u16()?);
        let (topic, encoding) = (cursor.text()?.to_owned(), cursor.text()?.to_owned());
        let metadata = cursor.texts()?;
        cursor.rest.is_empty().then_some(Self { id, schema, topic, encoding, metadata })
    }
}

/// What stands before a message's body, in a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MessageHead {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

impl MessageHead {
    /// Bytes of it.
    pub(crate) const BYTES: usize = 22;

    #[inline]
    pub(crate) fn parse(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        Some(Self {
            channel: cursor.u16()?,
            sequence: cursor.u32()?,
            log_time: cursor.u64()?,
            publish_time: cursor.u64()?,
        })
    }
}

/// Where one chunk stands, as the summary has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChunkIndex {
    pub start: u64,
    pub end: u64,
    pub offset: u64,
    /// Of the record, with code and length.
    pub length: u64,
    /// Channels with messages in it, ascending; empty if the writer wrote no message indexes.
    pub channels: Vec<u16>,
    pub unpacked_bytes: u64,
}

impl ChunkIndex {
    pub(crate) fn parse(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        let (start, end) = (cursor.u64()?, cursor.u64()?);
        let (offset, length) = (cursor.u64()?, cursor.u64()?);
        let entries = cursor.bytes_u32()?;
        if entries.len() % 10 != 0 {
            return None;
        }
        let mut channels: Vec<u16> =
            entries.chunks_exact(10).map(|entry| u16::from_le_bytes([entry[0], entry[1]])).collect();
        if !channels.is_sorted() {
            channels.sort_unstable();
        }
        let (_index_bytes, _compression, _packed) = (cursor.u64()?, cursor.text()?, cursor.u64()?);
        Some(Self { start, end, offset, length, channels, unpacked_bytes: cursor.u64()? })
    }
}

/// Where something named stands, as the summary has it: metadata or an attachment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NamedIndex {
    pub offset: u64,
    pub length: u64,
    pub name: String,
}

impl NamedIndex {
    pub(crate) fn metadata(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        let (offset, length) = (cursor.u64()?, cursor.u64()?);
        Some(Self { offset, length, name: cursor.text()?.to_owned() })
    }

    pub(crate) fn attachment(body: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        let (offset, length) = (cursor.u64()?, cursor.u64()?);
        let (_logged, _created, _bytes) = (cursor.u64()?, cursor.u64()?, cursor.u64()?);
        Some(Self { offset, length, name: cursor.text()?.to_owned() })
    }
}

/// The metadata record in `body`: its name and content.
pub(crate) fn metadata(body: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    let mut cursor = Cursor::new(body);
    let found = (cursor.text()?.to_owned(), cursor.texts()?);
    cursor.rest.is_empty().then_some(found)
}

/// Counts of the statistics record in `body`: messages in all, chunks, and messages of each channel.
pub(crate) fn statistics(body: &[u8]) -> Option<(u64, u32, BTreeMap<u16, u64>)> {
    let mut cursor = Cursor::new(body);
    let messages = cursor.u64()?;
    let (_schemas, _channels) = (cursor.u16()?, cursor.u32()?);
    let (_attachments, _metadata, chunks) = (cursor.u32()?, cursor.u32()?, cursor.u32()?);
    let (_start, _end) = (cursor.u64()?, cursor.u64()?);
    let mut entries = Cursor::new(cursor.bytes_u32()?);
    let mut counts = BTreeMap::new();
    while !entries.rest.is_empty() {
        counts.insert(entries.u16()?, entries.u64()?);
    }
    Some((messages, chunks, counts))
}

/// An attachment: its name, its media type and its data, if its checksum holds or is not there.
pub(crate) fn attachment(body: &[u8]) -> Option<(&str, &str, &[u8])> {
    let mut cursor = Cursor::new(body);
    let (_logged, _created) = (cursor.u64()?, cursor.u64()?);
    let (name, media_type, data) = (cursor.text()?, cursor.text()?, cursor.bytes_u64()?);
    let covered = body.len() - cursor.rest.len();
    let stated = cursor.u32()?;
    let holds = stated == 0 || stated == crc32fast::hash(&body[..covered]);
    (holds && cursor.rest.is_empty()).then_some((name, media_type, data))
}
