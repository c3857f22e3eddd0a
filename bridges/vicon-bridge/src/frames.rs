//! Frame numbers that never fall, and datagrams put together to frames.

use quantity::{Span, Time};
use schemas::MocapFrame;

/// A run of falling numbers shorter than this is no restart.
const RESTART_FRAMES_MIN: u32 = 5;

/// What a datagram's frame number says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Numbering {
    /// A frame after all before it, by its unwrapped number.
    New(u64),
    /// The newest frame once more.
    Same,
    /// An earlier frame: out of order, or the vendor's system starts over, which only its next frames will
    /// tell.
    Late,
    /// A frame of a vendor's system that has started over, by its unwrapped number.
    Restarted(u64),
}

/// Unwraps the vendor's 32-bit count.
#[derive(Clone, Debug)]
pub(crate) struct FrameCounter {
    restart: Span,
    newest: Option<(u32, u64)>,
    behind: Option<Behind>,
}

/// A run of numbers behind the newest, each above the one before, with no newer one among them.
#[derive(Clone, Copy, Debug)]
struct Behind {
    since: Time,
    number: u32,
    frames: u32,
}

impl FrameCounter {
    /// A count that has not begun; a run of numbers behind the newest means a restart if it lasts for
    /// `restart`.
    pub(crate) const fn new(restart: Span) -> Self {
        Self { restart, newest: None, behind: None }
    }

    /// Takes in the number of a datagram that arrived at `at`.
    pub(crate) fn sight(&mut self, number: u32, at: Time) -> Numbering {
        let Some((newest, frame)) = self.newest else {
            self.newest = Some((number, u64::from(number)));
            return Numbering::New(u64::from(number));
        };
        // Half the range ahead is ahead, the other half behind: the only reading that survives the wrap.
        let ahead = number.wrapping_sub(newest);
        if ahead == 0 {
            return Numbering::Same;
        }
        if ahead <= u32::MAX / 2 {
            let frame = frame + u64::from(ahead);
            self.newest = Some((number, frame));
            self.behind = None;
            return Numbering::New(frame);
        }
        let run = self.run_behind(number, at);
        if run.frames < RESTART_FRAMES_MIN || at - run.since < self.restart {
            self.behind = Some(run);
            return Numbering::Late;
        }
        self.behind = None;
        self.newest = Some((number, frame + 1));
        Numbering::Restarted(frame + 1)
    }

    fn run_behind(&self, number: u32, at: Time) -> Behind {
        match self.behind {
            Some(run) if run.number == number => run,
            Some(run) if number.wrapping_sub(run.number) <= u32::MAX / 2 => {
                Behind { number, frames: run.frames.saturating_add(1), ..run }
            }
            _ => Behind { since: at, number, frames: 1 },
        }
    }
}

/// A frame whose datagrams are still coming.
#[derive(Clone, Debug)]
pub(crate) struct OpenFrame {
    /// The frame, its exposure still to be filled in.
    pub(crate) message: MocapFrame,
    /// When its first datagram came, less what its latency had above the usual: what the clock's fit goes by.
    pub(crate) first_at: Time,
    /// When to stop waiting for more.
    pub(crate) close_at: Time,
    /// A bit per vehicle of the fleet the datagrams spoke of, believed or not.
    pub(crate) reported: u16,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn counter() -> FrameCounter {
        FrameCounter::new(Span::from_millis(50))
    }

    #[test]
    fn the_count_goes_on_across_the_wrap() {
        let mut counter = counter();
        assert_eq!(counter.sight(u32::MAX - 1, at(0)), Numbering::New(u64::from(u32::MAX) - 1));
        assert_eq!(counter.sight(u32::MAX, at(5)), Numbering::New(u64::from(u32::MAX)));
        assert_eq!(counter.sight(0, at(10)), Numbering::New(1 << 32));
        assert_eq!(counter.sight(u32::MAX, at(11)), Numbering::Late);
        assert_eq!(counter.sight(2, at(20)), Numbering::New((1 << 32) + 2));
    }

    #[test]
    fn stragglers_are_late_and_repeats_are_the_same() {
        let mut counter = counter();
        counter.sight(100, at(0));
        assert_eq!(counter.sight(100, at(0)), Numbering::Same);
        assert_eq!(counter.sight(103, at(10)), Numbering::New(103));
        for (number, milliseconds) in [(101, 11), (102, 11), (99, 90)] {
            assert_eq!(counter.sight(number, at(milliseconds)), Numbering::Late);
        }
        assert_eq!(counter.sight(104, at(95)), Numbering::New(104));
    }

    #[test]
    fn a_restart_is_believed_after_a_run_of_rising_numbers() {
        for restart_at in [0, 1, 90_000, 99_950] {
            let mut counter = counter();
            counter.sight(100_000, at(0));
            let mut numberings =
                (0..11).map(|frame| counter.sight(restart_at + frame, at(1000 + 5 * i64::from(frame))));
            assert!(numberings.by_ref().take(10).all(|sighting| sighting == Numbering::Late));
            assert_eq!(numberings.next(), Some(Numbering::Restarted(100_001)));
            assert_eq!(counter.sight(restart_at + 11, at(1055)), Numbering::New(100_002));
        }
    }

    #[test]
    fn one_number_stuck_behind_is_no_restart() {
        let mut counter = counter();
        counter.sight(100, at(0));
        for milliseconds in 0..1000 {
            assert_eq!(counter.sight(7, at(milliseconds)), Numbering::Late);
        }
    }
}
