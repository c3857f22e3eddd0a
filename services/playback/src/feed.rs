//! Reads ahead in a thread of its own, so that neither disk nor decompression makes a message late.

use std::ops::{ControlFlow, Range};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread;

use quantity::Time;

use crate::source::{Kept, Message, Source, SourceError};

/// Batches read ahead.
const BATCHES_AHEAD: usize = 4;
/// The most messages of a batch; the first after a jump has one, each further one twice as many.
const BATCH_MESSAGES_MAX: usize = 512;
/// A batch of so many bytes is full.
const BATCH_BYTES: usize = 256 * 1024;

/// Messages, one after the other in one piece of memory.
#[derive(Debug, Default)]
struct Batch {
    messages: Vec<(Message<'static>, Range<usize>)>,
    bytes: Vec<u8>,
}

impl Batch {
    fn push(&mut self, message: Message<'_>) {
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(message.body);
        self.messages.push((Message { body: &[], ..message }, begin..self.bytes.len()));
    }

    fn get(&self, index: usize) -> Option<Message<'_>> {
        let (message, range) = self.messages.get(index)?;
        Some(Message { body: &self.bytes[range.clone()], ..*message })
    }
}

/// A stretch of the recording to be read.
#[derive(Clone, Copy, Debug)]
struct Order {
    number: u64,
    from: Time,
    to: Time,
}

#[derive(Debug)]
enum Fed {
    Latched(Vec<Kept>),
    Messages(Batch),
    End,
    Failed(SourceError),
}

/// The player's end.
#[derive(Debug)]
pub(crate) struct Feed {
    orders: Sender<Order>,
    fed: Receiver<(u64, Fed)>,
    number: u64,
    batch: Batch,
    next: usize,
    ended: bool,
}

impl Feed {
    /// Starts to read; the thread ends with the feed.
    pub(crate) fn start(mut source: Box<dyn Source>, wanted: Vec<bool>) -> Self {
        let (orders, taken) = channel();
        let (give, fed) = sync_channel(BATCHES_AHEAD);
        thread::spawn(move || {
            let mut next = taken.recv().ok();
            while let Some(order) = next {
                next = match serve(source.as_mut(), &wanted, order, &taken, &give) {
                    Some(newer) => Some(newer),
                    None => taken.recv().ok(),
                };
            }
        });
        Self { orders, fed, number: 0, batch: Batch::default(), next: 0, ended: false }
    }

    /// Jumps: what follows is the latched messages before `from`, then what was heard from there to `to`.
    pub(crate) fn begin(&mut self, from: Time, to: Time) -> Result<Vec<Kept>, SourceError> {
        self.number += 1;
        (self.batch, self.next, self.ended) = (Batch::default(), 0, false);
        let order = Order { number: self.number, from, to };
        self.orders.send(order).map_err(|_| gone())?;
        match self.receive()? {
            Fed::Latched(latched) => Ok(latched),
            Fed::Failed(error) => Err(error),
            Fed::Messages(_) | Fed::End => Err(gone()),
        }
    }

    /// When the next message was heard; `None` if there is no more.
    pub(crate) fn peek(&mut self) -> Result<Option<Time>, SourceError> {
        while self.next == self.batch.messages.len() && !self.ended {
            match self.receive()? {
                Fed::Messages(batch) => (self.batch, self.next) = (batch, 0),
                Fed::End => self.ended = true,
                Fed::Failed(error) => return Err(error),
                Fed::Latched(_) => {}
            }
        }
        Ok(self.batch.get(self.next).map(|message| message.at))
    }

    /// The message that was looked at.
    pub(crate) fn take(&mut self) -> Option<Message<'_>> {
        let message = self.batch.get(self.next)?;
        self.next += 1;
        Some(message)
    }

    /// What comes next of the stretch asked for last.
    fn receive(&mut self) -> Result<Fed, SourceError> {
        loop {
            let (number, fed) = self.fed.recv().map_err(|_| gone())?;
            if number == self.number {
                return Ok(fed);
            }
        }
    }
}

fn gone() -> SourceError {
    SourceError("the reading thread has ended".to_owned())
}

