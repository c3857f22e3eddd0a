//! What drives a node in a replay: datagrams in, calls of the node out, in the order of the recording's time.
//!
//! The node's `now` is the newest time that playback has said, by its clock or as the publish time of a message.
//! Before anything of a later time is handed on, the node is woken at each deadline that lies before it, at that very
//! instant, as in virtual time. Nothing here looks at a clock.

use quantity::{Span, Time};
use reflect::Text;
use schemas::{ReplayAnswer, ReplayClock, Topic, topics};
use service_core::{AnyNode, Identity, Publisher, Sink};
use settings::ConfigError;
use tracing::{info, warn};
use wire::{Kind, Role, Secret, VerifyKey, Windows};

use crate::run_loop::NodeFactory;

/// What claims to be from later than the clock by more than this is from before a jump back. Playback says the time
/// at least every [`crate::REPLAY_STEP_MAX`] of the replay, which is half of it.
const HORIZON_SPAN: Span = Span::from_millis(20);
/// A core that asks so often to be woken at one instant would never let time go on.
const IDLE_WAKES_MAX: u32 = 10_000;

/// A node in a replay.
pub(crate) struct Driver<'f> {
    factory: &'f NodeFactory<'f>,
    identity: Identity,
    name: &'static str,
    topics_in: &'static [&'static Topic],
    keys: Vec<(&'static Topic, VerifyKey)>,
    clock_key: VerifyKey,
    windows: Windows,
    voice: Publisher,
    playing: Option<Playing>,
    /// How often the node was made.
    starts: u32,
    from_elsewhen: u64,
}

/// The node while it lives: from the first word of an epoch to the first of the next.
struct Playing {
    node: Box<dyn AnyNode>,
    /// Playback's incarnation and its epoch.
    epoch: (u32, u32),
    clock_at: Time,
    now: Time,
    answered_steps: u64,
    stuck: bool,
}

