//! When a recorded instant is due on the host's clock, and how well that was kept.

use std::fmt;
use std::str::FromStr;

use quantity::{Span, Time};

/// The slowest and the fastest rate that is kept by the clock.
const RATIO_MIN: f64 = 0.1;
const RATIO_MAX: f64 = 20.0;

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Seconds of the recording per second.
    Ratio(f64),
    /// As fast as the replay's services can follow, in lock step with them.
    Max,
}

impl Rate {
    /// As it recorded.
    pub const REAL_TIME: Self = Self::Ratio(1.0);

    /// As [`schemas::ReplayClock`] says it.
    #[must_use]
    pub fn ratio(self) -> f64 {
        match self {
            Self::Ratio(ratio) => ratio,
            Self::Max => 0.0,
        }
    }
}

impl FromStr for Rate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse::<f64>() {
            Ok(ratio) if (RATIO_MIN..=RATIO_MAX).contains(&ratio) => Ok(Self::Ratio(ratio)),
            _ => Err(format!("{text:?} is no rate: {RATIO_MIN} to {RATIO_MAX}, or max")),
        }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ratio(ratio) => write!(f, "{ratio}"),
            Self::Max => f.write_str("max"),
        }
    }
}

/// The schedule: absolute from its last anchor, so that lateness never adds up.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    host: Time,
    replay: Time,
    ratio: f64,
}

impl Pace {
    /// From now on, where `replay` is due at `host`.
    #[must_use]
    pub fn anchored(host: Time, replay: Time, ratio: f64) -> Self {
        Self { host, replay, ratio }
    }

    /// When a recorded instant is due on the host's clock.
    #[must_use]
    pub fn due(&self, replay: Time) -> Time {
        let ahead_ns = replay.as_nanos().saturating_sub(self.replay.as_nanos());
        // Multiplied in integers where nothing is to be divided: hours from the anchor no nanosecond is lost.
        let host_ns = if self.ratio == 1.0 { ahead_ns } else { (ahead_ns as f64 / self.ratio) as i64 };
        self.host.saturating_add(Span::from_nanos(host_ns))
    }
}

/// Buckets per doubling of a lateness.
const STEPS: usize = 32;
const DOUBLINGS: usize = 40;

/// How late messages were: counts in buckets 3 % wide, so that hours take no more memory than seconds.
#[derive(Clone, Debug)]
pub struct Lateness {
    buckets: Vec<u64>,
    count: u64,
    max: Span,
}

impl Default for Lateness {
    fn default() -> Self {
        Self { buckets: vec![0; STEPS * DOUBLINGS], count: 0, max: Span::ZERO }
    }
}

impl Lateness {
    /// Takes note of one message; early is not late.
    pub fn note(&mut self, late: Span) {
        let late = late.max(Span::ZERO);
        let last = self.buckets.len() - 1;
        self.buckets[bucket(late.as_nanos().unsigned_abs()).min(last)] += 1;
        self.count += 1;
        self.max = self.max.max(late);
    }

    /// Messages noted.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The lateness that this share of the messages did not exceed, to 3 %; zero if there were none.
    #[must_use]
    pub fn quantile(&self, share: f64) -> Span {
        let rank = ((self.count as f64 * share).ceil() as u64).clamp(1, self.count.max(1));
        let mut passed = 0;
        for (index, count) in self.buckets.iter().enumerate() {
            passed += count;
            if passed >= rank {
                return Span::from_nanos(upper_end(index)).min(self.max);
            }
        }
        self.max
    }

    /// The greatest.
    #[must_use]
    pub fn max(&self) -> Span {
        self.max
    }
}

fn bucket(nanos: u64) -> usize {
    if nanos < STEPS as u64 {
        return nanos as usize;
    }
    let doubling = nanos.ilog2() - STEPS.ilog2();
    let step = (nanos >> doubling) as usize - STEPS;
    STEPS * (doubling as usize + 1) + step
}

fn upper_end(bucket: usize) -> i64 {
    if bucket < STEPS {
        return bucket as i64;
    }
    let (doubling, step) = (bucket / STEPS - 1, bucket % STEPS);
    (((STEPS + step + 1) as i64) << doubling) - 1
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{BEGIN, at_ms};

    #[test]
    fn an_instant_is_due_as_far_from_the_anchor_as_the_rate_says() {
        let host = Time::ZERO + Span::from_secs(70);
        for (ratio, host_ms) in [(1.0, 3000), (0.5, 6000), (20.0, 150)] {
            let pace = Pace::anchored(host, BEGIN, ratio);
            assert_eq!(pace.due(at_ms(3000)), host + Span::from_millis(host_ms));
            assert_eq!(pace.due(BEGIN), host);
        }
        // A day on, at rate 1, to the nanosecond; and no recording is so strange that it ends in a panic.
        let pace = Pace::anchored(host, BEGIN, 1.0);
        let day = Span::from_secs(86_400) + Span::from_nanos(1);
        assert_eq!(pace.due(BEGIN + day), host + day);
        assert_eq!(Pace::anchored(host, BEGIN, 0.1).due(Time::FAR_FUTURE), Time::FAR_FUTURE);
    }

    #[test]
    fn rates_outside_the_range_are_refused_with_the_range() {
        for (text, rate) in
            [("1", Rate::REAL_TIME), ("0.1", Rate::Ratio(0.1)), ("20", Rate::Ratio(20.0)), ("max", Rate::Max)]
        {
            assert_eq!(text.parse(), Ok(rate));
        }
        for text in ["0", "0.09", "20.1", "-1", "NaN", "inf", "", "fast"] {
            let error = text.parse::<Rate>().unwrap_err();
            assert!(error.contains("0.1 to 20") && error.contains(text), "{error}");
        }
    }

    #[test]
    fn nothing_noted_is_not_late() {
        let lateness = Lateness::default();
        assert_eq!((lateness.quantile(0.5), lateness.max(), lateness.count()), (Span::ZERO, Span::ZERO, 0));
    }

    proptest! {
        #[test]
        fn quantiles_are_those_of_the_sorted_latenesses(mut nanos in prop::collection::vec(0..10_000_000_000_i64, 1..200)) {
            let mut lateness = Lateness::default();
            for late in &nanos {
                lateness.note(Span::from_nanos(*late));
            }
            nanos.sort_unstable();
            for share in [0.5, 0.99, 1.0] {
                let rank = (nanos.len() as f64 * share).ceil() as usize;
                let exact = nanos[rank - 1];
                let found = lateness.quantile(share).as_nanos();
                prop_assert!(found >= exact && found as f64 <= exact as f64 * 1.04 + 1.0, "{found} for {exact}");
            }
        }
    }
}