/// Reads one stretch; a newer order, if one came meanwhile.
fn serve(
    source: &mut dyn Source,
    wanted: &[bool],
    order: Order,
    orders: &Receiver<Order>,
    give: &SyncSender<(u64, Fed)>,
) -> Option<Order> {
    let Order { number, from, to } = order;
    let give = |fed| give.send((number, fed)).is_ok();
    let latched = match source.latched_before(from, wanted) {
        Ok(latched) => latched,
        Err(error) => {
            give(Fed::Failed(error));
            return None;
        }
    };
    if !give(Fed::Latched(latched)) {
        return None;
    }
    let (mut batch, mut limit, mut newer) = (Batch::default(), 1, None);
    let read = source.read(from, to, wanted, &mut |message| {
        batch.push(message);
        if batch.messages.len() < limit && batch.bytes.len() < BATCH_BYTES {
            return ControlFlow::Continue(());
        }
        limit = (limit * 2).min(BATCH_MESSAGES_MAX);
        let given = give(Fed::Messages(std::mem::take(&mut batch)));
        newer = orders.try_iter().last();
        if given && newer.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    if newer.is_some() {
        return newer;
    }
    // What was read before the damage is played; then it is named.
    give(Fed::Messages(batch));
    give(match read {
        Ok(()) => Fed::End,
        Err(error) => Fed::Failed(error),
    });
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{Channel, Take, Tape};
    use crate::testing::{at_ms, stream};

    fn tape(count: u32) -> Tape {
        let mut tape = Tape::default();
        for sequence in 0..count {
            let at = at_ms(i64::from(sequence));
            let body = sequence.to_le_bytes().to_vec();
            tape.push(&stream("a", 1), None, Kept { channel: 0, sequence, at, published_at: at, body });
        }
        tape
    }

    fn rest(feed: &mut Feed) -> Vec<u32> {
        let mut heard = Vec::new();
        while feed.peek().unwrap().is_some() {
            let message = feed.take().unwrap();
            assert_eq!(message.body, message.sequence.to_le_bytes());
            heard.push(message.sequence);
        }
        heard
    }

    #[test]
    fn everything_comes_once_and_in_order() {
        let mut feed = Feed::start(Box::new(tape(5_000)), vec![true]);
        feed.begin(at_ms(0), Time::FAR_FUTURE).unwrap();
        assert_eq!(rest(&mut feed), (0..5_000).collect::<Vec<_>>());
        assert_eq!(feed.peek(), Ok(None), "an end stays an end");
    }

    #[test]
    fn a_jump_leaves_nothing_of_the_stretch_before() {
        let mut feed = Feed::start(Box::new(tape(50_000)), vec![true]);
        feed.begin(at_ms(0), Time::FAR_FUTURE).unwrap();
        for jump in [40_000, 10, 49_999, 20_000] {
            feed.begin(at_ms(jump), at_ms(jump + 100)).unwrap();
            assert_eq!(feed.peek(), Ok(Some(at_ms(jump))));
        }
        assert_eq!(rest(&mut feed), (20_000..=20_100).collect::<Vec<_>>());
        feed.begin(at_ms(3), at_ms(4)).unwrap();
        assert_eq!(rest(&mut feed), [3, 4]);
    }

    /// A recording with damage after some messages.
    struct Damaged(Tape);

    impl Source for Damaged {
        fn channels(&self) -> &[Channel] {
            self.0.channels()
        }

        fn time_range(&self) -> Option<(Time, Time)> {
            self.0.time_range()
        }

        fn latched_before(&mut self, before: Time, wanted: &[bool]) -> Result<Vec<Kept>, SourceError> {
            self.0.latched_before(before, wanted)
        }

        fn read(
            &mut self,
            from: Time,
            to: Time,
            wanted: &[bool],
            take: &mut Take<'_>,
        ) -> Result<(), SourceError> {
            self.0.read(from, to, wanted, take)?;
            Err(SourceError("damaged at byte 7".to_owned()))
        }
    }

    #[test]
    fn what_comes_before_damage_is_played_and_the_damage_named() {
        let mut feed = Feed::start(Box::new(Damaged(tape(700))), vec![true]);
        feed.begin(at_ms(0), Time::FAR_FUTURE).unwrap();
        for _ in 0..700 {
            feed.peek().unwrap();
            feed.take().unwrap();
        }
        assert_eq!(feed.peek(), Err(SourceError("damaged at byte 7".to_owned())));
    }
}
