//! The records of a file that may be damaged, as far as they are whole, with their places.

use std::io::Read;

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, parse_record};

use super::RecoverError;

/// The longest record that is believed, and the most that a chunk may unfold to; ours are far below.
const RECORD_BYTES_MAX: usize = 64 << 20;
const HEAD_BYTES: usize = 9;
/// An opcode of those that the format leaves to applications.
const SENTINEL: u8 = 0xff;

/// Where a file ceases to be whole, and why.
pub(super) struct Torn {
    pub(super) offset: u64,
    pub(super) reason: String,
}

/// Reads records, one or a chunk of them at a time.
pub(super) struct Records<R> {
    input: R,
    offset: u64,
    batch_offset: u64,
    record: Vec<u8>,
    stage: Stage,
}

/// Where in a file the reader is: what may come next. An opcode has no checksum, so a chunk whose opcode was
/// damaged must not pass for a record that nobody needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Beginning,
    Data,
    AfterChunk,
    Summary,
}

impl Stage {
    /// The stage after a record, or `None` where there can be no such record.
    fn after(self, opcode: u8) -> Option<Self> {
        match (self, opcode) {
            (Self::Beginning, op::HEADER) => Some(Self::Data),
            (Self::Data | Self::AfterChunk, op::CHUNK) => Some(Self::AfterChunk),
            (Self::AfterChunk, op::MESSAGE_INDEX) => Some(Self::AfterChunk),
            (Self::Data | Self::AfterChunk, op::SCHEMA | op::CHANNEL | op::METADATA | op::ATTACHMENT) => {
                Some(Self::Data)
            }
            (Self::Data | Self::AfterChunk, op::DATA_END) => Some(Self::Summary),
            (
                Self::Summary,
                op::SCHEMA
                | op::CHANNEL
                | op::STATISTICS
                | op::CHUNK_INDEX
                | op::ATTACHMENT_INDEX
                | op::METADATA_INDEX
                | op::SUMMARY_OFFSET
                | op::FOOTER,
            ) => Some(Self::Summary),
            _ => None,
        }
    }
}

impl<R: Read> Records<R> {
    pub(super) fn new(input: R) -> Self {
        Self { input, offset: 0, batch_offset: 0, record: Vec::new(), stage: Stage::Beginning }
    }

    /// Reads what every such file begins with.
    pub(super) fn open(&mut self) -> Result<(), RecoverError> {
        let found = self.take(MAGIC.len())?;
        if self.record != MAGIC {
            let reason = if found < MAGIC.len() {
                format!("{found} bytes, too few even for a beginning")
            } else {
                format!("begins with {:02x?}, not with {MAGIC:02x?}", self.record)
            };
            return Err(RecoverError::Foreign(reason));
        }
        Ok(())
    }

    /// Where the last batch begins.
    pub(super) fn batch_offset(&self) -> u64 {
        self.batch_offset
    }

    /// Takes the next record, or all of a chunk: `None` at the proper end, the damage where there is one.
    pub(super) fn next_whole(
        &mut self,
        batch: &mut Vec<Record<'static>>,
    ) -> Result<Result<Option<()>, Torn>, RecoverError> {
        self.batch_offset = self.offset;
        let offset = self.batch_offset;
        let found = self.take(HEAD_BYTES)?;
        if found < HEAD_BYTES {
            let reason =
                if found == 0 { "the file ends without its end" } else { "the file ends within a record" };
            return Ok(Err(Torn { offset, reason: reason.to_owned() }));
        }
        let opcode = self.record[0];
        let mut length = [0; 8];
        length.copy_from_slice(&self.record[1..HEAD_BYTES]);
        let length = u64::from_le_bytes(length);
        if length > RECORD_BYTES_MAX as u64 {
            let reason = format!("a record of {length} bytes, more than the {RECORD_BYTES_MAX} there can be");
            return Ok(Err(Torn { offset, reason }));
        }
        let length = length as usize;
        let found = self.take(length)?;
        if found < length {
            let reason = format!("the file ends within a record: {found} of its {length} bytes are there");
            return Ok(Err(Torn { offset, reason }));
        }
        let Some(stage) = self.stage.after(opcode) else {
            let reason = format!("a record of kind {opcode:#04x}, which has no place there");
            return Ok(Err(Torn { offset, reason }));
        };
        self.stage = stage;
        let taken = if opcode == op::CHUNK {
            unfold(&self.record, batch)
        } else if opcode == op::MESSAGE_INDEX {
            check_index(&self.record)
        } else if stage == Stage::Summary && matches!(opcode, op::SCHEMA | op::CHANNEL) {
            // Repeated from the data, where they were taken.
            Ok(())
        } else {
            parse_record(opcode, &self.record)
                .map(|record| batch.push(record.into_owned()))
                .map_err(|error| error.to_string())
        };
        if let Err(reason) = taken {
            return Ok(Err(Torn { offset, reason }));
        }
        if opcode == op::FOOTER {
            return self.end(offset);
        }
        Ok(Ok(Some(())))
    }

    fn end(&mut self, offset: u64) -> Result<Result<Option<()>, Torn>, RecoverError> {
        self.take(MAGIC.len())?;
        if self.record == MAGIC {
            return Ok(Ok(None));
        }
        Ok(Err(Torn { offset, reason: "the closing magic is not there".to_owned() }))
    }

    /// Reads so many bytes, or those there are: how many. Memory grows with what is there, not with what is
    /// claimed.
    fn take(&mut self, count: usize) -> Result<usize, RecoverError> {
        self.record.clear();
        let read = (&mut self.input).take(count as u64).read_to_end(&mut self.record);
        let found = read.map_err(RecoverError::Read)?;
        self.offset += found as u64;
        Ok(found)
    }
}

/// A message index: a channel, a length in bytes, and as many of sixteen-byte entries. It is made anew, so
/// only its shape matters.
fn check_index(index: &[u8]) -> Result<(), String> {
    const CHANNEL_BYTES: usize = 2;
    let entries = index.get(CHANNEL_BYTES..).and_then(|rest| rest.split_first_chunk::<4>());
    let fits = entries.is_some_and(|(length, entries)| {
        u32::from_le_bytes(*length) as usize == entries.len() && entries.len() % 16 == 0
    });
    if fits { Ok(()) } else { Err("a message index that is none".to_owned()) }
}

/// The records of a chunk, none of them unless its checksum holds.
fn unfold(chunk: &[u8], batch: &mut Vec<Record<'static>>) -> Result<(), String> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    let mut reader = LinearReader::new_with_options(options);
    let head: Vec<u8> = std::iter::once(op::CHUNK).chain((chunk.len() as u64).to_le_bytes()).collect();
    // A record behind the chunk: only a chunk that is whole lets the reader come to it.
    let tail: Vec<u8> = std::iter::once(SENTINEL).chain(0_u64.to_le_bytes()).collect();
    let mut bytes = head.as_slice().chain(chunk).chain(tail.as_slice());
    let wanted_max = head.len() + chunk.len() + tail.len();
    let mut came_through = false;
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| error.to_string())? {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = bytes.read(reader.insert(wanted.min(wanted_max)));
                let count = read.map_err(|error| error.to_string())?;
                if count == 0 {
                    break;
                }
                reader.notify_read(count);
            }
            LinearReadEvent::Record { opcode, data } => {
                came_through = opcode == SENTINEL && data.is_empty();
                let record = parse_record(opcode, data).map_err(|error| error.to_string())?;
                batch.push(record.into_owned());
            }
        }
    }
    if came_through { Ok(()) } else { Err("a chunk that is not whole".to_owned()) }
}
