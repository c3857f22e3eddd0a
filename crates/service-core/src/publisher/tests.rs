//! What a sender says, as those who listen take it.

use schemas::{ArenaOrder, PlantTruth, topics};
use wire::{Domain, VerifyKey, Windows};

use super::*;
use crate::Seed;

fn identity() -> Identity {
    Identity { source: 9, incarnation: 4, domain: Domain::Sim, run: 77, seed: Seed(1) }
}

fn secret() -> Secret {
    Secret::new([3; 32])
}

fn publisher() -> Publisher {
    Publisher::new("arena", &secret(), identity())
}

fn key(role: Role) -> VerifyKey {
    VerifyKey::derive(&secret(), Domain::Sim, 77, role)
}

const NOW: Time = Time::from_nanos(5_000_000_000);

#[test]
fn what_is_said_is_signed_by_its_role_and_tells_who_when_and_what() {
    let order = ArenaOrder { given_at: NOW, ..ArenaOrder::default() };
    let mut said = Vec::new();
    publisher()
        .publish(NOW, &topics::ARENA_ORDER, &order, &mut |published| {
            assert!(published.is_data());
            assert_eq!(published.topic, &topics::ARENA_ORDER);
            assert_eq!(wire::decode::<ArenaOrder>(published.body), Ok(order));
            said.push(published.datagram.to_vec());
        })
        .unwrap();
    let [datagram] = said.as_slice() else { panic!("{} datagrams", said.len()) };
    assert!(wire::open(datagram).unwrap().verify(&key(Role::NODE)).is_err());
    let fresh = wire::open(datagram)
        .unwrap()
        .verify(&key(Role("arena")))
        .unwrap()
        .fresh(&mut Windows::new())
        .unwrap();
    let header = fresh.header();
    assert_eq!((header.source, header.incarnation, header.run), (9, 4, 77));
    assert_eq!((header.published_at, header.sequence), (NOW, 1));
    assert_eq!(fresh.decode::<ArenaOrder>(topics::ARENA_ORDER.schema_id()), Ok(order));
}

#[test]
fn each_topic_and_kind_is_numbered_by_itself_without_gaps() {
    let mut publisher = publisher();
    let mut numbers: Vec<(&str, Kind, u64)> = Vec::new();
    let mut sink = |published: Published<'_>| {
        let opened = wire::open(published.datagram).unwrap();
        numbers.push((published.topic.name, published.kind, opened.claimed().sequence));
    };
    for _ in 0..2 {
        publisher.publish(NOW, &topics::ARENA_ORDER, &ArenaOrder::default(), &mut sink).unwrap();
        publisher.announce(NOW, &[&topics::ARENA_ORDER, &topics::PLANT_TRUTH], &mut sink);
        publisher.publish(NOW, &topics::PLANT_TRUTH, &PlantTruth::default(), &mut sink).unwrap();
    }
    assert_eq!(publisher.published(), 8);
    let (order, truth) = (topics::ARENA_ORDER.name, topics::PLANT_TRUTH.name);
    let round = |n| {
        [(order, Kind::Data, n), (order, Kind::Schema, n), (truth, Kind::Schema, n), (truth, Kind::Data, n)]
    };
    assert_eq!(numbers, [round(1), round(2)].concat());
}

#[test]
fn what_cannot_be_said_is_refused_and_takes_no_number() {
    let mut publisher = publisher();
    let mut sequences = Vec::new();
    let mut sink = |published: Published<'_>| {
        sequences.push(wire::open(published.datagram).unwrap().claimed().sequence);
    };
    let good = PlantTruth::default();
    let unsayable = PlantTruth { battery_ratio: f64::NAN, ..good };
    publisher.publish(NOW, &topics::PLANT_TRUTH, &good, &mut sink).unwrap();
    let error = publisher.publish(NOW, &topics::PLANT_TRUTH, &unsayable, &mut sink).unwrap_err();
    assert!(matches!(error, SayError::Encode(EncodeError::NotFinite { .. })), "{error}");
    let early = Time::from_nanos(-1);
    let error = publisher.publish(early, &topics::PLANT_TRUTH, &good, &mut sink).unwrap_err();
    assert_eq!(error, SayError::Seal(SealError::PublishTime { nanos: -1 }));
    publisher.publish(NOW, &topics::PLANT_TRUTH, &good, &mut sink).unwrap();
    assert_eq!(sequences, [1, 2]);
    assert_eq!(publisher.published(), 2);
}

#[test]
fn every_definition_of_the_topic_table_can_be_announced_and_read() {
    let mut announced = Vec::new();
    publisher().announce(NOW, topics::ALL, &mut |published| {
        assert!(!published.is_data());
        let authentic = wire::open(published.datagram).unwrap().verify(&key(Role::NODE)).unwrap();
        let fresh = authentic.fresh(&mut Windows::new()).unwrap();
        assert_eq!(fresh.header().schema_id, published.topic.schema_id());
        let end = published.body.iter().position(|byte| *byte == 0).unwrap();
        assert_eq!(&published.body[..end], published.topic.schema.name.as_bytes());
        assert_eq!(&published.body[end + 1..], published.topic.schema_text().as_bytes());
        announced.push(published.topic);
    });
    assert_eq!(announced, topics::ALL);
}
