//! A recording made in virtual time.
//!
//! It holds what a recorder on the bus would have recorded, had it missed nothing: every datagram at the instant it was
//! sent. Settings and seed decide its every byte. So it knows nothing of the machine and the day: it says that virtual time
//! began in 1970, and names no host and no revision of the source.

use std::io::Write;

use recording::{About, Compression, Ending, WriteError, WriteOptions, Writer};
use service_core::Observed;
use settings::Arena;
use virtual_arena::{Heard, VirtualArena};
use wire::Domain;

/// Chunks of so many bytes compress well, and are still read in no time.
const CHUNK_BYTES: usize = 1 << 20;

/// Writes what is heard in an arena in virtual time.
pub struct VirtualRecording<W: Write> {
    writer: Writer<W>,
    /// The first write that failed; nothing is written after it.
    failed: Option<WriteError>,
    ending: Ending,
}

impl<W: Write> VirtualRecording<W> {
    /// Begins a recording of an arena in which nothing has happened yet.
    ///
    /// # Errors
    /// The sink refuses.
    pub fn begin(sink: W, flying: &VirtualArena<'_>, settings: &Arena) -> Result<Self, WriteError> {
        let started_at = flying.now();
        let about = About {
            // The run's number is drawn from the seed, and as good as random.
            recording: flying.run(),
            segment: 0,
            run: flying.run(),
            domain: Domain::Sim,
            scenario: settings.name.clone(),
            settings_digest: settings.digest(),
            started_at,
            started_wall_ns: started_at.as_nanos(),
            host: String::new(),
            revision: String::new(),
        };
        let options = WriteOptions { compression: Compression::Zstd, chunk_bytes: CHUNK_BYTES };
        let writer = Writer::new(sink, options, &about, Some(settings))?;
        Ok(Self { writer, failed: None, ending: Ending::default() })
    }

    /// Writes a datagram. An error waits for [`VirtualRecording::finish`]: the flight goes on.
    pub fn hear(&mut self, heard: &Heard<'_>) {
        if self.failed.is_some() {
            return;
        }
        self.ending.stopped_at = heard.at;
        let opened = wire::open(heard.published.datagram).expect("the arena's own nodes have just sealed it");
        let observed = Observed {
            header: *opened.claimed(),
            topic: opened.topic(),
            body: heard.published.body,
            verified: true,
        };
        if let Err(error) = self.writer.observe(heard.at, &observed) {
            self.failed = Some(error);
        }
    }

    /// Seals the recording, and gives the sink back.
    ///
    /// # Errors
    /// The first write that failed.
    pub fn finish(self) -> Result<W, WriteError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        let recorded = self.writer.messages();
        let ending = Ending { reason: "stopped".to_owned(), recorded, ..self.ending };
        self.writer.finish(&ending, &[])
    }
}
