//! Which sequence numbers were seen: a sliding window of 1024 bits per source, topic and kind.

use std::collections::BTreeMap;

use crate::Kind;

/// How far behind the newest sequence number one may arrive and still be told from a replay.
pub const WINDOW_BITS: u64 = 1024;

/// Streams remembered at most. Only authentic datagrams make one, and an arena has some hundreds; the limit
/// is there because nothing that a network feeds may grow without one.
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
    /// The first of a stream for which no memory is left.
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

/// The window of one source, topic and kind, through all its incarnations.
#[derive(Clone, Debug)]
pub struct Window {
    incarnation: u32,
    /// The first number of this incarnation that came: what was before it may have been sent before we
    /// listened.
    first: u64,
    highest: u64,
    /// Bit `s % 1024` says whether `s` was seen, for the 1024 numbers up to the highest.
    seen: [u64; WORDS],
    counts: SequenceCounts,
}

impl Window {
    /// The window after the first datagram of a stream.
    #[must_use]
    pub fn new(incarnation: u32, sequence: u64) -> Self {
        let counts = SequenceCounts { accepted: 1, ..SequenceCounts::default() };
        let mut window = Self { incarnation, first: sequence, highest: sequence, seen: [0; WORDS], counts };
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
            self.counts = SequenceCounts { accepted: counts.accepted + 1, ..counts };
            return Freshness::Fresh;
        }
        if sequence > self.highest {
            self.counts.lost = self.counts.lost.saturating_add(sequence - self.highest - 1);
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
                self.counts.lost = self.counts.lost.saturating_sub(1);
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

/// Whose sequence numbers they are: source, topic hash and kind. The kind is part of it because schemas and
/// journals are signed with a key that every node holds, and must not move the window of another node's
/// commands.
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
        Self { windows: BTreeMap::new() }
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

    /// What the numbers of each stream told.
    pub fn counts(&self) -> impl Iterator<Item = (Stream, SequenceCounts)> {
        self.windows.iter().map(|(stream, window)| (*stream, window.counts()))
    }

    /// Sequence numbers that never came, over all streams.
    #[must_use]
    pub fn lost_total(&self) -> u64 {
        self.windows.values().fold(0, |sum, window| sum.saturating_add(window.counts.lost))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// The same decisions by remembering everything.
    struct Memory {
        seen: BTreeSet<u64>,
    }

    impl Memory {
        fn accept(&mut self, sequence: u64) -> Freshness {
            let highest = *self.seen.last().expect("it begins with one");
            if sequence <= highest && highest - sequence >= WINDOW_BITS {
                return Freshness::TooOld;
            }
            if self.seen.insert(sequence) { Freshness::Fresh } else { Freshness::Duplicate }
        }
    }

    fn steps() -> impl Strategy<Value = i64> {
        prop_oneof![-40..40_i64, -1100..1100_i64, -5000..5000_i64]
    }

    proptest! {
        #[test]
        fn decides_as_one_who_remembers_everything(
            first in 0..5000_u64, steps in prop::collection::vec(steps(), 1..400),
        ) {
            let mut window = Window::new(1, first);
            let mut memory = Memory { seen: BTreeSet::from([first]) };
            let mut at = first;
            for step in steps {
                at = at.saturating_add_signed(step);
                prop_assert_eq!(window.accept(1, at), memory.accept(at), "sequence {}", at);
            }
            let counts = window.counts();
            prop_assert_eq!(counts.accepted, memory.seen.len() as u64);
            let from_first = memory.seen.range(first..).count() as u64;
            let span = memory.seen.last().expect("it begins with one") - first + 1;
            prop_assert_eq!(counts.lost, span - from_first);
        }
    }

    #[test]
    fn a_new_incarnation_starts_afresh_and_ends_the_old_one() {
        let mut window = Window::new(5, 1000);
        assert_eq!(window.accept(4, 1001), Freshness::OldIncarnation);
        assert_eq!(window.accept(6, 1), Freshness::Fresh);
        assert_eq!(window.accept(6, 1), Freshness::Duplicate);
        assert_eq!(window.accept(5, 1002), Freshness::OldIncarnation);
        let expected = SequenceCounts { accepted: 2, lost: 0, reordered: 0, duplicates: 1, stale: 2 };
        assert_eq!(window.counts(), expected);
    }

    #[test]
    fn the_ends_of_the_numbers_are_no_trap() {
        let mut window = Window::new(0, 0);
        assert_eq!(window.accept(0, u64::MAX), Freshness::Fresh);
        assert_eq!(window.accept(0, u64::MAX), Freshness::Duplicate);
        assert_eq!(window.accept(0, u64::MAX - 1023), Freshness::Fresh);
        assert_eq!(window.accept(0, u64::MAX - 1024), Freshness::TooOld);
        assert_eq!(window.accept(1, 0), Freshness::Fresh);
        assert_eq!(window.accept(1, u64::MAX), Freshness::Fresh);
        assert_eq!(window.counts().lost, u64::MAX, "the count stops at its end");
    }

    #[test]
    fn memory_has_an_end() {
        let mut windows = Windows::new();
        for source in 0..WINDOWS_MAX as u32 {
            assert_eq!(windows.accept((source, 1, Kind::Data), 1, 1), Freshness::Fresh);
        }
        assert_eq!(windows.accept((u32::MAX, 1, Kind::Data), 1, 1), Freshness::NoRoom);
        assert_eq!(windows.accept((0, 1, Kind::Data), 1, 3), Freshness::Fresh);
        assert_eq!(windows.lost_total(), 1);
    }
}
