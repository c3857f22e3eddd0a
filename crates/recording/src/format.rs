//! What stands in a recording besides messages: the names and the metadata that writer and reader share.

use std::collections::BTreeMap;

use quantity::Time;
use thiserror::Error;
use wire::{Domain, Kind};

/// The profile of our files: bodies and definitions are those of ROS 1.
pub const PROFILE: &str = "ros1";
/// The encoding of message bodies.
pub const MESSAGE_ENCODING: &str = "ros1";
/// The encoding of definitions.
pub const SCHEMA_ENCODING: &str = "ros1msg";
/// Name of the attachment that holds the settings the arena ran with, as one resolved TOML file.
pub const SETTINGS_FILE: &str = "settings.toml";

/// One channel of a recording: what one sender said on one topic, in one incarnation and under one definition.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stream {
    /// The topic.
    pub topic: String,
    /// Data or journal.
    pub kind: Kind,
    /// Which node instance said it.
    pub source: u32,
    /// Which start of that instance.
    pub incarnation: u32,
    /// The domain it was said in.
    pub domain: Domain,
    /// The run it was said in.
    pub run: u64,
    /// Schema id of the bodies, as in the datagrams' headers.
    pub schema_id: u64,
    /// Whether whoever comes late wants the newest of it.
    pub latched: bool,
    /// Whether the recorder could check the sender's tag: it cannot for topics that are not in its topic table.
    pub verified: bool,
}

/// A definition as it is announced on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Definition {
    /// FNV-1a-64 of name, NUL and text.
    pub id: u64,
    /// `package/Type`.
    pub name: String,
    /// `ros1msg` text.
    pub text: String,
}

/// One datagram on its way into a recording.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    /// When it arrived: the kernel's stamp, in the arena's time.
    pub at: Time,
    /// Its header.
    pub header: &'a wire::Header,
    /// Its topic.
    pub topic: &'a str,
    /// Whether its tag was checked.
    pub verified: bool,
    /// Its body, as it came.
    pub body: &'a [u8],
}

/// Metadata that are not ours, or not whole.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FormatError {
    /// A key that metadata of ours have is not there.
    #[error("{of}: no {key} in its metadata")]
    Missing {
        /// The channel's topic, or the record's name.
        of: String,
        /// The key.
        key: &'static str,
    },
    /// A value that cannot be.
    #[error("{of}: {key} = {value:?} is {reason}")]
    Value {
        /// The channel's topic, or the record's name.
        of: String,
        /// The key.
        key: &'static str,
        /// What stands there.
        value: String,
        /// Why it cannot be.
        reason: &'static str,
    },
}

impl Stream {
    /// The stream of a datagram.
    #[must_use]
    pub fn of(entry: &Entry<'_>) -> Self {
        let header = entry.header;
        Self {
            topic: entry.topic.to_owned(),
            kind: header.kind,
            source: header.source,
            incarnation: header.incarnation,
            domain: header.domain,
            run: header.run,
            schema_id: header.schema_id,
            latched: header.latched,
            verified: entry.verified,
        }
    }

    /// What stands in the channel's metadata: ids in hexadecimal, counts in decimal.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let kind = if self.kind == Kind::Journal { "journal" } else { "data" };
        [
            ("source", format!("{:08x}", self.source)),
            ("incarnation", self.incarnation.to_string()),
            ("domain", self.domain.name().to_owned()),
            ("run", format!("{:016x}", self.run)),
            ("schema_id", format!("{:016x}", self.schema_id)),
            ("kind", kind.to_owned()),
            ("latched", self.latched.to_string()),
            ("verified", self.verified.to_string()),
        ]
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
    }

    /// The stream that a channel's topic and metadata describe.
    ///
    /// # Errors
    /// A key that is not there, or a value that cannot be.
    pub fn from_metadata(topic: &str, metadata: &BTreeMap<String, String>) -> Result<Self, FormatError> {
        let fields = Fields { of: topic, metadata };
        Ok(Self {
            topic: topic.to_owned(),
            kind: fields.one_of("kind", &[("data", Kind::Data), ("journal", Kind::Journal)])?,
            source: u32::try_from(fields.hexadecimal("source")?)
                .map_err(|_| fields.refused("source", "no number of 32 bits"))?,
            incarnation: fields.number("incarnation")?,
            domain: fields.domain("domain")?,
            run: fields.hexadecimal("run")?,
            schema_id: fields.hexadecimal("schema_id")?,
            latched: fields.one_of("latched", &[("true", true), ("false", false)])?,
            verified: fields.one_of("verified", &[("true", true), ("false", false)])?,
        })
    }
}

/// Metadata being read.
pub(crate) struct Fields<'a> {
    /// The channel's topic, or the record's name.
    pub of: &'a str,
    /// The metadata.
    pub metadata: &'a BTreeMap<String, String>,
}

impl Fields<'_> {
    pub(crate) fn text(&self, key: &'static str) -> Result<String, FormatError> {
        let missing = || FormatError::Missing { of: self.of.to_owned(), key };
        self.metadata.get(key).cloned().ok_or_else(missing)
    }

    pub(crate) fn number<T: std::str::FromStr>(&self, key: &'static str) -> Result<T, FormatError> {
        self.text(key)?.parse().map_err(|_| self.refused(key, "no number, or too great"))
    }

    pub(crate) fn hexadecimal(&self, key: &'static str) -> Result<u64, FormatError> {
        u64::from_str_radix(&self.text(key)?, 16).map_err(|_| self.refused(key, "no hexadecimal number"))
    }

    pub(crate) fn domain(&self, key: &'static str) -> Result<Domain, FormatError> {
        self.one_of(key, &[("live", Domain::Live), ("sim", Domain::Sim), ("replay", Domain::Replay)])
    }

    fn one_of<T: Copy>(&self, key: &'static str, known: &[(&str, T)]) -> Result<T, FormatError> {
        let text = self.text(key)?;
        let found = known.iter().find(|(word, _)| *word == text).map(|(_, value)| *value);
        found.ok_or_else(|| self.refused(key, "none of the known words"))
    }

    fn refused(&self, key: &'static str, reason: &'static str) -> FormatError {
        let value = self.metadata.get(key).cloned().unwrap_or_default();
        FormatError::Value { of: self.of.to_owned(), key, value, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream() -> Stream {
        Stream {
            topic: "vehicle/state".to_owned(),
            kind: Kind::Journal,
            source: 0xdead_beef,
            incarnation: 17,
            domain: Domain::Sim,
            run: 0x0123_4567_89ab_cdef,
            schema_id: 5,
            latched: true,
            verified: false,
        }
    }

    #[test]
    fn a_stream_survives_its_metadata() {
        let stream = stream();
        assert_eq!(Stream::from_metadata(&stream.topic, &stream.metadata()), Ok(stream));
    }

    #[test]
    fn what_is_missing_or_cannot_be_is_named() {
        for key in stream().metadata().keys() {
            let mut metadata = stream().metadata();
            metadata.remove(key);
            let error = Stream::from_metadata("a/b", &metadata).unwrap_err().to_string();
            assert!(error.contains("a/b") && error.contains(key.as_str()), "{error}");
            metadata.insert(key.clone(), "nonsense".to_owned());
            let error = Stream::from_metadata("a/b", &metadata).unwrap_err().to_string();
            assert!(error.contains(key.as_str()) && error.contains("nonsense"), "{error}");
        }
    }
}
