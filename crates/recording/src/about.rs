//! What a segment says of itself: at its beginning, and, if it was sealed, at its end.

use std::collections::BTreeMap;

use quantity::Time;
use wire::Domain;

use crate::FormatError;
use crate::format::Fields;

/// Name of the metadata record at a segment's beginning.
pub const ABOUT_RECORD: &str = "flyarena.recording";
/// Name of the metadata record at a sealed segment's end.
pub const ENDING_RECORD: &str = "flyarena.ending";
/// Name of the metadata record with what each stream lost; written beside the ending.
pub const LOSSES_RECORD: &str = "flyarena.losses";

/// What a segment says of itself at its beginning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct About {
    /// Random; the same in all segments of one recording.
    pub recording: u64,
    /// Number of this segment, from zero.
    pub segment: u32,
    /// The arena's run.
    pub run: u64,
    /// The domain.
    pub domain: Domain,
    /// The scenario's name.
    pub scenario: String,
    /// Digest of the settings, which are attached.
    pub settings_digest: u64,
    /// When the segment was begun, in the arena's time.
    pub started_at: Time,
    /// The same instant on the wall clock, ns since 1970: what turns the arena's time into a date.
    pub started_wall_ns: i64,
    /// The host's name.
    pub host: String,
    /// Revision of the source tree that the recorder ran in; empty if there was none.
    pub revision: String,
}

/// What a segment says of itself when it is sealed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ending {
    /// When it was sealed, in the arena's time.
    pub stopped_at: Time,
    /// Why: `stopped`, `segment full`, `disk full`, a write error in words, `recovered`.
    pub reason: String,
    /// Messages in this segment.
    pub recorded: u64,
    /// Messages that the recorder dropped since its start because the disk was too slow.
    pub dropped_full: u64,
    /// Messages that the recorder dropped since its start because no file was open.
    pub dropped_stopped: u64,
    /// Datagrams refused since the recorder's start: not authentic, not of this run.
    pub refused: u64,
    /// Datagrams that the kernel dropped since the recorder's start.
    pub overflowed: u64,
}

impl About {
    /// The metadata record's content.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<String, String> {
        owned([
            ("recording", format!("{:016x}", self.recording)),
            ("segment", self.segment.to_string()),
            ("run", format!("{:016x}", self.run)),
            ("domain", self.domain.name().to_owned()),
            ("scenario", self.scenario.clone()),
            ("settings_digest", format!("{:016x}", self.settings_digest)),
            ("started_at_ns", self.started_at.as_nanos().to_string()),
            ("started_wall_ns", self.started_wall_ns.to_string()),
            ("host", self.host.clone()),
            ("revision", self.revision.clone()),
        ])
    }

    /// Reads the metadata record's content.
    ///
    /// # Errors
    /// A key that is not there, or a value that cannot be.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, FormatError> {
        let fields = Fields { of: ABOUT_RECORD, metadata };
        Ok(Self {
            recording: fields.hexadecimal("recording")?,
            segment: fields.number("segment")?,
            run: fields.hexadecimal("run")?,
            domain: fields.domain("domain")?,
            scenario: fields.text("scenario")?,
            settings_digest: fields.hexadecimal("settings_digest")?,
            started_at: Time::from_nanos(fields.number("started_at_ns")?),
            started_wall_ns: fields.number("started_wall_ns")?,
            host: fields.text("host")?,
            revision: fields.text("revision")?,
        })
    }
}

impl Ending {
    /// The metadata record's content.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<String, String> {
        owned([
            ("stopped_at_ns", self.stopped_at.as_nanos().to_string()),
            ("reason", self.reason.clone()),
            ("recorded", self.recorded.to_string()),
            ("dropped_full", self.dropped_full.to_string()),
            ("dropped_stopped", self.dropped_stopped.to_string()),
            ("refused", self.refused.to_string()),
            ("overflowed", self.overflowed.to_string()),
        ])
    }

    /// Reads the metadata record's content.
    ///
    /// # Errors
    /// A key that is not there, or a value that cannot be.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, FormatError> {
        let fields = Fields { of: ENDING_RECORD, metadata };
        Ok(Self {
            stopped_at: Time::from_nanos(fields.number("stopped_at_ns")?),
            reason: fields.text("reason")?,
            recorded: fields.number("recorded")?,
            dropped_full: fields.number("dropped_full")?,
            dropped_stopped: fields.number("dropped_stopped")?,
            refused: fields.number("refused")?,
            overflowed: fields.number("overflowed")?,
        })
    }
}

fn owned<const N: usize>(fields: [(&str, String); N]) -> BTreeMap<String, String> {
    fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_survive_their_metadata() {
        let about = About {
            recording: 1,
            segment: 2,
            run: u64::MAX,
            domain: Domain::Live,
            scenario: "double-flip".to_owned(),
            settings_digest: 4,
            started_at: Time::from_nanos(5),
            started_wall_ns: -6,
            host: "a host".to_owned(),
            revision: String::new(),
        };
        assert_eq!(About::from_metadata(&about.metadata()), Ok(about));
        let ending = Ending {
            stopped_at: Time::from_nanos(1),
            reason: "disk full".to_owned(),
            recorded: 2,
            dropped_full: 3,
            dropped_stopped: 4,
            refused: 5,
            overflowed: 6,
        };
        assert_eq!(Ending::from_metadata(&ending.metadata()), Ok(ending));
    }
}
