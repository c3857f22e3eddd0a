//! The driver in virtual time.

use std::collections::BTreeMap;
use std::rc::Rc;

use plant::random::{Purpose, Stream};
use plant::{DeviceOutput, ManeuverTruth, Plant, Truth};
use reflect::Seq;
use quantity::{Span, Time};
use schemas::{DeviceBytes, PlantManeuver, PlantTruth, Topic, topics};
use service_core::{AnyNode, Identity, Published, Publisher, Seed};
use settings::{Arena, ConfigError, Ports};
use wire::{Domain, Secret};

use crate::network::NetworkFaults;
use crate::queue::{Arrival, Queue};

/// Builds a service's node by name; the roster's, or a test's with one core replaced.
pub type NodeFactory = dyn Fn(&str, &Arena, &Secret, Identity, Time) -> Result<Box<dyn AnyNode>, ConfigError>;

/// What an observer is told of each datagram at the instant it is sent.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'a> {
    /// When it was sent.
    pub at: Time,
    /// The sender's service name.
    pub from: &'a str,
    /// The datagram.
    pub published: Published<'a>,
}

struct Seat {
    name: String,
    node: Option<Box<dyn AnyNode>>,
    deadline: Time,
    paused_until: Time,
    starts: u32,
}

/// A whole arena in virtual time.
pub struct VirtualArena<'f> {
    now: Time,
    settings: Arena,
    secret: Secret,
    run: u64,
    seed: u64,
    factory: &'f NodeFactory,
    seats: Vec<Seat>,
    subscribers: BTreeMap<u32, Vec<usize>>,
    queue: Queue,
    plant: Plant,
    truth: Publisher,
    truth_at: Time,
    maneuvers: Vec<ManeuverTruth>,
    network: NetworkFaults,
    network_random: Stream,
    digest: blake3::Hasher,
    datagrams: u64,
}

/// Virtual time starts here, so that nothing before the start is negative on the wire.
const START: Time = Time::from_nanos(1_000_000_000);
/// The plant asserts that its state stays finite.
const FINITE: &str = "the truth is finite";
/// What one message of device bytes holds at most.
const DEVICE_BYTES_MAX: usize = 1472;
const TRUTH_PERIOD: Span = Span::from_millis(20);

impl<'f> VirtualArena<'f> {
    /// An arena with the named services, all started at the same instant.
    ///
    /// # Errors
    /// A setting some service cannot work with.
    pub fn new(
        settings: &Arena,
        seed: u64,
        services: &[&str],
        factory: &'f NodeFactory,
    ) -> Result<Self, ConfigError> {
        // No other process sees these datagrams: the secret need only differ from one seed to the next.
        let secret = Secret::new(blake3::derive_key("flyarena virtual arena secret", &seed.to_le_bytes()));
        let run = Stream::new(seed, Purpose::Run, 0).bits();
        let identity = identity("simulator", 0, run, seed);
        let mut arena = Self {
            now: START,
            settings: settings.clone(),
            truth: Publisher::new("simulator", &secret, identity),
            truth_at: START,
            maneuvers: Vec::new(),
            secret,
            run,
            seed,
            factory,
            seats: Vec::new(),
            subscribers: BTreeMap::new(),
            queue: Queue::default(),
            plant: Plant::new(settings, seed, START).map_err(|error| ConfigError::Malformed {
                file: format!("scenario {}", settings.name),
                reason: error.to_string(),
            })?,
            network: NetworkFaults::default(),
            network_random: Stream::new(seed, Purpose::Network, 0),
            digest: blake3::Hasher::new(),
            datagrams: 0,
        };
        for name in services {
            arena.seats.push(Seat {
                name: (*name).to_owned(),
                node: None,
                deadline: Time::FAR_FUTURE,
                paused_until: Time::ZERO,
                starts: 0,
            });
        }
        for index in 0..arena.seats.len() {
            arena.start_seat(index)?;
        }
        Ok(arena)
    }

    /// The arena's clock.
    #[must_use]
    pub fn now(&self) -> Time {
        self.now
    }

    /// Virtual time since the start.
    #[must_use]
    pub fn elapsed(&self) -> Span {
        self.now - START
    }

