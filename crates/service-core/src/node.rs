//! A core on the bus: what comes is authenticated, filtered and decoded; what goes is numbered, encoded and sealed.

use quantity::{Span, Time};
use reflect::Text;
use schemas::{DeviceBytes, NodeEvent, NodeHealth, Severity, Topic, topics};
use settings::{Arena, ConfigError};
use wire::{Counters, Domain, DropReason, Keyring, Kind, Role, Secret, Windows};

use crate::publisher::{Publisher, SayError};
use crate::sections::check_sections;
use crate::{Core, Event, Inbound, Outbound, Outbox, Seed, Start};

/// How often definitions and health are announced.
const ANNOUNCE_PERIOD: Span = Span::from_secs(1);
/// Requests for definitions are answered at most so often, and only what was asked for: whoever floods the bus with them
/// gets no more than ten answers a second out of a node, and none of its time at a radio slot.
const ANSWER_PERIOD: Span = Span::from_millis(100);
/// A datagram that has waited longer than this in the kernel is not delivered: its reader was stopped or starved, and what
/// it says of the past must not look like news. Longer than any age limit of commands and states.
pub const QUEUE_AGE_MAX: Span = Span::from_millis(250);

/// Who a node is, besides its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Which node instance.
    pub source: u32,
    /// Rises at each start of this instance.
    pub incarnation: u32,
    /// Where its messages' truth comes from.
    pub domain: Domain,
    /// The arena's run.
    pub run: u64,
    /// Seed of everything random in it.
    pub seed: Seed,
}

/// A datagram at the moment it is sent.
#[derive(Clone, Copy, Debug)]
pub struct Published<'a> {
    /// Its topic.
    pub topic: &'static Topic,
    /// Data, or the topic's definition.
    pub kind: Kind,
    /// All of it, as it goes on the bus.
    pub datagram: &'a [u8],
    /// Its body.
    pub body: &'a [u8],
}

impl Published<'_> {
    /// Whether it is a message, not a definition.
    #[must_use]
    pub fn is_data(&self) -> bool {
        self.kind == Kind::Data
    }
}

/// Where a node's datagrams go.
pub type Sink<'a> = dyn FnMut(Published<'_>) + 'a;

/// A node whose core's type is forgotten: what drivers hold.
pub trait AnyNode {
    /// The service's name.
    fn name(&self) -> &'static str;

