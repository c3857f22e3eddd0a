//! Chunks: unpacked within limits, believed once their checksum held, taken apart into messages.

use std::io::Read;

use crate::read::error::Defect;
use crate::read::record::{Cursor, MessageHead, op};

/// The most bytes one chunk may unpack to.
pub(crate) const CHUNK_BYTES_MAX: u64 = 1 << 28;
/// The most bytes that one lz4 block may unpack to.
const BLOCK_BYTES_MAX: u64 = 4 << 20;
/// By how much memory for unpacked bytes grows at a time: what a chunk says of itself reserves nothing.
const GROWTH_BYTES: usize = 1 << 20;

/// A chunk record, its content still packed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chunk<'a> {
    pub unpacked_bytes: u64,
    /// Of the unpacked content; zero if the writer wrote none.
    pub checksum: u32,
    pub compression: &'a str,
    pub packed: &'a [u8],
}

impl<'a> Chunk<'a> {
    pub(crate) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut cursor = Cursor::new(body);
        // Its times stand in the index as well, where a checksum covers them, and in its messages.
        let (_start, _end) = (cursor.u64()?, cursor.u64()?);
        let chunk = Self {
            unpacked_bytes: cursor.u64()?,
            checksum: cursor.u32()?,
            compression: cursor.text()?,
            packed: cursor.bytes_u64()?,
        };
        cursor.rest.is_empty().then_some(chunk)
    }

    /// Unpacks the content into `content` and holds it against its checksum. Without `unchecked` a chunk that
    /// has no checksum is refused.
    pub(crate) fn unpack(&self, content: &mut Vec<u8>, unchecked: bool) -> Result<(), Defect> {
        let stated = self.unpacked_bytes;
        if stated > CHUNK_BYTES_MAX {
            return Err(Defect::Limit {
                what: "a chunk's unpacked size",
                found: stated,
                limit: CHUNK_BYTES_MAX,
            });
        }
        content.clear();
        let unpacked = match self.compression {
            "" if self.packed.len() as u64 != stated => {
                return Err(Defect::count("a chunk's unpacked size", stated, self.packed.len() as u64));
            }
            "" => {
                content.extend_from_slice(self.packed);
                Ok(())
            }
            "lz4" => match single_block(self.packed).filter(|_| stated <= BLOCK_BYTES_MAX) {
                Some(block) => unpack_block(block, stated as usize, content),
                None => lz4::Decoder::new(self.packed).and_then(|from| fill(from, stated as usize, content)),
            },
            "zstd" => zstd::stream::read::Decoder::with_buffer(self.packed)
                .and_then(|from| fill(from, stated as usize, content)),
            other => return Err(Defect::Compression(format!("chunk compression {other:?} is not known"))),
        };
        unpacked.map_err(|error| Defect::Compression(format!("a chunk does not unpack: {error}")))?;
        if self.checksum == 0 && unchecked {
            return Ok(());
        }
        let actual = crc32fast::hash(content);
        match actual == self.checksum {
            true => Ok(()),
            false => Err(Defect::checksum("a chunk's checksum", actual, self.checksum)),
        }
    }
}

/// The compressed block of an lz4 frame that has just one, as those of a live recorder have: it unpacks by
/// itself, straight to where it belongs and without the frame's own checksum, which the chunk's makes
/// needless.
fn single_block(frame: &[u8]) -> Option<&[u8]> {
    const MAGIC: u32 = 0x184d_2204;
    const RAW: u32 = 1 << 31;
    let mut cursor = Cursor::new(frame);
    let (magic, flags, _block_size) = (cursor.u32()?, cursor.u8()?, cursor.u8()?);
    let has = |bit: u8| flags & (1 << bit) != 0;
    let (version, dictionary, content_size) = (flags >> 6, has(0), has(3));
    if magic != MAGIC || version != 1 || dictionary {
        return None;
    }
    cursor.take(if content_size { 8 } else { 0 })?;
    let _header_checksum = cursor.u8()?;
    let length = cursor.u32().filter(|length| length & RAW == 0 && *length != 0)?;
    let block = cursor.take(length as usize)?;
    cursor.take(if has(4) { 4 } else { 0 })?;
    let end = cursor.u32()?;
    let content_checksum = cursor.take(if has(2) { 4 } else { 0 }).is_some();
    (end == 0 && content_checksum && cursor.rest.is_empty()).then_some(block)
}

fn unpack_block(block: &[u8], length: usize, into: &mut Vec<u8>) -> std::io::Result<()> {
    into.resize(length, 0);
    match lz4::block::decompress_to_buffer(block, Some(length as i32), into)? {
        unpacked if unpacked == length => Ok(()),
        unpacked => Err(std::io::Error::other(format!("{unpacked} bytes, not the {length} that it says"))),
    }
}

