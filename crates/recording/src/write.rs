//! Writing a recording: messages into compressed chunks, chunks into a sink.
//!
//! The sink gets whole records only, one block of them per `write`: whatever of its blocks a file holds
//! completely can be read, and what follows can be cut off.

mod channels;
mod losses;
mod shelf;
#[cfg(test)]
mod tests;

use std::io::{self, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use quantity::{Span, Time};
use service_core::Observed;
use settings::Arena;
use thiserror::Error;
use wire::Kind;

use crate::{
    ABOUT_RECORD, About, Definition, ENDING_RECORD, Ending, Entry, LOSSES_RECORD, PROFILE, SETTINGS_FILE,
};
use channels::Channels;
pub use losses::{GAP_RECORD, Gap, Loss, losses_from_metadata, losses_metadata};
pub(crate) use shelf::{Shelf, Writing};

/// A chunk is closed when so much stands in it, before compression.
pub const CHUNK_BYTES: usize = 256 * 1024;
/// The oldest message of an open chunk waits at most this long for the chunk to be closed.
pub const CHUNK_SPAN: Span = Span::from_millis(100);
/// What the format adds to each message of a chunk: opcode, length, and the message's header.
const MESSAGE_OVERHEAD_BYTES: usize = 9 + 22;

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// Fast: for live recordings.
    #[default]
    Lz4,
    /// Smaller: for archives.
    Zstd,
}

/// How a recording is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// A chunk is closed when so much stands in it, before compression.
    pub chunk_bytes: usize,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { compression: Compression::default(), chunk_bytes: CHUNK_BYTES }
    }
}

impl WriteOptions {
    pub(crate) fn mcap(self) -> mcap::WriteOptions {
        let (compression, level) = match self.compression {
            Compression::None => (None, 0),
            Compression::Lz4 => (Some(mcap::Compression::Lz4), 0),
            Compression::Zstd => (Some(mcap::Compression::Zstd), 1),
        };
        mcap::WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("flyarena ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_level(level)
            .compression_threads(0)
            // Only so are chunks kept in memory until they are whole.
            .disable_seeking(true)
            // Chunks are closed here, by size and by age.
            .chunk_size(None)
    }
}

/// Why something could not be written.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The sink refuses; from now on it gets nothing more.
    #[error("{0}")]
    Sink(#[from] io::Error),
    /// The sink refused before.
    #[error("nothing is written after a failed write")]
    Latched,
    /// An instant before the clock's zero has no place in the format.
    #[error("{topic}: time {nanos} ns is before the clock's zero")]
    Time {
        /// The topic.
        topic: String,
        /// The time.
        nanos: i64,
    },
    /// More streams or definitions than a file can tell apart.
    #[error("{topic}: no room for another stream besides {channels}")]
    NoRoom {
        /// The topic, or the definition's name.
        topic: String,
        /// Streams there are.
        channels: usize,
    },
    /// The library refuses.
    #[error("{0}")]
    Format(mcap::McapError),
}

/// What became of something observed on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// A message: it was recorded as one.
    Message,
    /// A definition: it stands in the file once.
    Definition,
    /// Nothing that belongs into a recording: a request, or a definition that is not what its id says.
    Neither,
}

/// Writes one file.
pub struct Writer<W: Write> {
    mcap: mcap::Writer<NoSeek<Writing>>,
    shelf: Shelf,
    sink: W,
    options: WriteOptions,
    channels: Channels,
    latched: bool,
    /// Uncompressed bytes in the open chunk.
    chunk_bytes: usize,
    /// When the oldest message of the open chunk arrived.
    chunk_since: Option<Time>,
    messages: u64,
    committed: u64,
}

impl<W: Write> Writer<W> {
    /// Begins a file: what it says of itself, and the settings, go to the sink at once.
    ///
    /// # Errors
    /// The sink refuses.
    pub fn new(
        sink: W,
        options: WriteOptions,
        about: &About,
        settings: Option<&Arena>,
    ) -> Result<Self, WriteError> {
        let shelf = Shelf::default();
        let mcap = options.mcap().create(NoSeek::new(shelf.writing())).map_err(WriteError::Format)?;
        let mut writer = Self {
            mcap,
            shelf,
            sink,
            options,
            channels: Channels::default(),
            latched: false,
            chunk_bytes: 0,
            chunk_since: None,
            messages: 0,
            committed: 0,
        };
        writer.put_metadata(ABOUT_RECORD, about.metadata())?;
        if let Some(settings) = settings {
            writer.attach_settings(about, settings)?;
        }
        writer.close_chunk()?;
        Ok(writer)
    }

    fn attach_settings(&mut self, about: &About, settings: &Arena) -> Result<(), WriteError> {
        let attachment = mcap::Attachment {
            log_time: nanos_of(SETTINGS_FILE, about.started_at)?,
            create_time: u64::try_from(about.started_wall_ns).unwrap_or(0),
            name: SETTINGS_FILE.to_owned(),
            media_type: "application/toml".to_owned(),
            data: settings.to_toml().into_bytes().into(),
        };
        self.mcap.attach(&attachment).map_err(WriteError::Format)
    }

    /// Takes note of a definition: it is written at once, before the first message that uses it. Messages of
    /// its id that came before it stay on channels without a definition; those to come get channels with it.
    ///
    /// # Errors
    /// The sink has refused before, or the file has no room for another definition.
    pub fn define(&mut self, definition: &Definition) -> Result<(), WriteError> {
        self.refuse_if_latched()?;
        self.channels.define(&mut self.mcap, definition)
    }

