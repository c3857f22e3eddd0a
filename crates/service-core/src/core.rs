//! The contract of a service: time, seed and messages in, messages out; no clock, no socket, no file.

use quantity::Time;
use reflect::Text;
use schemas::{NodeEvent, Severity, Topic};
use serde::de::DeserializeOwned;
use settings::{Arena, ConfigError};
use wire::{DecodeError, EncodeError};

/// Seed of everything random in one node, derived from the arena's seed and the node's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

/// A service without I/O.
///
/// The only fallible call is [`Core::new`]. Afterwards a core takes whatever comes: a driver calls [`Core::step`] for
/// each input, and with [`Event::Deadline`] as soon as the instant of [`Core::deadline`] has come. The same core runs
/// live, in virtual time and in a replay, and cannot tell which.
pub trait Core: Sized {
    /// The service's name: its binary, its section of the settings, its role on the bus.
    const NAME: &'static str;
    /// The service's own section of the settings.
    type Tuning: DeserializeOwned;
    /// Closed enum of the topics consumed.
    type Input: Inbound;
    /// Closed enum of the topics produced.
    type Output: Outbound;

    /// Builds the service from the arena's settings and its own section.
    ///
    /// # Errors
    /// A setting the service cannot work with.
    fn new(arena: &Arena, tuning: Self::Tuning, start: Start) -> Result<Self, ConfigError>;

    /// When to wake this core if nothing comes; `None` for only when something comes.
    fn deadline(&self) -> Option<Time>;

    /// One step: something came, or the deadline did.
    fn step(&mut self, now: Time, event: Event<Self::Input>, out: &mut Outbox<Self::Output>);
}

/// What a core learns of its own start besides settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    /// Now.
    pub at: Time,
    /// Seed of everything random in this core.
    pub seed: Seed,
    /// Rises at each start of this service: also the epoch of any lease it takes.
    pub incarnation: u32,
}

/// Why a core is stepped.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<I> {
    /// Its deadline has come.
    Deadline,
    /// A message has come.
    Input(I),
}

/// The topics a core consumes; written by [`inputs!`](crate::inputs).
pub trait Inbound: Sized {
    /// The topics, in the enum's order.
    fn topics() -> &'static [&'static Topic];

    /// Decodes a body of the topic at `index` of [`Inbound::topics`].
    ///
    /// # Errors
    /// The body is not of that topic's type.
    fn decode(index: usize, body: &[u8]) -> Result<Self, DecodeError>;
}

/// The topics a core produces; written by [`outputs!`](crate::outputs).
pub trait Outbound: Sized {
    /// The topics, in the enum's order.
    fn topics() -> &'static [&'static Topic];

    /// The topic of this message.
    fn topic(&self) -> &'static Topic;

    /// Appends the body.
    ///
    /// # Errors
    /// The message holds a number that is not finite, or is too long.
    fn encode(&self, body: &mut Vec<u8>) -> Result<(), EncodeError>;
}

/// Where a step puts what it has to say. The driver empties it after each step, in order.
#[derive(Debug)]
pub struct Outbox<O> {
    messages: Vec<O>,
    events: Vec<NodeEvent>,
}

impl<O> Default for Outbox<O> {
    fn default() -> Self {
        Self { messages: Vec::new(), events: Vec::new() }
    }
}

impl<O> Outbox<O> {
    /// Says something on the bus.
    pub fn publish(&mut self, message: impl Into<O>) {
        self.messages.push(message.into());
    }

    /// Reports a fault or a turn of events under a searchable name; `vehicle` is zero for none. The node's name is
    /// filled in by the driver.
    pub fn event(&mut self, at: Time, severity: Severity, vehicle: u8, name: &str, detail: &str) {
        self.events.push(NodeEvent {
            severity,
            vehicle,
            at,
            node: Text::default(),
            name: Text::truncated(name),
            detail: Text::truncated(detail),
        });
    }

    /// What was published since the last call, in order.
    pub fn take_messages(&mut self) -> std::vec::Drain<'_, O> {
        self.messages.drain(..)
    }

    /// What was reported since the last call, in order.
    pub fn take_events(&mut self) -> std::vec::Drain<'_, NodeEvent> {
        self.events.drain(..)
    }

    /// What has been published and not yet taken; for tests.
    #[must_use]
    pub fn messages(&self) -> &[O] {
        &self.messages
    }

    /// What has been reported and not yet taken; for tests.
    #[must_use]
    pub fn events(&self) -> &[NodeEvent] {
        &self.events
    }

    /// Nothing to say.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty() && self.events.is_empty()
    }
}
