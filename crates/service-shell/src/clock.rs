//! The arena's clock, live: the host's monotonic clock.
//!
//! Wall time is a label in logs and nothing else (a wall clock may be stepped at any moment), with one
//! exception: the kernel stamps received datagrams in wall time. Such a stamp is turned into arena time by
//! its *age*, taken against both clocks at one moment, and bounded by what is known of the queue it came
//! from.

use quantity::{Span, Time};
use rustix::time::{ClockId, Timespec, clock_gettime};

const NANOS_PER_SECOND: i64 = 1_000_000_000;
/// Two readings of clocks take less than this unless something comes between them.
const READING_SPAN: Span = Span::from_micros(5);
const READINGS_MAX: u32 = 4;

/// Reads the arena's clock.
#[must_use]
pub fn now() -> Time {
    Time::from_nanos(nanos(clock_gettime(ClockId::Monotonic)))
}

/// Reads the host's wall clock: nanoseconds since 1970. For labels only.
#[must_use]
pub fn wall_clock_ns() -> i64 {
    nanos(clock_gettime(ClockId::Realtime))
}

/// Whether somebody keeps the wall clock to a reference.
///
/// # Errors
/// The system does not tell.
pub fn synchronised() -> std::io::Result<bool> {
    crate::kernel::clock_synchronised()
}

/// Both clocks at one moment: what turns the kernel's wall-clock stamps into arena time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockPair {
    /// The arena's clock.
    pub arena: Time,
    /// The wall clock, nanoseconds since 1970.
    pub wall_ns: i64,
}

impl ClockPair {
    /// Reads both, the arena's last: an instant made from the pair is late by the time between the two
    /// readings, never early. Should the process be interrupted between them, it reads again.
    #[must_use]
    pub fn read() -> Self {
        let mut before = now();
        let mut pair = Self { arena: before, wall_ns: 0 };
        for _ in 0..READINGS_MAX {
            pair.wall_ns = wall_clock_ns();
            pair.arena = now();
            if pair.arena - before <= READING_SPAN {
                break;
            }
            before = pair.arena;
        }
        pair
    }

    /// The arena time of a kernel stamp.
    ///
    /// The result lies between `earliest` (when its queue was last seen empty) and now, so that a step of the
    /// wall clock between stamp and reading cannot make old data look fresh, nor fresh data older than its
    /// queue.
    #[must_use]
    pub fn arena_time(self, stamp_ns: i64, earliest: Time) -> Time {
        let age = Span::from_nanos(self.wall_ns.saturating_sub(stamp_ns).max(0));
        let at = Time::from_nanos(self.arena.as_nanos().saturating_sub(age.as_nanos()));
        at.max(earliest).min(self.arena)
    }
}

pub(crate) fn timespec(at: Time) -> Timespec {
    let nanos = at.as_nanos().max(1);
    Timespec { tv_sec: nanos / NANOS_PER_SECOND, tv_nsec: nanos % NANOS_PER_SECOND }
}

fn nanos(time: Timespec) -> i64 {
    time.tv_sec.saturating_mul(NANOS_PER_SECOND).saturating_add(time.tv_nsec)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    const MS: i64 = 1_000_000;

    #[test]
    fn the_clock_does_not_go_back() {
        let first = now();
        assert!(now() >= first);
    }

    #[test]
    fn a_stamp_becomes_arena_time_by_its_age() {
        let pair = ClockPair { arena: at_ms(5_000), wall_ns: 1_000_000 * MS };
        assert_eq!(pair.arena_time((1_000_000 - 3) * MS, at_ms(4_000)), at_ms(4_997));
    }

    #[test]
    fn a_step_of_the_wall_clock_stays_within_the_queues_bounds() {
        let pair = ClockPair { arena: at_ms(5_000), wall_ns: 1_000_000 * MS };
        let year_ns = 365 * 86_400 * NANOS_PER_SECOND;
        assert_eq!(pair.arena_time(1_000_000 * MS - year_ns, at_ms(4_990)), at_ms(4_990));
        assert_eq!(pair.arena_time(1_000_000 * MS + year_ns, at_ms(4_990)), at_ms(5_000));
        assert_eq!(pair.arena_time(i64::MIN, at_ms(4_990)), at_ms(4_990));
        assert_eq!(pair.arena_time(i64::MAX, at_ms(4_990)), at_ms(5_000));
    }
}
