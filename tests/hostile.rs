//! Hostile datagrams: garbage, truncated, every bit of a valid one flipped, replayed, of another domain, of another
//! run. They change nothing but counters.

use quantity::{Span, Time};
use schemas::topics;
use service_core::{AnyNode, Identity, Seed};
use virtual_arena::Heard;
use wire::{Domain, DropReason, Secret};

use crate::common::{Flight, arena};

/// A datagram of each topic, as it was on the bus of a hovering arena.
fn overheard(flight: &mut Flight, span: Span) -> Vec<Vec<u8>> {
    let mut kept: Vec<(&'static str, Vec<u8>)> = Vec::new();
    flight.arena.run_for(span, &mut |heard: Heard<'_>| {
        let name = heard.published.topic.name;
        if heard.published.is_data() && !kept.iter().any(|(topic, _)| *topic == name) {
            kept.push((name, heard.published.datagram.to_vec()));
        }
    });
    assert!(kept.len() >= 10, "only {} topics were heard", kept.len());
    kept.into_iter().map(|(_, datagram)| datagram).collect()
}

/// What a node says in the next moments if nothing more reaches it.
fn words(node: &mut dyn AnyNode, mut now: Time, span: Span) -> Vec<Vec<u8>> {
    let end = now + span;
    let mut said = Vec::new();
    while let Some(at) = node.deadline().filter(|at| *at <= end) {
        now = now.max(at);
        node.wake(now, &mut |published| {
            // A node's health tells its counters, which is the one thing that may differ.
            if published.topic != &topics::NODE_HEALTH {
                said.push(published.body.to_vec());
            }
        });
    }
    said
}

fn identity(domain: Domain, run: u64) -> Identity {
    Identity { source: 5, incarnation: 1, domain, run, seed: Seed(3) }
}

#[test]
fn every_flipped_bit_and_every_truncation_is_refused_by_every_node() {
    let mut flight = Flight::hovering("double-flip", 11);
    let datagrams = overheard(&mut flight, Span::from_secs(3));
    let settings = arena("double-flip");
    let now = flight.arena.now();
    for name in roster::SERVICES {
        let build =
            || roster::node(name, &settings, &Secret::new([1; 32]), identity(Domain::Sim, 9), now).unwrap();
        let (mut pestered, mut untouched) = (build(), build());
        let steps = pestered.steps();
        for datagram in &datagrams {
            for bit in 0..datagram.len() * 8 {
                let mut flipped = datagram.clone();
                flipped[bit / 8] ^= 1 << (bit % 8);
                let _ = pestered.receive(now, &flipped, &mut |_| panic!("{name} answers a forgery"));
            }
            for length in 0..datagram.len() {
                let _ = pestered.receive(now, &datagram[..length], &mut |_| panic!("{name} answers a stump"));
            }
        }
        assert_eq!(pestered.steps(), steps, "{name} stepped on a forgery");
        assert_eq!(pestered.counters().accepted, 0);
        assert!(pestered.counters().dropped_total() > 0);
        let span = Span::from_millis(900);
        assert_eq!(words(pestered.as_mut(), now, span), words(untouched.as_mut(), now, span), "{name}");
    }
}

