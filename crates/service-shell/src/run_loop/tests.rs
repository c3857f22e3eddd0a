//! Nodes on real loopback sockets: one thread drives a node and plays the rest of the arena.

use std::net::UdpSocket;

use quantity::Span;
use schemas::{CommandSent, MocapFrame, VehicleCommand, topics};
use service_core::{Event, Identity, Outbox, Publisher, Start, inputs, outputs};
use settings::{Arena, ConfigError, Ports};
use wire::{Domain, Secret};

use super::*;
use crate::identity::identity;
use crate::scratch::{network, udp};

inputs! {
    /// What the toy camera bridge hears.
    pub enum CameraInput {
        /// Its device.
        Bytes(DeviceBytes) = topics::VICON_RX,
    }
}
outputs! {
    /// What it says.
    pub enum CameraOutput {
        /// One per datagram of the device.
        Frame(MocapFrame) = topics::MOCAP_FRAME,
    }
}

/// Says a frame per datagram of its device.
struct Camera {
    received: Vec<DeviceBytes>,
}

impl Core for Camera {
    const NAME: &'static str = "vicon-bridge";
    type Tuning = toml::Table;
    type Input = CameraInput;
    type Output = CameraOutput;

    fn new(_: &Arena, _: toml::Table, _: Start) -> Result<Self, ConfigError> {
        Ok(Self { received: Vec::new() })
    }

    fn deadline(&self) -> Option<Time> {
        None
    }

    fn step(&mut self, _: Time, event: Event<CameraInput>, out: &mut Outbox<CameraOutput>) {
        if let Event::Input(CameraInput::Bytes(bytes)) = event {
            self.received.push(bytes);
            out.publish(MocapFrame::default());
        }
    }
}

inputs! {
    /// What the toy radio bridge hears.
    pub enum RadioInput {
        /// Commands.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
        /// Its device.
        Bytes(DeviceBytes) = topics::RADIO_RX,
    }
}
outputs! {
    /// What it says.
    pub enum RadioOutput {
        /// To its devices.
        Transmit(DeviceBytes) = topics::RADIO_TX,
        /// One per command.
        Sent(CommandSent) = topics::COMMAND_SENT,
    }
}

/// Passes each command on to the vehicle's radio, and is always due.
struct Radio {
    steps: Vec<&'static str>,
    now: Time,
}

impl Core for Radio {
    const NAME: &'static str = "radio-bridge";
    type Tuning = toml::Table;
    type Input = RadioInput;
    type Output = RadioOutput;

    fn new(_: &Arena, _: toml::Table, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { steps: Vec::new(), now: start.at })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.now)
    }

    fn step(&mut self, now: Time, event: Event<RadioInput>, out: &mut Outbox<RadioOutput>) {
        self.now = now;
        match event {
            Event::Deadline => self.steps.push("deadline"),
            Event::Input(RadioInput::Command(command)) => {
                self.steps.push("command");
                let bytes = Seq::try_from(vec![command.vehicle; 25]).unwrap();
                out.publish(DeviceBytes { port: Ports::command_link(command.vehicle), at: now, bytes });
                out.publish(CommandSent { vehicle: command.vehicle, ..CommandSent::default() });
            }
            Event::Input(RadioInput::Bytes(bytes)) => {
                self.steps.push("bytes");
                out.publish(DeviceBytes { port: bytes.port, at: now, bytes: bytes.bytes });
            }
        }
    }
}

const RUN: u64 = 0x1234;

fn secret() -> Secret {
    Secret::new([9; 32])
}

fn setup(service: &str) -> Setup {
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let mut arena = Arena::load(&config, "fleet").unwrap();
    arena.network = network();
    let identity = identity(service, Domain::Sim, RUN, 1);
    Setup { arena, secret: secret(), identity, started_at: clock::now(), supervised: false }
}

fn node<C: Core>(setup: &Setup) -> Node<C> {
    Node::new(&setup.arena, &setup.secret, setup.identity, clock::now()).unwrap()
}

/// One round of the loop: waits for work, then does it.
async fn round(shell: &mut Shell, node: &mut dyn AnyNode) {
    poll_fn(|cx| shell.poll_work(cx)).await.unwrap();
    shell.wake_if_due(node);
    shell.take_devices(node).unwrap();
    shell.take_bus(node).unwrap();
}

