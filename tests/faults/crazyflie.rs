//! A Crazyflie's radio falls silent, its bridge dies, a person stops it.

use front_door::experiment::{node, services};
use plant::faults::Fault;
use quantity::{Span, Time};
use service_core::Node;
use settings::Arena;
use virtual_arena::VirtualArena;

use super::stop::Person;
use crate::common::{Flight, arena};

const ID: u8 = 5;

fn motors_off(flight: &Flight) -> bool {
    flight.arena.plant().truth(ID).unwrap().motors_off()
}

fn flies(flight: &Flight) -> bool {
    !motors_off(flight) && flight.position_m(ID).z > 0.5
}

#[test]
fn a_cut_link_leaves_it_level_and_after_two_seconds_its_motors_stop() {
    for seed in 1..=4 {
        let mut flight = Flight::hovering("crazyflie-hover", seed);
        let cut = flight.arena.now();
        let loss = Fault::CommandLoss { vehicle: ID, loss_ratio: 1.0 };
        flight.arena.plant_mut().fault(loss, cut, cut + Span::from_secs(6));
        flight.run(Span::from_millis(1_900));
        let truth = flight.arena.plant().truth(ID).unwrap();
        let tilt = truth.motion.orientation.tilt_rad();
        println!("seed {seed}: 1.9 s after the cut at {:?}, tilt {tilt:.3}", truth.motion.position_m);
        assert!(!truth.motors_off() && tilt < 0.1, "seed {seed}: {truth:?}");
        flight.run(Span::from_millis(250));
        assert!(motors_off(&flight), "seed {seed}");
        flight.run(Span::from_secs(20));
        assert!(motors_off(&flight) && flight.position_m(ID).z < 0.1, "seed {seed}: nobody has ordered anew");
    }
}

#[test]
fn a_bridge_that_comes_back_in_time_flies_on_and_one_that_is_late_finds_it_down() {
    for (away, lasts) in [(300, true), (1_200, true), (3_000, false)] {
        let mut flight = Flight::hovering("crazyflie-hover", 5);
        flight.arena.kill("radio-bridge");
        flight.run(Span::from_millis(away));
        flight.arena.restart("radio-bridge").unwrap();
        flight.run(Span::from_secs(20));
        assert_eq!(flies(&flight), lasts, "{away} ms away: {:?}", flight.position_m(ID));
        assert!(lasts || motors_off(&flight), "{away} ms");
    }
}

#[test]
fn any_other_service_may_die_in_hover_and_come_back_a_second_later() {
    for name in roster::SERVICES.iter().filter(|name| **name != "radio-bridge") {
        let mut flight = Flight::hovering("crazyflie-hover", 6);
        flight.arena.kill(name);
        flight.run(Span::from_secs(1));
        flight.arena.restart(name).unwrap();
        flight.run(Span::from_secs(30));
        let extremes = flight.arena.plant().extremes(ID).unwrap();
        assert!(!extremes.crashed, "{name}: hit the floor at {} m/s", extremes.touchdown_m_s_max);
    }
}

#[test]
fn without_the_controller_or_the_estimator_it_comes_down() {
    for name in ["estimator", "hover-controller"] {
        let mut flight = Flight::hovering("crazyflie-hover", 7);
        flight.arena.kill(name);
        flight.run(Span::from_secs(20));
        let extremes = flight.arena.plant().extremes(ID).unwrap();
        println!("without the {name}: down at {:.2} m/s", extremes.touchdown_m_s_max);
        assert!(motors_off(&flight) && flight.position_m(ID).z < 0.1, "{name}");
    }
}

/// Presses the stop in a flight of its own; answers how long it took until the motors were off.
fn press(settings: &Arena, seed: u64) -> Span {
    let stop_at = Time::ZERO + Span::from_millis(5_000 + (seed * 97) as i64 % 6_000);
    let release_at = stop_at + Span::from_secs(4);
    let factory = move |name: &str, arena: &Arena, secret: &wire::Secret, identity, now| {
        if name != "arena" {
            return node(name, arena, secret, identity, now);
        }
        let mut node = Node::<Person>::new(arena, secret, identity, now)?;
        (node.core_mut().stop_at, node.core_mut().release_at) = (stop_at, release_at);
        Ok(Box::new(node) as Box<dyn service_core::AnyNode>)
    };
    let mut flying = VirtualArena::new(settings, seed, &services(), &factory).unwrap();
    flying.run_until(stop_at, &mut |_| {});
    let off = |flying: &VirtualArena<'_>| flying.plant().truth(ID).unwrap().motors_off();
    assert!(!off(&flying), "seed {seed}: it flies by then");
    let loss = Fault::CommandLoss { vehicle: ID, loss_ratio: 0.3 };
    flying.plant_mut().fault(loss, stop_at, Time::FAR_FUTURE);
    flying.network_mut().loss_ratio = 0.3;
    while !off(&flying) && flying.now() - stop_at < Span::from_secs(2) {
        flying.run_for(Span::from_millis(1), &mut |_| {});
    }
    let took = flying.now() - stop_at;
    // Released or not, its supervisor is locked until it is restarted.
    let end = release_at + Span::from_secs(5);
    while flying.now() < end {
        flying.run_for(Span::from_millis(20), &mut |_| {});
        assert!(off(&flying), "seed {seed}: it must stay off");
    }
    took
}

#[test]
fn an_emergency_stop_is_effective_at_once_and_lasts() {
    let settings = arena("crazyflie-hover");
    let mut spans: Vec<Span> = (1..=40).map(|seed| press(&settings, seed)).collect();
    spans.sort_unstable();
    println!("40 presses of a Crazyflie's stop: median {}, longest {}", spans[20], spans[39]);
    assert!(spans[39] <= Span::from_millis(200), "{spans:?}");
}
