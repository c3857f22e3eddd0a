//! Who a program on the bus is.

use std::time::Duration;

use service_core::{Identity, Seed, source_of};
use wire::Domain;

use crate::clock;

/// 2026-01-01 00:00:00 UTC, in seconds since 1970.
const INCARNATION_EPOCH_S: i64 = 1_767_225_600;
/// A supervisor does not restart a service faster; in `u32` it lasts 13 years.
const INCARNATION_TICK: Duration = Duration::from_millis(100);

/// The incarnation of a program that starts at this wall-clock time: rises by one every 100 ms.
///
/// A wall clock set back would make a restarted node look older than it was, so a supervisor, which knows
/// what it started before, gives `--incarnation` itself.
#[must_use]
pub fn incarnation_at(wall_ns: i64) -> u32 {
    let since_epoch_ns = wall_ns.saturating_sub(INCARNATION_EPOCH_S * 1_000_000_000);
    let ticks = since_epoch_ns / INCARNATION_TICK.as_nanos() as i64;
    u32::try_from(ticks.max(1)).unwrap_or(u32::MAX)
}

/// The incarnation of a program that starts now.
#[must_use]
pub fn incarnation_now() -> u32 {
    incarnation_at(clock::wall_clock_ns())
}

/// The identity of a service's only instance.
///
/// The seed follows from run and name: a recording of the run, which names both, repeats it.
#[must_use]
pub fn identity(service: &str, domain: Domain, run: u64, incarnation: u32) -> Identity {
    let source = source_of(service);
    Identity {
        source,
        incarnation,
        domain,
        run,
        seed: Seed(run ^ (u64::from(source) << 32 | u64::from(source))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incarnations_rise_ten_times_a_second_and_never_wrap() {
        let start_ns = INCARNATION_EPOCH_S * 1_000_000_000;
        assert_eq!(incarnation_at(start_ns + 5_000_000_000), 50);
        assert_eq!(incarnation_at(start_ns + 5_100_000_000), 51);
        assert_eq!(incarnation_at(0), 1);
        assert_eq!(incarnation_at(i64::MIN), 1);
        assert_eq!(incarnation_at(i64::MAX), u32::MAX);
    }

    #[test]
    fn services_of_a_run_differ_in_source_and_seed() {
        let one = identity("estimator", Domain::Sim, 7, 1);
        let other = identity("learner", Domain::Sim, 7, 1);
        assert_ne!(one.source, other.source);
        assert_ne!(one.seed, other.seed);
        assert_eq!(one, identity("estimator", Domain::Sim, 7, 1));
    }
}