/// What of these topics came by the bus, in order.
fn heard(bus: &mut BusReceiver) -> Vec<String> {
    let mut heard = Vec::new();
    loop {
        let count = bus.take_batch().unwrap();
        for index in 0..count {
            let opened = wire::open(bus.datagram(index).bytes).unwrap();
            heard.push(opened.topic().name().to_owned());
        }
        if !bus.has_backlog() {
            return heard;
        }
    }
}

#[test]
fn device_bytes_step_their_bridge_once_and_are_published_first() {
    block_on(async {
        let setup = setup("vicon-bridge");
        let mut node = node::<Camera>(&setup);
        let endpoints = devices::endpoints("vicon-bridge", &setup.arena).unwrap();
        let mut shell = Shell::open(&setup, &node, endpoints).unwrap();
        let data = [&topics::VICON_RX, &topics::MOCAP_FRAME];
        let mut listener =
            BusReceiver::join(&setup.arena.network, Domain::Sim, Listen::Topics(&data)).unwrap();
        let cameras = UdpSocket::bind("127.0.0.1:0").unwrap();
        let before = clock::now();
        cameras.send_to(b"frame one", udp(&setup.arena.network.devices.motion_capture.url)).unwrap();
        cameras.send_to(b"frame two", udp(&setup.arena.network.devices.motion_capture.url)).unwrap();
        while node.core().received.len() < 2 {
            round(&mut shell, &mut node).await;
        }
        // Its own words come back by the bus; they must not step it again.
        poll_fn(|cx| listener.poll_readable(cx)).await.unwrap();
        shell.take_bus(&mut node).unwrap();
        let received = &node.core().received;
        assert_eq!(received.len(), 2);
        assert_eq!(
            (&*received[0].bytes, &*received[1].bytes),
            (b"frame one".as_slice(), b"frame two".as_slice())
        );
        assert!(received.iter().all(|bytes| bytes.port == Ports::MOTION_CAPTURE && bytes.at >= before));
        assert_eq!(heard(&mut listener), ["vicon/rx", "mocap/frame", "vicon/rx", "mocap/frame"]);
        Ok(())
    })
    .unwrap();
}

fn publish_commands(setup: &Setup, identity: Identity, vehicles: impl IntoIterator<Item = u8>) {
    let mut bus = BusSender::open(&setup.arena.network, Domain::Sim).unwrap();
    let mut publisher = Publisher::new("hover-controller", &setup.secret, identity);
    for vehicle in vehicles {
        let command = VehicleCommand { vehicle, ..VehicleCommand::default() };
        let mut sink = |published: Published<'_>| bus.send(published.datagram);
        publisher.publish(clock::now(), &topics::VEHICLE_COMMAND, &command, &mut sink).unwrap();
    }
}

fn commands(node: &Node<Radio>) -> usize {
    node.core().steps.iter().filter(|step| **step == "command").count()
}

#[test]
fn commands_reach_the_radio_of_their_vehicle() {
    block_on(async {
        let setup = setup("radio-bridge");
        let mut node = node::<Radio>(&setup);
        let endpoints = devices::endpoints("radio-bridge", &setup.arena).unwrap();
        let mut shell = Shell::open(&setup, &node, endpoints).unwrap();
        let radio_of = |member| setup.arena.network.devices.radio_of(member).unwrap();
        let encoders: Vec<UdpSocket> =
            setup.arena.fleet.iter().map(|member| UdpSocket::bind(udp(&radio_of(member))).unwrap()).collect();
        publish_commands(&setup, identity("hover-controller", Domain::Sim, RUN, 1), [2, 3, 9]);
        while commands(&node) < 3 {
            round(&mut shell, &mut node).await;
        }
        let mut bytes = [0; 64];
        for (encoder, vehicle) in encoders.iter().zip(1_u8..) {
            encoder.set_nonblocking(true).unwrap();
            let expected = if vehicle == 1 { None } else { Some([vehicle; 25].to_vec()) };
            assert_eq!(encoder.recv(&mut bytes).ok().map(|count| bytes[..count].to_vec()), expected);
            assert!(encoder.recv(&mut bytes).is_err(), "one frame each");
        }
        Ok(())
    })
    .unwrap();
}