impl<'f> Driver<'f> {
    /// Waits for playback's first word.
    ///
    /// # Errors
    /// A setting the service cannot work with.
    pub(crate) fn new(
        secret: &Secret,
        identity: Identity,
        factory: &'f NodeFactory<'f>,
    ) -> Result<Self, ConfigError> {
        // Made once before there is a time, so that wrong settings are refused at once.
        let node = factory(identity, Time::ZERO)?;
        let key = |role| VerifyKey::derive(secret, identity.domain, identity.run, role);
        let (name, topics_in) = (node.name(), node.topics_in());
        Ok(Self {
            factory,
            identity,
            name,
            topics_in,
            keys: topics_in.iter().map(|topic| (*topic, key(Role::of(Kind::Data, topic.writer)))).collect(),
            clock_key: key(Role::of(Kind::Data, topics::REPLAY_CLOCK.writer)),
            windows: Windows::new(),
            voice: Publisher::new(name, secret, identity),
            playing: None,
            starts: 0,
            from_elsewhen: 0,
        })
    }

    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    pub(crate) fn topics_in(&self) -> &'static [&'static Topic] {
        self.topics_in
    }

    /// Steps of the node's core since the last jump.
    pub(crate) fn steps(&self) -> u64 {
        self.playing.as_ref().map_or(0, |playing| playing.node.steps())
    }

    /// Tells the node that the kernel has dropped datagrams meant for it.
    pub(crate) fn overflowed(&mut self, datagrams: u64) {
        if let Some(playing) = &mut self.playing {
            playing.node.overflowed(datagrams);
        }
    }

    /// Lets the node say what it still has to say.
    pub(crate) fn close(&mut self, sink: &mut Sink<'_>) {
        if let Some(playing) = &mut self.playing {
            playing.node.close(playing.now, sink);
        }
    }

    /// Takes a datagram from the bus.
    ///
    /// # Errors
    /// The node cannot be made anew after a jump, which it could before.
    pub(crate) fn take(&mut self, datagram: &[u8], sink: &mut Sink<'_>) -> Result<(), ConfigError> {
        if let Some((playback, clock)) = self.clock_in(datagram) {
            return self.tick((playback, clock.epoch), &clock, sink);
        }
        let at = self.said_at(datagram);
        let Some(playing) = &mut self.playing else { return Ok(()) };
        if let Some(at) = at {
            if at > playing.clock_at.saturating_add(HORIZON_SPAN) {
                self.from_elsewhen += 1;
                if self.from_elsewhen.is_power_of_two() {
                    warn!(datagrams = self.from_elsewhen, "dropped: later than the replay's clock");
                }
                return Ok(());
            }
            playing.advance(at, sink);
        }
        // The node has counted what it drops; its health says so.
        let _ = playing.node.receive(playing.now, datagram, sink);
        Ok(())
    }

    /// Playback's incarnation and word, if this is an authentic and new one.
    fn clock_in(&mut self, datagram: &[u8]) -> Option<(u32, ReplayClock)> {
        let opened = wire::open(datagram).ok()?;
        let topic = &topics::REPLAY_CLOCK;
        if opened.claimed().kind != Kind::Data || opened.topic().name() != topic.name {
            return None;
        }
        let fresh = opened.verify(&self.clock_key).ok()?.fresh(&mut self.windows).ok()?;
        let clock = fresh.decode(topic.schema_id()).ok()?;
        Some((fresh.header().incarnation, clock))
    }

    /// When an authentic message that the node reads was said.
    fn said_at(&self, datagram: &[u8]) -> Option<Time> {
        let opened = wire::open(datagram).ok()?;
        let header = *opened.claimed();
        let name = opened.topic().name();
        let (_, key) = self.keys.iter().find(|(topic, _)| topic.name == name)?;
        let authentic = header.kind == Kind::Data && opened.verify(key).is_ok();
        authentic.then_some(header.published_at)
    }

    fn tick(
        &mut self,
        epoch: (u32, u32),
        clock: &ReplayClock,
        sink: &mut Sink<'_>,
    ) -> Result<(), ConfigError> {
        match &self.playing {
            Some(playing) if epoch < playing.epoch => return Ok(()),
            Some(playing) if epoch == playing.epoch => {}
            _ => self.begin(epoch, clock.at, sink)?,
        }
        let Some(playing) = &mut self.playing else { return Ok(()) };
        playing.clock_at = playing.clock_at.max(clock.at);
        playing.advance(clock.at, sink);
        if clock.answer {
            let steps = playing.node.steps();
            let answer = ReplayAnswer {
                node: Text::truncated(self.name),
                tick: clock.tick,
                round: clock.round,
                steps: steps - playing.answered_steps,
                due_at: playing.node.deadline().unwrap_or(Time::ZERO),
            };
            playing.answered_steps = steps;
            // Bounded text and instants of the recording: there is nothing in it that could not be said.
            let _ = self.voice.publish(playing.now, &topics::REPLAY_ANSWER, &answer, sink);
        }
        Ok(())
    }

    /// Makes the node anew, for whom time has never been anything else.
    fn begin(&mut self, epoch: (u32, u32), at: Time, sink: &mut Sink<'_>) -> Result<(), ConfigError> {
        self.close(sink);
        let incarnation = self.identity.incarnation.saturating_add(self.starts);
        self.starts = self.starts.saturating_add(1);
        info!(epoch = epoch.1, incarnation, "begins at {at}");
        let node = (self.factory)(Identity { incarnation, ..self.identity }, at)?;
        self.playing = Some(Playing { node, epoch, clock_at: at, now: at, answered_steps: 0, stuck: false });
        Ok(())
    }
}

impl Playing {
    /// Lets time pass up to an instant, waking the node at each of its deadlines on the way.
    fn advance(&mut self, to: Time, sink: &mut Sink<'_>) {
        let mut idle_wakes = 0;
        while let Some(at) = self.node.deadline().filter(|at| *at <= to.max(self.now)) {
            idle_wakes = if at > self.now { 0 } else { idle_wakes + 1 };
            if idle_wakes > IDLE_WAKES_MAX {
                if !self.stuck {
                    warn!("asks without end to be woken at {at}; time goes on without it");
                }
                self.stuck = true;
                break;
            }
            self.now = self.now.max(at);
            self.node.wake(self.now, sink);
        }
        self.now = self.now.max(to);
    }
}
