//! Playback and raw originals thrown at a live radio bridge while its vehicles fly: it sends not one frame more.

use std::time::Duration;

use playback::{Channel, Kept, Signer, Source};
use quantity::{Span, Time};
use schemas::{DeviceBytes, NodeHealth, topics};
use service_core::{AnyNode, Identity, Observer, Seed};
use service_shell::{BusReceiver, BusSender, Listen};
use settings::{Arena, Ports};
use wire::{Domain, Header, Kind, Role, Secret, SigningKey, TopicName};

use super::{Hall, PATIENCE, record};

const LIVE_RUN: u64 = 21;
const EARLIER_RUN: u64 = 20;
/// Hostile datagrams thrown; FLYARENA_ATTACK names another number.
const THROWN: usize = 100_000;

/// A recorded message as it was in an arena of this domain and run.
fn original(secret: &Secret, domain: Domain, run: u64, channel: &Channel, kept: &Kept) -> Vec<u8> {
    let stream = &channel.stream;
    let topic = topics::by_name(&stream.topic).unwrap();
    let role = Role::of(stream.kind, topic.writer);
    let header = Header {
        kind: stream.kind,
        domain,
        latched: stream.latched,
        source: stream.source,
        schema_id: stream.schema_id,
        run,
        incarnation: stream.incarnation,
        sequence: u64::from(kept.sequence),
        published_at: kept.published_at,
    };
    let mut datagram = Vec::new();
    let key = SigningKey::derive(secret, domain, run, role);
    wire::seal(&header, TopicName::new(topic.name).unwrap(), &kept.body, &key, &mut datagram).unwrap();
    datagram
}

/// A live radio bridge, and what it has said.
struct Bridge {
    node: Box<dyn AnyNode>,
    said: Vec<(Time, &'static str, Vec<u8>)>,
    frames: usize,
}

impl Bridge {
    fn new(settings: &Arena, secret: &Secret, now: Time) -> Self {
        let identity =
            Identity { source: 5, incarnation: 1, domain: Domain::Live, run: LIVE_RUN, seed: Seed(3) };
        let node = roster::node("radio-bridge", settings, secret, identity, now).unwrap();
        Self { node, said: Vec::new(), frames: 0 }
    }

    fn until(&mut self, now: Time) {
        while let Some(at) = self.node.deadline().filter(|at| *at <= now) {
            self.act(at, |node, sink| node.wake(at, sink));
        }
    }

    fn hear(&mut self, now: Time, datagram: &[u8]) {
        self.act(now, |node, sink| {
            let _ = node.receive(now, datagram, sink);
        });
    }