#[test]
fn the_data_link_answers_the_socket_it_was_spoken_to_from() {
    block_on(async {
        let setup = setup("radio-bridge");
        let mut node = node::<Radio>(&setup);
        let radio = UdpSocket::bind(udp(&setup.arena.network.devices.data_link.url)).unwrap();
        let endpoints = devices::endpoints("radio-bridge", &setup.arena).unwrap();
        let mut shell = Shell::open(&setup, &node, endpoints).unwrap();
        // The bridge speaks first: only so does the radio learn where it is.
        let bytes = DeviceBytes { port: Ports::DATA_LINK, at: clock::now(), bytes: Seq::default() };
        let mut hello = bytes.clone();
        hello.bytes = Seq::try_from(b"hello".to_vec()).unwrap();
        node.inject(clock::now(), &topics::RADIO_RX, hello, &mut |published| shell.outlet.put(&published));
        let mut buffer = [0; 64];
        let (count, bridge) = radio.recv_from(&mut buffer).unwrap();
        assert_eq!(&buffer[..count], b"hello");
        node.core_mut().steps.clear();
        radio.send_to(b"answer", bridge).unwrap();
        while !node.core().steps.contains(&"bytes") {
            round(&mut shell, &mut node).await;
        }
        let count = radio.recv(&mut buffer).unwrap();
        assert_eq!(&buffer[..count], b"answer");
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_deadline_is_kept_between_any_two_datagrams_of_a_flood() {
    block_on(async {
        let setup = setup("radio-bridge");
        let mut node = node::<Radio>(&setup);
        let mut shell = Shell::open(&setup, &node, Vec::new()).unwrap();
        publish_commands(
            &setup,
            identity("hover-controller", Domain::Sim, RUN, 1),
            std::iter::repeat_n(1, 500),
        );
        while commands(&node) < 500 {
            round(&mut shell, &mut node).await;
        }
        let bursts = node.core().steps.windows(2).filter(|pair| **pair == ["command", "command"]).count();
        assert_eq!(bursts, 0, "two commands with no look at the deadline between them");
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_stranger_is_dropped_and_counted() {
    block_on(async {
        let setup = setup("radio-bridge");
        let mut node = node::<Radio>(&setup);
        let mut shell = Shell::open(&setup, &node, Vec::new()).unwrap();
        let stranger = Setup { secret: Secret::new([8; 32]), ..self::setup("radio-bridge") };
        let stranger = Setup { arena: setup.arena.clone(), ..stranger };
        publish_commands(&stranger, identity("hover-controller", Domain::Sim, RUN, 1), [1, 1, 1]);
        publish_commands(&setup, identity("hover-controller", Domain::Sim, RUN, 2), [1]);
        while commands(&node) == 0 {
            round(&mut shell, &mut node).await;
        }
        assert_eq!(node.counters().dropped(wire::DropReason::Unauthentic), 3);
        assert_eq!(commands(&node), 1);
        Ok(())
    })
    .unwrap();
}

#[test]
fn what_waited_too_long_in_the_queue_is_no_news() {
    let now = Time::ZERO + Span::from_secs(100);
    assert!(!is_old(now, now));
    assert!(!is_old(now, now - QUEUE_AGE_MAX));
    assert!(is_old(now, now - QUEUE_AGE_MAX - Span::from_nanos(1)));
}

#[test]
fn an_alarm_rings_for_what_is_past_and_not_before_what_is_to_come() {
    block_on(async {
        let mut timer = Timer::new().unwrap();
        for ahead in [Span::from_millis(-5), Span::ZERO, Span::from_micros(300), Span::from_millis(2)] {
            let at = clock::now() + ahead;
            timer.set(Some(at)).unwrap();
            poll_fn(|cx| timer.poll_elapsed(cx)).await.unwrap();
            assert!(clock::now() >= at, "rang before {at}");
        }
        // Cleared, it never rings; set again, it rings once.
        timer.set(Some(clock::now())).unwrap();
        timer.set(None).unwrap();
        let later = clock::now() + Span::from_millis(1);
        timer.set(Some(later)).unwrap();
        poll_fn(|cx| timer.poll_elapsed(cx)).await.unwrap();
        assert!(clock::now() >= later);
        let again = poll_fn(|cx| Poll::Ready(timer.poll_elapsed(cx).is_ready())).await;
        assert!(!again);
        Ok(())
    })
    .unwrap();
}
