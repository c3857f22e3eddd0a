//! How often messages come, how evenly, and how late.

use std::collections::VecDeque;

use quantity::{Time, math};
use serde::Serialize;

/// The newest messages of one sender.
#[derive(Clone, Debug)]
pub struct Rates {
    window: usize,
    arrivals: VecDeque<(Time, f64)>,
    messages: u64,
    bytes: u64,
}

/// What the newest messages of one sender say of its rate; times in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Messages since the beginning.
    pub messages: u64,
    /// Messages that the figures are of.
    pub window: usize,
    /// Messages per second.
    pub rate_hz: f64,
    /// Bytes of bodies, since the beginning.
    pub bytes: u64,
    /// Mean of the time between two.
    pub period_ms: f64,
    /// The shortest.
    pub period_ms_min: f64,
    /// The longest.
    pub period_ms_max: f64,
    /// Standard deviation of it.
    pub jitter_ms: f64,
    /// Mean time from sending to arriving.
    pub lateness_ms: f64,
    /// The longest.
    pub lateness_ms_max: f64,
}

impl Rates {
    /// Figures of the newest `window` messages.
    #[must_use]
    pub fn new(window: usize) -> Self {
        Self { window: window.max(2), arrivals: VecDeque::new(), messages: 0, bytes: 0 }
    }

    /// Takes a message.
    pub fn take(&mut self, at: Time, published_at: Time, bytes: usize) {
        self.messages += 1;
        self.bytes += bytes as u64;
        if self.arrivals.len() == self.window {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back((at, milliseconds(published_at, at)));
    }

    /// What they say; `None` of fewer than two messages, between which there is no period.
    #[must_use]
    pub fn figures(&self) -> Option<Figures> {
        let (first, last) = (self.arrivals.front()?.0, self.arrivals.back()?.0);
        let count = self.arrivals.len();
        if count < 2 {
            return None;
        }
        let periods =
            || self.arrivals.iter().zip(self.arrivals.iter().skip(1)).map(|(a, b)| milliseconds(a.0, b.0));
        let mean = milliseconds(first, last) / (count - 1) as f64;
        let variance =
            periods().map(|period| (period - mean) * (period - mean)).sum::<f64>() / (count - 1) as f64;
        let lateness = || self.arrivals.iter().map(|(_, lateness)| *lateness);
        Some(Figures {
            messages: self.messages,
            window: count,
            rate_hz: if mean > 0.0 { 1e3 / mean } else { 0.0 },
            bytes: self.bytes,
            period_ms: mean,
            period_ms_min: periods().fold(f64::INFINITY, f64::min),
            period_ms_max: periods().fold(f64::NEG_INFINITY, f64::max),
            jitter_ms: math::sqrt(variance),
            lateness_ms: lateness().sum::<f64>() / count as f64,
            lateness_ms_max: lateness().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

fn milliseconds(from: Time, to: Time) -> f64 {
    (i128::from(to.as_nanos()) - i128::from(from.as_nanos())) as f64 * 1e-6
}

#[cfg(test)]
mod tests {
    use quantity::Span;

    use super::*;

    #[test]
    fn figures_are_those_of_the_newest_messages() {
        let mut rates = Rates::new(3);
        assert_eq!(rates.figures(), None);
        for (at_ms, sent_ms) in [(0, 0), (100, 99), (110, 108), (140, 137)] {
            let time = |ms| Time::ZERO + Span::from_millis(ms);
            rates.take(time(at_ms), time(sent_ms), 50);
        }
        let figures = rates.figures().unwrap();
        assert_eq!((figures.messages, figures.window, figures.bytes), (4, 3, 200));
        assert_eq!((figures.period_ms, figures.period_ms_min, figures.period_ms_max), (20.0, 10.0, 30.0));
        assert_eq!((figures.rate_hz, figures.jitter_ms), (50.0, 10.0));
        assert_eq!((figures.lateness_ms, figures.lateness_ms_max), (2.0, 3.0));
    }
}
