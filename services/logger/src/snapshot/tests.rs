//! The last seconds are kept, the oldest give way.

use super::*;

fn at(ms: i64) -> Time {
    Time::ZERO + Span::from_secs(100) + Span::from_millis(ms)
}

/// So many bytes as the ring would hold them, all that the keeping looks at: when, and how long.
fn drained(ms: i64, bytes: usize) -> Vec<u8> {
    use wire::{Domain, Header, Kind, Role, Secret, SigningKey, TopicName};
    let key = SigningKey::derive(&Secret::new([1; 32]), Domain::Sim, 7, Role("estimator"));
    let header = Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: false,
        source: 1,
        schema_id: 2,
        run: 7,
        incarnation: 3,
        sequence: 1,
        published_at: at(ms),
    };
    let mut datagram = Vec::new();
    wire::seal(&header, TopicName::new("a/b").unwrap(), &vec![0; bytes], &key, &mut datagram).unwrap();
    let mut drained = (datagram.len() as u32).to_le_bytes().to_vec();
    drained.extend_from_slice(&at(ms).as_nanos().to_le_bytes());
    drained.push(1);
    drained.extend_from_slice(&datagram);
    drained
}

fn kept(snapshot: &Snapshot) -> Vec<i64> {
    let all = snapshot.blocks.iter().flat_map(|block| datagrams(&block.bytes));
    all.map(|(time, _)| (time - at(0)).as_nanos() / 1_000_000).collect()
}

#[test]
fn what_is_older_than_the_span_gives_way_and_nothing_younger() {
    let mut snapshot = Snapshot::new(Span::from_secs(2), u64::MAX);
    for ms in (0..10_000).step_by(20) {
        snapshot.take(at(ms), &drained(ms, 100));
    }
    let kept = kept(&snapshot);
    let oldest = *kept.first().unwrap();
    assert!((7500..=7980).contains(&oldest), "the oldest is of {oldest} ms");
    assert_eq!(kept, (oldest..10_000).step_by(20).collect::<Vec<_>>());
}

#[test]
fn memory_has_an_end() {
    let mut snapshot = Snapshot::new(Span::from_secs(1000), 100_000);
    for ms in (0..60_000).step_by(20) {
        snapshot.take(at(ms), &drained(ms, 50_000));
        assert!(snapshot.bytes() <= 100_000 + 51_000, "{} bytes", snapshot.bytes());
    }
    assert_eq!(kept(&snapshot).last(), Some(&59_980));
}
