//! The messages of the last while: what journals may still name.

use std::collections::{BTreeMap, VecDeque};

use quantity::{Span, Time};

/// How far back a journal may reach: longer than any process is stopped that still counts as running.
const AGE_MAX: Span = Span::from_secs(30);
/// Most bytes kept, whatever their age.
const BYTES_MAX: usize = 192 << 20;
/// What a message costs besides its body, roughly.
const OVERHEAD_BYTES: usize = 128;

/// What one sender said on one topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    pub topic_hash: u32,
    pub source: u32,
    pub incarnation: u32,
}

/// A recorded message.
#[derive(Debug)]
pub(super) struct Kept {
    /// Its place in the recording.
    pub order: u64,
    /// When it was recorded.
    pub at: Time,
    /// When its sender sent it.
    pub published_at: Time,
    /// Id of its type.
    pub schema_id: u64,
    /// Its body.
    pub body: Box<[u8]>,
    /// Whether its sender is proven to have said something else.
    pub damaged: bool,
}

/// Why a message is not at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Absent {
    /// Nobody recorded it.
    Missed,
    /// It may have been recorded, too long ago.
    Forgotten,
}

/// The messages of the last while, by sender, topic and the low 32 bits of their number: all that a recording has of it.
#[derive(Debug, Default)]
pub(super) struct Window {
    streams: BTreeMap<Key, BTreeMap<u32, Kept>>,
    ages: VecDeque<(Time, Key, u32)>,
    bytes: usize,
    order: u64,
    /// When the newest message that was forgotten had been recorded.
    forgotten: Option<Time>,
}

impl Window {
    /// Keeps a message, and forgets those that are too old beside it.
    pub fn keep(&mut self, key: Key, sequence: u32, mut message: Kept) {
        let at = message.at;
        self.order += 1;
        message.order = self.order;
        self.bytes += message.body.len() + OVERHEAD_BYTES;
        let stream = self.streams.entry(key).or_default();
        // Of two of one number the first counts, as it does for whoever listens on the bus.
        if let Some(first) = stream.remove(&sequence) {
            self.bytes -= message.body.len() + OVERHEAD_BYTES;
            stream.insert(sequence, first);
        } else {
            stream.insert(sequence, message);
            self.ages.push_back((at, key, sequence));
        }
        self.forget(at);
    }

    fn forget(&mut self, now: Time) {
        while let Some((at, key, sequence)) = self.ages.front().copied() {
            if at.saturating_add(AGE_MAX) >= now && self.bytes <= BYTES_MAX {
                return;
            }
            self.ages.pop_front();
            self.forgotten = self.forgotten.max(Some(at));
            if let Some(stream) = self.streams.get_mut(&key) {
                if let Some(kept) = stream.remove(&sequence) {
                    self.bytes -= kept.body.len() + OVERHEAD_BYTES;
                }
                if stream.is_empty() {
                    self.streams.remove(&key);
                }
            }
        }
    }

    /// The message of that number.
    pub fn get(&self, key: Key, sequence: u64) -> Option<&Kept> {
        self.streams.get(&key)?.get(&(sequence as u32))
    }

    /// The message of that number, which caused a step at `step_at`; or why it is not there.
    pub fn cause(&self, key: Key, sequence: u64, step_at: Time) -> Result<&Kept, Absent> {
        self.get(key, sequence).ok_or_else(|| {
            // It was recorded at about the time of the step, or a little before.
            let may_be_forgotten =
                self.forgotten.is_some_and(|at| at.saturating_add(Span::from_secs(1)) >= step_at);
            if may_be_forgotten { Absent::Forgotten } else { Absent::Missed }
        })
    }

    /// Notes that this is not what its sender said.
    pub fn mark_damaged(&mut self, key: Key, sequence: u64) {
        if let Some(kept) = self.streams.get_mut(&key).and_then(|stream| stream.get_mut(&(sequence as u32))) {
            kept.damaged = true;
        }
    }

    /// The topics on which a sender was heard.
    pub fn topics_of(&self, source: u32, incarnation: u32) -> impl Iterator<Item = u32> {
        self.streams
            .keys()
            .filter(move |key| key.source == source && key.incarnation == incarnation)
            .map(|key| key.topic_hash)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: Key = Key { topic_hash: 1, source: 2, incarnation: 3 };

    fn message(at: Time, bytes: usize) -> Kept {
        Kept {
            order: 0,
            at,
            published_at: at,
            schema_id: 0,
            body: vec![0; bytes].into_boxed_slice(),
            damaged: false,
        }
    }

    #[test]
    fn what_was_forgotten_is_told_from_what_never_came() {
        let mut window = Window::default();
        let late = Time::ZERO + AGE_MAX + Span::from_secs(10);
        window.keep(KEY, 1, message(Time::ZERO, 10));
        window.keep(KEY, 3, message(late, 10));
        assert_eq!(window.cause(KEY, 1, Time::ZERO).unwrap_err(), Absent::Forgotten);
        assert_eq!(window.cause(KEY, 2, late).unwrap_err(), Absent::Missed);
        assert!(window.cause(KEY, 3, late).is_ok());
        assert!(window.get(KEY, 3 + (1 << 32)).is_some(), "only the low 32 bits are recorded");
    }

    #[test]
    fn bytes_are_bounded_and_the_first_of_one_number_counts() {
        let mut window = Window::default();
        for number in 0..400 {
            window.keep(KEY, number, message(Time::from_nanos(number.into()), 1 << 20));
            assert!(window.bytes <= BYTES_MAX);
        }
        assert!(window.get(KEY, 0).is_none() && window.get(KEY, 399).is_some());
        let before = window.bytes;
        window.keep(KEY, 399, message(Time::from_nanos(400), 7));
        assert_eq!(window.bytes, before);
        assert_eq!(window.get(KEY, 399).unwrap().body.len(), 1 << 20);
    }
}
