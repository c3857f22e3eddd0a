//! When a segment ends, what is kept, and how much of the disk is left alone.

use quantity::Span;

/// A segment's length in time unless said otherwise.
pub const SEGMENT_SPAN: Span = Span::from_secs(60);
/// A segment's length in bytes unless said otherwise.
pub const SEGMENT_BYTES: u64 = 256 << 20;
/// Free bytes on the disk at which a recording seals and stops, unless said otherwise.
pub const MIN_FREE_BYTES: u64 = 512 << 20;

/// How many of the sealed segments of a recording are kept; the oldest give way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// All of them.
    #[default]
    All,
    /// So many.
    Segments(usize),
    /// As many as fit into so many bytes, and always the newest.
    Bytes(u64),
}

/// When a segment ends, what is kept, and how much of the disk is left alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// A segment ends after so much time; `None` for never.
    pub segment_span: Option<Span>,
    /// A segment ends at so many bytes; `None` for never.
    pub segment_bytes: Option<u64>,
    /// Which sealed segments are kept.
    pub keep: Keep,
    /// With fewer free bytes on the disk the recording seals and stops; with twice as many it warns.
    pub min_free_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            segment_span: Some(SEGMENT_SPAN),
            segment_bytes: Some(SEGMENT_BYTES),
            keep: Keep::All,
            min_free_bytes: MIN_FREE_BYTES,
        }
    }
}

impl Limits {
    /// One file, as long as it gets.
    #[must_use]
    pub fn one_file() -> Self {
        Self { segment_span: None, segment_bytes: None, ..Self::default() }
    }

    /// With fewer free bytes than these there is a warning.
    #[must_use]
    pub fn warn_free_bytes(&self) -> u64 {
        self.min_free_bytes.saturating_mul(2)
    }

    /// How many of these sealed segments, from the oldest on, give way. `bytes` are their sizes, oldest
    /// first.
    pub(super) fn surplus(&self, bytes: &[u64]) -> usize {
        match self.keep {
            Keep::All => 0,
            Keep::Segments(count) => bytes.len().saturating_sub(count.max(1)),
            Keep::Bytes(limit) => {
                let mut sum = 0_u64;
                let fitting = bytes.iter().rev().take_while(|size| {
                    sum = sum.saturating_add(**size);
                    sum <= limit
                });
                bytes.len() - fitting.count().max(1).min(bytes.len())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surplus(keep: Keep, bytes: &[u64]) -> usize {
        Limits { keep, ..Limits::default() }.surplus(bytes)
    }

    #[test]
    fn the_oldest_give_way_and_the_newest_stays() {
        assert_eq!(surplus(Keep::All, &[1; 100]), 0);
        assert_eq!(surplus(Keep::Segments(3), &[1; 5]), 2);
        assert_eq!(surplus(Keep::Segments(3), &[1; 3]), 0);
        assert_eq!(surplus(Keep::Segments(0), &[1; 3]), 2);
        assert_eq!(surplus(Keep::Bytes(10), &[5, 5, 5]), 1);
        assert_eq!(surplus(Keep::Bytes(15), &[5, 5, 5]), 0);
        assert_eq!(surplus(Keep::Bytes(1), &[5, 5, 5]), 2);
        assert_eq!(surplus(Keep::Bytes(u64::MAX), &[u64::MAX, u64::MAX]), 0);
        assert_eq!(surplus(Keep::Bytes(1), &[]), 0);
    }
}
