//! The driver in virtual time.

use std::rc::Rc;

use plant::random::{Purpose, Stream};
use plant::{DeviceOutput, ManeuverTruth, Plant, Truth};
use quantity::{Span, Time};
use reflect::Seq;
use schemas::{DeviceBytes, PlantManeuver, PlantTruth, Topic, topics};
use service_core::{AnyNode, Identity, Published, Publisher, QUEUE_AGE_MAX, Seed};
use settings::{Arena, ConfigError};
use wire::{Domain, Secret};

use crate::bus::{Arrival, Bus};
use crate::network::NetworkFaults;

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

/// One service: its process, if it is alive, and the sockets of that process.
struct Seat {
    name: String,
    node: Option<Box<dyn AnyNode>>,
    deadline: Time,
    /// Stopped, as by SIGSTOP, until then.
    paused_until: Option<Time>,
    /// What has arrived at a stopped process, and when.
    waiting: Vec<(Time, Incoming)>,
    starts: u32,
}

/// Something at the door of a process.
#[derive(Clone, Debug)]
enum Incoming {
    Bus(Rc<[u8]>),
    Device(&'static Topic, DeviceBytes),
}

/// Every datagram that was sent, in one number.
struct Log {
    digest: blake3::Hasher,
    datagrams: u64,
}

impl Log {
    fn note(&mut self, now: Time, datagram: &[u8]) {
        let mut line = [0_u8; size_of::<i64>() + wire::TAG_BYTES];
        line[..8].copy_from_slice(&now.as_nanos().to_le_bytes());
        line[8..].copy_from_slice(&datagram[datagram.len() - wire::TAG_BYTES..]);
        self.digest.update(&line);
        self.datagrams += 1;
    }
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
    bus: Bus,
    plant: Plant,
    truth: Publisher,
    truth_at: Time,
    announce_at: Time,
    maneuvers: Vec<ManeuverTruth>,
    log: Log,
    idle_wakes: u32,
}

/// Virtual time starts here, so that nothing before the start is negative on the wire.
const START: Time = Time::from_nanos(1_000_000_000);
/// The plant asserts that its state stays finite.
const FINITE: &str = "the truth is finite";
/// What one message of device bytes holds at most.
const DEVICE_BYTES_MAX: usize = 32_768;
/// How often the simulator tells the truth.
const TRUTH_PERIOD: Span = Span::from_millis(20);
/// How often the simulator announces its definitions.
const ANNOUNCE_PERIOD: Span = Span::from_secs(1);
/// A node that asks so often to be woken at one and the same instant would never let time go on.
const IDLE_WAKES_MAX: u32 = 10_000;

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
        let seat = |name: &&str| Seat {
            name: (*name).to_owned(),
            node: None,
            deadline: Time::FAR_FUTURE,
            paused_until: None,
            waiting: Vec::new(),
            starts: 0,
        };
        let mut arena = Self {
            now: START,
            settings: settings.clone(),
            truth: Publisher::new("simulator", &secret, identity("simulator", 0, run, seed)),
            truth_at: START,
            announce_at: START,
            maneuvers: Vec::new(),
            secret,
            run,
            seed,
            factory,
            seats: services.iter().map(seat).collect(),
            bus: Bus::new(services, Stream::new(seed, Purpose::Network, 0)),
            plant: Plant::new(settings, seed, START).map_err(|error| ConfigError::Malformed {
                file: format!("scenario {}", settings.name),
                reason: error.to_string(),
            })?,
            log: Log { digest: blake3::Hasher::new(), datagrams: 0 },
            idle_wakes: 0,
        };
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
        self.bus.faults_mut()
    }

    /// The run, which every datagram names.
    #[must_use]
    pub fn run(&self) -> u64 {
        self.run
    }

    /// Datagrams sent so far.
    #[must_use]
    pub fn datagrams(&self) -> u64 {
        self.log.datagrams
    }

    /// Digest of every datagram sent so far, in order: each one's instant and its tag, which covers its every byte.
    #[must_use]
    pub fn digest(&self) -> String {
        self.log.digest.finalize().to_hex().to_string()
    }

    /// The node of that name, if it is alive.
    #[must_use]
    pub fn node(&self, name: &str) -> Option<&dyn AnyNode> {
        self.seats.iter().find(|seat| seat.name == name).and_then(|seat| seat.node.as_deref())
    }

    /// Runs until `end`, telling `observe` of every datagram; an `end` that has passed changes nothing. In how many
    /// calls a span is run through makes no difference to what is sent.
    ///
    /// # Panics
    /// A node that asks without end to be woken at one instant: it would never let time go on.
    pub fn run_until(&mut self, end: Time, observe: &mut dyn FnMut(Heard<'_>)) {
        while self.step(end, observe) {}
        self.now = self.now.max(end);
        // Nothing comes out before the plant's next event; this brings its state up to the instant asked for.
        self.advance_plant(observe);
    }

    /// Runs for `span`; see [`VirtualArena::run_until`].
    ///
    /// # Panics
    /// As [`VirtualArena::run_until`].
    pub fn run_for(&mut self, span: Span, observe: &mut dyn FnMut(Heard<'_>)) {
        self.run_until(self.now + span, observe);
    }

    /// Lets every node that is alive say what it would say at its end: the rest of its journal.
    pub fn close(&mut self, observe: &mut dyn FnMut(Heard<'_>)) {
        for node in 0..self.seats.len() {
            self.with_node(node, observe, |node, now, sink| node.close(now, sink));
        }
    }

    /// Ends a service at once, as `kill -9` would; what has arrived at it is gone.
    ///
    /// # Panics
    /// No service has that name: a fault that hits nobody proves nothing.
    pub fn kill(&mut self, name: &str) {
        let index = self.seat_of(name);
        self.seats[index].end();
    }

    /// Starts a service anew, with a higher incarnation and no memory.
    ///
    /// # Errors
    /// A setting the service cannot work with.
    ///
    /// # Panics
    /// No service has that name.
    pub fn restart(&mut self, name: &str) -> Result<(), ConfigError> {
        self.start_seat(self.seat_of(name))
    }

    /// Stops a service for a while, as SIGSTOP would: what arrives meanwhile waits for it, and what has waited longer
    /// than [`QUEUE_AGE_MAX`] is dropped unread, as `service-shell` does.
    ///
    /// # Panics
    /// No service has that name.
    pub fn pause(&mut self, name: &str, span: Span) {
        let until = self.now + span;
        let index = self.seat_of(name);
        self.seats[index].paused_until = Some(until);
        self.bus.send(until, Arrival::Resume { node: index });
    }

    /// Throws bytes at every node, past the kernel's filter.
    pub fn throw(&mut self, bytes: &[u8]) {
        let bytes: Rc<[u8]> = Rc::from(bytes);
        for node in 0..self.seats.len() {
            self.bus.send(self.now, Arrival::Datagram { node, bytes: Rc::clone(&bytes) });
        }
    }

    fn seat_of(&self, name: &str) -> usize {
        let found = self.seats.iter().position(|seat| seat.name == name);
        found.unwrap_or_else(|| panic!("no service of this arena is called {name}"))
    }

    fn start_seat(&mut self, index: usize) -> Result<(), ConfigError> {
        let seat = &mut self.seats[index];
        seat.end();
        seat.starts += 1;
        let identity = identity(&seat.name, seat.starts, self.run, self.seed);
        let node = (self.factory)(&seat.name, &self.settings, &self.secret, identity, self.now)?;
        self.bus.subscribe(index, &seat.name, node.topics_in());
        seat.deadline = node.deadline().unwrap_or(Time::FAR_FUTURE);
        seat.node = Some(node);
        Ok(())
    }

    /// Does what is due next, if that is not after `end`; says whether something was.
    fn step(&mut self, end: Time, observe: &mut dyn FnMut(Heard<'_>)) -> bool {
        let world_at = self.plant.next_event().min(self.truth_at);
        let bus_at = self.bus.next_at();
        let (node_at, node) = self.next_deadline();
        let at = world_at.min(bus_at).min(node_at).max(self.now);
        if at > end {
            return false;
        }
        if at > self.now {
            self.idle_wakes = 0;
        }
        self.now = at;
        if world_at <= at {
            self.advance_plant(observe);
            self.publish_truth(observe);
        } else if bus_at <= at {
            if let Some(arrival) = self.bus.take() {
                self.arrive(arrival, observe);
            }
        } else {
            self.with_node(node, observe, |node, now, sink| node.wake(now, sink));
            self.idle_wakes += 1;
            assert!(
                self.idle_wakes < IDLE_WAKES_MAX,
                "{} asks without end to be woken at {at}",
                self.seats[node].name
            );
        }
        true
    }

    fn next_deadline(&self) -> (Time, usize) {
        let mut earliest = (Time::FAR_FUTURE, usize::MAX);
        for (index, seat) in self.seats.iter().enumerate() {
            if seat.paused_until.is_none() && seat.deadline < earliest.0 {
                earliest = (seat.deadline, index);
            }
        }
        earliest
    }

    fn arrive(&mut self, arrival: Arrival, observe: &mut dyn FnMut(Heard<'_>)) {
        match arrival {
            Arrival::Datagram { node, bytes } => self.hand(node, Incoming::Bus(bytes), observe),
            Arrival::Resume { node } => self.resume(node, observe),
        }
    }

    /// Hands a process what has come for it, or lets it wait at the door of one that is stopped.
    fn hand(&mut self, index: usize, incoming: Incoming, observe: &mut dyn FnMut(Heard<'_>)) {
        let seat = &mut self.seats[index];
        if seat.paused_until.is_some() {
            seat.waiting.push((self.now, incoming));
            return;
        }
        self.with_node(index, observe, |node, now, sink| match incoming {
            Incoming::Bus(bytes) => {
                // A refusal is counted by the node; tests read the counters.
                let _ = node.receive(now, &bytes, sink);
            }
            Incoming::Device(topic, bytes) => node.inject(now, topic, bytes, sink),
        });
    }

    /// Lets a stopped process go on: it looks at its deadline first and between any two datagrams, as the shell does.
    fn resume(&mut self, index: usize, observe: &mut dyn FnMut(Heard<'_>)) {
        let seat = &mut self.seats[index];
        if seat.paused_until.is_none_or(|until| until > self.now) {
            // Stopped anew since, or dead.
            return;
        }
        seat.paused_until = None;
        let waiting = std::mem::take(&mut seat.waiting);
        self.wake_if_due(index, observe);
        for (at, incoming) in waiting {
            if self.now - at > QUEUE_AGE_MAX {
                self.with_node(index, observe, |node, _, _| node.overflowed(1));
            } else {
                self.hand(index, incoming, observe);
                self.wake_if_due(index, observe);
            }
        }
    }

    fn wake_if_due(&mut self, index: usize, observe: &mut dyn FnMut(Heard<'_>)) {
        if self.seats[index].deadline <= self.now {
            self.with_node(index, observe, |node, now, sink| node.wake(now, sink));
        }
    }

    /// Brings the plant up to now, and what its devices say to the bridges.
    fn advance_plant(&mut self, observe: &mut dyn FnMut(Heard<'_>)) {
        let mut outputs: Vec<(&'static Topic, DeviceBytes)> = Vec::new();
        self.plant.advance(self.now, &mut |output: DeviceOutput<'_>| {
            let port = output.device.port();
            let topic = match output.device {
                plant::Device::MotionCapture | plant::Device::MotionCaptureGroup => &topics::VICON_RX,
                plant::Device::DataLink | plant::Device::CommandLink(_) => &topics::RADIO_RX,
            };
            for piece in output.bytes.chunks(DEVICE_BYTES_MAX) {
                let bytes = Seq::try_from(piece).expect("a piece is not longer than that");
                outputs.push((topic, DeviceBytes { port, at: output.at, bytes }));
            }
        });
        for (topic, bytes) in outputs {
            // A device sends whether its bridge is there or not.
            if let Some(index) = self.seats.iter().position(|seat| seat.name == topic.writer) {
                self.hand(index, Incoming::Device(topic, bytes), observe);
            }
        }
    }

    /// Tells the truth when it is due: at instants of its own, so that it does not matter how far and how often the
    /// plant was brought up to date in between.
    fn publish_truth(&mut self, observe: &mut dyn FnMut(Heard<'_>)) {
        if self.now < self.truth_at {
            return;
        }
        self.truth_at += TRUTH_PERIOD;
        let now = self.now;
        let Self { truth, log, bus, plant, settings, maneuvers, announce_at, .. } = self;
        let mut sink = |published: Published<'_>| {
            log.note(now, published.datagram);
            observe(Heard { at: now, from: "simulator", published });
            bus.carry(now, "simulator", &published);
        };
        if *announce_at <= now {
            *announce_at = now + ANNOUNCE_PERIOD;
            truth.announce(now, &[&topics::PLANT_TRUTH, &topics::PLANT_MANEUVER], &mut sink);
        }
        for member in &settings.fleet {
            if let Some(state) = plant.truth(member.vehicle.id) {
                let message = truth_message(member.vehicle.id, now, &state);
                truth.publish(now, &topics::PLANT_TRUTH, &message, &mut sink).expect(FINITE);
            }
        }
        for maneuver in plant.maneuver_truths() {
            let message = maneuver_message(&maneuver);
            truth.publish(now, &topics::PLANT_MANEUVER, &message, &mut sink).expect(FINITE);
            maneuvers.push(maneuver);
        }
    }

    /// Steps a node and sends what it says; bytes it has for its devices go to the plant.
    fn with_node(
        &mut self,
        index: usize,
        observe: &mut dyn FnMut(Heard<'_>),
        act: impl FnOnce(&mut dyn AnyNode, Time, &mut dyn FnMut(Published<'_>)),
    ) {
        let Self { seats, bus, plant, log, now, .. } = self;
        let (now, seat) = (*now, &mut seats[index]);
        let Some(node) = seat.node.as_mut() else { return };
        let from = seat.name.as_str();
        let mut sink = |published: Published<'_>| {
            log.note(now, published.datagram);
            observe(Heard { at: now, from, published });
            if [&topics::RADIO_TX, &topics::VICON_TX].contains(&published.topic)
                && published.is_data()
                && let Ok(bytes) = wire::decode::<DeviceBytes>(published.body)
            {
                plant.receive(now, bytes.port, &bytes.bytes);
            }
            bus.carry(now, from, &published);
        };
        act(node.as_mut(), now, &mut sink);
        seat.deadline = node.deadline().unwrap_or(Time::FAR_FUTURE);
    }
}

impl Seat {
    /// The process is gone, and its sockets with it.
    fn end(&mut self) {
        self.node = None;
        self.deadline = Time::FAR_FUTURE;
        self.paused_until = None;
        self.waiting.clear();
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
