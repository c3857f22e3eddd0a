//! One file of a recording: what it defines and where its chunks stand, from its summary or by reading all of
//! it.

use std::collections::BTreeMap;

use super::error::{Defect, ReadError};
use super::record::{self, ChunkIndex, Cursor, NamedIndex, RawChannel, Schema, op};
use super::source::{FRAME_BYTES, Frame, Source, frame_in};
use crate::ABOUT_RECORD;
use crate::chunk::{Chunk, Unpacked, Wanted};
use crate::format::PROFILE;

/// How the library is called that our recorders name in a file's header.
const LIBRARY: &str = "flyarena ";
const MAGIC_BYTES: u64 = mcap::MAGIC.len() as u64;
/// Body of a footer: start of the summary, start of its offsets, its checksum.
const FOOTER_BYTES: u64 = 20;

/// In which condition a file is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Sealed, with a summary whose checksum holds.
    Sealed,
    /// All of its messages are there, but it has no summary, or one that does not hold: all of it had to be
    /// read.
    WithoutSummary,
    /// It ends in the middle, as a file does whose recorder was killed.
    Torn {
        /// Where its last whole record ends.
        whole_bytes: u64,
        /// Bytes after that, which are lost.
        lost_bytes: u64,
    },
    /// Damaged at some place, and what follows it cannot be told apart.
    Damaged {
        /// Where the damage begins.
        whole_bytes: u64,
        /// Bytes from there on, which are lost.
        lost_bytes: u64,
    },
}

/// Where some messages stand, and what is known of them without reading them.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    pub kind: PlaceKind,
    /// Where it begins in the file.
    pub at: u64,
    /// Its length, with code and length.
    pub length: u64,
    /// Log times of its first and last message.
    pub start: u64,
    pub end: u64,
    /// Channel ids with messages in it, ascending; `None` if that is not known.
    pub channels: Option<Box<[u16]>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PlaceKind {
    Chunk,
    /// Messages outside of chunks, which no checksum covers: only in files that are not ours.
    Loose,
}

/// One file.
#[derive(Debug)]
pub(crate) struct Segment {
    pub source: Source,
    pub profile: String,
    pub library: String,
    /// Whether a recorder of ours wrote it.
    pub ours: bool,
    pub condition: Condition,
    /// What was found wrong on opening.
    pub damage: Vec<ReadError>,
    pub schemas: BTreeMap<u16, Schema>,
    pub channels: BTreeMap<u16, RawChannel>,
    pub places: Vec<Place>,
    pub counts: BTreeMap<u16, u64>,
    pub metadata: Vec<NamedIndex>,
    pub attachments: Vec<NamedIndex>,
}

impl Segment {
    /// Reads what a file says of itself.
    pub(crate) fn open(source: Source) -> Result<Self, ReadError> {
        let mut segment = Self {
            source,
            profile: String::new(),
            library: String::new(),
            ours: false,
            condition: Condition::Sealed,
            damage: Vec::new(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            places: Vec::new(),
            counts: BTreeMap::new(),
            metadata: Vec::new(),
            attachments: Vec::new(),
        };
        segment.open_header()?;
        match segment.summary() {
            Ok(Some(summary)) => segment.take_summary(summary),
            Ok(None) => super::scan::scan(&mut segment)?,
            Err(ReadError::Damaged { path, offset, defect }) => {
                super::scan::scan(&mut segment)?;
                segment.damage.push(ReadError::Damaged { path, offset, defect });
            }
            Err(error) => return Err(error),
        }
        if segment.ours && !segment.metadata.iter().any(|index| index.name == ABOUT_RECORD) {
            segment.damage.push(segment.source.damaged(MAGIC_BYTES, Defect::Missing(ABOUT_RECORD)));
        }
        Ok(segment)
    }

    /// Where the first record after the header begins; the header itself may be torn.
    pub(crate) fn first_record_at(&self) -> Result<u64, ReadError> {
        Ok(self.source.frame(MAGIC_BYTES)?.map_or(MAGIC_BYTES, Frame::end))
    }

    fn open_header(&mut self) -> Result<(), ReadError> {
        let mut buffer = Vec::new();
        self.source.read(0, MAGIC_BYTES.min(self.source.length), &mut buffer)?;
        if buffer != mcap::MAGIC {
            let found = match buffer.is_empty() {
                true => "nothing, it is empty".to_owned(),
                false => buffer.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" "),
            };
            return Err(ReadError::NotMcap { path: self.source.path.clone(), found });
        }
        let Some(frame) = self.source.frame(MAGIC_BYTES)? else { return Ok(()) };
        if frame.code != op::HEADER {
            return Err(self.source.damaged(frame.at, Defect::Misplaced(frame.code)));
        }
        self.source.body(frame, &mut buffer)?;
        let mut cursor = Cursor::new(&buffer);
        let texts = cursor.text().and_then(|profile| Some((profile.to_owned(), cursor.text()?.to_owned())));
        (self.profile, self.library) =
            texts.ok_or_else(|| self.source.damaged(frame.at, Defect::Unparsable("the header")))?;
        // Two places say so, the header and the description: damage to one of them makes no foreign file of
        // ours.
        self.ours = self.profile == PROFILE && self.library.starts_with(LIBRARY);
        Ok(())
    }

