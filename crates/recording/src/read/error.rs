//! Why something in a recording cannot be read.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use settings::ConfigError;
use thiserror::Error;

use crate::FormatError;

/// Why something in a recording cannot be read. Cheap to clone: one damaged chunk may be met many times.
#[derive(Clone, Debug, Error)]
pub enum ReadError {
    /// The system did not give the file's bytes.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: Arc<std::io::Error>,
    },
    /// The file does not begin as MCAP files do.
    #[error("{}: no MCAP file: it begins with {found}", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes, in hexadecimal.
        found: String,
    },
    /// Bytes that cannot be what was written.
    #[error("{}: damaged at byte {offset}: {defect}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the damaged record begins.
        offset: u64,
        /// What is wrong with it.
        defect: Defect,
    },
    /// Metadata of ours that cannot be.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// The attached settings are no settings.
    #[error("{}: {source}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        source: Arc<ConfigError>,
    },
}

/// What is wrong with a record.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Defect {
    /// Two values that must agree do not.
    #[error("{what} is {found}, not {expected}")]
    Mismatch {
        /// What was compared.
        what: &'static str,
        /// The value in the file.
        found: Shown,
        /// What it must be.
        expected: Shown,
    },
    /// A value beyond what this reader takes.
    #[error("{what} is {found}, at most {limit} is taken")]
    Limit {
        /// What was too great.
        what: &'static str,
        /// The value in the file.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// A record that cannot be parsed as what its code says.
    #[error("{0} cannot be parsed")]
    Unparsable(&'static str),
    /// Something that every file of ours has is not there.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A record where none of its code may stand.
    #[error("a record of code {0:#04x}, which cannot stand here")]
    Misplaced(u8),
    /// A chunk whose compression this reader does not know, or whose compressed bytes do not unpack.
    #[error("{0}")]
    Compression(String),
    /// A message on a channel that nothing defines.
    #[error("a message on channel {0}, which is defined nowhere")]
    UnknownChannel(u16),
    /// One id defined in two ways.
    #[error("{what} {id} is defined twice, differently")]
    Conflict {
        /// Channel or schema.
        what: &'static str,
        /// Its id.
        id: u16,
    },
}

/// A number as an error shows it: sizes and counts in decimal, checksums in hexadecimal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// A size, count or time.
    Count(u64),
    /// A checksum.
    Checksum(u32),
}

impl fmt::Display for Shown {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(formatter, "{count}"),
            Self::Checksum(checksum) => write!(formatter, "{checksum:#010x}"),
        }
    }
}

impl Defect {
    pub(crate) const fn count(what: &'static str, found: u64, expected: u64) -> Self {
        Self::Mismatch { what, found: Shown::Count(found), expected: Shown::Count(expected) }
    }

    pub(crate) const fn checksum(what: &'static str, found: u32, expected: u32) -> Self {
        Self::Mismatch { what, found: Shown::Checksum(found), expected: Shown::Checksum(expected) }
    }
}
