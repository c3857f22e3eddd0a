//! A service dies, sleeps or comes back, at every phase of a flight.

use quantity::Span;
use schemas::{CommandSent, topics};

use front_door::experiment::message;

use crate::common::{Flight, arena};

/// Down on the floor with its motors off.
fn is_down(flight: &Flight) -> bool {
    let truth = flight.arena.plant().truth(1).unwrap();
    truth.motion.position_m.z < 0.05 && truth.motion.velocity_m_s.norm() < 0.05 && truth.motors_off()
}

#[test]
fn without_the_estimator_the_vehicle_comes_down_and_its_motors_stop() {
    for seed in 1..=4 {
        let mut flight = Flight::hovering("double-flip", seed);
        flight.arena.kill("estimator");
        flight.run(Span::from_secs(25));
        assert!(is_down(&flight), "seed {seed}: {:?}", flight.arena.plant().truth(1));
    }
}

#[test]
fn without_the_controller_the_vehicle_comes_down_and_its_motors_stop() {
    for seed in 1..=4 {
        let mut flight = Flight::hovering("double-flip", seed);
        flight.arena.kill("hover-controller");
        flight.run(Span::from_secs(25));
        assert!(is_down(&flight), "seed {seed}: {:?}", flight.arena.plant().truth(1));
    }
}

#[test]
fn any_service_may_die_in_hover_and_come_back_a_second_later() {
    for name in roster::SERVICES {
        let mut flight = Flight::hovering("double-flip", 5);
        flight.arena.kill(name);
        flight.run(Span::from_secs(1));
        flight.arena.restart(name).unwrap();
        flight.run(Span::from_secs(30));
        let extremes = flight.arena.plant().extremes(1).unwrap();
        assert!(!extremes.crashed, "{name}: hit the floor at {} m/s", extremes.touchdown_m_s_max);
    }
}

#[test]
fn any_service_may_die_in_a_flip_and_come_back_a_second_later() {
    for name in roster::SERVICES {
        let mut flight = Flight::to_learn(arena("double-flip"), 6);
        // Long enough to be within the second or third flip or the recovery after it, wherever that falls.
        flight.run(Span::from_millis(24_350));
        flight.arena.kill(name);
        flight.run(Span::from_secs(1));
        flight.arena.restart(name).unwrap();
        flight.run(Span::from_secs(30));
    }
}

#[test]
fn a_controller_that_slept_through_its_own_backlog_sends_no_old_frame() {
    let mut flight = Flight::hovering("double-flip", 7);
    flight.arena.pause("hover-controller", Span::from_secs(2));
    flight.run(Span::from_millis(1_500));
    let mut sent = 0;
    flight.arena.run_for(Span::from_millis(400), &mut |heard| {
        sent += usize::from(message::<CommandSent>(&heard, &topics::COMMAND_SENT).is_some());
    });
    assert_eq!(sent, 0, "the bridge repeated a command of a controller that sleeps");
    flight.run(Span::from_secs(20));
}