    /// The summary: `None` if the file has none that tells where every message is, an error if it does not
    /// hold.
    fn summary(&self) -> Result<Option<Summary>, ReadError> {
        let ending = FRAME_BYTES + FOOTER_BYTES + MAGIC_BYTES;
        let Some(footer_at) = self.source.length.checked_sub(ending).filter(|at| *at >= MAGIC_BYTES) else {
            return Ok(None);
        };
        let mut buffer = Vec::new();
        self.source.read(footer_at, ending, &mut buffer)?;
        let sealed = frame_in(&buffer, footer_at)
            .is_some_and(|frame| frame.code == op::FOOTER && frame.length == FOOTER_BYTES);
        if !sealed || !buffer.ends_with(mcap::MAGIC) {
            return Ok(None);
        }
        let mut cursor = Cursor::new(&buffer[FRAME_BYTES as usize..]);
        let fields = (cursor.u64(), cursor.u64(), cursor.u32());
        let (Some(start), Some(_offsets), Some(stated)) = fields else { return Ok(None) };
        if start == 0 {
            return Ok(None);
        }
        if start < MAGIC_BYTES || start > footer_at {
            let defect = Defect::Limit { what: "the summary's place", found: start, limit: footer_at };
            return Err(self.source.damaged(footer_at, defect));
        }
        // The checksum covers the summary and the footer up to itself.
        let covered = footer_at - start + FRAME_BYTES + FOOTER_BYTES - 4;
        self.source.read(start, covered, &mut buffer)?;
        let actual = crc32fast::hash(&buffer);
        if stated != 0 && stated != actual {
            let defect = Defect::checksum("the summary's checksum", actual, stated);
            return Err(self.source.damaged(start, defect));
        }
        buffer.truncate((footer_at - start) as usize);
        let summary = Summary::parse(&buffer)
            .ok_or_else(|| self.source.damaged(start, Defect::Unparsable("the summary")))?;
        // A summary of ours that nothing covers is none.
        let believed = stated != 0 || !(self.ours || summary.ours());
        Ok(Some(summary).filter(|summary| believed && summary.tells_all(start)))
    }

    fn take_summary(&mut self, summary: Summary) {
        self.ours |= summary.ours();
        self.schemas = summary.schemas;
        self.channels = summary.channels;
        self.counts = summary.counts;
        self.metadata = summary.metadata;
        self.attachments = summary.attachments;
        // Chunks of ours without a message hold definitions, which the summary repeats.
        let ours = self.ours;
        let empty = |chunk: &ChunkIndex| ours && chunk.channels.is_empty();
        self.places = summary
            .chunks
            .into_iter()
            .filter(|chunk| !empty(chunk))
            .map(|chunk| Place {
                kind: PlaceKind::Chunk,
                at: chunk.offset,
                length: chunk.length,
                start: chunk.start,
                end: chunk.end,
                channels: (!chunk.channels.is_empty()).then(|| chunk.channels.into()),
            })
            .collect();
    }

    /// Reads the messages at a place: its content is held against its checksum before anything of it is
    /// looked at.
    pub(crate) fn load(
        &self,
        place: &Place,
        wanted: &Wanted<'_>,
        buffer: &mut Vec<u8>,
        into: &mut Unpacked,
    ) -> Result<(), ReadError> {
        let failed = |defect| self.source.damaged(place.at, defect);
        match place.kind {
            PlaceKind::Loose => self.source.read(place.at, place.length, &mut into.content)?,
            PlaceKind::Chunk => {
                self.source.read(place.at, place.length, buffer)?;
                let frame =
                    frame_in(buffer, place.at).ok_or_else(|| failed(Defect::Unparsable("a chunk")))?;
                if frame.code != op::CHUNK {
                    return Err(failed(Defect::Misplaced(frame.code)));
                }
                if frame.length + FRAME_BYTES != place.length {
                    return Err(failed(Defect::count(
                        "a chunk's length",
                        frame.length + FRAME_BYTES,
                        place.length,
                    )));
                }
                let chunk = Chunk::parse(&buffer[FRAME_BYTES as usize..])
                    .ok_or_else(|| failed(Defect::Unparsable("a chunk")))?;
                chunk.unpack(&mut into.content, !self.ours).map_err(failed)?;
            }
        }
        into.sift(wanted).map_err(failed)
    }

