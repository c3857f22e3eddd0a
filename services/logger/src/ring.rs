//! The bounded memory between the bus and the disk.
//!
//! Whoever puts something in never waits: what finds no room is dropped and counted. Whoever takes, takes all
//! there is at once and leaves an empty buffer in its place, so that the two meet for a moment only.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use quantity::Time;
use recording::Gap;
use service_core::Observed;

/// Topics whose drops are counted apart; those of others count together.
const TOPICS_MAX: usize = 1024;
const OTHERS: &str = "(others)";
/// Before each datagram: its length, when it arrived, whether its tag was checked.
const HEAD_BYTES: usize = 4 + 8 + 1;

/// The bounded memory between the bus and the disk.
#[derive(Debug)]
pub(crate) struct Ring {
    inside: Mutex<Inside>,
    something: Condvar,
    capacity_bytes: usize,
}

#[derive(Debug)]
struct Inside {
    bytes: Vec<u8>,
    gap: Option<Gap>,
    closed: bool,
}

/// What was taken besides the datagrams.
#[derive(Debug, Default)]
pub(crate) struct Drained {
    /// Messages that found no room since the last time.
    pub(crate) gap: Option<Gap>,
    /// Nothing more will come.
    pub(crate) closed: bool,
}

/// Access for putting several datagrams in.
pub(crate) struct Putting<'r> {
    inside: MutexGuard<'r, Inside>,
    ring: &'r Ring,
}

impl Ring {
    /// A ring with so much memory, and as much again for what is being written; all of it is there from now
    /// on.
    pub(crate) fn new(capacity_bytes: usize) -> (Self, Vec<u8>) {
        let inside = Inside { bytes: Vec::with_capacity(capacity_bytes), gap: None, closed: false };
        let ring = Self { inside: Mutex::new(inside), something: Condvar::new(), capacity_bytes };
        (ring, Vec::with_capacity(capacity_bytes))
    }

    /// Access for putting datagrams in.
    pub(crate) fn put(&self) -> Putting<'_> {
        Putting { inside: self.inside(), ring: self }
    }

    /// Says that nothing more will come.
    pub(crate) fn close(&self) {
        self.inside().closed = true;
        self.something.notify_one();
    }

    /// Waits so long, or until the ring is half full or closed, and exchanges its content for `empty`, which
    /// is emptied.
    pub(crate) fn drain(&self, empty: &mut Vec<u8>, patience: Duration) -> Drained {
        empty.clear();
        let urgent = |inside: &Inside| inside.closed || inside.bytes.len() * 2 > self.capacity_bytes;
        let waiting = self.something.wait_timeout_while(self.inside(), patience, |inside| !urgent(inside));
        let (mut inside, _) = waiting.unwrap_or_else(PoisonError::into_inner);
        std::mem::swap(&mut inside.bytes, empty);
        Drained { gap: inside.gap.take(), closed: inside.closed }
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        // Every change is whole before anything that could panic.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Putting<'_> {
    /// Puts a datagram in, and says whether there was room.
    pub(crate) fn datagram(&mut self, at: Time, observed: &Observed<'_>, datagram: &[u8]) -> bool {
        let inside = &mut *self.inside;
        if inside.bytes.len() + HEAD_BYTES + datagram.len() > self.ring.capacity_bytes {
            note_drop(&mut inside.gap, at, observed.topic.name());
            return false;
        }
        // No datagram is longer than UDP allows.
        inside.bytes.extend_from_slice(&(datagram.len() as u32).to_le_bytes());
        inside.bytes.extend_from_slice(&at.as_nanos().to_le_bytes());
        inside.bytes.push(u8::from(observed.verified));
        inside.bytes.extend_from_slice(datagram);
        true
    }
}

impl Drop for Putting<'_> {
    fn drop(&mut self) {
        // Below that, whoever takes comes by itself soon enough: most datagrams wake nobody.
        if self.inside.bytes.len() * 2 > self.ring.capacity_bytes {
            self.ring.something.notify_one();
        }
    }
}

fn note_drop(gap: &mut Option<Gap>, at: Time, topic: &str) {
    let gap = gap.get_or_insert_with(|| Gap { from: at, until: at, dropped: BTreeMap::new() });
    gap.until = gap.until.max(at);
    let named = gap.dropped.contains_key(topic) || gap.dropped.len() < TOPICS_MAX;
    let topic = if named { topic } else { OTHERS };
    match gap.dropped.get_mut(topic) {
        Some(count) => *count += 1,
        None => {
            gap.dropped.insert(topic.to_owned(), 1);
        }
    }
}

/// The datagrams of a drained buffer, in order: when each arrived, and what it is.
pub(crate) fn datagrams(mut bytes: &[u8]) -> impl Iterator<Item = (Time, Observed<'_>)> {
    std::iter::from_fn(move || {
        let (head, rest) = bytes.split_first_chunk::<HEAD_BYTES>()?;
        let (length, head) = head.split_first_chunk::<4>()?;
        let (at, verified) = head.split_first_chunk::<8>()?;
        let (datagram, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        bytes = rest;
        let opened = wire::open(datagram).ok()?;
        let (header, topic, body) = (*opened.claimed(), opened.topic(), opened.body_unverified());
        let observed = Observed { header, topic, body, verified: verified == [1] };
        Some((Time::from_nanos(i64::from_le_bytes(*at)), observed))
    })
}

#[cfg(test)]
mod tests;
