//! A core with what it says brought into bytes: the part of a node that a re-execution shares with it.

use std::fmt;

use quantity::Time;
use reflect::Text;
use schemas::{NodeEvent, Severity, Topic, topics};
use settings::{Arena, ConfigError};
use twox_hash::XxHash3_64;
use wire::{DecodeError, EncodeError};

use crate::{Core, Event, Inbound, Outbound, Outbox, Start};

/// Takes each message that a core says in a step, in order.
pub type Say<'a> = dyn FnMut(&'static Topic, &[u8]) + 'a;

/// What a step came to: how much was said, and a digest of all of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Said {
    /// Messages and events.
    pub outputs: u16,
    /// XXH3-64 over them, in order: of each, the topic's hash, the body's length as `u32`, the body; zero where there
    /// were none.
    pub digest: u64,
}

impl Said {
    /// What these messages, said in this order in one step, come to.
    #[must_use]
    pub fn of<'a>(messages: impl IntoIterator<Item = (&'a Topic, &'a [u8])>) -> Self {
        let (mut outputs, mut digested) = (0_u16, Vec::new());
        for (topic, body) in messages {
            outputs = outputs.saturating_add(1);
            digest_into(&mut digested, topic, body);
        }
        if outputs == 0 { Self::default() } else { Self { outputs, digest: XxHash3_64::oneshot(&digested) } }
    }
}

/// Appends what the digest of a step covers of one message.
fn digest_into(digested: &mut Vec<u8>, topic: &Topic, body: &[u8]) {
    digested.extend_from_slice(&topic.hash.to_le_bytes());
    digested.extend_from_slice(&(body.len() as u32).to_le_bytes());
    digested.extend_from_slice(body);
}

/// A core whose type is forgotten, without a bus: what a re-execution holds.
pub trait AnyCore {
    /// The service's name.
    fn name(&self) -> &'static str;

    /// The topics the core consumes.
    fn topics_in(&self) -> &'static [&'static Topic];

    /// When the core wants to be woken.
    fn deadline(&self) -> Option<Time>;

    /// Steps the core with its deadline.
    fn step_deadline(&mut self, now: Time, say: &mut Say<'_>) -> Said;

    /// Steps the core with a message of the topic at `index` of [`AnyCore::topics_in`].
    ///
    /// # Errors
    /// The body does not decode; the core was not stepped.
    fn step_input(
        &mut self,
        now: Time,
        index: usize,
        body: &[u8],
        say: &mut Say<'_>,
    ) -> Result<Said, DecodeError>;
}

/// A core, its outbox, and the bytes of what it says.
pub struct Stepper<C: Core> {
    pub(crate) core: C,
    outbox: Outbox<C::Output>,
    body: Vec<u8>,
    digested: Vec<u8>,
    unsayable: u64,
}

impl<C: Core> Stepper<C> {
    /// Makes the core of a service from the arena's settings.
    ///
    /// # Errors
    /// A setting the core cannot work with.
    pub fn new(arena: &Arena, start: Start) -> Result<Self, ConfigError> {
        let tuning = arena.section(C::NAME)?;
        Ok(Self {
            core: C::new(arena, tuning, start)?,
            outbox: Outbox::default(),
            body: Vec::with_capacity(1024),
            digested: Vec::with_capacity(1024),
            unsayable: 0,
        })
    }

    /// Steps the core and says what it has to say, each message in turn.
    pub fn step(&mut self, now: Time, event: Event<C::Input>, say: &mut Say<'_>) -> Said {
        self.core.step(now, event, &mut self.outbox);
        if self.outbox.is_empty() {
            return Said::default();
        }
        self.digested.clear();
        let mut outputs = 0;
        let mut outbox = std::mem::take(&mut self.outbox);
        for message in outbox.take_messages() {
            self.body.clear();
            let topic = message.topic();
            match message.encode(&mut self.body) {
                Ok(()) => self.put(topic, &mut outputs, say),
                Err(error) => self.note_unsayable(now, topic, &error, &mut outputs, say),
            }
        }
        for mut event in outbox.take_events() {
            event.node = Text::truncated(C::NAME);
            self.put_event(&event, &mut outputs, say);
        }
        // Emptied, it keeps its memory.
        self.outbox = outbox;
        Said { outputs, digest: XxHash3_64::oneshot(&self.digested) }
    }

    /// Says what is in `body`.
    fn put(&mut self, topic: &'static Topic, outputs: &mut u16, say: &mut Say<'_>) {
        *outputs = outputs.saturating_add(1);
        digest_into(&mut self.digested, topic, &self.body);
        say(topic, &self.body);
    }

    fn put_event(&mut self, event: &NodeEvent, outputs: &mut u16, say: &mut Say<'_>) {
        self.body.clear();
        // Bounded texts and no floats: it fails only with a time before the clock's zero, which no driver has.
        if wire::encode(event, &mut self.body).is_ok() {
            self.put(&topics::NODE_EVENT, outputs, say);
        }
    }

    /// Reports bytes of a device that cannot be said.
    pub(crate) fn report_unsayable(
        &mut self,
        now: Time,
        topic: &Topic,
        error: &EncodeError,
        say: &mut Say<'_>,
    ) {
        self.note_unsayable(now, topic, error, &mut 0, say);
    }

    /// A message that cannot be said is a bug of the core's. The vehicles fly on, in debug builds too; tests look for the
    /// event. A core that does it in each step is reported whenever the count doubles, so that it does not flood the bus.
    fn note_unsayable(
        &mut self,
        now: Time,
        topic: &Topic,
        error: &EncodeError,
        outputs: &mut u16,
        say: &mut Say<'_>,
    ) {
        self.unsayable += 1;
        if !self.unsayable.is_power_of_two() {
            return;
        }
        let event = NodeEvent {
            severity: Severity::Fault,
            vehicle: 0,
            at: now,
            node: Text::truncated(C::NAME),
            name: Text::truncated("message-unsayable"),
            detail: Text::truncated(format_args!("{}: {error}; {} so far", topic.name, self.unsayable)),
        };
        self.put_event(&event, outputs, say);
    }
}

impl<C: Core + fmt::Debug> fmt::Debug for Stepper<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stepper").field("core", &self.core).finish_non_exhaustive()
    }
}

impl<C: Core> AnyCore for Stepper<C> {
    fn name(&self) -> &'static str {
        C::NAME
    }

    fn topics_in(&self) -> &'static [&'static Topic] {
        C::Input::topics()
    }

    fn deadline(&self) -> Option<Time> {
        self.core.deadline()
    }

    fn step_deadline(&mut self, now: Time, say: &mut Say<'_>) -> Said {
        self.step(now, Event::Deadline, say)
    }

    fn step_input(
        &mut self,
        now: Time,
        index: usize,
        body: &[u8],
        say: &mut Say<'_>,
    ) -> Result<Said, DecodeError> {
        let input = C::Input::decode(index, body)?;
        Ok(self.step(now, Event::Input(input), say))
    }
}
