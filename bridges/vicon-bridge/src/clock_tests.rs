//! The clock fit against synthetic arrivals with a known truth.

use super::*;

const LATENCY: Span = Span::from_millis(10);

/// Uniform in [0, 1), from a multiplicative congruential generator.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Exponentially distributed around a mean.
    fn exponential(&mut self, mean_s: f64) -> f64 {
        -mean_s * quantity::math::ln(1.0 - self.uniform())
    }
}

/// Frames at an even rate, each delayed by the latency and exponential jitter.
struct Cameras {
    noise: Noise,
    frame: u64,
    exposed_s: f64,
    period_s: f64,
    jitter_s: f64,
    extra_s: f64,
}

impl Cameras {
    fn at_hz(rate_hz: f64) -> Self {
        let period_s = 1.0 / rate_hz;
        Self { noise: Noise(1), frame: 0, exposed_s: 100.0, period_s, jitter_s: 0.0002, extra_s: 0.0 }
    }

    /// Number, exposure and arrival of the next frame.
    fn next(&mut self) -> (u64, Time, Time) {
        self.frame += 1;
        self.exposed_s += self.period_s;
        let arrived_s =
            self.exposed_s + LATENCY.as_secs_f64() + self.extra_s + self.noise.exponential(self.jitter_s);
        (self.frame, at(self.exposed_s), at(arrived_s))
    }
}

fn at(seconds: f64) -> Time {
    Time::ZERO + Span::from_secs_f64(seconds)
}

fn clock() -> FrameClock {
    FrameClock::new(LATENCY, Span::from_micros(500), Span::from_millis(1))
}

/// Runs `frames` frames and answers the greatest and the mean error of their exposures.
fn errors_s(clock: &mut FrameClock, cameras: &mut Cameras, frames: u32) -> (f64, f64) {
    let (mut worst, mut sum) = (0.0_f64, 0.0);
    let mut newest = Time::ZERO;
    for _ in 0..frames {
        let (frame, exposed, arrived) = cameras.next();
        clock.observe(frame, arrived);
        let stamped = clock.exposed_at(frame, arrived);
        assert!(stamped > newest && stamped <= arrived);
        newest = stamped;
        let error = (stamped - exposed).as_secs_f64();
        worst = worst.max(error.abs());
        sum += error;
    }
    (worst, sum / f64::from(frames))
}

#[test]
fn exposures_are_right_within_a_fifth_of_the_jitter() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    errors_s(&mut clock, &mut cameras, 400);
    let (worst, mean) = errors_s(&mut clock, &mut cameras, 4000);
    assert!(worst < 40e-6, "worst {worst}");
    assert!(mean.abs() < 25e-6, "mean {mean}");
}

#[test]
fn a_drift_of_the_vendors_clock_is_followed() {
    for drift in [-200e-6, 200e-6] {
        let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
        errors_s(&mut clock, &mut cameras, 1000);
        cameras.period_s *= 1.0 + drift;
        let (worst, _) = errors_s(&mut clock, &mut cameras, 1000);
        assert!(worst < 300e-6, "while the drift sets in, worst {worst}");
        let (worst, _) = errors_s(&mut clock, &mut cameras, 20_000);
        assert!(worst < 60e-6, "under drift {drift}, worst {worst}");
    }
}

#[test]
fn an_odd_rate_is_found() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(178.3));
    errors_s(&mut clock, &mut cameras, 2000);
    let period = clock.period().expect("fitted").as_secs_f64();
    assert!((period * 178.3 - 1.0).abs() < 5e-5, "period {period}");
}

#[test]
fn before_the_fit_only_the_frames_own_jitter_is_left() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    let (worst, _) = errors_s(&mut clock, &mut cameras, 39);
    assert!(worst < 1.2e-3, "worst {worst}");
}

#[test]
fn another_rate_is_noticed_within_three_frames() {
    for rate_hz in [100.0, 60.0, 20.0, 400.0] {
        let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
        errors_s(&mut clock, &mut cameras, 1000);
        cameras.period_s = 1.0 / rate_hz;
        let mut noticed = 0;
        loop {
            let (frame, _, arrived) = cameras.next();
            noticed += 1;
            if clock.observe(frame, arrived) == Rhythm::Broken {
                break;
            }
            clock.exposed_at(frame, arrived);
        }
        assert!(noticed <= 3, "{rate_hz} Hz noticed after {noticed}");
        errors_s(&mut clock, &mut cameras, 40);
        let (worst, _) = errors_s(&mut clock, &mut cameras, 1000);
        assert!(worst < 300e-6, "{rate_hz} Hz, worst {worst}");
    }
}

#[test]
fn a_slightly_other_rate_is_noticed_too() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    errors_s(&mut clock, &mut cameras, 1000);
    cameras.period_s *= 1.02;
    let (worst, _) = errors_s(&mut clock, &mut cameras, 300);
    assert!(worst < 15e-3, "worst {worst}");
    let (worst, _) = errors_s(&mut clock, &mut cameras, 1000);
    assert!(worst < 100e-6, "worst {worst}");
}

#[test]
fn every_tenth_frame_with_its_own_number_needs_no_new_fit() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    errors_s(&mut clock, &mut cameras, 2000);
    for _ in 0..500 {
        for _ in 0..9 {
            cameras.next();
        }
        let (frame, exposed, arrived) = cameras.next();
        assert_eq!(clock.observe(frame, arrived), Rhythm::Steady);
        let error = (clock.exposed_at(frame, arrived) - exposed).as_secs_f64();
        assert!(error.abs() < 80e-6, "error {error}");
    }
}

#[test]
fn a_stall_and_a_passing_delay_leave_the_exposures_where_they_were() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    errors_s(&mut clock, &mut cameras, 2000);
    // 300 ms in which everything waits, then comes in one bunch.
    let release = at(cameras.exposed_s + 0.3);
    for _ in 0..58 {
        let (frame, exposed, arrived) = cameras.next();
        let arrived = arrived.max(release);
        assert_eq!(clock.observe(frame, arrived), Rhythm::Steady);
        assert!((clock.exposed_at(frame, arrived) - exposed).as_secs_f64().abs() < 60e-6);
    }
    // A second of 50 ms more: no block is used, the line goes on as it was.
    cameras.extra_s = 0.05;
    let (worst, _) = errors_s(&mut clock, &mut cameras, 200);
    assert!(worst < 100e-6, "worst {worst}");
    cameras.extra_s = 0.0;
    let (worst, _) = errors_s(&mut clock, &mut cameras, 2000);
    assert!(worst < 100e-6, "worst {worst}");
}

#[test]
fn a_leap_of_the_count_starts_the_fit_over() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    errors_s(&mut clock, &mut cameras, 1000);
    cameras.frame += 5000;
    let (worst, _) = errors_s(&mut clock, &mut cameras, 60);
    assert!(worst < 2e-3, "worst {worst}");
    let (worst, _) = errors_s(&mut clock, &mut cameras, 1000);
    assert!(worst < 300e-6, "worst {worst}");
}

#[test]
fn a_quarter_of_an_hour_of_jitter_never_breaks_the_line() {
    let (mut clock, mut cameras) = (clock(), Cameras::at_hz(200.0));
    for _ in 0..180_000 {
        let (frame, _, arrived) = cameras.next();
        assert_eq!(clock.observe(frame, arrived), Rhythm::Steady);
    }
}
