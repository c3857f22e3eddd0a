//! A node around a small core that speaks as the radio bridge: topics of its own, device bytes, another's topic.

use schemas::{CommandSent, NodeEvent, Severity, VehicleCommand};
use serde::Deserialize;
use wire::{Header, SigningKey, TopicName};

use super::*;
use crate::Outbox;

crate::inputs! {
    /// What it hears.
    enum Input {
        /// Another's topic.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
        /// Its own device.
        Bytes(DeviceBytes) = topics::RADIO_RX,
        /// What every node writes.
        Event(NodeEvent) = topics::NODE_EVENT,
    }
}

crate::outputs! {
    /// What it says.
    enum Output {
        /// An answer to each command.
        Sent(CommandSent) = topics::COMMAND_SENT,
        /// Bytes to its device.
        Tx(DeviceBytes) = topics::RADIO_TX,
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Tuning {
    wakes_every_ms: i64,
}

/// Answers each command, keeps all else.
#[derive(Debug)]
struct Bridge {
    start: Start,
    period: Option<Span>,
    wake_at: Time,
    heard: Vec<Event<Input>>,
}

impl Core for Bridge {
    const NAME: &'static str = "radio-bridge";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        let period = (tuning.wakes_every_ms > 0).then(|| Span::from_millis(tuning.wakes_every_ms));
        Ok(Self { start, period, wake_at: start.at + period.unwrap_or(Span::ZERO), heard: Vec::new() })
    }

    fn deadline(&self) -> Option<Time> {
        self.period.map(|_| self.wake_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match &event {
            Event::Deadline => self.wake_at = now + self.period.unwrap_or(Span::ZERO),
            Event::Input(Input::Command(command)) => {
                // What comes in as no number of a vehicle goes out as no number at all.
                let collective_m_s2 = if command.vehicle == 99 { f64::NAN } else { 1.0 };
                out.publish(CommandSent {
                    vehicle: command.vehicle,
                    collective_m_s2,
                    ..CommandSent::default()
                });
                out.event(now, Severity::Info, command.vehicle, "command-heard", "in a sentence");
            }
            Event::Input(_) => {}
        }
        self.heard.push(event);
    }
}

mod journal;

const BEGIN: Time = Time::from_nanos(10_000_000_000);

fn secret() -> Secret {
    Secret::new([5; 32])
}

fn arena(services: &str) -> Arena {
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let mut arena = Arena::load(&config, "double-flip").unwrap();
    arena.services = services.parse().unwrap();
    arena
}

fn identity() -> Identity {
    Identity { source: 7, incarnation: 2, domain: Domain::Sim, run: 11, seed: Seed(42) }
}

fn unannounced_bridge() -> Node<Bridge> {
    Node::new(&arena(""), &secret(), identity(), BEGIN).unwrap()
}

/// A node that has said what it writes.
fn bridge() -> Node<Bridge> {
    let mut node = unannounced_bridge();
    node.wake(BEGIN, &mut |_| {});
    node
}

/// What a node said in one call: topic, kind and body.
#[derive(Debug, Default)]
struct Said(Vec<(&'static str, Kind, Vec<u8>)>);

impl Said {
    fn during(act: impl FnOnce(&mut Sink<'_>)) -> Self {
        let mut said = Self::default();
        act(&mut |published| said.0.push((published.topic.name, published.kind, published.body.to_vec())));
        said
    }

    fn data(&self) -> Vec<&str> {
        self.0.iter().filter(|(_, kind, _)| *kind == Kind::Data).map(|(name, ..)| *name).collect()
    }

    fn definitions(&self) -> Vec<&str> {
        self.0.iter().filter(|(_, kind, _)| *kind == Kind::Schema).map(|(name, ..)| *name).collect()
    }

    fn of<M: reflect::Message>(&self, topic: &Topic) -> Vec<M> {
        let bodies = self.0.iter().filter(|(name, kind, _)| *name == topic.name && *kind == Kind::Data);
        bodies.map(|(.., body)| wire::decode(body).unwrap()).collect()
    }
}

fn after(millis: i64) -> Time {
    BEGIN + Span::from_millis(millis)
}

/// A datagram as some other node would send it, each of its parts to be spoilt.
struct Sender {
    header: Header,
    topic: &'static str,
    role: Role,
    secret: Secret,
    body: Vec<u8>,
}

impl Sender {
    fn new(topic: &'static Topic, role: &'static str, sequence: u64) -> Self {
        let header = Header {
            kind: Kind::Data,
            domain: Domain::Sim,
            latched: false,
            source: 3,
            schema_id: topic.schema_id(),
            run: 11,
            incarnation: 1,
            sequence,
            published_at: BEGIN,
        };
        Self { header, topic: topic.name, role: Role(role), secret: secret(), body: Vec::new() }
    }

    fn command(vehicle: u8, sequence: u64) -> Self {
        let mut sender = Self::new(&topics::VEHICLE_COMMAND, "hover-controller", sequence);
        wire::encode(&VehicleCommand { vehicle, ..VehicleCommand::default() }, &mut sender.body).unwrap();
        sender
    }

    fn request(topic: &'static Topic, sequence: u64) -> Self {
        let mut sender = Self::new(topic, "node", sequence);
        sender.header.kind = Kind::SchemaRequest;
        sender
    }

    fn datagram(&self) -> Vec<u8> {
        let key = SigningKey::derive(&self.secret, self.header.domain, self.header.run, self.role);
        let mut datagram = Vec::new();
        wire::seal(&self.header, TopicName::new(self.topic).unwrap(), &self.body, &key, &mut datagram)
            .unwrap();
        datagram
    }
}

fn receive(node: &mut Node<Bridge>, now: Time, sender: &Sender) -> (Result<(), DropReason>, Said) {
    let mut result = Ok(());
    let said = Said::during(|sink| result = node.receive(now, &sender.datagram(), sink));
    (result, said)
}

#[test]
fn a_core_learns_time_seed_and_incarnation_and_its_own_section() {
    let node =
        Node::<Bridge>::new(&arena("[radio-bridge]\nwakes_every_ms = 30"), &secret(), identity(), BEGIN)
            .unwrap();
    assert_eq!(node.core().start, Start { at: BEGIN, seed: Seed(42), incarnation: 2 });
    assert_eq!(node.core().period, Some(Span::from_millis(30)));
}

#[test]
fn a_wrong_key_in_its_section_or_a_section_of_nobodys_keeps_a_service_from_starting() {
    for (services, word) in [
        ("[radio-bridge]\nwakes = 3", "unknown field `wakes`"),
        ("[radio_bridge]", "radio_bridge"),
        ("[estimater]", "estimater"),
        ("[simulator]", "simulator"),
        ("rate = 3", "rate"),
    ] {
        let error =
            Node::<Bridge>::new(&arena(services), &secret(), identity(), BEGIN).unwrap_err().to_string();
        assert!(error.starts_with("services.toml: ") && error.contains(word), "{services}: {error}");
    }
    for name in ["arena", "estimator", "flip-manager", "hover-controller", "learner", "vicon-bridge"] {
        Node::<Bridge>::new(&arena(&format!("[{name}]")), &secret(), identity(), BEGIN).unwrap();
    }
}

#[test]
fn a_good_datagram_is_decoded_and_answered_and_the_answer_is_the_nodes_own() {
    let mut node = bridge();
    let (result, said) = receive(&mut node, BEGIN, &Sender::command(6, 1));
    assert_eq!(result, Ok(()));
    assert_eq!(said.data(), ["vehicle/command-sent", "node/event"], "messages first, then events");
    assert_eq!(said.of::<CommandSent>(&topics::COMMAND_SENT)[0].vehicle, 6);
    let event = &said.of::<NodeEvent>(&topics::NODE_EVENT)[0];
    assert_eq!(
        (event.node.as_str(), event.name.as_str(), event.vehicle),
        ("radio-bridge", "command-heard", 6)
    );
    assert!(
        matches!(&node.core().heard[..], [Event::Input(Input::Command(command))] if command.vehicle == 6)
    );
    assert_eq!((node.steps(), node.counters().accepted, node.counters().dropped_total()), (1, 1, 0));
}

#[test]
fn what_is_dropped_is_counted_by_its_reason_and_reaches_no_core() {
    let spoil = |change: &dyn Fn(&mut Sender)| {
        let mut sender = Sender::command(1, 1);
        change(&mut sender);
        sender
    };
    for (reason, sender) in [
        (DropReason::Unauthentic, spoil(&|sender| sender.secret = Secret::new([6; 32]))),
        (DropReason::Unauthentic, spoil(&|sender| sender.role = Role("estimator"))),
        (DropReason::Unauthentic, spoil(&|sender| sender.role = Role::NODE)),
        (DropReason::Domain, spoil(&|sender| sender.header.domain = Domain::Live)),
        (DropReason::Run, spoil(&|sender| sender.header.run = 12)),
        (DropReason::Undecodable, spoil(&|sender| sender.header.schema_id ^= 1)),
        (DropReason::Undecodable, spoil(&|sender| sender.body.push(0))),
        (DropReason::Undecodable, spoil(&|sender| sender.body.truncate(3))),
    ] {
        let mut node = bridge();
        let (result, said) = receive(&mut node, BEGIN, &sender);
        assert_eq!(result, Err(reason));
        assert!(said.0.is_empty() && node.core().heard.is_empty(), "{reason}");
        assert_eq!((node.counters().dropped(reason), node.counters().dropped_total()), (1, 1));
        assert_eq!((node.counters().accepted, node.steps()), (0, 0));
    }
    let mut node = bridge();
    let datagram = Sender::command(1, 1).datagram();
    assert_eq!(node.receive(BEGIN, &datagram[..40], &mut |_| {}), Err(DropReason::Malformed));
    assert_eq!(node.receive(BEGIN, &[], &mut |_| {}), Err(DropReason::Malformed));
    assert_eq!(node.receive(BEGIN, &datagram, &mut |_| {}), Ok(()));
    assert_eq!(node.receive(BEGIN, &datagram, &mut |_| {}), Err(DropReason::Replayed));
    let (malformed, replayed) = (DropReason::Malformed, DropReason::Replayed);
    assert_eq!((node.counters().dropped(malformed), node.counters().dropped(replayed)), (2, 1));
}

#[test]
fn an_earlier_incarnation_is_not_heard_after_a_later_one() {
    let mut node = bridge();
    let started = |incarnation, sequence| {
        let mut sender = Sender::command(1, sequence);
        sender.header.incarnation = incarnation;
        sender
    };
    assert_eq!(receive(&mut node, BEGIN, &started(1, 500)).0, Ok(()));
    assert_eq!(receive(&mut node, BEGIN, &started(2, 1)).0, Ok(()));
    assert_eq!(receive(&mut node, BEGIN, &started(1, 501)).0, Err(DropReason::Replayed));
}

#[test]
fn what_is_not_for_this_node_is_no_fault_and_changes_nothing() {
    let mut node = bridge();
    let mut definition = Sender::command(1, 1);
    definition.header.kind = Kind::Schema;
    definition.role = Role::NODE;
    let mut journal = Sender::command(1, 1);
    journal.header.kind = Kind::Journal;
    journal.role = Role::NODE;
    let unread = Sender::new(&topics::MOCAP_FRAME, "vicon-bridge", 1);
    for sender in [definition, journal, unread] {
        let (result, said) = receive(&mut node, BEGIN, &sender);
        assert_eq!(result, Ok(()));
        assert!(said.0.is_empty());
    }
    assert_eq!(*node.counters(), Counters::default());
    assert_eq!(node.steps(), 0);
}

#[test]
fn the_nodes_own_device_bytes_are_not_taken_from_the_bus() {
    let mut node = bridge();
    let bytes = DeviceBytes { port: 1, at: BEGIN, ..DeviceBytes::default() };
    let mut echo = Vec::new();
    node.inject(BEGIN, &topics::RADIO_RX, bytes, &mut |published| echo.push(published.datagram.to_vec()));
    assert_eq!((echo.len(), node.steps()), (1, 1));
    // Its echo, a replay of it, and what somebody with its key would send.
    assert_eq!(node.receive(BEGIN, &echo[0], &mut |_| {}), Ok(()));
    assert_eq!(node.receive(BEGIN, &echo[0], &mut |_| {}), Ok(()));
    let mut forged = Sender::new(&topics::RADIO_RX, "radio-bridge", 900);
    wire::encode(&DeviceBytes::default(), &mut forged.body).unwrap();
    assert_eq!(receive(&mut node, BEGIN, &forged).0, Ok(()));
    assert_eq!((node.steps(), node.counters().accepted), (1, 0));
}

#[test]
fn in_a_replay_the_nodes_own_device_bytes_come_from_the_bus_signed_for_its_role() {
    let replay = Identity { domain: Domain::Replay, ..identity() };
    let mut node = Node::<Bridge>::new(&arena(""), &secret(), replay, BEGIN).unwrap();
    let mut replayed = Sender::new(&topics::RADIO_RX, "radio-bridge", 900);
    replayed.header.domain = Domain::Replay;
    wire::encode(&DeviceBytes::default(), &mut replayed.body).unwrap();
    assert_eq!(receive(&mut node, BEGIN, &replayed).0, Ok(()));
    assert_eq!(node.core().heard.len(), 1);
    let stranger = Sender { role: Role("playback"), ..replayed };
    assert_eq!(receive(&mut node, BEGIN, &stranger).0, Err(DropReason::Unauthentic));
    assert_eq!(node.core().heard.len(), 1);
}

#[test]
fn bytes_of_its_device_are_published_before_the_core_is_stepped_with_the_very_same() {
    let mut node = bridge();
    let bytes = DeviceBytes { port: 3, at: after(-1), bytes: vec![9; 32_768].try_into().unwrap() };
    let said = Said::during(|sink| node.inject(BEGIN, &topics::RADIO_RX, bytes.clone(), sink));
    assert_eq!(said.of::<DeviceBytes>(&topics::RADIO_RX), std::slice::from_ref(&bytes));
    assert_eq!(node.core().heard, [Event::Input(Input::Bytes(bytes))]);
    assert_eq!(node.counters().accepted, 0, "they did not come from the bus");
}

#[test]
fn a_driver_cannot_make_a_node_publish_what_is_not_its_devices() {
    let mut node = bridge();
    for topic in [&topics::VICON_RX, &topics::VEHICLE_COMMAND, &topics::RADIO_TX, &topics::NODE_EVENT] {
        let said = Said::during(|sink| node.inject(BEGIN, topic, DeviceBytes::default(), sink));
        assert!(said.0.is_empty(), "{}", topic.name);
    }
    assert_eq!(node.steps(), 0);
}

#[test]
fn device_bytes_that_cannot_be_said_are_reported_and_not_stepped_on() {
    // 1473 bytes are no `DeviceBytes` at all: the type keeps them out.
    assert!(reflect::Seq::<u8, 32768>::try_from(vec![0; 32_769]).is_err());
    let mut node = bridge();
    let early = DeviceBytes { at: Time::from_nanos(-5), ..DeviceBytes::default() };
    let said = Said::during(|sink| node.inject(BEGIN, &topics::RADIO_RX, early, sink));
    assert_eq!(said.data(), ["node/event"]);
    assert_eq!(said.of::<NodeEvent>(&topics::NODE_EVENT)[0].name.as_str(), "message-unsayable");
    assert_eq!(node.steps(), 0);
}

#[test]
fn an_unsayable_message_is_reported_and_not_sent_and_the_core_goes_on() {
    let mut node = bridge();
    let (result, said) = receive(&mut node, BEGIN, &Sender::command(99, 1));
    assert_eq!(result, Ok(()));
    assert_eq!(said.data(), ["node/event", "node/event"], "the fault, and the core's own event");
    let fault = &said.of::<NodeEvent>(&topics::NODE_EVENT)[0];
    assert_eq!(
        (fault.severity, fault.name.as_str(), fault.at),
        (Severity::Fault, "message-unsayable", BEGIN)
    );
    assert_eq!(fault.node.as_str(), "radio-bridge");
    assert!(fault.detail.as_str().starts_with("vehicle/command-sent: "), "{}", fault.detail);
    let (_, said) = receive(&mut node, BEGIN, &Sender::command(1, 2));
    assert_eq!(said.data(), ["vehicle/command-sent", "node/event"]);
}

#[test]
fn a_core_that_is_always_unsayable_does_not_flood_the_bus() {
    let mut node = bridge();
    let mut reports = 0;
    for sequence in 1..=1000 {
        let (_, said) = receive(&mut node, BEGIN, &Sender::command(99, sequence));
        let events = said.of::<NodeEvent>(&topics::NODE_EVENT);
        reports += events.iter().filter(|event| event.name.as_str() == "message-unsayable").count();
    }
    assert_eq!(reports, 10, "1, 2, 4, ... 512");
}

const WRITTEN: [&str; 7] = [
    "vehicle/command-sent",
    "radio/tx",
    "radio/rx",
    "node/event",
    "node/health",
    "node/journal",
    "node/latency",
];

#[test]
fn definitions_of_all_it_writes_and_health_come_at_the_start_and_each_second() {
    let mut node = unannounced_bridge();
    for second in 0..3 {
        let now = after(1000 * second);
        assert_eq!(node.deadline(), Some(now));
        let early = Said::during(|sink| node.wake(now - Span::from_nanos(1), sink));
        assert!(early.0.is_empty());
        let said = Said::during(|sink| node.wake(now, sink));
        assert_eq!(said.definitions(), WRITTEN);
        assert_eq!(said.data(), ["node/health"]);
        let again = Said::during(|sink| node.wake(now, sink));
        assert!(again.0.is_empty(), "once is enough");
    }
    assert_eq!(node.steps(), 0, "the core has no deadline, so it was not stepped");
}

#[test]
fn a_node_that_slept_announces_once_and_not_once_for_each_second_it_missed() {
    let mut node = bridge();
    let said = Said::during(|sink| node.wake(after(10_500), sink));
    assert_eq!(said.data(), ["node/health"]);
    assert_eq!(node.deadline(), Some(after(11_500)));
}

#[test]
fn the_core_is_stepped_at_its_deadline_and_not_before() {
    let mut node =
        Node::<Bridge>::new(&arena("[radio-bridge]\nwakes_every_ms = 30"), &secret(), identity(), BEGIN)
            .unwrap();
    node.wake(BEGIN, &mut |_| {});
    assert_eq!((node.deadline(), node.steps()), (Some(after(30)), 0));
    node.wake(after(29), &mut |_| {});
    assert_eq!(node.steps(), 0);
    node.wake(after(31), &mut |_| {});
    assert_eq!(node.core().heard, [Event::Deadline]);
    assert_eq!(node.deadline(), Some(after(61)));
}

#[test]
fn who_asks_for_a_definition_gets_that_one_at_once() {
    let mut node = bridge();
    let (result, said) = receive(&mut node, after(10), &Sender::request(&topics::COMMAND_SENT, 1));
    assert_eq!(result, Ok(()));
    assert!(said.0.is_empty(), "the node is in somebody else's turn");
    assert_eq!(node.deadline(), Some(after(10)), "but its own is next");
    let said = Said::during(|sink| node.wake(after(10), sink));
    assert_eq!((said.definitions(), said.data()), (vec!["vehicle/command-sent"], vec![]));
    assert_eq!(node.deadline(), Some(after(1000)));
    assert_eq!(node.steps(), 0);
}

#[test]
fn requests_for_what_others_write_and_forged_ones_are_not_answered() {
    let mut node = bridge();
    let mut forged = Sender::request(&topics::COMMAND_SENT, 1);
    forged.secret = Secret::new([8; 32]);
    assert_eq!(receive(&mut node, BEGIN, &forged).0, Err(DropReason::Unauthentic));
    // The role that writes the topic does not ask for it: everybody asks as a node.
    let mut other_role = Sender::request(&topics::COMMAND_SENT, 1);
    other_role.role = Role("radio-bridge");
    assert_eq!(receive(&mut node, BEGIN, &other_role).0, Err(DropReason::Unauthentic));
    for topic in [&topics::VEHICLE_COMMAND, &topics::MOCAP_FRAME] {
        assert_eq!(receive(&mut node, BEGIN, &Sender::request(topic, 1)).0, Ok(()));
    }
    assert_eq!(node.deadline(), Some(after(1000)));
    let request = Sender::request(&topics::COMMAND_SENT, 1);
    assert_eq!(receive(&mut node, BEGIN, &request).0, Ok(()));
    assert_eq!(receive(&mut node, BEGIN, &request).0, Err(DropReason::Replayed));
}

#[test]
fn a_flood_of_requests_gets_ten_answers_a_second_out_of_a_node() {
    let mut node = bridge();
    let (mut answers, mut sequence) = (0, 0);
    for millis in 0..1000 {
        for topic in [&topics::COMMAND_SENT, &topics::RADIO_RX, &topics::NODE_EVENT] {
            sequence += 1;
            assert_eq!(receive(&mut node, after(millis), &Sender::request(topic, sequence)).0, Ok(()));
        }
        let said = Said::during(|sink| {
            while node.deadline().is_some_and(|at| at <= after(millis)) {
                node.wake(after(millis), sink);
            }
        });
        answers += said.definitions().len();
    }
    assert_eq!(answers, 10 * 3);
    assert_eq!(node.counters().accepted, 3000);
}

#[test]
fn health_tells_what_became_of_everything() {
    let mut node = bridge();
    // Two of three numbers come, one comes twice.
    for sequence in [1, 3, 3] {
        let _ = receive(&mut node, BEGIN, &Sender::command(1, sequence));
    }
    let mut elsewhere = Sender::command(1, 9);
    elsewhere.header.domain = Domain::Live;
    let _ = receive(&mut node, BEGIN, &elsewhere);
    elsewhere = Sender::command(1, 9);
    elsewhere.header.run = 1;
    let _ = receive(&mut node, BEGIN, &elsewhere);
    let mut forged = Sender::command(1, 9);
    forged.secret = Secret::new([0; 32]);
    let _ = receive(&mut node, BEGIN, &forged);
    let mut stump = Sender::command(1, 4);
    stump.body.clear();
    let _ = receive(&mut node, BEGIN, &stump);
    let _ = node.receive(BEGIN, b"FM", &mut |_| {});
    node.identify_program(77);
    node.overflowed(5);
    node.overflowed(2);
    let said = Said::during(|sink| node.wake(after(1000), sink));
    let expected = NodeHealth {
        node: Text::truncated("radio-bridge"),
        started_at: BEGIN,
        program_digest: 77,
        steps: 2,
        // Twice seven definitions, the first health, two answers with an event each.
        published: 14 + 1 + 4,
        accepted: 2,
        dropped_malformed: 1,
        dropped_unauthentic: 1,
        dropped_domain: 1,
        dropped_run: 1,
        dropped_replayed: 1,
        dropped_undecodable: 1,
        lost: 1,
        overflowed: 7,
    };
    assert_eq!(said.of::<NodeHealth>(&topics::NODE_HEALTH), [expected]);
}

#[test]
fn what_every_node_writes_is_heard_from_any_of_them() {
    let mut node = bridge();
    let mut sender = Sender::new(&topics::NODE_EVENT, "node", 1);
    wire::encode(&NodeEvent::default(), &mut sender.body).unwrap();
    assert_eq!(receive(&mut node, BEGIN, &sender).0, Ok(()));
    assert_eq!(node.core().heard, [Event::Input(Input::Event(NodeEvent::default()))]);
    // Another source has numbers of its own.
    sender.header.source = 4;
    assert_eq!(receive(&mut node, BEGIN, &sender).0, Ok(()));
    assert_eq!(receive(&mut node, BEGIN, &sender).0, Err(DropReason::Replayed));
}

#[test]
fn an_outbox_gives_up_what_it_holds_in_order_and_once() {
    let mut outbox: Outbox<Output> = Outbox::default();
    assert!(outbox.is_empty());
    for vehicle in [1, 2] {
        outbox.publish(CommandSent { vehicle, ..CommandSent::default() });
        outbox.event(BEGIN, Severity::Warning, vehicle, &"n".repeat(99), &"d".repeat(999));
    }
    assert_eq!((outbox.messages().len(), outbox.events().len()), (2, 2));
    let vehicles: Vec<u8> = outbox.take_events().map(|event| event.vehicle).collect();
    assert_eq!(vehicles, [1, 2]);
    assert_eq!(outbox.events().len(), 0);
    assert!(!outbox.is_empty());
    assert_eq!(outbox.take_messages().count(), 2);
    assert!(outbox.is_empty());
}

#[test]
fn a_contract_lists_its_topics_in_its_own_order() {
    let names = |topics: &[&Topic]| topics.iter().map(|topic| topic.name).collect::<Vec<_>>();
    let node = bridge();
    assert_eq!(node.name(), "radio-bridge");
    assert_eq!(names(node.topics_in()), ["vehicle/command", "radio/rx", "node/event"]);
    assert_eq!(names(node.topics_out()), ["vehicle/command-sent", "radio/tx"]);
    assert_eq!(Output::from(DeviceBytes::default()).topic(), &topics::RADIO_TX);
    assert!(Input::decode(1, &[0]).is_err());
}
