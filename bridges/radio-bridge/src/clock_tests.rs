//! The clock's fit against two simulated clocks and a link with known delays.

use super::*;

/// Uniform in [0, 1), from a multiplicative congruential generator.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn exponential(&mut self, mean_s: f64) -> f64 {
        -mean_s * quantity::math::ln(1.0 - self.uniform())
    }
}

/// A vehicle that was switched on 87.3 s before the arena's zero, and its link.
struct World {
    noise: Noise,
    drift_ratio: f64,
    boot_s: f64,
    up: (f64, f64),
    down: (f64, f64),
    loss_ratio: f64,
    now_s: f64,
}

impl World {
    fn new(seed: u64, drift_ratio: f64) -> Self {
        let (up, down) = ((0.008, 0.002), (0.008, 0.002));
        Self { noise: Noise(seed), drift_ratio, boot_s: -87.3, up, down, loss_ratio: 0.02, now_s: 5.0 }
    }

    fn uptime_us(&self, arena_s: f64) -> u64 {
        ((arena_s - self.boot_s) * (1.0 + self.drift_ratio) * 1e6) as u64
    }

    fn up_s(&mut self) -> f64 {
        self.up.0 + self.noise.exponential(self.up.1)
    }

    fn down_s(&mut self) -> f64 {
        self.down.0 + self.noise.exponential(self.down.1)
    }

    /// Statuses at 20 Hz and pings every `ping` of them, for `seconds`.
    fn run(&mut self, clock: &mut VehicleClock, seconds: f64, ping: u64) {
        for step in 0..(seconds * 20.0) as u64 {
            self.now_s += 0.05;
            let lost = self.noise.uniform() < self.loss_ratio;
            let arrived_s = self.now_s + self.down_s();
            if !lost {
                clock.hear(self.uptime_us(self.now_s), at(arrived_s));
            }
            if step % ping == 0 {
                self.ping(clock);
            }
        }
    }

    fn ping(&mut self, clock: &mut VehicleClock) {
        let received_s = self.now_s + self.up_s();
        let left_s = received_s + 0.000_7;
        let arrived = at(left_s + self.down_s());
        if self.noise.uniform() < 2.0 * self.loss_ratio {
            return;
        }
        if clock.hear(self.uptime_us(left_s), arrived) != Plausibility::Implausible {
            clock.answer(at(self.now_s), self.uptime_us(received_s), 700, arrived);
        }
    }

    /// Error of the fit for an instant `ago_s` before now.
    fn error_s(&self, clock: &VehicleClock, ago_s: f64) -> f64 {
        let then_s = self.now_s - ago_s;
        (clock.at(self.uptime_us(then_s)).expect("fitted") - at(then_s)).as_secs_f64()
    }
}

fn at(seconds: f64) -> Time {
    Time::ZERO + Span::from_secs_f64(seconds)
}

fn clock() -> VehicleClock {
    VehicleClock::new(Span::from_secs(12), Span::ZERO)
}

#[test]
fn jitter_and_drift_leave_a_fraction_of_a_millisecond() {
    for drift_ratio in [0.0, 20e-6, -20e-6, 200e-6, -200e-6] {
        let mut worst = 0.0_f64;
        let mut sum = 0.0;
        for seed in 1..=20 {
            let (mut world, mut clock) = (World::new(seed, drift_ratio), clock());
            world.run(&mut clock, 1.0, 1);
            world.run(&mut clock, 19.0, 10);
            for _ in 0..20 {
                world.run(&mut clock, 2.0, 10);
                let error = world.error_s(&clock, 0.0).abs();
                worst = worst.max(error).max(world.error_s(&clock, 1.5).abs());
                sum += error / 400.0;
                assert!(error < clock.uncertainty_s(at(world.now_s)));
            }
        }
        assert!(sum < 120e-6, "mean {sum} at drift {drift_ratio}");
        assert!(worst < 500e-6, "worst {worst} at drift {drift_ratio}");
    }
}

#[test]
fn a_second_of_quick_pings_is_enough_to_begin_with() {
    for seed in 1..=20 {
        let (mut world, mut clock) = (World::new(seed, 20e-6), clock());
        world.run(&mut clock, 1.0, 1);
        assert!(world.error_s(&clock, 0.0).abs() < 500e-6, "error {}", world.error_s(&clock, 0.0));
        assert!((0.008..0.0095).contains(&clock.uncertainty_s(at(world.now_s))));
        let least = clock.least_delay().expect("answered").as_secs_f64();
        assert!((0.008..0.009).contains(&least), "least delay {least}");
    }
}