/// Takes exactly `length` bytes, and finds the end after them.
fn fill(mut from: impl Read, length: usize, into: &mut Vec<u8>) -> std::io::Result<()> {
    while into.len() < length {
        let filled = into.len();
        into.resize(length.min(filled + GROWTH_BYTES), 0);
        from.read_exact(&mut into[filled..])?;
    }
    match from.read(&mut [0])? {
        0 => Ok(()),
        _ => Err(std::io::Error::other(format!("more than the {length} bytes that it says"))),
    }
}

/// A record in a chunk.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Inside<'a> {
    Schema(&'a [u8]),
    Channel(&'a [u8]),
    Message {
        head: MessageHead,
        /// Where its body begins in the content.
        at: usize,
        bytes: usize,
    },
}

/// Calls `each` with every record of a chunk's content, in order.
///
/// # Errors
/// A record that is not whole or cannot stand in a chunk, with where it begins in the content.
#[inline]
pub(crate) fn walk<'a>(
    content: &'a [u8],
    mut each: impl FnMut(Inside<'a>) -> Result<(), Defect>,
) -> Result<(), Defect> {
    let mut cursor = Cursor::new(content);
    while !cursor.rest.is_empty() {
        let whole = cursor.u8().and_then(|code| Some((code, cursor.bytes_u64()?)));
        let (code, body) = whole.ok_or(Defect::Unparsable("a record in a chunk"))?;
        each(match code {
            op::SCHEMA => Inside::Schema(body),
            op::CHANNEL => Inside::Channel(body),
            op::MESSAGE => {
                let head = MessageHead::parse(body).ok_or(Defect::Unparsable("a message"))?;
                let end = content.len() - cursor.rest.len();
                let bytes = body.len() - MessageHead::BYTES;
                Inside::Message { head, at: end - bytes, bytes }
            }
            _ => return Err(Defect::Misplaced(code)),
        })?;
    }
    Ok(())
}

/// One message of a chunk that was read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Log time.
    pub at_ns: i64,
    /// Publish time.
    pub published_at_ns: i64,
    /// Its number in the recording's list of channels.
    pub channel: u32,
    pub sequence: u32,
    offset: u32,
    bytes: u32,
}

/// A chunk's wanted messages, in order of time.
#[derive(Debug, Default)]
pub(crate) struct Unpacked {
    pub content: Vec<u8>,
    pub places: Vec<Place>,
}

/// Which messages of a chunk are wanted, and what holds for all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted<'a> {
    /// Of each channel id of the file: its number in the recording's list.
    pub numbers: &'a [Option<u32>],
    /// Of each of the recording's channels: whether it is wanted.
    pub channels: &'a [bool],
    pub from_ns: i64,
    pub to_ns: i64,
    /// Within these log times the index says that all messages are.
    pub index: (u64, u64),
}

impl Unpacked {
    /// Finds the wanted messages in the content, whose checksum holds.
    pub(crate) fn sift(&mut self, wanted: &Wanted<'_>) -> Result<(), Defect> {
        self.places.clear();
        let (content, places) = (&self.content, &mut self.places);
        let mut sorted = true;
        let mut latest = i64::MIN;
        walk(content, |inside| {
            let Inside::Message { head, at, bytes } = inside else { return Ok(()) };
            let number = wanted.numbers.get(usize::from(head.channel)).copied().flatten();
            let number = number.ok_or(Defect::UnknownChannel(head.channel))?;
            if head.log_time < wanted.index.0 || head.log_time > wanted.index.1 {
                let nearest = head.log_time.clamp(wanted.index.0, wanted.index.1);
                return Err(Defect::count("a message's time, by its chunk's index,", head.log_time, nearest));
            }
            if !wanted.channels[number as usize] {
                return Ok(());
            }
            let at_ns = nanos("a message's log time", head.log_time)?;
            if at_ns < wanted.from_ns || at_ns > wanted.to_ns {
                return Ok(());
            }
            sorted &= at_ns >= latest;
            latest = at_ns;
            places.push(Place {
                at_ns,
                published_at_ns: nanos("a message's publish time", head.publish_time)?,
                channel: number,
                sequence: head.sequence,
                offset: at as u32,
                bytes: bytes as u32,
            });
            Ok(())
        })?;
        if !sorted {
            places.sort_by_key(|place| place.at_ns);
        }
        Ok(())
    }

    /// A message's body.
    pub(crate) fn body(&self, place: &Place) -> &[u8] {
        &self.content[place.offset as usize..][..place.bytes as usize]
    }
}

fn nanos(what: &'static str, value: u64) -> Result<i64, Defect> {
    i64::try_from(value).map_err(|_| Defect::Limit { what, found: value, limit: i64::MAX as u64 })
}
