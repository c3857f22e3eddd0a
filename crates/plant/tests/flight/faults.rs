//! Faults that only a whole vehicle shows.

use device::vehicle_link::{FlightMode, Uplink};
use plant::Fault;
use quantity::{Span, Time, Vector};

use crate::ground::{Goal, Ground, arena, rms};

fn hovering(seed: u64) -> Ground {
    let mut ground = Ground::new(&arena(), seed);
    ground.hover_at(Vector::new(0.0, 0.0, 3.0));
    ground
}

#[test]
fn without_commands_it_levels_then_descends_and_stops() {
    let mut ground = hovering(1);
    let now = ground.plant.now();
    ground.plant.fault(Fault::CommandLoss { vehicle: 1, loss_ratio: 1.0 }, now, Time::FAR_FUTURE);
    let mut modes = Vec::new();
    for _ in 0..80 {
        ground.run(0.1);
        modes.push(ground.plant.firmware(1).unwrap().mode());
    }
    modes.dedup();
    assert_eq!(modes, [FlightMode::Flying, FlightMode::LevelHold, FlightMode::Descend, FlightMode::Landed]);
    let truth = ground.plant.truth(1).unwrap();
    let touchdown = truth.touchdown.expect("it came down");
    assert!(
        truth.motors_off() && touchdown.vertical_m_s < 1.5 && touchdown.horizontal_m_s < 1.5,
        "{touchdown:?}"
    );
}

#[test]
fn a_short_silence_changes_nothing_for_long() {
    let mut ground = hovering(2);
    let now = ground.plant.now();
    ground.plant.fault(Fault::CommandLoss { vehicle: 1, loss_ratio: 1.0 }, now, now + Span::from_millis(300));
    ground.run(3.0);
    assert_eq!(ground.plant.firmware(1).unwrap().mode(), FlightMode::Flying);
    assert!((ground.motion().position_m - Vector::new(0.0, 0.0, 3.0)).norm() < 0.2, "{:?}", ground.motion());
}

#[test]
fn corrupted_command_frames_are_not_flown() {
    let mut ground = hovering(3);
    let now = ground.plant.now();
    ground.plant.fault(Fault::CommandCorruption { vehicle: 1, corruption_ratio: 0.5 }, now, Time::FAR_FUTURE);
    let before = ground.plant.firmware(1).unwrap().counters();
    let mut away = Vec::new();
    for _ in 0..100 {
        ground.run(0.1);
        away.push((ground.motion().position_m - Vector::new(0.0, 0.0, 3.0)).norm());
    }
    let after = ground.plant.firmware(1).unwrap().counters();
    assert!(after.commands_damaged - before.commands_damaged > 100, "{after:?}");
    assert!(rms(away.iter().copied()) < 0.3, "{}", rms(away.iter().copied()));
}

#[test]
fn a_weak_rotor_pulls_the_vehicle_off_and_is_healed() {
    let away = |thrust_ratio: f64| {
        let mut ground = hovering(4);
        let now = ground.plant.now();
        let weak = Fault::WeakRotor { vehicle: 1, rotor: 0, thrust_ratio };
        ground.plant.fault(weak, now, now + Span::from_millis(400));
        ground.run(0.4);
        let away = (ground.motion().position_m - Vector::new(0.0, 0.0, 3.0)).norm();
        ground.run(4.0);
        let after = (ground.motion().position_m - Vector::new(0.0, 0.0, 3.0)).norm();
        (away, after)
    };
    let (healthy, weak) = (away(1.0), away(0.7));
    assert!(weak.0 > healthy.0 + 0.01, "{healthy:?} {weak:?}");
    assert!(weak.1 < 0.15, "{weak:?}");
}

#[test]
fn dead_gyros_stop_the_motors() {
    let mut ground = hovering(5);
    let now = ground.plant.now();
    ground.plant.fault(Fault::GyroNotANumber { vehicle: 1 }, now, Time::FAR_FUTURE);
    ground.run(2.0);
    let truth = ground.plant.truth(1).unwrap();
    assert!(truth.motors_off());
    assert!(ground.plant.extremes(1).unwrap().touched_floor);
}

#[test]
fn an_emergency_stop_by_the_data_link_drops_it_and_it_stays_down() {
    let mut ground = hovering(6);
    for _ in 0..5 {
        ground.send(&Uplink::Stop);
        ground.run(0.02);
    }
    ground.run(3.0);
    let truth = ground.plant.truth(1).unwrap();
    let touchdown = truth.touchdown.expect("it fell");
    assert!(truth.motors_off() && touchdown.crashed && touchdown.vertical_m_s > 6.0, "{touchdown:?}");
    ground.goal = Goal::Hover(Vector::new(0.0, 0.0, 3.0));
    ground.run(1.0);
    assert!(ground.plant.truth(1).unwrap().motors_off());
    assert!(ground.motion().position_m.z < 0.05);
}

#[test]
fn silent_cameras_are_silent_until_the_faults_are_cleared() {
    let mut ground = hovering(7);
    let now = ground.plant.now();
    ground.plant.fault(Fault::CamerasSilent, now, Time::FAR_FUTURE);
    ground.run(0.1);
    let before = ground.vicon.len();
    ground.run(1.0);
    assert_eq!(ground.vicon.len(), before);
    ground.plant.clear_faults();
    ground.run(1.0);
    assert!(ground.vicon.len() > before + 190);
}