    /// Writes a message.
    ///
    /// # Errors The sink refuses, the message's times cannot be written, or the file has no room for another
    /// stream. Except for the sink's, the error concerns this message only.
    pub fn write(&mut self, entry: &Entry<'_>) -> Result<(), WriteError> {
        self.refuse_if_latched()?;
        let log_time = nanos_of(entry.topic, entry.at)?;
        let publish_time = nanos_of(entry.topic, entry.header.published_at)?;
        let bytes = MESSAGE_OVERHEAD_BYTES + entry.body.len();
        if self.chunk_bytes > 0 && self.chunk_bytes + bytes > self.options.chunk_bytes {
            self.close_chunk()?;
        }
        let channel_id = self.channels.id_of(&mut self.mcap, entry)?;
        // The bus counts in 64 bits, the format in 32.
        let sequence = entry.header.sequence as u32;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        self.mcap.write_to_known_channel(&header, entry.body).map_err(WriteError::Format)?;
        self.messages += 1;
        self.chunk_bytes += bytes;
        let since = self.chunk_since.get_or_insert(entry.at);
        *since = entry.at.min(*since);
        Ok(())
    }

    /// Takes whatever was heard on the bus: a message is written, a definition noted. The one call that
    /// recorders make.
    ///
    /// # Errors
    /// As of [`Writer::write`] and [`Writer::define`].
    pub fn observe(&mut self, at: Time, observed: &Observed<'_>) -> Result<Taken, WriteError> {
        match observed.header.kind {
            Kind::Data | Kind::Journal => {
                let Observed { header, topic, body, verified } = *observed;
                self.write(&Entry { at, header: &header, topic: topic.name(), verified, body })?;
                Ok(Taken::Message)
            }
            Kind::Schema => {
                let Some(announced) = observed.definition() else { return Ok(Taken::Neither) };
                if !self.channels.knows(announced.id) {
                    let (name, text) = (announced.name.to_owned(), announced.text.to_owned());
                    self.define(&Definition { id: announced.id, name, text })?;
                }
                Ok(Taken::Definition)
            }
            Kind::SchemaRequest => Ok(Taken::Neither),
        }
    }

    /// Notes that the recorder dropped messages.
    ///
    /// # Errors
    /// The sink refuses.
    pub fn note_gap(&mut self, gap: &Gap) -> Result<(), WriteError> {
        self.refuse_if_latched()?;
        self.put_metadata(GAP_RECORD, gap.metadata())?;
        self.close_chunk()
    }

    /// When the open chunk has to be closed by [`Writer::close_chunk`]; `None` if none is open.
    #[must_use]
    pub fn chunk_due_at(&self) -> Option<Time> {
        self.chunk_since.map(|since| since + CHUNK_SPAN)
    }

    /// Closes the open chunk and hands it to the sink, in one block.
    ///
    /// # Errors
    /// The sink refuses; from now on it gets nothing more.
    pub fn close_chunk(&mut self) -> Result<(), WriteError> {
        self.refuse_if_latched()?;
        self.mcap.flush().map_err(WriteError::Format)?;
        self.chunk_bytes = 0;
        self.chunk_since = None;
        self.hand_over()?;
        self.committed = self.messages;
        Ok(())
    }

    /// Ends the file and gives the sink back. `losses` says what each stream lost on its way.
    ///
    /// # Errors
    /// The sink refuses.
    pub fn finish(mut self, ending: &Ending, losses: &[Loss]) -> Result<W, WriteError> {
        self.seal(ending, losses)?;
        Ok(self.sink)
    }

    /// Ends the file; nothing can be written afterwards.
    pub(crate) fn seal(&mut self, ending: &Ending, losses: &[Loss]) -> Result<(), WriteError> {
        self.close_chunk()?;
        if !losses.is_empty() {
            self.put_metadata(LOSSES_RECORD, losses_metadata(losses))?;
        }
        self.put_metadata(ENDING_RECORD, ending.metadata())?;
        self.mcap.finish().map_err(WriteError::Format)?;
        self.hand_over()?;
        self.sink.flush().inspect_err(|_| self.latched = true)?;
        self.latched = true;
        Ok(())
    }

    /// Messages written, those of the open chunk included.
    #[must_use]
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Messages that the sink has taken.
    #[must_use]
    pub fn committed(&self) -> u64 {
        self.committed
    }

    /// Uncompressed bytes in the open chunk.
    #[must_use]
    pub fn open_chunk_bytes(&self) -> usize {
        self.chunk_bytes
    }

    /// Where the file goes.
    #[must_use]
    pub fn sink(&self) -> &W {
        &self.sink
    }

    pub(crate) fn sink_mut(&mut self) -> &mut W {
        &mut self.sink
    }

    pub(crate) fn into_sink(self) -> W {
        self.sink
    }

    fn refuse_if_latched(&self) -> Result<(), WriteError> {
        if self.latched { Err(WriteError::Latched) } else { Ok(()) }
    }

    fn put_metadata(
        &mut self,
        name: &str,
        metadata: std::collections::BTreeMap<String, String>,
    ) -> Result<(), WriteError> {
        let metadata = Metadata { name: name.to_owned(), metadata };
        self.mcap.write_metadata(&metadata).map_err(WriteError::Format)
    }

    fn hand_over(&mut self) -> Result<(), WriteError> {
        let Self { shelf, sink, latched, .. } = self;
        shelf.empty_into(sink).inspect_err(|_| *latched = true)?;
        Ok(())
    }
}

/// An instant as the format has it.
fn nanos_of(topic: &str, at: Time) -> Result<u64, WriteError> {
    let nanos = at.as_nanos();
    u64::try_from(nanos).map_err(|_| WriteError::Time { topic: topic.to_owned(), nanos })
}