    fn act(&mut self, now: Time, act: impl FnOnce(&mut dyn AnyNode, &mut service_core::Sink<'_>)) {
        let Self { node, said, frames } = self;
        act(node.as_mut(), &mut |published| {
            if published.topic == &topics::RADIO_TX && published.is_data() {
                let bytes: DeviceBytes = wire::decode(published.body).unwrap();
                *frames += usize::from(bytes.port >= Ports::command_link(0));
            }
            // How many were dropped is the one thing that may differ.
            if published.topic != &topics::NODE_HEALTH {
                said.push((now, published.topic.name, published.datagram.to_vec()));
            }
        });
    }
}

#[test]
fn a_live_radio_bridge_in_flight_sends_not_one_frame_more() {
    let hall = Hall::new("attack", 750);
    let tape = record(&hall.settings, Span::ZERO, Span::from_secs(12));
    let count = std::env::var("FLYARENA_ATTACK").map_or(THROWN, |count| count.parse().unwrap());
    let channels = tape.channels();
    let names: Vec<_> = channels.iter().map(|channel| Some(channel.stream.topic.clone())).collect();
    // The worst case: one secret, and by accident one run.
    let mut signer = Signer::new(&hall.secret, LIVE_RUN, 1, channels, &names);
    let begin = tape.messages()[0].at;
    let mut attacked = Bridge::new(&hall.settings, &hall.secret, begin);
    let mut quiet = Bridge::new(&hall.settings, &hall.secret, begin);
    let inputs = attacked.node.topics_in();
    let read = |kept: &Kept| {
        let stream = &channels[kept.channel].stream;
        let topic = inputs.iter().find(|topic| topic.name == stream.topic);
        stream.kind == Kind::Data && topic.is_some_and(|topic| topic.writer != "radio-bridge")
    };
    let heard: Vec<&Kept> = tape.messages().iter().filter(|kept| read(kept)).collect();
    assert!(heard.len() > 2_000, "{} messages for the bridge", heard.len());
    let mut hostile = tape.messages().iter().cycle();
    let (mut thrown, mut dangerous) = (0, 0);
    let each = count.div_ceil(heard.len() * 4);
    for kept in heard {
        let heard_before = original(&hall.secret, Domain::Live, LIVE_RUN, &channels[kept.channel], kept);
        for bridge in [&mut attacked, &mut quiet] {
            bridge.until(kept.at);
            bridge.hear(kept.at, &heard_before);
        }
        for victim in hostile.by_ref().take(each) {
            let resigned = signer.seal(victim.message()).unwrap().unwrap().to_vec();
            let mut mislabelled = resigned.clone();
            mislabelled[4] = Domain::Live as u8;
            let earlier =
                original(&hall.secret, Domain::Live, EARLIER_RUN, &channels[victim.channel], victim);
            for datagram in [&resigned, &mislabelled, &earlier] {
                attacked.hear(kept.at, datagram);
                dangerous += u64::from(read(victim));
            }
            // What it has heard already, once more.
            attacked.hear(kept.at, &heard_before);
            dangerous += 1;
            thrown += 4;
        }
    }
    let counters = attacked.node.counters();
    println!("{thrown} thrown, {} dropped, {} frames", counters.dropped_total(), attacked.frames);
    assert!(thrown >= count);
    assert!(attacked.frames > 400, "only {} frames: it does not fly", attacked.frames);
    assert_eq!(attacked.frames, quiet.frames, "frames");
    assert!(attacked.said == quiet.said, "it said something else");
    assert_eq!(counters.dropped_total(), dangerous, "each one that it reads is dropped and counted");
    assert_eq!(quiet.node.counters().dropped_total(), 0);
}

/// A slot of the command link.
const SLOT: Span = Span::from_millis(20);

/// What the radio bridge of a running arena said while somebody threw datagrams at its group and port.
#[derive(Default)]
struct Witness {
    /// When each frame went to the command link.
    frames: Vec<Time>,
    health: Option<NodeHealth>,
}

impl Witness {
    fn take(&mut self, observer: &mut Observer, bus: &BusReceiver, count: usize) {
        for index in 0..count {
            let Ok(heard) = observer.observe(bus.datagram(index).bytes) else { continue };
            if heard.topic.name() == topics::RADIO_TX.name {
                let bytes: DeviceBytes = wire::decode(heard.body).unwrap();
                if bytes.port >= Ports::command_link(0) {
                    self.frames.push(heard.header.published_at);
                }
            } else if let Ok(health) = wire::decode::<NodeHealth>(heard.body)
                && health.node.as_str() == "radio-bridge"
            {
                self.health = Some(health);
            }
        }
    }
}

#[test]
fn an_arena_of_processes_flies_on_under_what_is_thrown_at_its_group_and_port() {
    let hall = Hall::new("attack-processes", 760);
    let mut arena = hall.up();
    arena.wait_for_hover();
    let run = service_shell::read_run(&hall.folder.join(".flyarena/run")).unwrap();
    let tape = record(&hall.settings, Span::from_secs(5), Span::from_secs(3));
    let channels = tape.channels();
    let names: Vec<_> = channels.iter().map(|channel| Some(channel.stream.topic.clone())).collect();
    let mut signer = Signer::new(&hall.secret, run, 1, channels, &names);
    let is_read = |kept: &&Kept| {
        let topic = topics::by_name(&channels[kept.channel].stream.topic).unwrap();
        topic.readers.contains(&"radio-bridge")
    };
    let mut victims = tape.messages().iter().filter(is_read).cycle();
    let count = std::env::var("FLYARENA_ATTACK").map_or(THROWN / 5, |count| count.parse().unwrap());
    let (mut witness, mut thrown) = (Witness::default(), 0_usize);
    service_shell::block_on(async {
        let network = &hall.settings.network;
        let listen = [&topics::RADIO_TX, &topics::NODE_HEALTH];
        let mut bus = BusReceiver::join(network, Domain::Sim, Listen::Topics(&listen))?;
        let mut observer = Observer::new(&hall.secret, Domain::Sim, run);
        let mut attacker = BusSender::open(network, Domain::Sim)?;
        while thrown < count {
            for victim in victims.by_ref().take(10) {
                attacker.send(signer.seal(victim.message()).unwrap().unwrap());
                let earlier = original(&hall.secret, Domain::Sim, run ^ 1, &channels[victim.channel], victim);
                attacker.send(&earlier);
                thrown += 2;
            }
            // Not a flood, which is another fear: so slowly that no queue overflows.
            tokio::time::sleep(Duration::from_millis(2)).await;
            let heard = bus.take_batch()?;
            witness.take(&mut observer, &bus, heard);
        }
        // Until the bridge has said twice over how many it dropped; those its queue had no room for reached nobody.
        let dropped = |witness: &Witness| {
            witness.health.as_ref().map_or(0, |health| health.dropped_domain + health.dropped_run)
        };
        let (mut known, mut again) = (u64::MAX, 0);
        while again < 2 {
            let before = witness.health.as_ref().map(|health| health.steps);
            let heard = tokio::time::timeout(PATIENCE, bus.next_batch()).await;
            witness.take(&mut observer, &bus, heard.expect("the bridge speaks")?);
            if witness.health.as_ref().map(|health| health.steps) != before {
                again = if dropped(&witness) == known { again + 1 } else { 0 };
                known = dropped(&witness);
            }
        }
        assert!(known > thrown as u64 / 2, "only {known} of {thrown} reached the bridge");
        Ok(())
    })
    .unwrap();
    arena.wait_for_hover();
    let (first, last) = (witness.frames[0], *witness.frames.last().unwrap());
    let slots = (last - first).as_nanos() / SLOT.as_nanos() + 1;
    println!("{thrown} thrown, {} frames in {slots} slots, {:?}", witness.frames.len(), witness.health);
    // A frame may be said some milliseconds into its slot.
    assert!(witness.frames.len() as i64 <= slots + 1, "{} frames in {slots} slots", witness.frames.len());
    let health = witness.health.unwrap();
    assert_eq!((health.dropped_unauthentic, health.dropped_replayed), (0, 0));
}
