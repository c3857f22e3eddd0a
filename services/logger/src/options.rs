//! The command line of whatever records.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use quantity::Span;
use recording::{Compression, Keep, Limits, MIN_FREE_BYTES, SEGMENT_BYTES, SEGMENT_SPAN, WriteOptions};

/// How chunks are compressed, as people write it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CompressionOption {
    /// Not at all.
    None,
    /// Fast.
    #[default]
    Lz4,
    /// Smaller, for archives.
    Zstd,
}

/// What is recorded, and into what.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct RecordOptions {
    /// The first file; further segments are numbered [default: SCENARIO-DATE-TIME.mcap]
    pub file: Option<PathBuf>,
    /// End after so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = parse_span)]
    pub duration: Option<Span>,
    /// Keep only the last seconds, in memory; write them on `arena record --dump` or SIGUSR1
    #[arg(long, value_name = "SECONDS", value_parser = parse_span)]
    pub snapshot: Option<Span>,
    /// With --snapshot: the most memory for them
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes, default_value = "256MiB")]
    pub snapshot_bytes: u64,
    /// Begin a new segment after so many seconds; 0 for never
    #[arg(long, value_name = "SECONDS", value_parser = parse_span, default_value = "60")]
    pub segment_span: Span,
    /// Begin a new segment at this size; 0 for never
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes, default_value = "256MiB")]
    pub segment_bytes: u64,
    /// Keep so many sealed segments, or so many bytes of them (with a unit, such as 10GiB); the oldest are
    /// deleted
    #[arg(long, value_name = "N|SIZE", value_parser = parse_keep)]
    pub keep: Option<Keep>,
    /// Seal and stop when the disk has less free than this; warn at twice as much
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes, default_value = "512MiB")]
    pub min_free: u64,
    /// How chunks are compressed
    #[arg(long, value_enum, default_value_t)]
    pub compression: CompressionOption,
}

impl Default for RecordOptions {
    fn default() -> Self {
        Self {
            file: None,
            duration: None,
            snapshot: None,
            snapshot_bytes: 256 << 20,
            segment_span: SEGMENT_SPAN,
            segment_bytes: SEGMENT_BYTES,
            keep: None,
            min_free: MIN_FREE_BYTES,
            compression: CompressionOption::default(),
        }
    }
}

impl RecordOptions {
    pub(crate) fn limits(&self) -> Limits {
        Limits {
            segment_span: (self.segment_span > Span::ZERO).then_some(self.segment_span),
            segment_bytes: (self.segment_bytes > 0).then_some(self.segment_bytes),
            keep: self.keep.unwrap_or_default(),
            min_free_bytes: self.min_free,
        }
    }

    pub(crate) fn write_options(&self) -> WriteOptions {
        let compression = match self.compression {
            CompressionOption::None => Compression::None,
            CompressionOption::Lz4 => Compression::Lz4,
            CompressionOption::Zstd => Compression::Zstd,
        };
        WriteOptions { compression, ..WriteOptions::default() }
    }
}

/// Reads a number of seconds, not negative, at most a year.
///
/// # Errors
/// What is wrong with it.
pub fn parse_span(text: &str) -> Result<Span, String> {
    const YEAR_S: f64 = 366.0 * 86_400.0;
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=YEAR_S).contains(&seconds) => Ok(Span::from_secs_f64(seconds)),
        Ok(seconds) => Err(format!("{seconds} is not between 0 and {YEAR_S} seconds")),
        Err(_) => Err(format!("{text:?} is not a number of seconds")),
    }
}

/// Reads a size in bytes, with or without a unit: `4096`, `64KiB`, `256MiB`, `10GiB`, `10GB`.
///
/// # Errors
/// What is wrong with it.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[digits.len()..] {
        "" | "B" => 1,
        "KiB" => 1 << 10,
        "MiB" => 1 << 20,
        "GiB" => 1 << 30,
        "TiB" => 1 << 40,
        "kB" | "KB" => 1_000,
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        "TB" => 1_000_000_000_000,
        other => {
            return Err(format!("{text:?}: {other:?} is no unit; there are B, KiB, MiB, GiB, kB, MB, GB"));
        }
    };
    let count: u64 = digits.parse().map_err(|_| format!("{text:?} is not a size such as 256MiB"))?;
    count.checked_mul(unit).ok_or_else(|| format!("{text:?} is more than there are bytes to count"))
}

/// Reads what is kept: a plain number of segments, or a size with a unit.
///
/// # Errors
/// What is wrong with it.
pub fn parse_keep(text: &str) -> Result<Keep, String> {
    let keep = if text.chars().all(|c| c.is_ascii_digit()) {
        let count = text.parse().map_err(|_| format!("{text:?} is not a number of segments"))?;
        Keep::Segments(count)
    } else {
        Keep::Bytes(parse_bytes(text)?)
    };
    match keep {
        Keep::Segments(0) | Keep::Bytes(0) => Err(format!("{text:?}: the newest segment is always kept")),
        keep => Ok(keep),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct CommandLine {
        #[command(flatten)]
        record: RecordOptions,
    }

    #[test]
    fn no_arguments_mean_the_defaults() {
        assert_eq!(CommandLine::parse_from(["logger"]).record, RecordOptions::default());
        assert_eq!(RecordOptions::default().limits(), Limits::default());
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(parse_bytes("0"), Ok(0));
        assert_eq!(parse_bytes("4096"), Ok(4096));
        assert_eq!(parse_bytes("64KiB"), Ok(65_536));
        assert_eq!(parse_bytes("1GB"), Ok(1_000_000_000));
        for text in ["", "MiB", "-1", "1.5GiB", "1 GiB", "5GIB", "99999999999TiB"] {
            assert!(parse_bytes(text).unwrap_err().contains(text), "{text}");
        }
    }

    #[test]
    fn what_is_kept_is_counted_or_weighed() {
        assert_eq!(parse_keep("10"), Ok(Keep::Segments(10)));
        assert_eq!(parse_keep("10GiB"), Ok(Keep::Bytes(10 << 30)));
        for text in ["0", "0MiB", "", "ten"] {
            assert!(parse_keep(text).is_err(), "{text}");
        }
    }

    #[test]
    fn spans_are_seconds() {
        assert_eq!(parse_span("0.5"), Ok(Span::from_millis(500)));
        for text in ["-1", "NaN", "inf", "1s", "1e300"] {
            assert!(parse_span(text).is_err(), "{text}");
        }
    }
}
