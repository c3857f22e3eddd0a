//! The bus on real loopback sockets.

use schemas::{Topic, topics};
use socket2::SockRef;
use wire::Kind;

use super::*;
use crate::clock;
use crate::scratch::network;

/// What a filter looks at, and a number to recognise a datagram by.
fn datagram(kind: Kind, topic: &Topic, number: u32) -> Vec<u8> {
    let mut bytes = vec![b'F', b'M', 1, kind as u8, 2, 0, 0, 0];
    bytes.extend(topic.hash.to_le_bytes());
    bytes.extend(number.to_le_bytes());
    bytes
}

fn number_of(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes[12..16].try_into().unwrap())
}

/// Everything that has come: on loopback, sending delivers.
fn drain(receiver: &mut BusReceiver) -> Vec<u32> {
    let mut numbers = Vec::new();
    loop {
        let count = receiver.take_batch().unwrap();
        numbers.extend((0..count).map(|index| number_of(receiver.datagram(index).bytes)));
        if !receiver.has_backlog() {
            return numbers;
        }
    }
}

/// Runs with tokio's reactor having seen what has come.
fn with_reactor(test: impl AsyncFnOnce()) {
    crate::block_on(async {
        test().await;
        Ok(())
    })
    .unwrap();
}

async fn settle(receiver: &BusReceiver) {
    std::future::poll_fn(|cx| receiver.poll_readable(cx)).await.unwrap();
}

const READ: [&Topic; 2] = [&topics::MOCAP_FRAME, &topics::VEHICLE_STATE];

#[test]
fn a_reader_gets_its_topics_and_requests_only() {
    with_reactor(async || {
        let network = network();
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Topics(&READ)).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        let mut expected = Vec::new();
        for (number, topic) in (0..).zip(topics::ALL) {
            sender.send(&datagram(Kind::Data, topic, number));
            sender.send(&datagram(Kind::Schema, topic, 1_000 + number));
            sender.send(&datagram(Kind::SchemaRequest, topic, 2_000 + number));
            if READ.contains(topic) {
                expected.push(number);
            }
            expected.push(2_000 + number);
        }
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), expected);
        assert_eq!(sender.failed(), 0);
    });
}

#[test]
fn everything_means_everything() {
    with_reactor(async || {
        let network = network();
        let mut receiver = BusReceiver::join(&network, Domain::Live, Listen::Everything).unwrap();
        let mut sender = BusSender::open(&network, Domain::Live).unwrap();
        for number in 0..40 {
            let kind = [Kind::Data, Kind::Schema, Kind::SchemaRequest, Kind::Journal][number as usize % 4];
            sender.send(&datagram(kind, &topics::PLANT_TRUTH, number));
        }
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), (0..40).collect::<Vec<_>>());
    });
}

#[test]
fn nothing_comes_in_but_by_the_domains_own_group() {
    with_reactor(async || {
        let mut network = network();
        // The nastiest case: another domain's group on the same port, and a program on this host that has
        // joined it.
        network.live.port = network.sim.port;
        let mut neighbour = network.clone();
        neighbour.live.group = std::net::Ipv4Addr::new(239, 192, 71, 9);
        let mut other = BusReceiver::join(&neighbour, Domain::Live, Listen::Everything).unwrap();
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Everything).unwrap();
        let mut other_sender = BusSender::open(&neighbour, Domain::Live).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        other_sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, 1));
        let unicast = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = (network.interface.address(), network.sim.port);
        unicast.send_to(&datagram(Kind::Data, &topics::VEHICLE_STATE, 2), to).unwrap();
        sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, 3));
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), [3]);
        assert_eq!(drain(&mut other), [1]);
    });
}

#[test]
fn datagrams_never_leave_further_than_the_settings_say() {
    for (asked, granted) in [(0, 0), (1, 1), (200, 1)] {
        let network = Network { ttl: asked, ..network() };
        let sender = BusSender::open(&network, Domain::Sim).unwrap();
        assert_eq!(SockRef::from(&sender.socket).multicast_ttl_v4().unwrap(), granted);
    }
}

