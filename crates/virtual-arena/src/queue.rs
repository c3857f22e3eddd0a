//! What is on its way, ordered by arrival and then by departure.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use quantity::Time;

#[derive(Debug)]
struct Entry<T> {
    at: Time,
    order: u64,
    what: T,
}

impl<T> PartialEq for Entry<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T> Eq for Entry<T> {}

impl<T> PartialOrd for Entry<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for Entry<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.at, self.order).cmp(&(other.at, other.order))
    }
}

/// The event queue.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    heap: BinaryHeap<Reverse<Entry<T>>>,
    sent: u64,
}

impl<T> Default for Queue<T> {
    fn default() -> Self {
        Self { heap: BinaryHeap::new(), sent: 0 }
    }
}

impl<T> Queue<T> {
    pub(crate) fn send(&mut self, at: Time, what: T) {
        self.sent += 1;
        self.heap.push(Reverse(Entry { at, order: self.sent, what }));
    }

    pub(crate) fn next_at(&self) -> Time {
        self.heap.peek().map_or(Time::FAR_FUTURE, |Reverse(entry)| entry.at)
    }

    pub(crate) fn take(&mut self) -> Option<T> {
        self.heap.pop().map(|Reverse(entry)| entry.what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_first_arrives_first_among_what_arrives_at_one_instant() {
        let at = |seconds: i64| Time::from_nanos(seconds * 1_000_000_000);
        let mut queue = Queue::default();
        for (seconds, what) in [(2, 'c'), (1, 'a'), (2, 'd'), (1, 'b'), (3, 'e')] {
            queue.send(at(seconds), what);
        }
        assert_eq!(queue.next_at(), at(1));
        assert_eq!(std::iter::from_fn(|| queue.take()).collect::<String>(), "abcde");
        assert_eq!(queue.next_at(), Time::FAR_FUTURE);
    }
}
