//! Making a whole file of a torn one: everything up to the first damage, and an account of what is missing.

mod records;
#[cfg(test)]
mod tests;

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::Path;

use mcap::records::{Metadata, Record, op};
use mcap::write::NoSeek;
use quantity::Time;
use thiserror::Error;

use crate::segment::{Host, Storage as _};
use crate::write::{Shelf, WriteOptions, Writing};
use crate::{ENDING_RECORD, Ending};
use records::{Records, Torn};

/// What recovery made of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Messages kept.
    pub messages: u64,
    /// Channels kept.
    pub channels: u64,
    /// Arrival of the earliest and latest message kept; `None` without messages.
    pub range: Option<(Time, Time)>,
    /// Bytes of the damaged file that were kept.
    pub kept_bytes: u64,
    /// Bytes of the damaged file.
    pub total_bytes: u64,
    /// What is missing; `None` if the file was whole.
    pub missing: Option<Missing>,
}

/// What of a damaged file could not be kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// Where the damage begins.
    pub offset: u64,
    /// Bytes from there to the file's end.
    pub bytes: u64,
    /// What is wrong there.
    pub reason: String,
}

/// Why nothing could be recovered.
#[derive(Debug, Error)]
pub enum RecoverError {
    /// The damaged file cannot be read.
    #[error("reading: {0}")]
    Read(io::Error),
    /// It is no recording, not even the beginning of one.
    #[error("no recording: {0}")]
    Foreign(String),
    /// The recovered file cannot be written.
    #[error("writing: {0}")]
    Write(io::Error),
}

/// Copies everything up to the first damage into a whole file.
///
/// Chunks are taken only if their checksum holds, so what is kept is an exact prefix of what was recorded.
///
/// # Errors
/// The input cannot be read or is no recording, or the output cannot be written. Damage is no error.
pub fn recover(
    input: impl Read,
    total_bytes: u64,
    output: &mut impl Write,
) -> Result<Recovered, RecoverError> {
    let mut records = Records::new(input);
    records.open()?;
    let mut copy = Copy::new(output)?;
    let mut batch = Vec::new();
    let torn = loop {
        batch.clear();
        match records.next_whole(&mut batch)? {
            Ok(None) => break None,
            Ok(Some(())) => {
                if let Err(reason) = copy.accepts(&batch) {
                    break Some(Torn { offset: records.batch_offset(), reason });
                }
                copy.take(&batch)?;
            }
            Err(torn) => break Some(torn),
        }
    };
    let missing = torn.map(|torn| Missing {
        offset: torn.offset,
        bytes: total_bytes.saturating_sub(torn.offset),
        reason: torn.reason,
    });
    let kept_bytes = missing.as_ref().map_or(total_bytes, |missing| missing.offset);
    copy.finish()?;
    let Copy { messages, channels, range, .. } = copy;
    Ok(Recovered { messages, channels: channels.len() as u64, range, kept_bytes, total_bytes, missing })
}

/// Recovers a file into another one, which must not be there; a failure leaves none behind.
///
/// # Errors
/// As of [`recover`]; that the output is there already is an error of writing.
pub fn recover_file(damaged: &Path, output: &Path) -> Result<Recovered, RecoverError> {
    let input = File::open(damaged).map_err(RecoverError::Read)?;
    let total_bytes = input.metadata().map_err(RecoverError::Read)?.len();
    if Host.exists(output) {
        let reason = format!("{} is there already", output.display());
        return Err(RecoverError::Write(io::Error::new(io::ErrorKind::AlreadyExists, reason)));
    }
    let mut draft = output.as_os_str().to_owned();
    draft.push(format!(".draft-{}", std::process::id()));
    let draft = Path::new(&draft);
    let recovered = into_draft(input, total_bytes, draft).and_then(|recovered| {
        Host.rename(draft, output).map_err(RecoverError::Write)?;
        Ok(recovered)
    });
    if recovered.is_err() {
        // It may never have come to be.
        let _ = fs::remove_file(draft);
    }
    recovered
}

fn into_draft(input: File, total_bytes: u64, draft: &Path) -> Result<Recovered, RecoverError> {
    let file = File::options().write(true).create_new(true).open(draft).map_err(RecoverError::Write)?;
    let mut output = BufWriter::new(file);
    let recovered = recover(BufReader::new(input), total_bytes, &mut output)?;
    output.flush().and_then(|()| output.get_ref().sync_all()).map_err(RecoverError::Write)?;
    Ok(recovered)
}

