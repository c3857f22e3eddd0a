//! The command link's delay: from a slot to the vehicle acting on its frame.
//!
//! A status names the counter of the newest frame the vehicle accepted and when that was. The counter has
//! five bits, so it comes round every 32 slots; the frame meant is the newest sent with it, if it arrived
//! after it was sent and not much later. Single values are off by jitter and by the error of the clock's fit,
//! so the median of some goes into a slow average.

use quantity::Span;

/// No link that is worth flying on takes longer.
const DELAY_MAX: Span = Span::from_millis(200);
/// A frame may seem to arrive before it was sent by no more than the clock's fit is off.
const DELAY_MIN: Span = Span::from_millis(-5);
/// Values of which the median is taken.
const MEDIAN_OF: usize = 15;
/// Part of the way to each new median.
const SMOOTHING_RATIO: f64 = 0.1;

/// The measured delay of one vehicle's command link.
#[derive(Clone, Debug)]
pub(crate) struct LinkDelay {
    delay_s: f64,
    action_s: f64,
    /// The newest values, in a ring.
    values: [Span; MEDIAN_OF],
    next: usize,
    full: bool,
}

impl LinkDelay {
    /// Not yet measured: `setting_s`. Measured, it is to the frame's arrival, to which `action_s` is added.
    pub(crate) const fn new(setting_s: f64, action_s: f64) -> Self {
        Self { delay_s: setting_s, action_s, values: [Span::ZERO; MEDIAN_OF], next: 0, full: false }
    }

    /// The delay as far as it is known, 0 to 0.2 s.
    pub(crate) const fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// A frame took so long to arrive. False where that is no delay but a mismatch of counters.
    pub(crate) fn measure(&mut self, delay: Span) -> bool {
        if delay < DELAY_MIN || delay > DELAY_MAX {
            return false;
        }
        self.values[self.next] = delay;
        self.next = (self.next + 1) % MEDIAN_OF;
        // The first full median replaces the setting; from then on it is averaged.
        let part = match (self.full, self.next) {
            (true, _) => SMOOTHING_RATIO,
            (false, 0) => 1.0,
            (false, _) => return true,
        };
        self.full = true;
        let mut sorted = self.values;
        sorted.sort_unstable();
        let measured_s = sorted[MEDIAN_OF / 2].as_secs_f64() + self.action_s;
        self.delay_s += part * (measured_s.clamp(0.0, DELAY_MAX.as_secs_f64()) - self.delay_s);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_setting_holds_until_fifteen_frames_are_measured() {
        let mut delay = LinkDelay::new(0.018, 0.0005);
        for _ in 0..14 {
            assert!(delay.measure(Span::from_millis(25)));
            assert_eq!(delay.delay_s(), 0.018);
        }
        delay.measure(Span::from_millis(25));
        assert!((delay.delay_s() - 0.0255).abs() < 1e-12);
    }

    #[test]
    fn mismatches_are_refused_and_outliers_do_not_move_it() {
        let mut delay = LinkDelay::new(0.018, 0.0);
        for frame in 0..300 {
            assert!(!delay.measure(Span::from_millis(640)));
            assert!(!delay.measure(Span::from_millis(-30)));
            let odd = frame % 5 == 0;
            assert!(delay.measure(Span::from_micros(if odd { 150_000 } else { 18_200 + frame % 7 * 100 })));
        }
        assert!((delay.delay_s() - 0.0186).abs() < 2e-4, "{}", delay.delay_s());
    }

    #[test]
    fn a_change_is_followed_within_two_seconds_of_frames() {
        let mut delay = LinkDelay::new(0.018, 0.0);
        (0..200).for_each(|_| assert!(delay.measure(Span::from_millis(18))));
        (0..100).for_each(|_| assert!(delay.measure(Span::from_millis(30))));
        assert!((delay.delay_s() - 0.030).abs() < 1e-4, "{}", delay.delay_s());
    }
}
