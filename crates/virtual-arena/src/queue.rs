//! What is on its way: datagrams to nodes and bytes to devices, ordered by arrival and then by departure.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::rc::Rc;

use quantity::Time;

/// Something that arrives.
#[derive(Clone, Debug)]
pub(crate) enum Arrival {
    /// A datagram at the node of that index.
    Datagram { node: usize, bytes: Rc<[u8]> },
    /// A resumed node's turn to look at the world again.
    Resume { node: usize },
}

#[derive(Debug)]
struct Entry {
    at: Time,
    order: u64,
    arrival: Arrival,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        (self.at, self.order) == (other.at, other.order)
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.at, self.order).cmp(&(other.at, other.order))
    }
}

/// The event queue.
#[derive(Debug, Default)]
pub(crate) struct Queue {
    heap: BinaryHeap<Reverse<Entry>>,
    sent: u64,
}

impl Queue {
    pub(crate) fn send(&mut self, at: Time, arrival: Arrival) {
        self.sent += 1;
        self.heap.push(Reverse(Entry { at, order: self.sent, arrival }));
    }

    pub(crate) fn next_at(&self) -> Time {
        self.heap.peek().map_or(Time::FAR_FUTURE, |Reverse(entry)| entry.at)
    }

    pub(crate) fn take(&mut self) -> Option<(Time, Arrival)> {
        self.heap.pop().map(|Reverse(entry)| (entry.at, entry.arrival))
    }
}
