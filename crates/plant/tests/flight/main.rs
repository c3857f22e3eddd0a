//! Whole vehicles in the simulated arena, spoken to by device bytes alone.

mod bytes;
mod faults;
mod flips;
mod ground;
mod planar;

use device::vehicle_link::FlightMode;
use ground::{Goal, Ground, arena};
use quantity::Vector;

#[test]
fn it_takes_off_hovers_and_lands() {
    let mut ground = Ground::new(&arena(), 1);
    ground.run(0.5);
    assert_eq!(ground.status().mode, FlightMode::Disarmed);
    assert!(ground.plant.truth(1).unwrap().motors_off());
    ground.goal = Goal::Hover(Vector::new(0.0, 0.0, 1.5));
    ground.run(8.0);
    let motion = ground.motion();
    assert!((motion.position_m - Vector::new(0.0, 0.0, 1.5)).norm() < 0.15, "{motion:?}");
    assert_eq!(ground.status().mode, FlightMode::Flying);
    ground.goal = Goal::Descend;
    ground.run(5.0);
    let truth = ground.plant.truth(1).unwrap();
    let touchdown = truth.touchdown.expect("it touched down");
    assert!(truth.motors_off(), "{:?}", ground.status());
    assert!(touchdown.vertical_m_s < 1.5 && !touchdown.crashed, "{touchdown:?}");
    let battery = ground.status().battery_mv;
    assert!((12_000..12_600).contains(&battery), "{battery}");
    let extremes = ground.plant.extremes(1).unwrap();
    assert!(extremes.touched_floor && !extremes.left_hall && extremes.height_m_max > 1.4, "{extremes:?}");
}

#[test]
fn a_minute_of_hovering_costs_the_charge_it_should() {
    let mut arena = arena();
    arena.fleet[0].vehicle.plant.battery.hover_endurance_s = 1800.0;
    let mut ground = Ground::new(&arena, 5);
    ground.hover_at(Vector::new(0.0, 0.0, 3.0));
    let before = ground.plant.truth(1).unwrap().battery_ratio;
    ground.run(60.0);
    let used = before - ground.plant.truth(1).unwrap().battery_ratio;
    // A thirtieth of half an hour's hover; the vehicle's rotors give 8 % less and must therefore run no
    // harder.
    assert!((used * 30.0 - 1.0).abs() < 0.15, "{used}");
}

#[test]
fn the_vehicles_clock_runs_apart_from_the_arenas_within_its_drift() {
    let mut ground = Ground::new(&arena(), 6);
    ground.run(120.0);
    let offset_us = |index: usize| {
        let (at, status) = ground.statuses[index];
        at.as_nanos() as f64 * 1e-3 - status.uptime_us as f64
    };
    let (first, last) = (offset_us(0), offset_us(ground.statuses.len() - 1));
    assert!(first.abs() > 1e6, "another zero");
    // 20 millionths of two minutes, and the radio's jitter.
    assert!((last - first).abs() < 2_400.0 + 20_000.0, "{first} {last}");
}
