//! Messages of several places in one order of time. Places are read when their time has come, not before.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;
use std::sync::mpsc::Receiver;

use quantity::Time;

use super::error::{Defect, ReadError};
use super::group::{PlaceRef, Plan};
use super::messages::Message;
use super::recording::Recording;
use crate::chunk::Unpacked;

/// The most unpacked bytes that may have to be held at once, because their times overlap.
const HELD_BYTES_MAX: u64 = 1 << 30;

/// Where places come from.
#[derive(Debug, Default)]
pub(crate) struct Here {
    buffer: Vec<u8>,
    spare: Vec<Unpacked>,
}

#[derive(Debug)]
pub(crate) enum Fetch {
    /// They are read when they are needed.
    Here(Here),
    /// Another thread reads them ahead, in the plan's order.
    Ahead(Receiver<Result<Unpacked, ReadError>>),
}

/// The messages of some places of a plan, in order of time.
#[derive(Debug)]
pub(crate) struct Merge {
    /// Places of the plan that are not read yet.
    pub waiting: Range<usize>,
    pub fetch: Fetch,
    /// Of each open place: its next message's time, its place in the files, its slot.
    heads: BinaryHeap<Reverse<(i64, PlaceRef, usize)>>,
    open: Vec<(Unpacked, usize)>,
    free: Vec<usize>,
    /// The slot whose last message was given, and is still looked at.
    finished: Option<usize>,
    held_bytes: u64,
}

impl Merge {
    pub(crate) fn new(waiting: Range<usize>) -> Self {
        Self {
            waiting,
            fetch: Fetch::Here(Here::default()),
            heads: BinaryHeap::new(),
            open: Vec::new(),
            free: Vec::new(),
            finished: None,
            held_bytes: 0,
        }
    }

    /// The next message; an error stands for a whole place, and what comes after it goes on.
    pub(crate) fn next<'a>(
        &'a mut self,
        recording: &'a Recording,
        plan: &Plan,
    ) -> Option<Result<Message<'a>, ReadError>> {
        if let Some(slot) = self.finished.take() {
            self.give_back(slot);
        }
        while self.next_is_due(recording, plan) {
            if let Err(error) = self.read_next(recording, plan) {
                return Some(Err(error));
            }
        }
        let Reverse((_, at, slot)) = self.heads.pop()?;
        let (unpacked, given) = &mut self.open[slot];
        let place = unpacked.places[*given];
        *given += 1;
        match unpacked.places.get(*given) {
            Some(next) => self.heads.push(Reverse((next.at_ns, at, slot))),
            None => self.finished = Some(slot),
        }
        Some(Ok(Message {
            channel: &recording.inner.channels[place.channel as usize],
            sequence: place.sequence,
            at: Time::from_nanos(place.at_ns),
            published_at: Time::from_nanos(place.published_at_ns),
            body: self.open[slot].0.body(&place),
        }))
    }

    /// Whether a place that was not read yet may hold a message that comes before all others.
    fn next_is_due(&self, recording: &Recording, plan: &Plan) -> bool {
        if self.waiting.is_empty() {
            return false;
        }
        let at = plan.places()[self.waiting.start];
        let start = recording.inner.segments[at.segment as usize].places[at.place as usize].start;
        self.heads.peek().is_none_or(|Reverse((next_ns, ..))| start <= *next_ns as u64)
    }

    fn read_next(&mut self, recording: &Recording, plan: &Plan) -> Result<(), ReadError> {
        let index = self.waiting.start;
        self.waiting.start += 1;
        let at = plan.places()[index];
        let unpacked = match &mut self.fetch {
            Fetch::Here(here) => {
                let mut unpacked = here.spare.pop().unwrap_or_default();
                plan.load(recording, index, &mut here.buffer, &mut unpacked)?;
                unpacked
            }
            Fetch::Ahead(receiver) => match receiver.recv() {
                Ok(read) => read?,
                // The thread that read ahead is gone: it ends early only by a panic, which has said why.
                Err(_) => {
                    let mut unpacked = Unpacked::default();
                    self.fetch = Fetch::Here(Here::default());
                    plan.load(recording, index, &mut Vec::new(), &mut unpacked)?;
                    unpacked
                }
            },
        };
        let Some(first) = unpacked.places.first() else { return Ok(()) };
        let held_bytes = self.held_bytes + unpacked.content.len() as u64;
        if held_bytes > HELD_BYTES_MAX {
            let segment = &recording.inner.segments[at.segment as usize];
            let what = "the size of chunks that overlap in time";
            let defect = Defect::Limit { what, found: held_bytes, limit: HELD_BYTES_MAX };
            return Err(segment.source.damaged(segment.places[at.place as usize].at, defect));
        }
        self.held_bytes = held_bytes;
        let slot = self.free.pop().unwrap_or(self.open.len());
        self.heads.push(Reverse((first.at_ns, at, slot)));
        match self.open.get_mut(slot) {
            Some(place) => *place = (unpacked, 0),
            None => self.open.push((unpacked, 0)),
        }
        Ok(())
    }

    fn give_back(&mut self, slot: usize) {
        let (unpacked, _) = std::mem::take(&mut self.open[slot]);
        self.held_bytes -= unpacked.content.len() as u64;
        self.free.push(slot);
        if let Fetch::Here(here) = &mut self.fetch
            && here.spare.is_empty()
        {
            here.spare.push(unpacked);
        }
    }
}
