//! Where the messages come from: a recording, or memory.

use std::ops::ControlFlow;
use std::sync::Arc;

use quantity::Time;
use recording::{Definition, Stream};
use thiserror::Error;

/// What one sender said on one topic.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Who said it, and under what.
    pub stream: Stream,
    /// What its bodies mean, if the recording knows.
    pub definition: Option<Arc<Definition>>,
}

/// A recorded message.
#[derive(Clone, Copy, Debug)]
pub struct Message<'m> {
    /// Index of its channel in [`Source::channels`].
    pub channel: usize,
    /// The low half of its sequence number.
    pub sequence: u32,
    /// When it was heard.
    pub at: Time,
    /// When it was said.
    pub published_at: Time,
    /// Its body.
    pub body: &'m [u8],
}

/// Why messages cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct SourceError(pub String);

/// What takes messages: it says whether it wants more.
pub type Take<'t> = dyn FnMut(Message<'_>) -> ControlFlow<()> + 't;

/// Recorded messages in the order in which they were heard.
pub trait Source: Send {
    /// The channels.
    fn channels(&self) -> &[Channel];

    /// When the first and the last message were heard; `None` if there is none.
    fn time_range(&self) -> Option<(Time, Time)>;

    /// What seconds of the recording are counted from.
    fn origin(&self) -> Option<Time> {
        self.time_range().map(|(first, _)| first)
    }

    /// The newest message before `before` of each sender and latched topic among the wanted channels, in the order in
    /// which they were heard: what whoever comes in there would have been told.
    ///
    /// # Errors
    /// The recording cannot be read.
    fn latched_before(&mut self, before: Time, wanted: &[bool]) -> Result<Vec<Kept>, SourceError>;

    /// Hands over the messages of the wanted channels that were heard at `from` or later and not after `to`.
    ///
    /// # Errors
    /// The recording cannot be read on.
    fn read(&mut self, from: Time, to: Time, wanted: &[bool], take: &mut Take<'_>)
    -> Result<(), SourceError>;
}

/// A message that stands for itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// Index of its channel.
    pub channel: usize,
    /// The low half of its sequence number.
    pub sequence: u32,
    /// When it was heard.
    pub at: Time,
    /// When it was said.
    pub published_at: Time,
    /// Its body.
    pub body: Vec<u8>,
}

impl Kept {
    /// A copy of a message.
    #[must_use]
    pub fn of(message: Message<'_>) -> Self {
        let Message { channel, sequence, at, published_at, body } = message;
        Self { channel, sequence, at, published_at, body: body.to_vec() }
    }

    /// The message.
    #[must_use]
    pub fn message(&self) -> Message<'_> {
        let Self { channel, sequence, at, published_at, ref body } = *self;
        Message { channel, sequence, at, published_at, body }
    }
}

/// Messages in memory.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    channels: Vec<Channel>,
    messages: Vec<Kept>,
}

impl Tape {
    /// Adds a message; it must not be earlier than the last one.
    ///
    /// # Panics
    /// It is earlier.
    pub fn push(&mut self, stream: &Stream, definition: Option<&Arc<Definition>>, message: Kept) {
        assert!(self.messages.last().is_none_or(|last| last.at <= message.at), "messages come in order");
        let known = self.channels.iter().position(|channel| channel.stream == *stream);
        let channel = known.unwrap_or_else(|| {
            self.channels.push(Channel { stream: stream.clone(), definition: definition.cloned() });
            self.channels.len() - 1
        });
        self.messages.push(Kept { channel, ..message });
    }

    /// The messages.
    #[must_use]
    pub fn messages(&self) -> &[Kept] {
        &self.messages
    }
}

impl Source for Tape {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn time_range(&self) -> Option<(Time, Time)> {
        Some((self.messages.first()?.at, self.messages.last()?.at))
    }

    fn latched_before(&mut self, before: Time, wanted: &[bool]) -> Result<Vec<Kept>, SourceError> {
        let sender = |channel: usize| {
            let stream = &self.channels[channel].stream;
            (stream.topic.as_str(), stream.source)
        };
        let mut found: Vec<Kept> = Vec::new();
        for message in self.messages.iter().take_while(|message| message.at < before) {
            if wanted[message.channel] && self.channels[message.channel].stream.latched {
                found.retain(|other| sender(other.channel) != sender(message.channel));
                found.push(message.clone());
            }
        }
        Ok(found)
    }

    fn read(
        &mut self,
        from: Time,
        to: Time,
        wanted: &[bool],
        take: &mut Take<'_>,
    ) -> Result<(), SourceError> {
        let begin = self.messages.partition_point(|message| message.at < from);
        let messages = self.messages[begin..].iter().take_while(|message| message.at <= to);
        for message in messages.filter(|message| wanted[message.channel]) {
            if take(message.message()).is_break() {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{at_ms, stream};

    fn tape(said: &[(&str, u32, i64)]) -> Tape {
        let mut tape = Tape::default();
        for (sequence, (topic, source, at)) in (1..).zip(said) {
            let stream = Stream { latched: *topic != "plain", ..stream(topic, *source) };
            let at = at_ms(*at);
            tape.push(&stream, None, Kept { channel: 0, sequence, at, published_at: at, body: vec![1] });
        }
        tape
    }

    fn latched(tape: &mut Tape, before_ms: i64) -> Vec<u32> {
        let wanted = vec![true; tape.channels().len()];
        let found = tape.latched_before(at_ms(before_ms), &wanted).unwrap();
        found.iter().map(|kept| kept.sequence).collect()
    }

    #[test]
    fn the_newest_of_each_latched_topic_and_sender_is_found_however_long_ago() {
        let mut tape = tape(&[
            ("order", 1, 0),
            ("parameters", 2, 10),
            ("plain", 3, 20),
            ("parameters", 2, 500_000),
            ("parameters", 4, 500_001),
            ("parameters", 2, 500_002),
            ("order", 1, 900_000),
        ]);
        assert_eq!(latched(&mut tape, 0), [] as [u32; 0]);
        assert_eq!(latched(&mut tape, 1), [1]);
        assert_eq!(latched(&mut tape, 11), [1, 2]);
        assert_eq!(latched(&mut tape, 800_000), [1, 5, 6]);
        assert_eq!(latched(&mut tape, 900_000), [1, 5, 6]);
        assert_eq!(latched(&mut tape, 900_001), [5, 6, 7]);
    }

    #[test]
    fn what_is_not_wanted_is_not_looked_for() {
        let mut tape = tape(&[("order", 1, 0), ("parameters", 2, 10)]);
        let found = tape.latched_before(at_ms(20), &[false, true]).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].channel, 1);
    }

    #[test]
    fn a_tape_is_read_within_its_bounds() {
        let mut tape = tape(&[("a", 1, 0), ("a", 1, 10), ("b", 1, 10), ("a", 1, 20)]);
        let mut heard = Vec::new();
        tape.read(at_ms(10), at_ms(19), &[true, true], &mut |message| {
            heard.push(message.sequence);
            ControlFlow::Continue(())
        })
        .unwrap();
        assert_eq!(heard, [2, 3]);
    }
}