/// The file that is being made.
struct Copy<'o, W: Write> {
    mcap: mcap::Writer<NoSeek<Writing>>,
    shelf: Shelf,
    output: &'o mut W,
    schemas: std::collections::BTreeSet<u16>,
    channels: std::collections::BTreeSet<u16>,
    messages: u64,
    range: Option<(Time, Time)>,
    ended: bool,
}

impl<'o, W: Write> Copy<'o, W> {
    fn new(output: &'o mut W) -> Result<Self, RecoverError> {
        let shelf = Shelf::default();
        let mcap =
            WriteOptions::default().mcap().create(NoSeek::new(shelf.writing())).map_err(from_library)?;
        Ok(Self {
            mcap,
            shelf,
            output,
            schemas: [0].into(),
            channels: std::collections::BTreeSet::new(),
            messages: 0,
            range: None,
            ended: false,
        })
    }

    /// Whether records make sense after what was taken: a checksum proves only that they are as they were
    /// written.
    fn accepts(&self, batch: &[Record<'static>]) -> Result<(), String> {
        let (mut schemas, mut channels) = (self.schemas.clone(), self.channels.clone());
        for record in batch {
            match record {
                Record::Schema { header, .. } => {
                    if header.id == 0 {
                        return Err("a schema with the number 0".to_owned());
                    }
                    schemas.insert(header.id);
                }
                Record::Channel(channel) if !schemas.contains(&channel.schema_id) => {
                    return Err(format!(
                        "channel {} has the unknown schema {}",
                        channel.id, channel.schema_id
                    ));
                }
                Record::Channel(channel) => {
                    channels.insert(channel.id);
                }
                Record::Message { header, .. } if !channels.contains(&header.channel_id) => {
                    return Err(format!("a message on the unknown channel {}", header.channel_id));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn take(&mut self, batch: &[Record<'static>]) -> Result<(), RecoverError> {
        let chunked =
            batch.iter().any(|record| matches!(record.opcode(), op::MESSAGE | op::CHANNEL | op::SCHEMA));
        for record in batch {
            self.take_record(record).map_err(from_library)?;
        }
        if chunked {
            self.mcap.flush().map_err(from_library)?;
        }
        self.shelf.empty_into(self.output).map_err(RecoverError::Write)
    }

    fn take_record(&mut self, record: &Record<'static>) -> mcap::McapResult<()> {
        match record {
            Record::Schema { header, data } => {
                self.mcap.add_schema_with_id(header.id, &header.name, &header.encoding, data)?;
                self.schemas.insert(header.id);
            }
            Record::Channel(channel) => {
                let (encoding, metadata) = (&channel.message_encoding, &channel.metadata);
                self.mcap.add_channel_with_id(
                    channel.id,
                    channel.schema_id,
                    &channel.topic,
                    encoding,
                    metadata,
                )?;
                self.channels.insert(channel.id);
            }
            Record::Message { header, data } => {
                self.mcap.write_to_known_channel(header, data)?;
                self.messages += 1;
                let at = Time::from_nanos(i64::try_from(header.log_time).unwrap_or(i64::MAX));
                self.range = Some(self.range.map_or((at, at), |(first, last)| (first.min(at), last.max(at))));
            }
            Record::Metadata(metadata) => {
                self.ended |= metadata.name == ENDING_RECORD;
                self.mcap.write_metadata(metadata)?;
            }
            Record::Attachment { header, data, .. } => self.mcap.attach(&mcap::Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name.clone(),
                media_type: header.media_type.clone(),
                data: data.clone(),
            })?,
            // Indexes, statistics and the like are made anew.
            _ => {}
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), RecoverError> {
        if !self.ended {
            let ending = Ending {
                stopped_at: self.range.map_or(Time::ZERO, |(_, last)| last),
                reason: "recovered".to_owned(),
                recorded: self.messages,
                ..Ending::default()
            };
            let metadata = Metadata { name: ENDING_RECORD.to_owned(), metadata: ending.metadata() };
            self.mcap.write_metadata(&metadata).map_err(from_library)?;
        }
        self.mcap.finish().map_err(from_library)?;
        self.shelf.empty_into(self.output).map_err(RecoverError::Write)
    }
}

/// The library writes to memory: what it refuses is content, such as two schemas of one number.
fn from_library(error: mcap::McapError) -> RecoverError {
    RecoverError::Foreign(error.to_string())
}