#[test]
fn asymmetric_jitter_does_no_harm() {
    // One exchange's middle would be off by half the difference of its two delays: 10 ms and more here.
    let (mut world, mut clock) = (World::new(3, 20e-6), clock());
    world.down = (0.008, 0.020);
    world.run(&mut clock, 1.0, 1);
    world.run(&mut clock, 30.0, 10);
    let mut sum = 0.0;
    for _ in 0..50 {
        world.run(&mut clock, 1.0, 10);
        sum += world.error_s(&clock, 0.0).abs() / 50.0;
    }
    assert!(sum < 800e-6, "mean {sum}");
}

#[test]
fn a_known_asymmetry_is_taken_off_and_an_unknown_one_stays_within_the_uncertainty() {
    for (told, error_s_max) in [(Span::from_millis(4), 300e-6), (Span::ZERO, 2.3e-3)] {
        let (mut world, mut clock) = (World::new(5, 0.0), VehicleClock::new(Span::from_secs(12), told));
        world.down = (0.012, 0.001);
        world.up = (0.008, 0.001);
        world.run(&mut clock, 1.0, 1);
        world.run(&mut clock, 15.0, 10);
        let error = world.error_s(&clock, 0.0).abs();
        assert!(error < error_s_max, "error {error}");
        assert!(error < clock.uncertainty_s(at(world.now_s)));
    }
}

#[test]
fn before_the_first_answer_there_is_a_guess_that_says_so() {
    let (mut world, mut clock) = (World::new(1, 0.0), clock());
    assert_eq!(clock.at(1_000_000), None);
    for _ in 0..20 {
        world.now_s += 0.05;
        clock.hear(world.uptime_us(world.now_s), at(world.now_s + 0.012));
    }
    assert!(world.error_s(&clock, 0.0).abs() < 5e-3);
    assert_eq!((clock.uncertainty_s(at(world.now_s)), clock.least_delay()), (1.0, None));
}

#[test]
fn the_uncertainty_grows_while_nothing_is_heard() {
    let (mut world, mut clock) = (World::new(1, 20e-6), clock());
    world.run(&mut clock, 20.0, 10);
    let fresh = clock.uncertainty_s(at(world.now_s));
    let later = clock.uncertainty_s(at(world.now_s + 100.0));
    assert!((later - fresh - 0.005).abs() < 1e-4);
    // And the rate carries the fit across the gap.
    world.now_s += 100.0;
    assert!(world.error_s(&clock, 0.0).abs() < later);
}

#[test]
fn a_vehicle_switched_on_anew_is_noticed_at_its_second_message() {
    let (mut world, mut clock) = (World::new(1, 0.0), clock());
    world.run(&mut clock, 5.0, 10);
    world.boot_s = world.now_s - 3.0;
    world.now_s += 0.05;
    assert_eq!(clock.hear(world.uptime_us(world.now_s), at(world.now_s + 0.01)), Plausibility::Implausible);
    world.now_s += 0.05;
    assert_eq!(clock.hear(world.uptime_us(world.now_s), at(world.now_s + 0.01)), Plausibility::Restarted);
    assert_eq!(clock.answers(), 0);
    world.run(&mut clock, 2.0, 1);
    assert!(world.error_s(&clock, 0.0).abs() < 500e-6);
}

#[test]
fn one_absurd_stamp_changes_nothing() {
    let (mut world, mut clock) = (World::new(1, 0.0), clock());
    world.run(&mut clock, 5.0, 10);
    let before = world.error_s(&clock, 0.0);
    for absurd in [u64::MAX, u64::MAX / 2, i64::MAX as u64 / 1000, 0, 1] {
        let arrived = at(world.now_s + 0.01);
        assert_eq!(clock.hear(absurd, arrived), Plausibility::Implausible);
        assert_eq!(clock.hear(world.uptime_us(world.now_s), arrived), Plausibility::Plausible);
    }
    assert_eq!(world.error_s(&clock, 0.0), before);
    assert_eq!(clock.at(u64::MAX), None);
}

#[test]
fn impossible_exchanges_say_nothing() {
    let (mut world, mut clock) = (World::new(1, 0.0), clock());
    world.run(&mut clock, 5.0, 10);
    let (before, answers) = (world.error_s(&clock, 0.0), clock.answers());
    let uptime_us = world.uptime_us(world.now_s);
    clock.answer(at(world.now_s), uptime_us, 500_000, at(world.now_s + 0.1));
    clock.answer(at(world.now_s), uptime_us, 0, at(world.now_s + 3.0));
    clock.answer(at(world.now_s), u64::MAX, u32::MAX, at(world.now_s + 0.1));
    assert_eq!((world.error_s(&clock, 0.0), clock.answers()), (before, answers));
}
