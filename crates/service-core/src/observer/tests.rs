//! What an ear believes, and what it counts.

use quantity::Time;
use schemas::Topic;
use wire::SigningKey;

use super::*;
use crate::{Identity, Publisher, Seed};

const RUN: u64 = 11;
const NOW: Time = Time::from_nanos(5_000_000_000);

fn secret() -> Secret {
    Secret::new([5; 32])
}

fn observer() -> Observer {
    Observer::new(&secret(), Domain::Sim, RUN)
}

fn datagram(topic: &str, role: Role, sequence: u64, spoil: impl FnOnce(&mut Header)) -> Vec<u8> {
    let mut header = Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: false,
        source: 3,
        schema_id: 9,
        run: RUN,
        incarnation: 1,
        sequence,
        published_at: NOW,
    };
    spoil(&mut header);
    let key = SigningKey::derive(&secret(), header.domain, header.run, role);
    let mut datagram = Vec::new();
    wire::seal(&header, TopicName::new(topic).unwrap(), b"body", &key, &mut datagram).unwrap();
    datagram
}

#[test]
fn every_topic_of_the_table_is_heard_from_its_own_writer_only() {
    let mut observer = observer();
    for (sequence, topic) in (1..).zip(topics::ALL) {
        let role = Role::of(Kind::Data, topic.writer);
        let good = datagram(topic.name, role, sequence, |_| {});
        let observed = observer.observe(&good).unwrap();
        assert!(observed.verified && observed.body == b"body", "{}", topic.name);
        let forged = datagram(topic.name, Role("console"), sequence + 100, |_| {});
        assert_eq!(observer.observe(&forged).unwrap_err(), DropReason::Unauthentic, "{}", topic.name);
    }
    assert_eq!(observer.counters().accepted, topics::ALL.len() as u64);
    assert_eq!(observer.counters().dropped(DropReason::Unauthentic), topics::ALL.len() as u64);
}

#[test]
fn a_topic_of_no_table_is_heard_and_not_believed() {
    let mut observer = observer();
    let unknown = datagram("laser/range", Role("laser"), 1, |_| {});
    assert!(!observer.observe(&unknown).unwrap().verified);
    assert_eq!(observer.observe(&unknown).unwrap_err(), DropReason::Replayed);
    let other_run = datagram("laser/range", Role("laser"), 2, |header| header.run = 12);
    assert_eq!(observer.observe(&other_run).unwrap_err(), DropReason::Run);
    let other_domain = datagram("laser/range", Role("laser"), 2, |header| header.domain = Domain::Live);
    assert_eq!(observer.observe(&other_domain).unwrap_err(), DropReason::Domain);
}

#[test]
fn what_never_came_is_counted_by_source_and_topic() {
    let mut observer = observer();
    for sequence in [1, 2, 5, 4] {
        observer.observe(&datagram("vehicle/state", Role("estimator"), sequence, |_| {})).unwrap();
    }
    observer.observe(&datagram("laser/range", Role("laser"), 1, |_| {})).unwrap();
    observer.observe(&datagram("laser/range", Role("laser"), 11, |_| {})).unwrap();
    let lost: Vec<_> =
        observer.sequences().map(|(topic, stream, counts)| (topic, stream.0, counts.lost)).collect();
    assert_eq!(lost, [("vehicle/state", 3, 1), ("laser/range", 3, 9)]);
    assert_eq!(observer.lost_total(), 10);
}

#[test]
fn a_definition_is_one_only_if_its_id_says_so() {
    static ANNOUNCED: [&Topic; 1] = [&topics::MOCAP_FRAME];
    let identity = Identity { source: 3, incarnation: 1, domain: Domain::Sim, run: RUN, seed: Seed(1) };
    let mut publisher = Publisher::new("vicon-bridge", &secret(), identity);
    let mut announced = Vec::new();
    publisher.announce(NOW, &ANNOUNCED, &mut |published| announced = published.datagram.to_vec());
    let mut observer = observer();
    let observed = observer.observe(&announced).unwrap();
    let definition = observed.definition().unwrap();
    assert_eq!(definition.id, topics::MOCAP_FRAME.schema_id());
    assert_eq!(
        (definition.name, definition.text),
        ("flyarena/MocapFrame", topics::MOCAP_FRAME.schema_text())
    );
    let lie = datagram("mocap/frame", Role::NODE, 2, |header| header.kind = Kind::Schema);
    assert!(observer.observe(&lie).unwrap().definition().is_none());
}
