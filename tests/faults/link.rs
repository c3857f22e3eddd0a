//! The command link falls silent for good, in every phase of a flight: the vehicle is left to itself.

use device::vehicle_link::{FlightMode, ManeuverPhase};
use plant::faults::Fault;
use quantity::{Span, Time};

use crate::common::{Flight, LANDS_AFTER, arena};

/// Speed and tilt of a touchdown that does no harm (the paper's vehicle falls from 0.1 m unharmed).
const TOUCHDOWN_M_S_MAX: f64 = 1.5;
const TOUCHDOWN_TILT_RAD_MAX: f64 = 0.262;

fn mode(flight: &Flight) -> FlightMode {
    flight.arena.plant().firmware(1).unwrap().mode()
}

/// Runs until the vehicle's firmware is in this state.
fn run_until(flight: &mut Flight, what: &str, holds: impl Fn(&Flight) -> bool) {
    let patience = flight.arena.now() + Span::from_secs(90);
    while !holds(flight) {
        assert!(flight.arena.now() < patience, "no {what} within 90 s");
        flight.run(Span::from_millis(5));
    }
}

/// Waits for the `count`th flip to begin.
fn run_to_flip(flight: &mut Flight, count: u32) {
    for flip in 1..=count {
        run_until(flight, "flip", |flight| mode(flight) == FlightMode::Maneuver);
        if flip < count {
            run_until(flight, "end of a flip", |flight| mode(flight) != FlightMode::Maneuver);
        }
    }
}

/// What is asked of a vehicle left to itself.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// It stays in the hall and comes down gently.
    Gentle,
    /// It comes down whole. A triple flip not learned yet ends at 4 to 5 m/s, 4 m up and 5 m from a wall, with a tilt
    /// that gyros alone do not know to a tenth of a radian: turning over takes half of that way, and what is left to
    /// brake in is as long as it takes.
    Whole,
}

/// What is asked when the last command came that long after the flip's end.
fn asked(scenario: &str, after_ms: i64) -> Asked {
    if scenario == "triple-flip" && after_ms < 500 { Asked::Whole } else { Asked::Gentle }
}

/// No command frame arrives any more; the vehicle must be down, whole, with its motors off.
fn fall_silent(mut flight: Flight, phase: &str, seed: u64, asked: Asked) {
    let now = flight.arena.now();
    let from = flight.arena.plant().truth(1).unwrap().motion;
    flight.arena.plant_mut().fault(Fault::CommandLoss { vehicle: 1, loss_ratio: 1.0 }, now, Time::FAR_FUTURE);
    if asked == Asked::Gentle {
        flight.run(Span::from_secs(16));
    } else {
        flight.arena.run_for(Span::from_secs(16), &mut |_| {});
    }
    let truth = flight.arena.plant().truth(1).unwrap();
    let drift_m = (truth.motion.position_m - from.position_m).horizontal().norm();
    assert!(truth.motors_off(), "{phase}, seed {seed}: still flies: {truth:?}");
    let extremes = flight.arena.plant().extremes(1).unwrap();
    assert!(!extremes.crashed, "{phase}, seed {seed}: {extremes:?}");
    let Some(touchdown) = truth.touchdown else {
        println!("{phase}, seed {seed}: never left the floor");
        return;
    };
    // A vehicle bounces: the hardest of its meetings with the floor counts.
    let down_m_s = extremes.touchdown_m_s_max;
    let left = if extremes.left_hall { " (left the hall)" } else { "" };
    println!(
        "{phase}, seed {seed}: silent at {:.2} m going {:.2} m/s across, {:.2} up; drifted {drift_m:.2} m, touched down at \
         {:.2} m/s down, {:.2} across, tilted {:.3} rad{left}",
        from.position_m.z,
        from.velocity_m_s.horizontal().norm(),
        from.velocity_m_s.z,
        down_m_s,
        touchdown.horizontal_m_s,
        touchdown.tilt_rad,
    );
    let gentle = down_m_s < TOUCHDOWN_M_S_MAX
        && touchdown.horizontal_m_s < TOUCHDOWN_M_S_MAX
        && touchdown.tilt_rad < TOUCHDOWN_TILT_RAD_MAX;
    assert!(gentle || asked == Asked::Whole, "{phase}, seed {seed}: {down_m_s} m/s, {touchdown:?}");
}

const SEEDS: std::ops::RangeInclusive<u64> = 51..=54;

#[test]
fn silence_during_take_off() {
    for seed in SEEDS {
        for height_m in [0.1, 0.5, 1.5] {
            let mut flight = Flight::to_hover(arena("double-flip"), seed);
            run_until(&mut flight, "take-off", |flight| flight.position_m(1).z > height_m);
            fall_silent(flight, &format!("take-off at {height_m} m"), seed, Asked::Gentle);
        }
    }
}

#[test]
fn silence_in_hover() {
    for seed in SEEDS {
        fall_silent(Flight::hovering("double-flip", seed), "hover", seed, Asked::Gentle);
    }
}

/// The vehicle takes its speed from the drag it feels; it need not know how much of it there is.
#[test]
fn silence_in_hover_whatever_the_drag() {
    for drag_1_s in [0.2, 0.6] {
        for seed in SEEDS {
            let mut settings = arena("double-flip");
            settings.fleet[0].vehicle.plant.body.drag_1_s = drag_1_s;
            let mut flight = Flight::to_hover(settings, seed);
            flight.run(Span::from_secs(20));
            fall_silent(flight, &format!("hover with a drag of {drag_1_s} 1/s"), seed, Asked::Gentle);
        }
    }
}

#[test]
fn silence_in_the_middle_of_a_flip() {
    for scenario in ["double-flip", "triple-flip"] {
        for seed in SEEDS {
            for flip in [1, 3] {
                let mut flight = Flight::to_learn(arena(scenario), seed);
                run_to_flip(&mut flight, flip);
                flight.run(Span::from_millis(300));
                fall_silent(flight, &format!("{scenario} {flip}, middle"), seed, asked(scenario, 0));
            }
        }
    }
}

#[test]
fn silence_at_a_flips_end_and_in_the_recovery() {
    for scenario in ["double-flip", "triple-flip"] {
        for seed in SEEDS {
            for (flip, after_ms) in [(1, 0), (1, 200), (1, 600), (3, 0), (3, 1_500)] {
                let mut flight = Flight::to_learn(arena(scenario), seed);
                run_to_flip(&mut flight, flip);
                run_until(&mut flight, "end of the flip", |flight| mode(flight) != FlightMode::Maneuver);
                let status = flight.arena.plant().firmware(1).unwrap().status(flight.arena.now());
                assert_eq!(status.maneuver_phase, ManeuverPhase::Completed);
                flight.run(Span::from_millis(after_ms));
                fall_silent(
                    flight,
                    &format!("{scenario} {flip}, {after_ms} ms after"),
                    seed,
                    asked(scenario, after_ms),
                );
            }
        }
    }
}

#[test]
fn silence_while_landing() {
    for seed in SEEDS {
        for height_m in [3.0, 1.0, 0.3] {
            let mut flight = Flight::to_hover_and_land(arena("double-flip"), seed);
            flight.run(LANDS_AFTER);
            flight.arena.kill("arena");
            flight.arena.restart("arena").unwrap();
            run_until(&mut flight, "landing", |flight| flight.position_m(1).z < height_m);
            fall_silent(flight, &format!("landing at {height_m} m"), seed, Asked::Gentle);
        }
    }
}
