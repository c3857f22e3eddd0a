//! A node's account of its own steps, batched.

use quantity::{Span, Time};
use reflect::{Seq, Text};
use schemas::{JournalStep, JournalStream, NodeJournal};

use crate::{Said, Start};

/// The oldest step of a batch waits at most this long to be published.
const BATCH_SPAN: Span = Span::from_millis(100);
const STREAMS_MAX: usize = 32;
const STEPS_MAX: usize = 48;

/// What caused a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    /// The core's own deadline.
    Deadline,
    /// A datagram, or bytes from the node's own device.
    Datagram { stream: JournalStream, sequence: u64 },
}

/// The steps of a node that are not published yet.
#[derive(Debug)]
pub(crate) struct Journal {
    batch: NodeJournal,
    streams: Vec<JournalStream>,
    steps: Vec<JournalStep>,
    due_at: Time,
    /// Whether every step so far followed from what is journalled.
    whole: bool,
}

impl Journal {
    pub(crate) fn new(node: &str, start: Start, settings_digest: u64) -> Self {
        let batch = NodeJournal {
            node: Text::truncated(node),
            started_at: start.at,
            seed: start.seed.0,
            settings_digest,
            ..NodeJournal::default()
        };
        Self {
            batch,
            streams: Vec::with_capacity(STREAMS_MAX),
            steps: Vec::with_capacity(STEPS_MAX),
            due_at: Time::FAR_FUTURE,
            whole: true,
        }
    }

    /// Ends the journal: something that no message tells of has changed the core.
    pub(crate) fn end(&mut self) {
        self.whole = false;
        self.streams.clear();
        self.steps.clear();
        self.due_at = Time::FAR_FUTURE;
    }

    /// Whether a batch has to go out before another step of this cause can be noted.
    pub(crate) fn is_full_for(&self, cause: Cause) -> bool {
        let room = self.streams.len() < STREAMS_MAX;
        self.steps.len() == STEPS_MAX
            || matches!(cause, Cause::Datagram { stream, .. } if !room && !self.streams.contains(&stream))
    }

    /// Notes a step; [`Journal::is_full_for`] its cause must be false.
    pub(crate) fn note(&mut self, now: Time, cause: Cause, said: Said) {
        if !self.whole {
            return;
        }
        if self.steps.is_empty() {
            self.due_at = now + BATCH_SPAN;
        }
        let (stream, sequence) = match cause {
            Cause::Deadline => (JournalStep::DEADLINE, 0),
            Cause::Datagram { stream, sequence } => (self.number_of(stream), sequence),
        };
        let Said { outputs, digest } = said;
        self.steps.push(JournalStep { at: now, stream, sequence, outputs, digest });
    }

    fn number_of(&mut self, stream: JournalStream) -> u8 {
        let known = self.streams.iter().position(|known| *known == stream);
        let number = known.unwrap_or_else(|| {
            self.streams.push(stream);
            self.streams.len() - 1
        });
        number as u8
    }

    /// When the batch is due at the latest.
    pub(crate) fn due_at(&self) -> Time {
        self.due_at
    }

    /// The batch, if there is anything in it.
    pub(crate) fn take(&mut self) -> Option<NodeJournal> {
        if self.steps.is_empty() {
            return None;
        }
        let mut batch = self.batch.clone();
        batch.streams = Seq::try_from(self.streams.as_slice()).expect("it holds no more than its bound");
        batch.steps = Seq::try_from(self.steps.as_slice()).expect("it holds no more than its bound");
        self.batch.first_step += self.steps.len() as u64;
        self.streams.clear();
        self.steps.clear();
        self.due_at = Time::FAR_FUTURE;
        Some(batch)
    }
}
