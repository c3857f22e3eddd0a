//! A vehicle's clock on the arena's.
//!
//! The vehicle counts microseconds since it was switched on, by a quartz of its own. A ping leaves at a known
//! arena time and arrives at a known vehicle time; its answer the other way round. Either way takes at least
//! some least delay, so the two of each exchange enclose the offset between the clocks:
//!
//! ```text
//!   arena - vehicle at the ping's arrival   <=  offset  <=   arena - vehicle at the answer's departure
//!   (as sent: too early by the delay up)                     (as received: too late by the delay down)
//! ```
//!
//! Jitter only ever adds to a delay. So of all exchanges in the window the greatest lower bound and the least
//! upper bound count, which need not be of the same exchange, and the offset is taken in the middle: right if
//! the least delays of both ways are equal, and never wrong by more than half the gap.
//!
//! Over the window's seconds the quartz drifts. Its rate is fitted to everything the vehicle sends, since for
//! a rate it does no harm that long reports take longer than answers: of each second the fastest message, and
//! of the slopes between such pairs half the record apart the median.

use std::collections::VecDeque;

use quantity::{Span, Time};

/// Seconds of which the rate's fit remembers the fastest message.
const RATE_BLOCKS: usize = 16;
/// Seconds before there is a rate.
const RATE_BLOCKS_MIN: usize = 8;
/// Length of such a block.
const RATE_BLOCK: Span = Span::from_secs(1);
/// No quartz is further off.
const RATE_RATIO_MAX: f64 = 5e-4;
/// How far the rate may still be off once there is one, for the uncertainty.
const RATE_ERROR_RATIO: f64 = 5e-5;
/// No message is on its way for longer: what seems to be comes from a clock that has been set anew.
const DELAY_MAX: Span = Span::from_secs(1);
/// A message may seem to arrive before it was sent by no more than the fit may be wrong.
const DELAY_MIN: Span = Span::from_millis(-20);
/// Uncertainty while there is only what the vehicle sent by itself.
const UNCERTAINTY_UNANSWERED_S: f64 = 1.0;
/// Delay assumed for that.
const DELAY_UNANSWERED: Span = Span::from_millis(10);

/// One instant on both clocks, but for a delay.
#[derive(Clone, Copy, Debug)]
struct Stamp {
    vehicle_ns: i64,
    arena: Time,
}

impl Stamp {
    fn new(vehicle_us: u64, arena: Time) -> Option<Self> {
        // A third of the range: sums and differences of two stamps cannot overflow.
        let vehicle_ns = i64::try_from(vehicle_us).ok()?.checked_mul(1000)?;
        (vehicle_ns < i64::MAX / 3).then_some(Self { vehicle_ns, arena })
    }

    const fn offset_ns(self) -> i64 {
        self.arena.as_nanos() - self.vehicle_ns
    }
}

/// A ping and its answer.
#[derive(Clone, Copy, Debug)]
struct Exchange {
    up: Stamp,
    down: Stamp,
}

/// The offset at one instant, and its rate.
#[derive(Clone, Copy, Debug)]
struct Fit {
    reference_ns: i64,
    offset_ns: f64,
    rate_ratio: f64,
    half_gap_ns: f64,
    newest: Time,
}

impl Fit {
    fn at(&self, vehicle_ns: i64) -> Time {
        let drift_ns = self.rate_ratio * (vehicle_ns - self.reference_ns) as f64;
        Time::from_nanos(vehicle_ns).saturating_add(Span::from_nanos((self.offset_ns + drift_ns) as i64))
    }
}

/// Whether a message's time stamp can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plausibility {
    /// It can.
    Plausible,
    /// It cannot: the message is to be dropped.
    Implausible,
    /// It cannot, and it is the second in a row: the vehicle was switched on anew, and the fit has started
    /// over.
    Restarted,
}

