//! Numbers that are missing: what no checksum can see, since a chunk that is not there has none.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use quantity::Time;
use wire::Kind;

use super::error::ReadError;
use super::recording::{Channel, Recording};
use crate::select::Selection;

/// Whose numbers: a sender numbers its datagrams by topic and kind, anew in each incarnation.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StreamKey {
    /// The topic.
    pub topic: String,
    /// Data or journal.
    pub kind: Kind,
    /// The sender.
    pub source: u32,
    /// The sender's incarnation.
    pub incarnation: u32,
}

/// Numbers in a row that are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hole {
    /// The first number that is missing, counted on past 32 bits.
    pub first: u64,
    /// How many are.
    pub count: u64,
}

/// What the numbers of one stream tell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamGaps {
    /// Whose.
    pub stream: StreamKey,
    /// Messages.
    pub messages: u64,
    /// Bytes of their bodies.
    pub bytes: u64,
    /// When the first arrived.
    pub first_at: Time,
    /// When the last arrived.
    pub last_at: Time,
    /// The lowest number.
    pub lowest: u64,
    /// The highest number.
    pub highest: u64,
    /// Messages whose number had come before.
    pub repeated: u64,
    /// Messages that came after one with a higher number.
    pub late: u64,
    /// Numbers between the lowest and the highest that never came.
    pub holes: Vec<Hole>,
}

impl StreamGaps {
    /// Numbers that are missing.
    #[must_use]
    pub fn missing(&self) -> u64 {
        self.holes.iter().map(|hole| hole.count).sum()
    }
}

/// What a pass over all messages found.
#[derive(Clone, Debug, Default)]
pub struct Gaps {
    /// Of each stream; only of those whose sender is known.
    pub streams: Vec<StreamGaps>,
    /// Chunks that could not be read.
    pub damage: Vec<ReadError>,
    /// Messages read.
    pub messages: u64,
}

/// What a worker takes down of each message.
struct Seen {
    channel: u32,
    sequence: u32,
    at: Time,
    bytes: u32,
}

impl Recording {
    /// Reads the selected messages, all of them, and says which numbers of which streams are missing.
    /// `progress` hears the number of messages read so far.
    #[must_use]
    pub fn gaps(&self, selection: &Selection, mut progress: impl FnMut(u64)) -> Gaps {
        let mut found = Gaps::default();
        let mut streams: BTreeMap<StreamKey, Numbers> = BTreeMap::new();
        let keys: Vec<Option<StreamKey>> = self.channels().iter().map(key_of).collect();
        self.visit(
            selection,
            Vec::new,
            |seen: &mut Vec<Seen>, message| {
                let (channel, bytes) = (message.channel.id, message.body.len() as u32);
                seen.push(Seen { channel, sequence: message.sequence, at: message.at, bytes });
            },
            |seen| {
                match seen {
                    Err(error) => found.damage.push(error),
                    Ok(seen) => {
                        found.messages += seen.len() as u64;
                        for message in seen {
                            let Some(key) = &keys[message.channel as usize] else { continue };
                            match streams.get_mut(key) {
                                Some(numbers) => numbers.take(&message),
                                None => {
                                    streams.insert(key.clone(), Numbers::new(&message));
                                }
                            }
                        }
                        progress(found.messages);
                    }
                }
                ControlFlow::Continue(())
            },
        );
        found.streams = streams.into_iter().map(|(stream, numbers)| numbers.finish(stream)).collect();
        found
    }
}

fn key_of(channel: &Channel) -> Option<StreamKey> {
    let stream = channel.stream.as_ref()?;
    Some(StreamKey {
        topic: stream.topic.clone(),
        kind: stream.kind,
        source: stream.source,
        incarnation: stream.incarnation,
    })
}

