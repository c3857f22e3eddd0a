//! The messages of a recording, one after the other.

use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use quantity::Time;

use super::error::ReadError;
use super::group::Plan;
use super::merge::{Fetch, Merge};
use super::recording::{Channel, Recording};
use super::segment::Condition;
use crate::chunk::Unpacked;
use crate::select::Selection;

/// Places that are read before another thread begins to read ahead: a seek needs one or two, and no thread.
const PLACES_BEFORE_AHEAD: usize = 2;
/// Fewer places than this are read sooner than a thread is started.
const PLACES_WORTH_A_THREAD: usize = 16;
/// Places that another thread may be ahead.
const PLACES_AHEAD: usize = 4;

/// One message of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its channel.
    pub channel: &'a Channel,
    /// The low 32 bits of its number on the bus.
    pub sequence: u32,
    /// When it arrived: the recorder's stamp, in the arena's time.
    pub at: Time,
    /// When it was sent, by its sender's clock.
    pub published_at: Time,
    /// Its body, as it came.
    pub body: &'a [u8],
}

/// The selected messages of a recording, in order of their log times.
///
/// Each message borrows from this, so this is no `Iterator`: `while let Some(message) = messages.next() { …
/// }`.
#[derive(Debug)]
pub struct Messages {
    recording: Recording,
    plan: Arc<Plan>,
    merge: Merge,
    /// What the ends of damaged files give, after all messages.
    endings: Vec<ReadError>,
}

impl Messages {
    pub(crate) fn new(recording: Recording, selection: &Selection) -> Self {
        let plan = Arc::new(Plan::new(&recording, selection));
        let merge = Merge::new(0..plan.places().len());
        let endings = endings(&recording);
        Self { recording, plan, merge, endings }
    }

    /// The next message, or `None` after the last.
    ///
    /// # Errors
    /// A chunk that is damaged: none of its messages is given, and the next call goes on with those after it.
    /// Where the rest of a file is damaged, that is the last thing said. A file that is merely torn is no
    /// error: its recording says so ([`SegmentFacts::condition`](super::SegmentFacts::condition)).
    #[expect(clippy::should_implement_trait, reason = "what it gives borrows from it")]
    pub fn next(&mut self) -> Option<Result<Message<'_>, ReadError>> {
        let waiting = &self.merge.waiting;
        if waiting.start == PLACES_BEFORE_AHEAD && waiting.len() >= PLACES_WORTH_A_THREAD {
            self.read_ahead();
        }
        match self.merge.next(&self.recording, &self.plan) {
            Some(next) => Some(next),
            None => self.endings.pop().map(Err),
        }
    }

    /// Lets another thread read and unpack what is still to come. Where none can be had, this one goes on.
    fn read_ahead(&mut self) {
        if !matches!(self.merge.fetch, Fetch::Here(_)) {
            return;
        }
        let (sender, receiver) = sync_channel(PLACES_AHEAD);
        let (recording, plan) = (self.recording.clone(), Arc::clone(&self.plan));
        let waiting = self.merge.waiting.clone();
        let read = move || {
            let mut buffer = Vec::new();
            for index in waiting {
                let mut unpacked = Unpacked::default();
                let read = plan.load(&recording, index, &mut buffer, &mut unpacked).map(|()| unpacked);
                if sender.send(read).is_err() {
                    return;
                }
            }
        };
        if std::thread::Builder::new().name("read-ahead".to_owned()).spawn(read).is_ok() {
            self.merge.fetch = Fetch::Ahead(receiver);
        }
    }
}

/// The damage that ended the reading of each file that could not be read to its end.
pub(crate) fn endings(recording: &Recording) -> Vec<ReadError> {
    let segments = recording.inner.segments.iter().rev();
    let damaged = segments.filter(|segment| matches!(segment.condition, Condition::Damaged { .. }));
    damaged.filter_map(|segment| segment.damage.last().cloned()).collect()
}