/// Turns a vehicle's times into the arena's.
#[derive(Clone, Debug)]
pub(crate) struct VehicleClock {
    window: Span,
    half_asymmetry_ns: f64,
    exchanges: VecDeque<Exchange>,
    answers: u32,
    fit: Option<Fit>,
    rate: Rate,
    implausible: u32,
}

impl VehicleClock {
    /// A clock nothing is known of. Exchanges count for `window`; `downlink_extra` is by how much the least
    /// delay from the vehicle is known to exceed that to it.
    pub(crate) fn new(window: Span, downlink_extra: Span) -> Self {
        Self {
            window,
            half_asymmetry_ns: 0.5 * downlink_extra.as_nanos() as f64,
            exchanges: VecDeque::new(),
            answers: 0,
            fit: None,
            rate: Rate::default(),
            implausible: 0,
        }
    }

    /// Answered pings since the clock was last found to be another.
    pub(crate) const fn answers(&self) -> u32 {
        self.answers
    }

    /// Takes in a message stamped by the vehicle at `vehicle_us`.
    pub(crate) fn hear(&mut self, vehicle_us: u64, arrived: Time) -> Plausibility {
        let Some(stamp) = Stamp::new(vehicle_us, arrived) else {
            return Plausibility::Implausible;
        };
        let mut plausibility = Plausibility::Plausible;
        if let Some(fit) = &self.fit {
            let delay = arrived - fit.at(stamp.vehicle_ns);
            if delay < DELAY_MIN || delay > DELAY_MAX {
                self.implausible += 1;
                if self.implausible < 2 {
                    return Plausibility::Implausible;
                }
                plausibility = Plausibility::Restarted;
                self.exchanges.clear();
                self.answers = 0;
                self.fit = None;
                self.rate = Rate::default();
            }
        }
        self.implausible = 0;
        self.rate.hear(stamp);
        if self.answers == 0 {
            self.guess(stamp);
        }
        plausibility
    }

    /// Takes in an answered ping, after [`VehicleClock::hear`] has let its answer pass. An exchange that took
    /// no time, or more than any message is on its way, says nothing.
    pub(crate) fn answer(&mut self, sent: Time, received_us: u64, turnaround_us: u32, arrived: Time) {
        let left_us = received_us.saturating_add(u64::from(turnaround_us));
        let (Some(up), Some(down)) = (Stamp::new(received_us, sent), Stamp::new(left_us, arrived)) else {
            return;
        };
        let on_air = (arrived - sent) - Span::from_micros(i64::from(turnaround_us));
        if on_air < Span::ZERO || on_air > DELAY_MAX * 2 {
            return;
        }
        while self.exchanges.front().is_some_and(|old| arrived - old.down.arena > self.window) {
            self.exchanges.pop_front();
        }
        self.exchanges.push_back(Exchange { up, down });
        self.answers = self.answers.saturating_add(1);
        self.refit();
    }

    /// That vehicle time on the arena's clock; `None` before the vehicle was first heard. Never before the
    /// clock's zero.
    pub(crate) fn at(&self, vehicle_us: u64) -> Option<Time> {
        let stamp = Stamp::new(vehicle_us, Time::ZERO)?;
        self.fit.as_ref().map(|fit| fit.at(stamp.vehicle_ns).max(Time::ZERO))
    }

    /// How far the fit may be off at `now`.
    pub(crate) fn uncertainty_s(&self, now: Time) -> f64 {
        match &self.fit {
            Some(fit) if self.answers > 0 => {
                fit.half_gap_ns * 1e-9 + RATE_ERROR_RATIO * (now - fit.newest).as_secs_f64().max(0.0)
            }
            _ => UNCERTAINTY_UNANSWERED_S,
        }
    }

    /// Least time a message takes, taken to be the same both ways; `None` before the first answer.
    pub(crate) fn least_delay(&self) -> Option<Span> {
        let fit = self.fit.as_ref().filter(|_| self.answers > 0)?;
        Some(Span::from_nanos(fit.half_gap_ns as i64))
    }

