//! What goes in comes out, and what does not is counted.

use wire::{Domain, Header, Kind, Role, Secret, SigningKey, TopicName};

use super::*;

fn datagram(number: u64, topic: &str) -> Vec<u8> {
    let key = SigningKey::derive(&Secret::new([1; 32]), Domain::Sim, 7, Role("estimator"));
    let header = Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: false,
        source: 1,
        schema_id: 2,
        run: 7,
        incarnation: 3,
        sequence: number,
        published_at: Time::from_nanos(5),
    };
    let mut datagram = Vec::new();
    wire::seal(&header, TopicName::new(topic).unwrap(), &[9; 100], &key, &mut datagram).unwrap();
    datagram
}

fn put(ring: &Ring, number: u64, topic: &str) -> bool {
    let datagram = datagram(number, topic);
    let opened = wire::open(&datagram).unwrap();
    let (header, topic, body) = (*opened.claimed(), opened.topic(), opened.body_unverified());
    let observed = Observed { header, topic, body, verified: number.is_multiple_of(2) };
    ring.put().datagram(Time::from_nanos(number as i64), &observed, &datagram)
}

fn numbers(bytes: &[u8]) -> Vec<u64> {
    datagrams(bytes)
        .map(|(at, observed)| {
            let number = observed.header.sequence;
            assert_eq!(at.as_nanos(), number as i64);
            assert_eq!(observed.verified, number % 2 == 0);
            assert_eq!(observed.body, [9; 100]);
            number
        })
        .collect()
}

#[test]
fn what_goes_in_comes_out_in_order() {
    let (ring, mut buffer) = Ring::new(100_000);
    for round in 0..3 {
        let range = round * 100..round * 100 + 100;
        assert!(range.clone().all(|number| put(&ring, number, "a/b")));
        let drained = ring.drain(&mut buffer, Duration::ZERO);
        assert!(drained.gap.is_none() && !drained.closed);
        assert_eq!(numbers(&buffer), range.collect::<Vec<_>>());
    }
    ring.close();
    assert!(ring.drain(&mut buffer, Duration::from_secs(1000)).closed);
    assert!(buffer.is_empty());
}

#[test]
fn what_finds_no_room_is_counted_by_topic_and_nothing_grows() {
    let (ring, mut buffer) = Ring::new(1000);
    let capacity = buffer.capacity();
    let taken: Vec<u64> =
        (0..50).filter(|number| put(&ring, *number, ["a/b", "c/d"][*number as usize % 2])).collect();
    let gap = ring.drain(&mut buffer, Duration::ZERO).gap.unwrap();
    assert_eq!(numbers(&buffer), taken);
    assert_eq!(taken.len() as u64 + gap.dropped.values().sum::<u64>(), 50);
    assert_eq!(gap.dropped.len(), 2);
    assert_eq!(gap.from.as_nanos() as u64, taken.len() as u64);
    assert_eq!(gap.until.as_nanos(), 49);
    assert_eq!(buffer.capacity(), capacity);
    assert!(put(&ring, 50, "a/b"), "there is room again");
    assert!(ring.drain(&mut buffer, Duration::ZERO).gap.is_none(), "a gap is told once");
}
