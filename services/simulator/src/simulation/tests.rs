//! The simulation in virtual time.

use std::path::Path;

use device::sbus;
use device::vehicle_link::CommandFrame;
use plant::Device;
use settings::Ports;

use super::*;

const START: Time = Time::from_nanos(7_000_000_000_123);

fn arena(scenario: &str) -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), scenario).unwrap()
}

fn simulation(scenario: &str) -> Simulation {
    Simulation::new(&arena(scenario), 5, START).unwrap()
}

/// What was said, in a form to compare: kind, time, bytes.
fn said(simulation: &mut Simulation, until: Time) -> Vec<(&'static str, Time, Vec<u8>)> {
    let mut all = Vec::new();
    simulation.advance(until, &mut |said| {
        all.push(match said {
            Said::Device(output) => match output.device {
                Device::MotionCapture => ("vicon", output.at, output.bytes.to_vec()),
                Device::DataLink => ("data-link", output.at, output.bytes.to_vec()),
                other => panic!("{other:?} has nothing to say in this arena"),
            },
            Said::Truth(truth) => ("truth", truth.at, vec![truth.vehicle]),
            Said::Maneuver(maneuver) => ("maneuver", maneuver.ended_at, vec![maneuver.vehicle]),
        });
    });
    all
}

/// A command-link frame to vehicle 1.
fn command(at: Time) -> Arrival {
    let channels = CommandFrame::default().encode(1).unwrap();
    Arrival { at, port: Ports::command_link(1), bytes: sbus::Frame::new(channels).encode().to_vec() }
}

#[test]
fn the_truth_is_told_of_every_vehicle_every_20_ms() {
    let mut simulation = simulation("fleet");
    let all = said(&mut simulation, START + Span::from_millis(105));
    for vehicle in [1, 2, 3] {
        let at: Vec<_> = all
            .iter()
            .filter(|(kind, _, bytes)| *kind == "truth" && *bytes == [vehicle])
            .map(|(_, at, _)| *at)
            .collect();
        let expected: Vec<_> = (0..6).map(|k| START + TRUTH_PERIOD * k).collect();
        assert_eq!(at, expected);
    }
    let frames = all.iter().filter(|(kind, ..)| *kind == "vicon").count();
    assert!((15..=21).contains(&frames), "{frames} frames of 200 Hz in 105 ms less latency");
}

#[test]
fn how_often_it_is_called_changes_nothing() {
    let (mut fine, mut coarse) = (simulation("fleet"), simulation("fleet"));
    let mut fine_said = Vec::new();
    for simulation in [&mut fine, &mut coarse] {
        for k in 1..30 {
            simulation.receive(command(START + Span::from_micros(19_900) * k));
        }
    }
    let end = START + Span::from_millis(600);
    while fine.now() < end {
        let next = fine.next_event().min(end);
        assert!(next > fine.now() || next == fine.now() && fine.now() == START, "{next} at {}", fine.now());
        fine_said.extend(said(&mut fine, next));
    }
    let coarse_said = said(&mut coarse, end);
    assert!(coarse_said.len() > 100);
    assert_eq!(fine_said, coarse_said);
}

#[test]
fn bytes_act_at_their_arrival_whatever_the_order_they_were_read_in() {
    let arrivals: Vec<_> = (0..20).map(|k| command(START + Span::from_millis(20 * k + 3))).collect();
    let (mut forward, mut backward) = (simulation("double-flip"), simulation("double-flip"));
    arrivals.iter().cloned().for_each(|arrival| forward.receive(arrival));
    arrivals.iter().rev().cloned().for_each(|arrival| backward.receive(arrival));
    let end = START + Span::from_millis(500);
    assert_eq!(said(&mut forward, end), said(&mut backward, end));
    assert_eq!(forward.plant.command_link_counts(1), backward.plant.command_link_counts(1));
    assert_ne!(forward.plant.command_link_counts(1), simulation("double-flip").plant.command_link_counts(1));
}

#[test]
fn bytes_of_the_past_act_at_once_and_time_does_not_go_back() {
    let mut simulation = simulation("double-flip");
    said(&mut simulation, START + Span::from_millis(100));
    simulation.receive(command(START + Span::from_millis(50)));
    let all = said(&mut simulation, START + Span::from_millis(200));
    assert!(all.iter().all(|(_, at, _)| *at > START + Span::from_millis(80)), "{all:?}");
    assert!(simulation.inbox.is_empty());
    assert_eq!(simulation.now(), START + Span::from_millis(200));
}