#[test]
fn arrivals_lie_between_sending_and_taking_and_keep_their_order() {
    with_reactor(async || {
        let network = network();
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Topics(&READ)).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        let mut sent = Vec::new();
        for number in 0..10 {
            let before = clock::now();
            sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, number));
            sent.push((before, clock::now()));
        }
        settle(&receiver).await;
        assert_eq!(receiver.take_batch().unwrap(), sent.len());
        let arrivals: Vec<_> = (0..sent.len()).map(|index| receiver.datagram(index).at).collect();
        assert!(arrivals.is_sorted(), "{arrivals:?}");
        let last = arrivals[sent.len() - 1];
        for (at, (before, _)) in arrivals.iter().zip(&sent) {
            assert!(at >= before, "arrived {at}, sent after {before}");
        }
        // The stamp is the kernel's, of the arrival: not that of the moment the batch was taken.
        assert!(arrivals[0] < last, "{arrivals:?}");
        assert!(last <= clock::now());
    });
}

#[test]
fn what_an_unfiltered_reader_does_not_take_in_time_is_counted_to_the_last_one() {
    with_reactor(async || {
        let network = Network { receive_buffer_bytes: 65_536, ..network() };
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Everything).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        const SENT: u32 = 5_000;
        for number in 0..SENT {
            sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, number));
        }
        settle(&receiver).await;
        let received = drain(&mut receiver);
        assert!(received.len() > 10 && received.len() < SENT as usize / 2, "{}", received.len());
        // The kernel tells with the next datagram that gets through.
        sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, SENT));
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), [SENT]);
        assert_eq!(receiver.take_overflowed() + received.len() as u64, u64::from(SENT));
        assert_eq!(receiver.take_overflowed(), 0);
    });
}

#[test]
fn what_a_filter_refuses_is_no_overflow() {
    with_reactor(async || {
        let network = network();
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Topics(&READ)).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        for number in 0..200 {
            sender.send(&datagram(Kind::Data, &topics::PLANT_TRUTH, number));
            sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, number));
        }
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), (0..200).collect::<Vec<_>>());
        assert_eq!(receiver.take_overflowed(), 0);
    });
}

#[test]
fn a_filtered_reader_that_is_too_slow_learns_of_it() {
    with_reactor(async || {
        let network = Network { receive_buffer_bytes: 65_536, ..network() };
        let mut receiver = BusReceiver::join(&network, Domain::Sim, Listen::Topics(&READ)).unwrap();
        let mut sender = BusSender::open(&network, Domain::Sim).unwrap();
        const SENT: u32 = 5_000;
        for number in 0..SENT {
            sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, number));
        }
        settle(&receiver).await;
        let received = drain(&mut receiver);
        assert_eq!(
            receiver.take_overflowed(),
            0,
            "the kernel tells with the next datagram that gets through"
        );
        sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, SENT));
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), [SENT]);
        assert_eq!(receiver.take_overflowed() + received.len() as u64, u64::from(SENT));
        for number in 0..20 {
            sender.send(&datagram(Kind::Data, &topics::PLANT_TRUTH, number));
        }
        sender.send(&datagram(Kind::Data, &topics::VEHICLE_STATE, 1));
        settle(&receiver).await;
        assert_eq!(drain(&mut receiver), [1]);
        assert_eq!(receiver.take_overflowed(), 0, "what the filter refuses later is not counted");
    });
}

#[test]
fn a_buffer_beyond_the_limit_is_reported_as_granted() {
    let socket = Socket::new(socket2::Domain::IPV4, Type::DGRAM, None).unwrap();
    assert!(grow_receive_buffer(&socket, 100_000).unwrap() >= 100_000);
    let granted = grow_receive_buffer(&socket, 64 << 20).unwrap();
    assert_eq!(granted, socket.recv_buffer_size().unwrap() / 2);
}