    /// The topics its core consumes; one that it writes itself carries the bytes of its devices.
    fn topics_in(&self) -> &'static [&'static Topic];

    /// The topics its core produces.
    fn topics_out(&self) -> &'static [&'static Topic];

    /// When to call [`AnyNode::wake`] at the latest.
    fn deadline(&self) -> Option<Time>;

    /// Does what is due: the core's deadline, announcements, health.
    fn wake(&mut self, now: Time, sink: &mut Sink<'_>);

    /// Takes a datagram from the bus.
    ///
    /// # Errors
    /// Why it was dropped; it has been counted.
    fn receive(&mut self, now: Time, datagram: &[u8], sink: &mut Sink<'_>) -> Result<(), DropReason>;

    /// Takes bytes from the node's own device: publishes them under the node's name, so that they are recorded, and
    /// steps the core with them.
    fn inject(&mut self, now: Time, topic: &'static Topic, bytes: DeviceBytes, sink: &mut Sink<'_>);

    /// Tells the node that the kernel has dropped datagrams meant for it.
    fn overflowed(&mut self, datagrams: u64);

    /// What was accepted and dropped so far.
    fn counters(&self) -> &Counters;

    /// Steps of the core so far.
    fn steps(&self) -> u64;
}

/// What a datagram turned out to be.
enum Taken<I> {
    /// Something for the core.
    Input(I),
    /// Somebody asks for the definition of a topic that this node writes.
    SchemaRequest(&'static Topic),
    /// Not for this node, and no fault of anybody.
    Elsewhere,
}

/// A core and everything between it and the bus.
#[derive(Debug)]
pub struct Node<C: Core> {
    core: C,
    outbox: Outbox<C::Output>,
    publisher: Publisher,
    keyring: Keyring,
    windows: Windows,
    counters: Counters,
    device_body: Vec<u8>,
    /// What this node writes: the core's outputs, its devices' bytes, and what every node writes.
    writes: Vec<&'static Topic>,
    asked: Vec<&'static Topic>,
    /// The earliest instant of the next answer to those who ask for definitions.
    answer_at: Time,
    started_at: Time,
    announce_at: Time,
    steps: u64,
    overflowed: u64,
    unsaid: u64,
}

impl<C: Core> Node<C> {
    /// Starts a service.
    ///
    /// # Errors
    /// A setting its core cannot work with, or a section of the settings that is no service's.
    pub fn new(arena: &Arena, secret: &Secret, identity: Identity, now: Time) -> Result<Self, ConfigError> {
        check_sections(arena)?;
        let tuning = arena.section(C::NAME)?;
        let start = Start { at: now, seed: identity.seed, incarnation: identity.incarnation };
        let reads = C::Input::topics().iter().map(|topic| Role::of(Kind::Data, topic.writer));
        let keyring = Keyring::new(secret, identity.domain, identity.run, Role(C::NAME), reads);
        Ok(Self {
            core: C::new(arena, tuning, start)?,
            outbox: Outbox::default(),
            publisher: Publisher::new(C::NAME, secret, identity),
            keyring,
            windows: Windows::new(),
            counters: Counters::default(),
            device_body: Vec::new(),
            writes: written_by::<C>(),
            asked: Vec::new(),
            answer_at: now,
            started_at: now,
            announce_at: now,
            steps: 0,
            overflowed: 0,
            unsaid: 0,
        })
    }

    /// The core, for tests and tools.
    #[must_use]
    pub fn core(&self) -> &C {
        &self.core
    }

    /// The core, for whoever gives it orders from outside the bus.
    pub fn core_mut(&mut self) -> &mut C {
        &mut self.core
    }

    fn step(&mut self, now: Time, event: Event<C::Input>, sink: &mut Sink<'_>) {
        self.steps += 1;
        self.core.step(now, event, &mut self.outbox);
        let mut outbox = std::mem::take(&mut self.outbox);
        for message in outbox.take_messages() {
            if let Err(error) = self.publisher.publish_output(now, &message, sink) {
                self.note_unsaid(now, message.topic(), &error, sink);
            }
        }
        for mut event in outbox.take_events() {
            event.node = Text::truncated(C::NAME);
            if let Err(error) = self.publisher.publish(now, &topics::NODE_EVENT, &event, sink) {
                self.note_unsaid(now, &topics::NODE_EVENT, &error, sink);
            }
        }
        // Emptied, it keeps its memory.
        self.outbox = outbox;
    }

    /// A message that cannot be said is a bug of the core's. The vehicles fly on, in debug builds too; tests look for the
    /// event. A core that does it in each step is reported whenever the count doubles, so that it does not flood the bus.
    fn note_unsaid(&mut self, now: Time, topic: &Topic, error: &SayError, sink: &mut Sink<'_>) {
        self.unsaid += 1;
        if !self.unsaid.is_power_of_two() {
            return;
        }
        let event = NodeEvent {
            severity: Severity::Fault,
            vehicle: 0,
            at: now,
            node: Text::truncated(C::NAME),
            name: Text::truncated("message-unsayable"),
            detail: Text::truncated(format_args!("{}: {error}; {} so far", topic.name, self.unsaid)),
        };
        // Bounded texts and no floats: it fails only with a clock before its zero, where nothing can be said at all.
        let _ = self.publisher.publish(now, &topics::NODE_EVENT, &event, sink);
    }

    /// From a datagram to an input, each check in its order.
    fn take(&mut self, datagram: &[u8]) -> Result<Taken<C::Input>, DropReason> {
        let opened = wire::open(datagram)?;
        if opened.claimed().kind == Kind::SchemaRequest {
            let wanted = opened.topic().name();
            let Some(topic) = self.writes.iter().copied().find(|topic| topic.name == wanted) else {
                return Ok(Taken::Elsewhere);
            };
            let key = self.keyring.verify_key(Role::NODE).ok_or(DropReason::Unauthentic)?;
            opened.verify(key)?.fresh(&mut self.windows)?;
            return Ok(Taken::SchemaRequest(topic));
        }
        let topics = C::Input::topics();
        let hash = opened.topic().hash();
        // The kernel's filter compares hashes only: another topic of the same hash is not for us, and no fault.
        let index = topics.iter().position(|topic| topic.hash == hash && topic.name == opened.topic().name());
        let Some(index) = index.filter(|_| opened.claimed().kind == Kind::Data) else {
            return Ok(Taken::Elsewhere);
        };
        let topic = topics[index];
        if topic.writer == C::NAME {
            // The node's own device bytes come from its device. From the bus they are its echo, or a replay of it.
            return Ok(Taken::Elsewhere);
        }
        let key =
            self.keyring.verify_key(Role::of(Kind::Data, topic.writer)).ok_or(DropReason::Unauthentic)?;
        let fresh = opened.verify(key)?.fresh(&mut self.windows)?;
        if fresh.header().schema_id != topic.schema_id() {
            return Err(DropReason::Undecodable);
        }
        Ok(Taken::Input(C::Input::decode(index, fresh.body())?))
    }

    fn announce(&mut self, now: Time, sink: &mut Sink<'_>) {
        self.publisher.announce(now, &self.writes, sink);
        // Whoever asked has been answered with it.
        self.asked.clear();
        let health = self.health();
        // As for events: there is nothing in it that could not be said.
        let _ = self.publisher.publish(now, &topics::NODE_HEALTH, &health, sink);
    }

    /// When the definitions asked for are due.
    fn answer_due(&self) -> Option<Time> {
        (!self.asked.is_empty()).then_some(self.answer_at)
    }

    fn health(&self) -> NodeHealth {
        let counters = &self.counters;
        NodeHealth {
            node: Text::truncated(C::NAME),
            started_at: self.started_at,
            steps: self.steps,
            published: self.publisher.published(),
            accepted: counters.accepted,
            dropped_malformed: counters.dropped(DropReason::Malformed),
            dropped_unauthentic: counters.dropped(DropReason::Unauthentic),
            dropped_domain: counters.dropped(DropReason::Domain),
            dropped_run: counters.dropped(DropReason::Run),
            dropped_replayed: counters.dropped(DropReason::Replayed),
            dropped_undecodable: counters.dropped(DropReason::Undecodable),
            lost: self.windows.lost_total(),
            overflowed: self.overflowed,
        }
    }
}

impl<C: Core> AnyNode for Node<C> {
    fn name(&self) -> &'static str {
        C::NAME
    }

    fn topics_in(&self) -> &'static [&'static Topic] {
        C::Input::topics()
    }

    fn topics_out(&self) -> &'static [&'static Topic] {
        C::Output::topics()
    }

    fn deadline(&self) -> Option<Time> {
        let due = [self.core.deadline(), self.answer_due()].into_iter().flatten();
        Some(due.fold(self.announce_at, Time::min))
    }

    fn wake(&mut self, now: Time, sink: &mut Sink<'_>) {
        if self.core.deadline().is_some_and(|at| at <= now) {
            self.step(now, Event::Deadline, sink);
        }
        if self.announce_at <= now {
            self.announce_at = now + ANNOUNCE_PERIOD;
            self.announce(now, sink);
        }
        if self.answer_due().is_some_and(|at| at <= now) {
            self.answer_at = now + ANSWER_PERIOD;
            self.publisher.announce(now, &self.asked, sink);
            self.asked.clear();
        }
    }

    fn receive(&mut self, now: Time, datagram: &[u8], sink: &mut Sink<'_>) -> Result<(), DropReason> {
        match self.take(datagram) {
            Ok(Taken::Input(input)) => {
                self.counters.accepted += 1;
                self.step(now, Event::Input(input), sink);
                Ok(())
            }
            Ok(Taken::SchemaRequest(topic)) => {
                self.counters.accepted += 1;
                // Answered when the node is woken next, which is at once unless it has just answered.
                self.answer_at = self.answer_at.max(now);
                if !self.asked.contains(&topic) {
                    self.asked.push(topic);
                }
                Ok(())
            }
            Ok(Taken::Elsewhere) => Ok(()),
            Err(reason) => {
                self.counters.count(reason);
                Err(reason)
            }
        }
    }

    fn inject(&mut self, now: Time, topic: &'static Topic, bytes: DeviceBytes, sink: &mut Sink<'_>) {
        // Another service's topic is not for this node to publish, whatever the driver believes.
        let own = |candidate: &&'static Topic| *candidate == topic && candidate.writer == C::NAME;
        let Some(index) = C::Input::topics().iter().position(own) else { return };
        let mut body = std::mem::take(&mut self.device_body);
        body.clear();
        let said = wire::encode(&bytes, &mut body)
            .map_err(SayError::from)
            .and_then(|()| self.publisher.publish_body(now, topic, &body, sink));
        match said {
            // Decoded from the very bytes that are recorded: a replay feeds the core the same.
            Ok(()) => {
                if let Ok(input) = C::Input::decode(index, &body) {
                    self.step(now, Event::Input(input), sink);
                }
            }
            Err(error) => self.note_unsaid(now, topic, &error, sink),
        }
        self.device_body = body;
    }

    fn overflowed(&mut self, datagrams: u64) {
        self.overflowed += datagrams;
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }

    fn steps(&self) -> u64 {
        self.steps
    }
}

fn written_by<C: Core>() -> Vec<&'static Topic> {
    let devices = C::Input::topics().iter().filter(|topic| topic.writer == C::NAME);
    let every_node = [&topics::NODE_EVENT, &topics::NODE_HEALTH];
    C::Output::topics().iter().chain(devices).copied().chain(every_node).collect()
}

#[cfg(test)]
mod tests;
