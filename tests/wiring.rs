//! The topic table against the services' own contracts.

use std::collections::BTreeMap;

use front_door::director::Director;
use front_door::experiment::node;
use front_door::supervisor::Console;
use quantity::Time;
use schemas::topics;
use service_core::{AnyNode, Core as _, Identity, Node, Seed};
use wire::{Domain, Secret};

use crate::common::arena;

/// Programs that are no cores: what they read and write stands in no contract.
const WITHOUT_CORE: [&str; 3] = ["simulator", "logger", "playback"];

fn identity() -> Identity {
    Identity { source: 1, incarnation: 1, domain: Domain::Sim, run: 7, seed: Seed(1) }
}

fn nodes() -> Vec<Box<dyn AnyNode>> {
    let settings = arena("double-flip");
    let secret = Secret::new([7; 32]);
    let mut nodes: Vec<Box<dyn AnyNode>> = roster::SERVICES
        .iter()
        .map(|name| node(name, &settings, &secret, identity(), Time::ZERO).unwrap())
        .collect();
    nodes.push(Box::new(Node::<Director>::new(&settings, &secret, identity(), Time::ZERO).unwrap()));
    nodes.push(Box::new(Node::<Console>::new(&settings, &secret, identity(), Time::ZERO).unwrap()));
    nodes
}

#[test]
fn every_reader_of_a_topic_is_in_its_row_and_every_row_is_true() {
    let mut readers: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for node in nodes() {
        for topic in node.topics_in() {
            let list = readers.entry(topic.name).or_default();
            if !list.contains(&node.name()) {
                list.push(node.name());
            }
        }
    }
    for topic in topics::ALL {
        let with_core = |reader: &&&str| !WITHOUT_CORE.contains(reader);
        let mut expected: Vec<&str> = topic.readers.iter().filter(with_core).copied().collect();
        expected.sort_unstable();
        let mut found = readers.remove(topic.name).unwrap_or_default();
        found.sort_unstable();
        assert_eq!(found, expected, "readers of {}", topic.name);
    }
    assert!(readers.is_empty(), "read but not in the table: {readers:?}");
}

#[test]
fn every_topic_has_one_writer_and_it_is_the_one_in_its_row() {
    let mut writers: BTreeMap<&str, &str> = BTreeMap::new();
    for node in nodes() {
        for topic in node.topics_out() {
            if let Some(other) = writers.insert(topic.name, node.name()) {
                assert_eq!(other, node.name(), "two writers of {}", topic.name);
            }
            assert_eq!(topic.writer, node.name(), "writer of {}", topic.name);
        }
        // Bytes from a bridge's device are published by the bridge's own node.
        for topic in node.topics_in().iter().filter(|topic| topic.writer == node.name()) {
            writers.insert(topic.name, node.name());
        }
    }
    // Some orders of the front door's are sent by commands that run without a core.
    writers.insert(topics::LOGGER_ORDER.name, Director::NAME);
    writers.insert(topics::STOP_ORDER.name, Director::NAME);
    for topic in
        topics::ALL.iter().filter(|topic| topic.writer != "*" && !WITHOUT_CORE.contains(&topic.writer))
    {
        assert!(writers.contains_key(topic.name), "nobody writes {}", topic.name);
    }
}

#[test]
fn topic_hashes_differ_so_that_a_kernel_filter_tells_them_apart() {
    let mut hashes = BTreeMap::new();
    for topic in topics::ALL {
        if let Some(other) = hashes.insert(topic.hash, topic.name) {
            panic!("{other} and {} share the hash {:#010x}", topic.name, topic.hash);
        }
    }
}