    /// The body of the record of `code` that an index names.
    pub(crate) fn indexed(&self, index: &NamedIndex, code: u8) -> Result<Vec<u8>, ReadError> {
        let failed = |defect| self.source.damaged(index.offset, defect);
        let frame = self.source.frame(index.offset)?;
        let frame = frame.ok_or_else(|| failed(Defect::Unparsable("an indexed record")))?;
        if frame.code != code {
            return Err(failed(Defect::Misplaced(frame.code)));
        }
        if frame.length.checked_add(FRAME_BYTES) != Some(index.length) {
            return Err(failed(Defect::count("a record's length", frame.length, index.length)));
        }
        let mut body = Vec::new();
        self.source.body(frame, &mut body)?;
        Ok(body)
    }

    /// The content of the metadata record of this name; the last, if there are several.
    pub(crate) fn metadata(&self, name: &str) -> Result<Option<BTreeMap<String, String>>, ReadError> {
        let index = self.metadata.iter().rfind(|index| index.name == name);
        index.map(|index| self.metadata_at(index)).transpose()
    }

    /// The content of one metadata record.
    pub(crate) fn metadata_at(&self, index: &NamedIndex) -> Result<BTreeMap<String, String>, ReadError> {
        let body = self.indexed(index, op::METADATA)?;
        match record::metadata(&body) {
            Some((found, content)) if found == index.name => Ok(content),
            _ => Err(self.source.damaged(index.offset, Defect::Unparsable("a metadata record"))),
        }
    }
}

/// A summary section.
#[derive(Debug, Default)]
struct Summary {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, RawChannel>,
    chunks: Vec<ChunkIndex>,
    metadata: Vec<NamedIndex>,
    attachments: Vec<NamedIndex>,
    counts: BTreeMap<u16, u64>,
    /// Messages in all and chunks, if the writer counted them.
    totals: Option<(u64, u32)>,
}

impl Summary {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let mut summary = Self::default();
        let mut cursor = Cursor::new(bytes);
        while !cursor.rest.is_empty() {
            let code = cursor.u8()?;
            let body = cursor.bytes_u64()?;
            match code {
                op::SCHEMA => {
                    let schema = Schema::parse(body)?;
                    summary.schemas.insert(schema.id, schema);
                }
                op::CHANNEL => {
                    let channel = RawChannel::parse(body)?;
                    summary.channels.insert(channel.id, channel);
                }
                op::CHUNK_INDEX => summary.chunks.push(ChunkIndex::parse(body)?),
                op::METADATA_INDEX => summary.metadata.push(NamedIndex::metadata(body)?),
                op::ATTACHMENT_INDEX => summary.attachments.push(NamedIndex::attachment(body)?),
                op::STATISTICS => {
                    let (messages, chunks, counts) = record::statistics(body)?;
                    summary.totals = Some((messages, chunks));
                    summary.counts = counts;
                }
                _ => {}
            }
        }
        summary.chunks.sort_by_key(|chunk| chunk.offset);
        Some(summary)
    }

    fn ours(&self) -> bool {
        self.metadata.iter().any(|index| index.name == ABOUT_RECORD)
    }

    /// Whether it says where every message of the file is. Writers may leave any of its records out.
    fn tells_all(&self, data_end: u64) -> bool {
        let Some((messages, chunks)) = self.totals else { return false };
        let counted: u64 = self.counts.values().fold(0, |sum, count| sum.saturating_add(*count));
        let placed = self.chunks.iter().all(|chunk| {
            let end = chunk.offset.checked_add(chunk.length);
            chunk.offset >= MAGIC_BYTES
                && chunk.length > FRAME_BYTES
                && end.is_some_and(|end| end <= data_end)
        });
        let apart = self.chunks.windows(2).all(|pair| pair[0].offset + pair[0].length <= pair[1].offset);
        placed
            && apart
            && chunks as usize == self.chunks.len()
            && (messages == 0 || chunks > 0)
            && counted == messages
            && self.counts.keys().all(|id| self.channels.contains_key(id))
    }
}
