//! What a node says of its own steps, and that it is enough to make them again.

use schemas::{JournalStep, NodeJournal};

use super::*;
use crate::{AnyCore, Stepper};

/// Batches as a recorder finds them.
fn batches(said: &Said) -> Vec<NodeJournal> {
    let journals = said.0.iter().filter(|(_, kind, _)| *kind == Kind::Journal);
    journals.map(|(.., body)| wire::decode(body).unwrap()).collect()
}

fn waking_arena() -> Arena {
    arena("[radio-bridge]\nwakes_every_ms = 30")
}

/// A node that hears two commands, its device and its deadline, all within one batch.
fn an_eventful_life() -> (Said, Vec<NodeJournal>) {
    let mut node = Node::<Bridge>::new(&waking_arena(), &secret(), identity(), BEGIN).unwrap();
    let bytes = DeviceBytes { port: 3, at: BEGIN, bytes: vec![9; 40].try_into().unwrap() };
    let said = Said::during(|sink| {
        let _ = node.receive(after(1), &Sender::command(1, 5).datagram(), sink);
        node.inject(after(2), &topics::RADIO_RX, bytes, sink);
        node.wake(after(30), sink);
        let _ = node.receive(after(31), &Sender::command(4, 6).datagram(), sink);
        node.close(after(32), sink);
    });
    let batches = batches(&said);
    (said, batches)
}

#[test]
fn each_step_is_journalled_with_its_instant_and_cause() {
    let (_, batches) = an_eventful_life();
    let [batch] = &batches[..] else { panic!("{} batches", batches.len()) };
    assert_eq!((batch.node.as_str(), batch.started_at, batch.seed), ("radio-bridge", BEGIN, 42));
    assert_eq!((batch.first_step, batch.settings_digest), (0, waking_arena().digest()));
    let sender = Sender::command(1, 5).header;
    let command = JournalStream {
        topic_hash: topics::VEHICLE_COMMAND.hash,
        source: sender.source,
        incarnation: sender.incarnation,
    };
    let device = JournalStream { topic_hash: topics::RADIO_RX.hash, source: 7, incarnation: 2 };
    assert_eq!(batch.streams[..], [command, device]);
    let steps: Vec<_> =
        batch.steps.iter().map(|step| (step.at, step.stream, step.sequence, step.outputs)).collect();
    let expected = [
        (after(1), 0, 5, 2),
        (after(2), 1, 1, 0),
        (after(30), JournalStep::DEADLINE, 0, 0),
        (after(31), 0, 6, 2),
    ];
    assert_eq!(steps, expected);
    assert_eq!((batch.steps[1].digest, batch.steps[2].digest), (0, 0), "nothing said, nothing digested");
    assert_ne!(batch.steps[0].digest, batch.steps[3].digest);
}

#[test]
fn a_bare_core_fed_the_same_says_the_same() {
    let (said, batches) = an_eventful_life();
    let start = Start { at: batches[0].started_at, seed: Seed(batches[0].seed), incarnation: 2 };
    let mut core = Stepper::<Bridge>::new(&waking_arena(), start).unwrap();
    let mut replayed = Vec::new();
    for step in &*batches[0].steps {
        let mut say = |topic: &'static Topic, body: &[u8]| replayed.push((topic.name, body.to_vec()));
        let outcome = if step.stream == JournalStep::DEADLINE {
            core.step_deadline(step.at, &mut say)
        } else {
            let stream = batches[0].streams[usize::from(step.stream)];
            let index = core.topics_in().iter().position(|topic| topic.hash == stream.topic_hash).unwrap();
            let body = match core.topics_in()[index].name {
                "vehicle/command" if step.sequence == 5 => Sender::command(1, 5).body,
                "vehicle/command" => Sender::command(4, 6).body,
                own => {
                    let of_device =
                        |(name, kind, _): &&(&str, Kind, Vec<u8>)| *name == own && *kind == Kind::Data;
                    said.0.iter().find(of_device).unwrap().2.clone()
                }
            };
            core.step_input(step.at, index, &body, &mut say).unwrap()
        };
        assert_eq!((outcome.outputs, outcome.digest), (step.outputs, step.digest));
    }
    let data = said
        .0
        .iter()
        .filter(|(name, kind, _)| *kind == Kind::Data && !["node/health", "radio/rx"].contains(name));
    assert_eq!(replayed, data.map(|(name, _, body)| (*name, body.clone())).collect::<Vec<_>>());
}

#[test]
fn a_batch_goes_out_after_a_tenth_of_a_second_or_when_it_is_full() {
    let mut node = bridge();
    let mut said = Said::during(|sink| {
        let _ = node.receive(after(1), &Sender::command(1, 1).datagram(), sink);
    });
    assert!(batches(&said).is_empty());
    assert_eq!(node.deadline(), Some(after(101)));
    said = Said::during(|sink| node.wake(after(101), sink));
    assert_eq!(batches(&said)[0].steps.len(), 1);
    said = Said::during(|sink| {
        for sequence in 2..=50 {
            let _ = node.receive(after(102), &Sender::command(1, sequence).datagram(), sink);
        }
    });
    let full = batches(&said);
    assert_eq!((full.len(), full[0].first_step, full[0].steps.len()), (1, 1, 48));
    said = Said::during(|sink| node.close(after(103), sink));
    let rest = batches(&said);
    assert_eq!((rest.len(), rest[0].first_step, rest[0].steps.len()), (1, 49, 1));
    said = Said::during(|sink| node.close(after(104), sink));
    assert!(said.0.is_empty(), "all is said");
}

#[test]
fn more_senders_than_a_batch_has_room_for_begin_another() {
    let mut node = bridge();
    let said = Said::during(|sink| {
        for source in 0..40 {
            let mut sender = Sender::command(1, 1);
            sender.header.source = source;
            let _ = node.receive(after(1), &sender.datagram(), sink);
        }
        node.close(after(2), sink);
    });
    let steps: Vec<_> = batches(&said).iter().map(|batch| (batch.streams.len(), batch.steps.len())).collect();
    assert_eq!(steps, [(32, 32), (8, 8)]);
}

#[test]
fn whoever_reaches_into_the_core_ends_its_journal() {
    let mut node = bridge();
    let said = Said::during(|sink| {
        let _ = node.receive(after(1), &Sender::command(1, 1).datagram(), sink);
        node.core_mut().heard.clear();
        let _ = node.receive(after(2), &Sender::command(1, 2).datagram(), sink);
        node.close(after(3), sink);
    });
    assert!(batches(&said).is_empty());
}
