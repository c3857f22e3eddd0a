//! Which sequence numbers were seen: a sliding window of 1024 bits per source, topic and kind.

use std::collections::BTreeMap;

use crate::Kind;

/// How far behind the newest sequence number one may arrive and still be told from a replay.
pub const WINDOW_BITS: u64 = 1024;

/// Sources and topics remembered at most. Only authentic datagrams get this far; an arena has some hundreds.
const WINDOWS_MAX: usize = 8192;

const WORDS: usize = (WINDOW_BITS / 64) as usize;

/// What a sequence number is to its window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// Never seen: act on it.
    Fresh,
    /// Seen before.
    Duplicate,
    /// Too far behind the newest to tell.
    TooOld,
    /// From before the node's last known start.
    OldIncarnation,
    /// The first of a source and topic for which no memory is left.
    NoRoom,
}

/// What sequence numbers tell of the way a source's datagrams came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceCounts {
    /// Accepted.
    pub accepted: u64,
    /// Numbers skipped and, so far, not come late.
    pub lost: u64,
    /// Accepted though a later number had come before.
    pub reordered: u64,
    /// Refused as seen before.
    pub duplicates: u64,
    /// Refused as too far behind, or of an earlier incarnation.
    pub stale: u64,
}

/// The window of one source and topic, through all its incarnations.
#[derive(Clone, Debug)]
pub struct Window {
    incarnation: u32,
    /// The first number of this incarnation that came: what was before it may have been sent before we listened.
    first: u64,
    highest: u64,
    /// Bit `s % 1024` says whether `s` was seen, for the 1024 numbers up to the highest.
    seen: [u64; WORDS],
    counts: SequenceCounts,
}

impl Window {
    /// The window after the first datagram of a source and topic.
    #[must_use]
    pub fn new(incarnation: u32, sequence: u64) -> Self {
        let counts = SequenceCounts {
            accepted: 1,
            ..SequenceCounts::default()
        };
        let mut window = Self {
            incarnation,
            first: sequence,
            highest: sequence,
            seen: [0; WORDS],
            counts,
        };
        window.mark(sequence);
        window
    }

    /// Takes note of a datagram and says whether to act on it.
    pub fn accept(&mut self, incarnation: u32, sequence: u64) -> Freshness {
        if incarnation < self.incarnation {
            self.counts.stale += 1;
            return Freshness::OldIncarnation;
        }
        if incarnation > self.incarnation {
            let counts = self.counts;
            *self = Self::new(incarnation, sequence);
            self.counts = SequenceCounts {
                accepted: counts.accepted + 1,
                ..counts
            };
            return Freshness::Fresh;
        }
        if sequence > self.highest {
            self.counts.lost += sequence - self.highest - 1;
            self.advance(sequence);
        } else {
            if self.highest - sequence >= WINDOW_BITS {
                self.counts.stale += 1;
                return Freshness::TooOld;
            }
            if self.is_marked(sequence) {
                self.counts.duplicates += 1;
                return Freshness::Duplicate;
            }
            self.counts.reordered += 1;
            if sequence > self.first {
                self.counts.lost -= 1;
            }
        }
        self.mark(sequence);
        self.counts.accepted += 1;
        Freshness::Fresh
    }

    /// What the numbers told so far, over all incarnations.
    #[must_use]
    pub const fn counts(&self) -> SequenceCounts {
        self.counts
    }

    /// Makes `sequence` the highest and forgets what falls out of the window.
    fn advance(&mut self, sequence: u64) {
        if sequence - self.highest >= WINDOW_BITS {
            self.seen = [0; WORDS];
        } else {
            for passed in self.highest + 1..=sequence {
                self.seen[word(passed)] &= !bit(passed);
            }
        }
        self.highest = sequence;
    }

    fn mark(&mut self, sequence: u64) {
        self.seen[word(sequence)] |= bit(sequence);
    }

    const fn is_marked(&self, sequence: u64) -> bool {
        self.seen[word(sequence)] & bit(sequence) != 0
    }
}

const fn word(sequence: u64) -> usize {
    (sequence % WINDOW_BITS / 64) as usize
}

const fn bit(sequence: u64) -> u64 {
    1 << (sequence % 64)
}

/// Whose sequence numbers they are: source, topic hash, and kind. The kind is part of it because schemas and journals
/// are signed with a key that every node holds, and must not move the window of another node's commands.
pub type Stream = (u32, u32, Kind);

/// The windows of everything a node listens to.
#[derive(Clone, Debug, Default)]
pub struct Windows {
    windows: BTreeMap<Stream, Window>,
}

impl Windows {
    /// No datagram seen.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            windows: BTreeMap::new(),
        }
    }

    /// Takes note of an authentic datagram and says whether to act on it.
    pub fn accept(&mut self, stream: Stream, incarnation: u32, sequence: u64) -> Freshness {
        if let Some(window) = self.windows.get_mut(&stream) {
            return window.accept(incarnation, sequence);
        }
        if self.windows.len() >= WINDOWS_MAX {
            return Freshness::NoRoom;
        }
        self.windows.insert(stream, Window::new(incarnation, sequence));
        Freshness::Fresh
    }

    /// What the numbers told of each stream.
    pub fn counts(&self) -> impl Iterator<Item = (Stream, SequenceCounts)> {
        self.windows
            .iter()
            .map(|(stream, window)| (*stream, window.counts()))
    }

    /// Sequence numbers that never came, over all streams.
    #[must_use]
    pub fn lost_total(&self) -> u64 {
        self.windows.values().map(|window| window.counts.lost).sum()
    }
}
