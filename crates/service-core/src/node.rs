//! A core on the bus: what comes is authenticated, filtered and decoded; what goes is numbered, encoded and sealed.

use quantity::{Span, Time};
use reflect::Text;
use schemas::{DeviceBytes, JournalStream, NodeHealth, NodeLatency, Topic, topics};
use settings::{Arena, ConfigError};
use wire::{Counters, Domain, DropReason, Keyring, Kind, Role, Secret, Windows};

use crate::journal::{Cause, Journal};
use crate::publisher::Publisher;
use crate::sections::check_sections;
use crate::{Core, Event, Inbound, Outbound, Seed, Start, Stepper};

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

    /// Tells the node what program it is part of, for its health: XXH3-64 of the program's file.
    fn identify_program(&mut self, digest: u64);

    /// Publishes what its driver has measured.
    fn publish_latency(&mut self, now: Time, latency: &NodeLatency, sink: &mut Sink<'_>);

    /// Says what is still to be said before the node ends: the rest of its journal.
    fn close(&mut self, now: Time, sink: &mut Sink<'_>);

    /// What was accepted and dropped so far.
    fn counters(&self) -> &Counters;

    /// Steps of the core so far.
    fn steps(&self) -> u64;
}

/// What a datagram turned out to be.
enum Taken<I> {
    /// Something for the core, and what the journal calls it.
    Input(I, Cause),
    /// Somebody asks for the definition of a topic that this node writes.
    SchemaRequest(&'static Topic),
    /// Not for this node, and no fault of anybody.
    Elsewhere,
}

/// A core and everything between it and the bus.
#[derive(Debug)]
pub struct Node<C: Core> {
    stepper: Stepper<C>,
    journal: Journal,
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
    announced: bool,
    program_digest: u64,
    steps: u64,
    overflowed: u64,
}

impl<C: Core> Node<C> {
    /// Starts a service.
    ///
    /// # Errors
    /// A setting its core cannot work with, or a section of the settings that is no service's.
    pub fn new(arena: &Arena, secret: &Secret, identity: Identity, now: Time) -> Result<Self, ConfigError> {
        check_sections(arena)?;
        let start = Start { at: now, seed: identity.seed, incarnation: identity.incarnation };
        let reads = C::Input::topics().iter().map(|topic| Role::of(Kind::Data, topic.writer));
        let keyring = Keyring::new(secret, identity.domain, identity.run, Role(C::NAME), reads);
        Ok(Self {
            stepper: Stepper::new(arena, start)?,
            journal: Journal::new(C::NAME, start, arena.digest()),
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
            announced: false,
            program_digest: 0,
            steps: 0,
            overflowed: 0,
        })
    }

    /// The core, for tests and tools.
    #[must_use]
    pub fn core(&self) -> &C {
        &self.stepper.core
    }

    /// The core, for whoever gives it orders from outside the bus. Of these no recording can tell, so the node's journal
    /// ends here.
    pub fn core_mut(&mut self) -> &mut C {
        self.journal.end();
        &mut self.stepper.core
    }

    fn step(&mut self, now: Time, event: Event<C::Input>, cause: Cause, sink: &mut Sink<'_>) {
        if self.journal.is_full_for(cause) {
            self.publish_journal(now, sink);
        }
        self.steps += 1;
        let Self { stepper, publisher, .. } = self;
        let said = stepper.step(now, event, &mut |topic, body| {
            // The codec has held the body to its length: sealing fails only with a clock before its zero, where
            // nothing can be said at all.
            let _ = publisher.publish_body(now, topic, body, sink);
        });
        self.journal.note(now, cause, said);
    }

    /// Decoded from the very bytes that are recorded: a re-execution feeds the core the same.
    fn take_device(
        &mut self,
        now: Time,
        topic: &'static Topic,
        index: usize,
        body: &[u8],
        sink: &mut Sink<'_>,
    ) {
        let Ok(input) = C::Input::decode(index, body) else { return };
        // Not said, it cannot be journalled; as for whatever a step says, that is no time of any clock.
        let Ok(sequence) = self.publisher.publish_body(now, topic, body, sink) else { return };
        let Identity { source, incarnation, .. } = self.publisher.identity();
        let stream = JournalStream { topic_hash: topic.hash, source, incarnation };
        self.step(now, Event::Input(input), Cause::Datagram { stream, sequence }, sink);
    }

    fn publish_journal(&mut self, now: Time, sink: &mut Sink<'_>) {
        if let Some(batch) = self.journal.take() {
            // Bounded texts and sequences, no floats, and no instant before the clock's zero that was not refused already.
            let _ = self.publisher.publish_journal(now, &batch, sink);
        }
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
        if topic.writer == C::NAME && self.publisher.identity().domain != Domain::Replay {
            // The node's own device bytes come from its device. From the bus they are its echo, or a replay of it.
            // In a replay there is no device: there they come from playback, which signs for this node's role.
            return Ok(Taken::Elsewhere);
        }
        let key =
            self.keyring.verify_key(Role::of(Kind::Data, topic.writer)).ok_or(DropReason::Unauthentic)?;
        let fresh = opened.verify(key)?.fresh(&mut self.windows)?;
        if fresh.header().schema_id != topic.schema_id() {
            return Err(DropReason::Undecodable);
        }
        let (header, topic_hash) = (fresh.header(), topic.hash);
        let stream = JournalStream { topic_hash, source: header.source, incarnation: header.incarnation };
        let cause = Cause::Datagram { stream, sequence: header.sequence };
        Ok(Taken::Input(C::Input::decode(index, fresh.body())?, cause))
    }

    /// Definitions go out before the first message does: whoever records need not guess what its bytes mean.
    fn announce_first(&mut self, now: Time, sink: &mut Sink<'_>) {
        if !self.announced && self.announce_at <= now {
            self.announce(now, sink);
        }
    }

    fn announce(&mut self, now: Time, sink: &mut Sink<'_>) {
        self.announced = true;
        self.announce_at = now + ANNOUNCE_PERIOD;
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
            program_digest: self.program_digest,
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
        let due = [self.stepper.core.deadline(), self.answer_due()].into_iter().flatten();
        Some(due.fold(self.announce_at.min(self.journal.due_at()), Time::min))
    }

    fn wake(&mut self, now: Time, sink: &mut Sink<'_>) {
        self.announce_first(now, sink);
        // A radio slot comes before whatever else a node says of itself.
        if self.stepper.core.deadline().is_some_and(|at| at <= now) {
            self.step(now, Event::Deadline, Cause::Deadline, sink);
        }
        if self.announce_at <= now {
            self.announce(now, sink);
        }
        if self.journal.due_at() <= now {
            self.publish_journal(now, sink);
        }
        if self.answer_due().is_some_and(|at| at <= now) {
            self.answer_at = now + ANSWER_PERIOD;
            self.publisher.announce(now, &self.asked, sink);
            self.asked.clear();
        }
    }

    fn receive(&mut self, now: Time, datagram: &[u8], sink: &mut Sink<'_>) -> Result<(), DropReason> {
        match self.take(datagram) {
            Ok(Taken::Input(input, cause)) => {
                self.counters.accepted += 1;
                self.announce_first(now, sink);
                self.step(now, Event::Input(input), cause, sink);
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
        self.announce_first(now, sink);
        let mut body = std::mem::take(&mut self.device_body);
        body.clear();
        match wire::encode(&bytes, &mut body) {
            Ok(()) => self.take_device(now, topic, index, &body, sink),
            Err(error) => {
                let Self { stepper, publisher, .. } = self;
                stepper.report_unsayable(now, topic, &error, &mut |topic, body| {
                    // As for whatever a step says.
                    let _ = publisher.publish_body(now, topic, body, sink);
                });
            }
        }
        self.device_body = body;
    }

    fn overflowed(&mut self, datagrams: u64) {
        self.overflowed += datagrams;
    }

    fn identify_program(&mut self, digest: u64) {
        self.program_digest = digest;
    }

    fn publish_latency(&mut self, now: Time, latency: &NodeLatency, sink: &mut Sink<'_>) {
        // As for health: there is nothing in it that could not be said.
        let _ = self.publisher.publish(now, &topics::NODE_LATENCY, latency, sink);
    }

    fn close(&mut self, now: Time, sink: &mut Sink<'_>) {
        self.publish_journal(now, sink);
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
    let every_node =
        [&topics::NODE_EVENT, &topics::NODE_HEALTH, &topics::NODE_JOURNAL, &topics::NODE_LATENCY];
    C::Output::topics().iter().chain(devices).copied().chain(every_node).collect()
}

#[cfg(test)]
mod tests;