    /// The simulated world.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The simulated world, to put faults into it.
    pub fn plant_mut(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// How the maneuvers since the last call truly went.
    pub fn take_maneuvers(&mut self) -> Vec<ManeuverTruth> {
        std::mem::take(&mut self.maneuvers)
    }

    /// The network, to make it bad.
    pub fn network_mut(&mut self) -> &mut NetworkFaults {
        &mut self.network
    }

    /// Datagrams sent so far.
    #[must_use]
    pub fn datagrams(&self) -> u64 {
        self.datagrams
    }

    /// Digest of every datagram sent so far, in order: each one's instant and its tag, which covers its every byte.
    #[must_use]
    pub fn digest(&self) -> String {
        self.digest.finalize().to_hex().to_string()
    }

    /// The node of that name, if it is alive.
    #[must_use]
    pub fn node(&self, name: &str) -> Option<&dyn AnyNode> {
        self.seats.iter().find(|seat| seat.name == name).and_then(|seat| seat.node.as_deref())
    }

    /// Runs until `end`, telling `observe` of every datagram.
    pub fn run_until(&mut self, end: Time, observe: &mut dyn FnMut(Heard<'_>)) {
        while self.step(end, observe) {}
        self.now = end;
        // Nothing comes out before the plant's next event; this only brings its state up to the instant asked for.
        self.plant.advance(end, &mut |output: DeviceOutput<'_>| {
            debug_assert!(false, "{:?} spoke before the plant's next event", output.device);
        });
    }

    /// Runs for `span`; see [`VirtualArena::run_until`].
    pub fn run_for(&mut self, span: Span, observe: &mut dyn FnMut(Heard<'_>)) {
        self.run_until(self.now + span, observe);
    }

    /// Does what is due next, if that is not after `end`; says whether something was.
    pub fn step(&mut self, end: Time, observe: &mut dyn FnMut(Heard<'_>)) -> bool {
        let plant_at = self.plant.next_event();
        let queue_at = self.queue.next_at();
        let (node_at, node) = self.next_deadline();
        let at = plant_at.min(queue_at).min(node_at).max(self.now);
        if at > end {
            return false;
        }
        self.now = at;
        if plant_at <= at {
            self.advance_plant(observe);
        } else if queue_at <= at {
            if let Some((_, arrival)) = self.queue.take() {
                self.arrive(arrival, observe);
            }
        } else {
            self.with_node(node, observe, |node, now, sink| node.wake(now, sink));
        }
        true
    }

    /// Ends a service at once, as `kill -9` would.
    pub fn kill(&mut self, name: &str) {
        if let Some(seat) = self.seats.iter_mut().find(|seat| seat.name == name) {
            seat.node = None;
            seat.deadline = Time::FAR_FUTURE;
        }
    }

    /// Starts a service anew, with a higher incarnation and no memory.
    ///
    /// # Errors
    /// A setting the service cannot work with.
    pub fn restart(&mut self, name: &str) -> Result<(), ConfigError> {
        match self.seats.iter().position(|seat| seat.name == name) {
            Some(index) => self.start_seat(index),
            None => Ok(()),
        }
    }

    /// Stops a service for a while, as SIGSTOP would; what arrives meanwhile waits for it.
    pub fn pause(&mut self, name: &str, span: Span) {
        let until = self.now + span;
        if let Some(index) = self.seats.iter().position(|seat| seat.name == name) {
            self.seats[index].paused_until = until;
            self.queue.send(until, Arrival::Resume { node: index });
        }
    }

    /// Throws bytes at every node, past the kernel's filter.
    pub fn throw(&mut self, bytes: &[u8]) {
        let bytes: Rc<[u8]> = Rc::from(bytes);
        for node in 0..self.seats.len() {
            self.queue.send(self.now, Arrival::Datagram { node, bytes: Rc::clone(&bytes) });
        }
    }

    fn start_seat(&mut self, index: usize) -> Result<(), ConfigError> {
        let seat = &mut self.seats[index];
        seat.starts += 1;
        let identity = identity(&seat.name, seat.starts, self.run, self.seed);
        let node = (self.factory)(&seat.name, &self.settings, &self.secret, identity, self.now)?;
        let own_name = seat.name.clone();
        for topic in node.topics_in() {
            let list = self.subscribers.entry(topic.hash).or_default();
            if topic.writer != own_name && !list.contains(&index) {
                list.push(index);
                list.sort_unstable();
            }
        }
        seat.deadline = node.deadline().unwrap_or(Time::FAR_FUTURE);
        seat.node = Some(node);
        Ok(())
    }

    fn next_deadline(&self) -> (Time, usize) {
        let mut earliest = (Time::FAR_FUTURE, usize::MAX);
        for (index, seat) in self.seats.iter().enumerate() {
            let at = seat.deadline.max(seat.paused_until);
            if seat.deadline < Time::FAR_FUTURE && at < earliest.0 {
                earliest = (at, index);
            }
        }
        earliest
    }

    fn arrive(&mut self, arrival: Arrival, observe: &mut dyn FnMut(Heard<'_>)) {
        match arrival {
            Arrival::Datagram { node, bytes } => {
                if self.seats[node].paused_until > self.now {
                    let until = self.seats[node].paused_until;
                    self.queue.send(until, Arrival::Datagram { node, bytes });
                    return;
                }
                self.with_node(node, observe, |node, now, sink| {
                    // A refusal is counted by the node; tests read the counters.
                    let _ = node.receive(now, &bytes, sink);
                });
            }
            Arrival::Resume { node } => self.with_node(node, observe, |node, now, sink| node.wake(now, sink)),
        }
    }

    fn advance_plant(&mut self, observe: &mut dyn FnMut(Heard<'_>)) {
        let now = self.now;
        let mut outputs: Vec<(&'static Topic, &'static str, DeviceBytes)> = Vec::new();
        self.plant.advance(now, &mut |output: DeviceOutput<'_>| {
            let (topic, bridge, port) = match output.device {
                plant::Device::Vicon => (&topics::VICON_RX, "vicon-bridge", Ports::VICON),
                plant::Device::DataLink => (&topics::RADIO_RX, "radio-bridge", Ports::DATA_LINK),
            };
            for piece in output.bytes.chunks(DEVICE_BYTES_MAX) {
                let bytes = Seq::try_from(piece).unwrap_or_default();
                outputs.push((topic, bridge, DeviceBytes { port, at: output.at, bytes }));
            }
        });
        self.publish_truth(observe);
        for (topic, bridge, bytes) in outputs {
            let seat = self.seats.iter().position(|seat| seat.name == bridge && seat.paused_until <= now);
            if let Some(index) = seat {
                self.with_node(index, observe, |node, now, sink| node.inject(now, topic, bytes, sink));
            }
        }
    }

    fn publish_truth(&mut self, observe: &mut dyn FnMut(Heard<'_>)) {
        let now = self.now;
        let mut sent: Vec<Vec<u8>> = Vec::new();
        let Self { truth, digest, datagrams, plant, truth_at, settings, maneuvers, .. } = self;
        let mut sink = |published: Published<'_>| {
            note(digest, datagrams, now, published.datagram);
            observe(Heard { at: now, from: "simulator", published });
            sent.push(published.datagram.to_vec());
        };
        for maneuver in plant.maneuver_truths() {
            let message = maneuver_message(&maneuver);
            truth.publish(now, &topics::PLANT_MANEUVER, &message, &mut sink).expect(FINITE);
            maneuvers.push(maneuver);
        }
        if now >= *truth_at {
            *truth_at = now + TRUTH_PERIOD;
            for member in &settings.fleet {
                if let Some(state) = plant.truth(member.vehicle.id) {
                    let message = truth_message(member.vehicle.id, now, &state);
                    truth.publish(now, &topics::PLANT_TRUTH, &message, &mut sink).expect(FINITE);
                }
            }
        }
        for datagram in sent {
            self.send("simulator", &datagram);
        }
    }

    /// Steps a node and sends what it says; bytes it has for its devices go to the plant.
    fn with_node(
        &mut self,
        index: usize,
        observe: &mut dyn FnMut(Heard<'_>),
        act: impl FnOnce(&mut dyn AnyNode, Time, &mut dyn FnMut(Published<'_>)),
    ) {
        let Some(mut node) = self.seats[index].node.take() else { return };
        let now = self.now;
        {
            let Self { seats, subscribers, queue, plant, network, network_random, digest, datagrams, .. } = self;
            let from = seats[index].name.as_str();
            let mut sink = |published: Published<'_>| {
                note(digest, datagrams, now, published.datagram);
                observe(Heard { at: now, from, published });
                if published.topic == &topics::RADIO_TX
                    && published.is_data()
                    && let Ok(bytes) = wire::decode::<DeviceBytes>(published.body)
                {
                    plant.receive(now, bytes.port, &bytes.bytes);
                }
                route(seats, subscribers, queue, network, network_random, now, from, &published);
            };
            act(node.as_mut(), now, &mut sink);
        }
        let seat = &mut self.seats[index];
        seat.deadline = node.deadline().unwrap_or(Time::FAR_FUTURE);
        seat.node = Some(node);
    }

    fn send(&mut self, from: &str, datagram: &[u8]) {
        let Self { seats, subscribers, queue, network, network_random, now, .. } = self;
        if let Ok(opened) = wire::open(datagram) {
            let hash = opened.topic().hash();
            deliver(seats, subscribers, queue, network, network_random, *now, from, hash, datagram);
        }
    }
}

fn note(digest: &mut blake3::Hasher, datagrams: &mut u64, now: Time, datagram: &[u8]) {
    let mut line = [0_u8; 24];
    line[..8].copy_from_slice(&now.as_nanos().to_le_bytes());
    line[8..].copy_from_slice(&datagram[datagram.len() - wire::TAG_BYTES..]);
    digest.update(&line);
    *datagrams += 1;
}

#[allow(clippy::too_many_arguments, reason = "the borrowed parts of one struct, split so that a node may be lent out")]
fn route(
    seats: &[Seat],
    subscribers: &BTreeMap<u32, Vec<usize>>,
    queue: &mut Queue,
    network: &NetworkFaults,
    random: &mut Stream,
    now: Time,
    from: &str,
    published: &Published<'_>,
) {
    if published.is_data() {
        deliver(seats, subscribers, queue, network, random, now, from, published.topic.hash, published.datagram);
    }
}

#[allow(clippy::too_many_arguments, reason = "the borrowed parts of one struct, split so that a node may be lent out")]
fn deliver(
    seats: &[Seat],
    subscribers: &BTreeMap<u32, Vec<usize>>,
    queue: &mut Queue,
    network: &NetworkFaults,
    random: &mut Stream,
    now: Time,
    from: &str,
    hash: u32,
    datagram: &[u8],
) {
    let Some(receivers) = subscribers.get(&hash).filter(|list| !list.is_empty()) else { return };
    let bytes: Rc<[u8]> = Rc::from(datagram);
    for &node in receivers {
        network.deliveries(from, &seats[node].name, &bytes, random, |delay, bytes| {
            queue.send(now + delay, Arrival::Datagram { node, bytes });
        });
    }
}

fn identity(name: &str, starts: u32, run: u64, seed: u64) -> Identity {
    Identity {
        source: schemas::topic_hash(name),
        incarnation: starts,
        domain: Domain::Sim,
        run,
        seed: Seed(Stream::new(seed ^ u64::from(schemas::topic_hash(name)), Purpose::Node, 0).bits()),
    }
}

fn maneuver_message(truth: &ManeuverTruth) -> PlantManeuver {
    PlantManeuver {
        vehicle: truth.vehicle,
        maneuver_id: truth.maneuver_id,
        began_at: truth.began_at,
        ended_at: truth.ended_at,
        error: schemas::FlipError {
            x_m: truth.error.x_m,
            z_m: truth.error.z_m,
            vx_m_s: truth.error.vx_m_s,
            vz_m_s: truth.error.vz_m_s,
            theta_rad: truth.error.theta_rad,
        },
    }
}

fn truth_message(vehicle: u8, at: Time, state: &Truth) -> PlantTruth {
    PlantTruth {
        vehicle,
        at,
        truth: schemas::Kinematics {
            position_m: state.motion.position_m,
            velocity_m_s: state.motion.velocity_m_s,
            orientation: state.motion.orientation,
            rate_rad_s: state.motion.rate_rad_s,
        },
        battery_ratio: state.battery_ratio,
    }
}
