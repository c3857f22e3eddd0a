//! The cameras lose a vehicle, or lie about it.

use std::f64::consts::PI;

use plant::faults::{Fault, Occlusion};
use quantity::{Span, Vector};

use crate::common::Flight;

fn off_place_m(flight: &Flight, vehicle: u8) -> f64 {
    let part = &flight.settings.vehicle(vehicle).unwrap().part;
    (Vector::new(part.place_x_m, part.place_y_m, part.place_z_m) - flight.position_m(vehicle)).norm()
}

/// Puts a fault into a settled hover for a while and then gives time to come back.
fn endure(fault: Fault, span: Span, seed: u64) -> Flight {
    let mut flight = Flight::hovering("double-flip", seed);
    let now = flight.arena.now();
    flight.arena.plant_mut().fault(fault, now, now + span);
    flight.run(span);
    flight.run(Span::from_secs(20));
    flight
}

#[test]
fn short_dropouts_are_bridged_however_they_look() {
    for shown in [Occlusion::Absent, Occlusion::ZeroPose, Occlusion::FrozenPose] {
        let flight = endure(Fault::Occluded { vehicle: 1, shown }, Span::from_millis(80), 31);
        assert!(off_place_m(&flight, 1) < 0.05, "{shown:?}: {} m off", off_place_m(&flight, 1));
        assert!(!flight.arena.plant().truth(1).unwrap().motors_off(), "{shown:?}: landed");
    }
}

#[test]
fn long_dropouts_end_in_a_descent_that_does_not_hurt() {
    for shown in [Occlusion::Absent, Occlusion::ZeroPose, Occlusion::FrozenPose] {
        for seed in [32, 33] {
            let mut flight = Flight::hovering("double-flip", seed);
            let now = flight.arena.now();
            let fault = Fault::Occluded { vehicle: 1, shown };
            flight.arena.plant_mut().fault(fault, now, now + Span::from_secs(60));
            flight.run(Span::from_secs(25));
            let truth = flight.arena.plant().truth(1).unwrap();
            assert!(truth.motors_off(), "{shown:?}, seed {seed}: still flies: {truth:?}");
            println!(
                "{shown:?}, seed {seed}: touched down at {:.2} m/s",
                flight.arena.plant().extremes(1).unwrap().touchdown_m_s_max
            );
        }
    }
}

#[test]
fn poses_that_cannot_be_are_not_followed() {
    for fault in [
        Fault::PoseNotANumber { vehicle: 1 },
        Fault::PoseInfinite { vehicle: 1 },
        Fault::PoseInMetres { vehicle: 1 },
        Fault::FlippedPose { vehicle: 1, turn_rad: Vector::new(PI, 0.0, 0.0) },
        Fault::FlippedPose { vehicle: 1, turn_rad: Vector::new(0.0, 0.0, 2.0 * PI / 3.0) },
        Fault::FlippedPose { vehicle: 1, turn_rad: Vector::new(0.0, 0.5 * PI, 0.0) },
    ] {
        let flight = endure(fault, Span::from_millis(80), 34);
        assert!(off_place_m(&flight, 1) < 0.05, "{fault:?}: {} m off", off_place_m(&flight, 1));
    }
}

#[test]
fn frozen_frame_numbers_and_late_frames_are_a_dropout() {
    for fault in
        [Fault::FrozenFrameNumber, Fault::CamerasSilent, Fault::LateFrames { delay: Span::from_millis(40) }]
    {
        let flight = endure(fault, Span::from_millis(80), 35);
        assert!(off_place_m(&flight, 1) < 0.05, "{fault:?}: {} m off", off_place_m(&flight, 1));
    }
}

#[test]
fn twenty_frames_a_second_are_enough_to_stay_in_the_hall() {
    let flight = endure(Fault::SlowFrames { one_of: 10 }, Span::from_secs(10), 36);
    assert!(off_place_m(&flight, 1) < 0.10, "{} m off", off_place_m(&flight, 1));
}

#[test]
fn neither_of_two_swapped_vehicles_follows_the_other() {
    let mut flight = Flight::hovering("fleet", 37);
    let now = flight.arena.now();
    let span = Span::from_millis(80);
    flight.arena.plant_mut().fault(Fault::SwappedMarkers { vehicle: 1, other: 2 }, now, now + span);
    flight.run(Span::from_secs(20));
    for vehicle in [1, 2] {
        assert!(
            off_place_m(&flight, vehicle) < 0.05,
            "vehicle {vehicle}: {} m",
            off_place_m(&flight, vehicle)
        );
    }
}