/// Numbers beyond which a recording cannot tell: it keeps the low 32 bits, so what comes is taken as the
/// nearest to what came.
struct Numbers {
    messages: u64,
    bytes: u64,
    first_at: Time,
    last_at: Time,
    lowest: u64,
    highest: u64,
    repeated: u64,
    late: u64,
    /// Holes by their first number, with the number after their last.
    holes: BTreeMap<u64, u64>,
}

impl Numbers {
    fn new(seen: &Seen) -> Self {
        // Room below the first, for what comes late.
        let number = (1 << 32) + u64::from(seen.sequence);
        Self {
            messages: 1,
            bytes: u64::from(seen.bytes),
            first_at: seen.at,
            last_at: seen.at,
            lowest: number,
            highest: number,
            repeated: 0,
            late: 0,
            holes: BTreeMap::new(),
        }
    }

    fn take(&mut self, seen: &Seen) {
        self.messages += 1;
        self.bytes += u64::from(seen.bytes);
        self.last_at = seen.at;
        let ahead = seen.sequence.wrapping_sub(self.highest as u32).cast_signed();
        let number = self.highest.saturating_add_signed(i64::from(ahead));
        if number > self.highest {
            if number > self.highest + 1 {
                self.holes.insert(self.highest + 1, number);
            }
            self.highest = number;
            return;
        }
        if number < self.lowest {
            if number + 1 < self.lowest {
                self.holes.insert(number + 1, self.lowest);
            }
            self.lowest = number;
            self.late += 1;
            return;
        }
        let hole = self.holes.range(..=number).next_back().map(|(first, end)| (*first, *end));
        match hole.filter(|(_, end)| number < *end) {
            None => self.repeated += 1,
            Some((first, end)) => {
                self.late += 1;
                self.holes.remove(&first);
                if first < number {
                    self.holes.insert(first, number);
                }
                if number + 1 < end {
                    self.holes.insert(number + 1, end);
                }
            }
        }
    }

    fn finish(self, stream: StreamKey) -> StreamGaps {
        // Where something came before the number zero of 32 bits, those are shown with the room they were
        // given.
        let room = if self.lowest >= 1 << 32 { 1 << 32 } else { 0 };
        let shown = |number: u64| number - room;
        StreamGaps {
            stream,
            messages: self.messages,
            bytes: self.bytes,
            first_at: self.first_at,
            last_at: self.last_at,
            lowest: shown(self.lowest),
            highest: shown(self.highest),
            repeated: self.repeated,
            late: self.late,
            holes: self
                .holes
                .into_iter()
                .map(|(first, end)| Hole { first: shown(first), count: end - first })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn holes(sequences: &[u32]) -> (Vec<(u64, u64)>, u64, u64) {
        let seen = |sequence: &u32| Seen { channel: 0, sequence: *sequence, at: Time::ZERO, bytes: 0 };
        let mut numbers = Numbers::new(&seen(&sequences[0]));
        sequences[1..].iter().for_each(|sequence| numbers.take(&seen(sequence)));
        let stream = StreamKey { topic: String::new(), kind: Kind::Data, source: 0, incarnation: 0 };
        let found = numbers.finish(stream);
        (found.holes.iter().map(|hole| (hole.first, hole.count)).collect(), found.late, found.repeated)
    }

    #[test]
    fn what_never_came_is_named_exactly() {
        assert_eq!(holes(&[5, 6, 7, 8]), (vec![], 0, 0));
        assert_eq!(holes(&[5, 9, 10, 12]), (vec![(6, 3), (11, 1)], 0, 0));
        assert_eq!(holes(&[5, 9, 7, 10]), (vec![(6, 1), (8, 1)], 1, 0));
        assert_eq!(holes(&[5, 6, 6, 5]), (vec![], 0, 2));
        assert_eq!(holes(&[5, 2, 3]), (vec![(4, 1)], 2, 0));
    }

    #[test]
    fn numbers_go_on_past_32_bits() {
        let past = u64::from(u32::MAX);
        assert_eq!(holes(&[u32::MAX - 1, 1]), (vec![(past, 2)], 0, 0));
    }
}
