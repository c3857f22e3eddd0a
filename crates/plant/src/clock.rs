//! A vehicle's own clock: started before the arena's, running a little fast or slow, ticking at 800 Hz.

use quantity::{Span, Time, math};
use settings::ClockSettings;

use crate::random::Stream;

/// Between two ticks, on the vehicle's clock.
pub const TICK: Span = Span::from_micros(1_250);

/// Parts a nanosecond is divided into, so that a million ticks add up.
const PARTS: f64 = 4_294_967_296.0;

/// A vehicle's clock, seen from the arena's.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleClock {
    /// The last tick on the arena's clock, with the fraction of a nanosecond beyond.
    tick_at: Time,
    parts: u32,
    /// The last tick on the vehicle's clock.
    uptime: Time,
    /// Between two ticks on the arena's clock.
    period: Span,
    period_parts: u32,
    /// Nanoseconds here by nanoseconds there.
    rate: f64,
}

impl VehicleClock {
    /// A clock whose drift, uptime and phase are drawn; its first tick comes within one period after `start`.
    #[must_use]
    pub fn new(settings: &ClockSettings, start: Time, build: &mut Stream) -> Self {
        let rate = 1.0 + settings.drift_ratio_max * build.symmetric();
        let period_ns = TICK.as_nanos() as f64 / rate;
        let whole = math::floor(period_ns);
        let phase = Span::from_secs_f64(build.uniform() * (whole - 1.0) * 1e-9);
        let period = Span::from_nanos(whole as i64);
        Self {
            tick_at: start + phase - period,
            parts: 0,
            uptime: Time::ZERO + Span::from_secs_f64(1.0 + settings.uptime_s_max * build.uniform()),
            period,
            period_parts: ((period_ns - whole) * PARTS) as u32,
            rate,
        }
    }

    /// Length of a tick on the arena's clock.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        TICK.as_secs_f64() / self.rate
    }

    /// When the last tick was, on the arena's clock.
    #[must_use]
    pub fn tick_at(&self) -> Time {
        self.tick_at
    }

    /// When the next tick is, on the arena's clock.
    #[must_use]
    pub fn next_at(&self) -> Time {
        let carry = i64::from(self.parts.checked_add(self.period_parts).is_none());
        self.tick_at + self.period + Span::from_nanos(carry)
    }

    /// Goes on to the next tick and tells it on the vehicle's clock.
    pub fn advance(&mut self) -> Time {
        self.tick_at = self.next_at();
        self.parts = self.parts.wrapping_add(self.period_parts);
        self.uptime += TICK;
        self.uptime
    }

    /// The vehicle's clock at an instant of the arena's not far from the last tick.
    #[must_use]
    pub fn uptime_at(&self, at: Time) -> Time {
        let since = (at - self.tick_at).as_nanos() as f64 * self.rate;
        self.uptime + Span::from_nanos(math::round(since) as i64)
    }

    /// The arena's clock at an instant of the vehicle's not far from the last tick.
    #[must_use]
    pub fn arena_at(&self, uptime: Time) -> Time {
        let since = (uptime - self.uptime).as_nanos() as f64 / self.rate;
        self.tick_at + Span::from_nanos(math::round(since) as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;
    use crate::testing::member;

    #[test]
    fn ticks_stay_on_the_drifting_clock_for_an_hour() {
        let start = Time::from_nanos(5_000_000_000);
        for seed in 0..20 {
            let mut build = Stream::new(seed, Purpose::Build, 1);
            let mut clock = VehicleClock::new(&member().vehicle.plant.clock, start, &mut build);
            let (first_at, first_uptime) = (clock.next_at(), clock.uptime + TICK);
            assert!(first_at >= start && first_at <= start + Span::from_micros(1_251));
            let ticks = 2_880_000;
            for _ in 0..ticks {
                clock.advance();
            }
            let true_ns = TICK.as_nanos() as f64 * f64::from(ticks - 1) / clock.rate;
            assert!(((clock.tick_at() - first_at).as_nanos() as f64 - true_ns).abs() < 2.0);
            assert_eq!((clock.uptime - first_uptime).as_nanos(), TICK.as_nanos() * i64::from(ticks - 1));
            assert!((clock.rate - 1.0).abs() <= 2e-5 && clock.rate != 1.0);
        }
    }

    #[test]
    fn both_clocks_convert_into_each_other() {
        let mut build = Stream::new(9, Purpose::Build, 1);
        let mut clock = VehicleClock::new(&member().vehicle.plant.clock, Time::ZERO, &mut build);
        for _ in 0..1_000 {
            clock.advance();
        }
        for offset in [-2_000_000_000, -1, 0, 1, 777_777] {
            let at = clock.tick_at() + Span::from_nanos(offset);
            assert!((clock.arena_at(clock.uptime_at(at)) - at).abs().as_nanos() <= 1);
        }
    }
}