#[test]
fn a_flipped_bit_of_a_key_holders_datagram_is_refused_where_the_original_is_taken() {
    let mut flight = Flight::hovering("double-flip", 12);
    let mut kept: Vec<(&'static str, Vec<u8>)> = Vec::new();
    flight.arena.run_for(Span::from_millis(200), &mut |heard| {
        let topic = heard.published.topic;
        if heard.published.is_data()
            && topic.writer != "*"
            && !kept.iter().any(|(name, _)| *name == topic.name)
        {
            kept.push((topic.name, heard.published.datagram.to_vec()));
        }
    });
    let before = flight.dropped(DropReason::Unauthentic);
    let counters = flight.steps_by_node();
    for (_, datagram) in &kept {
        // The body and the tag: a flipped header names another topic, run or domain and is refused as such.
        for bit in (56 * 8)..datagram.len() * 8 {
            let mut flipped = datagram.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            flight.arena.throw(&flipped);
        }
    }
    // At the very instant: nobody's deadline comes in between.
    let now = flight.arena.now();
    flight.arena.run_until(now, &mut |_| {});
    assert!(flight.dropped(DropReason::Unauthentic) > before);
    assert_eq!(flight.steps_by_node(), counters, "a forgery made some core step");
}

#[test]
fn a_replayed_stream_changes_nothing_but_counters() {
    let mut disturbed = Flight::hovering("double-flip", 13);
    let mut quiet = Flight::hovering("double-flip", 13);
    let mut stream = Vec::new();
    let span = Span::from_secs(1);
    disturbed.arena.run_for(span, &mut |heard| stream.push(heard.published.datagram.to_vec()));
    quiet.arena.run_for(span, &mut |_| {});
    // What was still on its way has arrived: a copy that overtakes its original is the first to come, and no replay.
    for arena in [&mut disturbed.arena, &mut quiet.arena] {
        arena.run_for(Span::from_millis(1), &mut |_| {});
    }
    for datagram in &stream {
        disturbed.arena.throw(datagram);
    }
    let said = |flight: &mut Flight| {
        let mut bodies = Vec::new();
        flight.arena.run_for(Span::from_secs(2), &mut |heard| {
            if heard.published.topic != &topics::NODE_HEALTH {
                bodies.push((heard.at, heard.published.datagram.to_vec()));
            }
        });
        bodies
    };
    assert!(said(&mut disturbed) == said(&mut quiet), "the replay was heard");
    assert!(disturbed.dropped(DropReason::Replayed) > 500, "{}", disturbed.dropped(DropReason::Replayed));
}

#[test]
fn another_run_and_another_domain_are_told_apart_and_refused() {
    let mut here = Flight::hovering("double-flip", 14);
    let mut elsewhere = Flight::hovering("double-flip", 15);
    let mut foreign = Vec::new();
    elsewhere
        .arena
        .run_for(Span::from_millis(500), &mut |heard| foreign.push(heard.published.datagram.to_vec()));
    let steps = here.steps_by_node();
    for datagram in &foreign {
        here.arena.throw(datagram);
        // The same with the domain written over: live, then replay.
        for domain in [1, 3] {
            let mut other = datagram.clone();
            other[4] = domain;
            here.arena.throw(&other);
        }
    }
    let now = here.arena.now();
    here.arena.run_until(now, &mut |_| {});
    assert_eq!(here.steps_by_node(), steps);
    assert!(here.dropped(DropReason::Run) > 0);
    assert!(here.dropped(DropReason::Domain) > 0);
}

#[test]
fn a_live_radio_bridge_sends_nothing_for_commands_of_a_simulation() {
    let settings = arena("double-flip");
    let secret = Secret::new([9; 32]);
    let mut flight = Flight::hovering("double-flip", 16);
    let now = flight.arena.now();
    let mut bridge =
        roster::node("radio-bridge", &settings, &secret, identity(Domain::Live, 9), now).unwrap();
    let (mut frames, mut commands) = (0, 0);
    flight.arena.run_for(Span::from_secs(1), &mut |heard| {
        let mut count = |published: service_core::Published<'_>| {
            let to_a_command_link = published.topic == &topics::RADIO_TX
                && wire::decode::<schemas::DeviceBytes>(published.body)
                    .is_ok_and(|bytes| bytes.port >= 0x100);
            frames += usize::from(to_a_command_link);
        };
        commands += u64::from(heard.published.topic == &topics::VEHICLE_COMMAND && heard.published.is_data());
        let mut datagram = heard.published.datagram.to_vec();
        let _ = bridge.receive(heard.at, &datagram, &mut count);
        datagram[4] = Domain::Live as u8;
        let _ = bridge.receive(heard.at, &datagram, &mut count);
        while bridge.deadline().is_some_and(|at| at <= heard.at) {
            bridge.wake(heard.at, &mut count);
        }
    });
    assert_eq!(frames, 0);
    assert!(commands > 150, "only {commands} commands were heard");
    assert!(bridge.counters().dropped_total() >= 2 * commands);
}