    /// Before the first answer, an offset from what the vehicle sends and an assumed delay.
    fn guess(&mut self, stamp: Stamp) {
        let offset_ns = (stamp.offset_ns() - DELAY_UNANSWERED.as_nanos()) as f64;
        let earlier = self.fit.as_ref().is_none_or(|fit| offset_ns < fit.offset_ns);
        if earlier {
            let (reference_ns, newest) = (stamp.vehicle_ns, stamp.arena);
            self.fit = Some(Fit { reference_ns, offset_ns, rate_ratio: 0.0, half_gap_ns: 0.0, newest });
        }
    }

    fn refit(&mut self) {
        let Some(&newest) = self.exchanges.back() else {
            return;
        };
        let (reference_ns, rate_ratio) = (newest.down.vehicle_ns, self.rate.ratio);
        // Relative to a whole number, so that no nanosecond is lost in an f64.
        let base_ns = newest.down.offset_ns();
        let carried = |stamp: Stamp| {
            let drift_ns = rate_ratio * (stamp.vehicle_ns - reference_ns) as f64;
            (stamp.offset_ns() - base_ns) as f64 - drift_ns
        };
        let low = self.exchanges.iter().map(|e| carried(e.up)).fold(f64::NEG_INFINITY, f64::max);
        let high = self.exchanges.iter().map(|e| carried(e.down)).fold(f64::INFINITY, f64::min);
        if high < low - RATE_RATIO_MAX * self.window.as_nanos() as f64 {
            // No rate explains this: one of the clocks leapt. Only the newest exchange is known to be of the
            // new one.
            self.exchanges.clear();
            self.exchanges.push_back(newest);
            self.rate = Rate::default();
            return self.refit();
        }
        self.fit = Some(Fit {
            reference_ns,
            offset_ns: base_ns as f64 + 0.5 * (low + high) - self.half_asymmetry_ns,
            rate_ratio,
            half_gap_ns: (0.5 * (high - low)).max(0.0),
            newest: newest.down.arena,
        });
    }
}

/// By how much the arena's clock gains on the vehicle's.
#[derive(Clone, Debug, Default)]
struct Rate {
    ratio: f64,
    blocks: VecDeque<Stamp>,
    fastest: Option<Stamp>,
    block_ends: Option<Time>,
}

impl Rate {
    fn hear(&mut self, stamp: Stamp) {
        if self.block_ends.is_some_and(|end| stamp.arena < end) {
            let faster = self.fastest.is_none_or(|fastest| stamp.offset_ns() < fastest.offset_ns());
            if faster {
                self.fastest = Some(stamp);
            }
            return;
        }
        self.block_ends = Some(stamp.arena.saturating_add(RATE_BLOCK));
        let Some(fastest) = self.fastest.replace(stamp) else {
            return;
        };
        if self.blocks.len() == RATE_BLOCKS {
            self.blocks.pop_front();
        }
        self.blocks.push_back(fastest);
        if self.blocks.len() >= RATE_BLOCKS_MIN {
            self.ratio = self.slope().clamp(-RATE_RATIO_MAX, RATE_RATIO_MAX);
        }
    }

    fn slope(&self) -> f64 {
        let half = self.blocks.len() / 2;
        let mut slopes = [0.0; RATE_BLOCKS];
        let mut count = 0;
        for (early, late) in self.blocks.iter().zip(self.blocks.iter().skip(half)) {
            let elapsed_ns = (late.vehicle_ns - early.vehicle_ns).max(1) as f64;
            slopes[count] = (late.offset_ns() - early.offset_ns()) as f64 / elapsed_ns;
            count += 1;
        }
        let slopes = &mut slopes[..count];
        slopes.sort_by(f64::total_cmp);
        0.5 * (slopes[(count - 1) / 2] + slopes[count / 2])
    }
}

#[cfg(test)]
#[path = "clock_tests.rs"]
mod tests;
