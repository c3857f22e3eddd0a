//! Things under way: handed over now, due later, taken in the order of their time.

use std::collections::VecDeque;

use quantity::Time;

/// A queue in the order of time; of equal times the earlier push comes first.
#[derive(Clone, Debug)]
pub(crate) struct DelayQueue<T> {
    entries: VecDeque<(Time, T)>,
}

impl<T> DelayQueue<T> {
    pub(crate) fn new() -> Self {
        Self { entries: VecDeque::new() }
    }

    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(crate) fn push(&mut self, due: Time, item: T) {
        let after = self.entries.iter().rev().take_while(|(at, _)| *at > due).count();
        self.entries.insert(self.entries.len() - after, (due, item));
    }

    pub(crate) fn next_at(&self) -> Option<Time> {
        self.entries.front().map(|(at, _)| *at)
    }

    pub(crate) fn pop_due(&mut self, now: Time) -> Option<(Time, T)> {
        if self.next_at()? <= now { self.entries.pop_front() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_come_in_the_order_of_time_and_then_of_pushing() {
        let mut queue = DelayQueue::new();
        for (due, name) in [(5, 'a'), (3, 'b'), (5, 'c'), (4, 'd'), (3, 'e')] {
            queue.push(Time::from_nanos(due), name);
        }
        assert_eq!(queue.next_at(), Some(Time::from_nanos(3)));
        let mut order = String::new();
        while let Some((_, name)) = queue.pop_due(Time::from_nanos(4)) {
            order.push(name);
        }
        assert_eq!((order.as_str(), queue.len()), ("bed", 2));
        while let Some((_, name)) = queue.pop_due(Time::from_nanos(9)) {
            order.push(name);
        }
        assert_eq!(order, "bedac");
    }
}
