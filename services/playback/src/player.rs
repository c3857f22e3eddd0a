//! The player: a thread of its own that puts messages on the bus when they are due, and says the time.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use quantity::{Span, Time};
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec};
use schemas::{ReplayAnswer, ReplayClock, ReplayState, topics};
use service_core::{Observer, Publisher};
use service_shell::{BusReceiver, BusSender, REPLAY_STEP_MAX, TICK_SPAN, clock};
use tracing::{info, warn};

use crate::PlayError;
use crate::control::{Command, Status, Summary};
use crate::feed::Feed;
use crate::lockstep::LockStep;
use crate::pace::{Lateness, Pace, Rate};
use crate::plan::Await;
use crate::signer::Signer;
use crate::source::{Kept, Message};

/// The kernel wakes a thread some tens of microseconds late: the rest of the way is waited awake.
const SPIN_SPAN: Span = Span::from_micros(100);
/// While time stands still it is said again this often, for whoever comes in.
const PAUSED_PERIOD: Duration = Duration::from_millis(500);
/// Every definition is announced this often.
const ANNOUNCE_PERIOD: Span = Span::from_secs(1);
/// In lock step no jump of time is longer than this.
const LOCK_STEP_MAX: Span = Span::from_millis(100);
/// A node that does not answer is asked again after this long.
const ASK_AGAIN: Duration = Duration::from_millis(250);
/// A node that has not answered for this long is waited for no more.
const ANSWER_PATIENCE: Span = Span::from_secs(1);
/// At one instant messages go to and fro at most so often.
const ROUNDS_MAX: u32 = 1_000;
/// Nodes that are awaited at the beginning must have come after this long.
const BEGIN_PATIENCE: Span = Span::from_secs(30);
/// The end is said more than once: whoever misses it would wait for more.
const END_REPEATS: u32 = 3;

/// What a player is made of.
pub(crate) struct Parts {
    pub bus: BusSender,
    pub ear: BusReceiver,
    pub observer: Observer,
    pub voice: Publisher,
    pub signer: Signer,
    pub feed: Feed,
    pub commands: Receiver<Command>,
    pub status: Arc<Mutex<Status>>,
    /// When the recording begins, from which seeks count.
    pub origin: Time,
    pub from: Time,
    pub to: Time,
    pub rate: Rate,
    pub looped: bool,
    pub paused: bool,
    pub awaits: Await,
}

/// Plays.
pub(crate) struct Player {
    parts: Parts,
    state: ReplayState,
    pace: Pace,
    epoch: u32,
    tick: u64,
    position: Time,
    next_tick_at: Time,
    lock_step: LockStep,
    lateness: Lateness,
    /// How late the first message since the last anchor was.
    first_late: Option<Span>,
    seek_asked_at: Option<Time>,
    announce_at: Time,
    announced: usize,
    summary: Summary,
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Goes {
    On,
    ToItsEnd,
}

impl Player {
    pub(crate) fn new(parts: Parts) -> Self {
        let now = clock::now();
        Self {
            state: if parts.paused { ReplayState::Paused } else { ReplayState::Playing },
            pace: Pace::anchored(now, parts.from, 1.0),
            epoch: 0,
            tick: 0,
            position: parts.from,
            next_tick_at: parts.from,
            lock_step: LockStep::default(),
            lateness: Lateness::default(),
            first_late: None,
            seek_asked_at: None,
            announce_at: now,
            announced: 0,
            summary: Summary::default(),
            parts,
        }
    }

    /// Plays to the end, or until told to end.
    pub(crate) async fn run(mut self) -> Result<Summary, PlayError> {
        for number in 0..=self.parts.signer.definition_count() {
            self.announce(number);
        }
        let latched = self.begin(self.parts.from)?;
        if self.await_nodes().await? == Goes::On {
            self.say_latched(&latched);
            self.anchor();
            while self.go_on().await? == Goes::On {}
        }
        self.end()
    }

    async fn go_on(&mut self) -> Result<Goes, PlayError> {
        while let Ok(command) = self.parts.commands.try_recv() {
            if self.obey(command).await? == Goes::ToItsEnd {
                return Ok(Goes::ToItsEnd);
            }
        }
        match (self.state, self.parts.rate) {
            (ReplayState::Paused, _) => self.stand_still().await,
            (ReplayState::Playing, Rate::Ratio(_)) => self.play_on(),
            (ReplayState::Playing, Rate::Max) => self.step_on().await,
            (ReplayState::Ended, _) => Ok(Goes::ToItsEnd),
        }
    }

    async fn obey(&mut self, command: Command) -> Result<Goes, PlayError> {
        match command {
            Command::Quit => return Ok(Goes::ToItsEnd),
            Command::HangUp if self.state == ReplayState::Paused => return Ok(Goes::ToItsEnd),
            Command::HangUp => return Ok(Goes::On),
            Command::Play => self.state = ReplayState::Playing,
            Command::Pause => self.pause()?,
            Command::Toggle if self.state == ReplayState::Playing => self.pause()?,
            Command::Toggle => self.state = ReplayState::Playing,
            Command::Rate(rate) => self.parts.rate = rate,
            Command::Seek(span) => self.seek(self.parts.origin.saturating_add(span))?,
            Command::Step(topic) => {
                self.pause()?;
                self.step(topic.as_deref()).await?;
            }
        }
        self.anchor();
        Ok(Goes::On)
    }

    fn pause(&mut self) -> Result<(), PlayError> {
        self.state = ReplayState::Paused;
        self.say_time(self.position, 0, false)
    }

    async fn stand_still(&mut self) -> Result<Goes, PlayError> {
        match self.parts.commands.recv_timeout(PAUSED_PERIOD) {
            Ok(command) => self.obey(command).await,
            Err(RecvTimeoutError::Timeout) => {
                self.say_time(self.position, 0, false)?;
                Ok(Goes::On)
            }
            // Nobody is left to let time go on.
            Err(RecvTimeoutError::Disconnected) => Ok(Goes::ToItsEnd),
        }
    }

    /// One thing by the clock: a tick or a message.
    fn play_on(&mut self) -> Result<Goes, PlayError> {
        let message_at = self.parts.feed.peek()?;
        let at = message_at.unwrap_or(self.parts.to).max(self.position);
        if self.next_tick_at <= at {
            let tick_at = self.next_tick_at;
            wait_until(self.pace.due(tick_at));
            self.next_tick_at = tick_at.saturating_add(self.tick_step());
            self.say_time(tick_at, 0, false)?;
            return Ok(Goes::On);
        }
        let due = self.pace.due(at);
        wait_until(due);
        self.position = at;
        if message_at.is_none() {
            return self.finish(at);
        }
        self.play_message();
        let late = clock::now() - due;
        self.lateness.note(late);
        let first = *self.first_late.get_or_insert(late);
        self.summary.drift = late - first;
        Ok(Goes::On)
    }

    /// One instant in lock step: the next at which a message was heard or a node wants to be woken.
    async fn step_on(&mut self) -> Result<Goes, PlayError> {
        let message_at = self.parts.feed.peek()?;
        let end = message_at.unwrap_or(self.parts.to).max(self.position);
        let furthest = self.position.saturating_add(LOCK_STEP_MAX);
        let due = self.lock_step.next_due(self.position).unwrap_or(furthest);
        let at = end.min(furthest).min(due);
        self.settle(at).await?;
        if at < end {
            return Ok(Goes::On);
        }
        if message_at.is_none() {
            return self.finish(at);
        }
        while self.parts.feed.peek()?.is_some_and(|next| next <= at) {
            self.play_message();
        }
        self.settle(at).await?;
        Ok(Goes::On)
    }

    /// Plays the next message, or up to the next of a topic, at once.
    async fn step(&mut self, topic: Option<&str>) -> Result<(), PlayError> {
        let signer = &self.parts.signer;
        let is_played =
            |topic| (0..signer.played().len()).any(|channel| signer.topic(channel) == Some(topic));
        if let Some(topic) = topic.filter(|topic| !is_played(topic)) {
            warn!("{topic} is not played");
            return Ok(());
        }
        while let Some(at) = self.parts.feed.peek()? {
            let at = at.max(self.position);
            match self.parts.rate {
                Rate::Max => self.settle(at).await?,
                Rate::Ratio(_) => self.say_time(at, 0, false)?,
            }
            let played = self.play_message();
            if self.parts.rate == Rate::Max {
                self.settle(at).await?;
            }
            let played = played.and_then(|channel| self.parts.signer.topic(channel));
            if topic.is_none_or(|topic| played == Some(topic)) {
                return Ok(());
            }
        }
        warn!("there is nothing more to step to");
        Ok(())
    }

    /// The last message has been played: begins again, or ends.
    fn finish(&mut self, at: Time) -> Result<Goes, PlayError> {
        if self.parts.looped {
            self.seek(self.parts.from)?;
            self.anchor();
            return Ok(Goes::On);
        }
        self.say_time(at, 0, false)?;
        Ok(Goes::ToItsEnd)
    }

    fn seek(&mut self, to: Time) -> Result<(), PlayError> {
        let to = to.clamp(self.parts.from, self.parts.to);
        self.seek_asked_at = Some(clock::now());
        let latched = self.begin(to)?;
        self.say_latched(&latched);
        info!("jumped to {:.3} s", (to - self.parts.origin).as_secs_f64());
        Ok(())
    }

    /// Begins an epoch.
    fn begin(&mut self, at: Time) -> Result<Vec<Kept>, PlayError> {
        let latched = self.parts.feed.begin(at, self.parts.to)?;
        self.epoch += 1;
        self.position = at;
        self.parts.signer.break_off();
        self.say_time(at, 0, false)?;
        Ok(latched)
    }

    /// Says the newest of what is latched, out of its order and therefore apart from what follows.
    fn say_latched(&mut self, latched: &[Kept]) {
        for kept in latched {
            let Parts { signer, bus, .. } = &mut self.parts;
            put(signer, bus, &mut self.summary, kept.message());
        }
        self.parts.signer.break_off();
    }

    /// From now on the schedule counts from here.
    fn anchor(&mut self) {
        let ratio = match self.parts.rate {
            Rate::Ratio(ratio) => ratio,
            Rate::Max => 1.0,
        };
        self.pace = Pace::anchored(clock::now(), self.position, ratio);
        self.next_tick_at = self.position;
        self.first_late = None;
    }

    /// How far time goes from tick to tick.
    fn tick_step(&self) -> Span {
        let step = TICK_SPAN.as_nanos() as f64 * self.parts.rate.ratio();
        Span::from_nanos(step as i64).min(REPLAY_STEP_MAX)
    }

    /// Puts the message that was looked at on the bus; its channel.
    fn play_message(&mut self) -> Option<usize> {
        let Parts { signer, bus, feed, .. } = &mut self.parts;
        let message = feed.take()?;
        let channel = message.channel;
        put(signer, bus, &mut self.summary, message);
        if let Some(asked_at) = self.seek_asked_at.take() {
            self.summary.seek_max = self.summary.seek_max.max(clock::now() - asked_at);
        }
        Some(channel)
    }

    fn say_time(&mut self, at: Time, round: u32, answer: bool) -> Result<(), PlayError> {
        self.position = self.position.max(at);
        if round == 0 && !answer {
            self.tick += 1;
        }
        let word = ReplayClock {
            state: self.state,
            at: self.position,
            rate_ratio: self.parts.rate.ratio(),
            epoch: self.epoch,
            tick: self.tick,
            round,
            answer,
        };
        let Parts { voice, bus, status, .. } = &mut self.parts;
        voice
            .publish(self.position, &topics::REPLAY_CLOCK, &word, &mut |published| {
                bus.send(published.datagram);
            })
            .map_err(|error| PlayError::Time { at: self.position, reason: error.to_string() })?;
        let mut status = status.lock().unwrap_or_else(PoisonError::into_inner);
        status.state = self.state;
        status.at = self.position;
        status.rate_ratio = word.rate_ratio;
        status.messages = self.summary.messages;
        drop(status);
        self.announce_if_due();
        Ok(())
    }

    /// One definition at a time, so that no message waits behind all of them.
    fn announce_if_due(&mut self) {
        let now = clock::now();
        if now < self.announce_at {
            return;
        }
        let count = self.parts.signer.definition_count() + 1;
        self.announce_at = now + ANNOUNCE_PERIOD / count as i64;
        self.announce(self.announced % count);
        self.announced += 1;
    }

    fn announce(&mut self, number: usize) {
        let Parts { signer, bus, voice, .. } = &mut self.parts;
        match signer.definition(number, self.position) {
            Some(datagram) => bus.send(datagram),
            None => voice.announce(
                self.position,
                &[&topics::REPLAY_CLOCK, &topics::REPLAY_ANSWER],
                &mut |published| bus.send(published.datagram),
            ),
        }
    }

    /// Waits at the beginning for those who want to be there from the beginning.
    async fn await_nodes(&mut self) -> Result<Goes, PlayError> {
        let give_up_at = clock::now() + BEGIN_PATIENCE;
        while !self.parts.awaits.is_met(&self.lock_step) {
            if self.parts.commands.try_iter().any(|command| command == Command::Quit) {
                return Ok(Goes::ToItsEnd);
            }
            if clock::now() >= give_up_at {
                return Err(PlayError::Await {
                    wanted: self.parts.awaits.to_string(),
                    found: self.lock_step.names().collect::<Vec<_>>().join(", "),
                });
            }
            self.tick += 1;
            self.lock_step.ask(self.tick, 0);
            self.say_time(self.position, 0, true)?;
            let answered = tokio::time::timeout(ASK_AGAIN, self.parts.ear.next_batch()).await;
            if let Ok(count) = answered {
                self.take_answers(count?);
            }
        }
        Ok(Goes::On)
    }

    /// Says the time until nobody has anything left to do at it.
    async fn settle(&mut self, at: Time) -> Result<(), PlayError> {
        self.tick += 1;
        for round in 0..ROUNDS_MAX {
            self.lock_step.ask(self.tick, round);
            self.say_time(at, round, true)?;
            self.gather(at, round).await?;
            if self.lock_step.is_quiet() {
                return Ok(());
            }
        }
        warn!("{ROUNDS_MAX} rounds at {at} and still not quiet; going on");
        Ok(())
    }

    /// Waits until everybody has answered, or is not waited for any more.
    async fn gather(&mut self, at: Time, round: u32) -> Result<(), PlayError> {
        // Lets the runtime look at the socket, also when there is nobody to wait for.
        tokio::task::yield_now().await;
        let count = self.parts.ear.take_batch()?;
        self.take_answers(count);
        let asked_at = clock::now();
        while !self.lock_step.is_answered() {
            let answered = tokio::time::timeout(ASK_AGAIN, self.parts.ear.next_batch()).await;
            match answered {
                Ok(count) => self.take_answers(count?),
                Err(_) => {
                    self.lock_step.ask_again();
                    self.say_time(at, round, true)?;
                }
            }
            if clock::now() - asked_at >= ANSWER_PATIENCE {
                for node in self.lock_step.drop_silent() {
                    warn!("{node} does not answer any more; going on without it");
                    self.summary.dropped_nodes.push(node);
                }
            }
        }
        Ok(())
    }

    fn take_answers(&mut self, count: usize) {
        let before = self.lock_step.count();
        for index in 0..count {
            // What is not authentic, its counters know.
            let Ok(heard) = self.parts.observer.observe(self.parts.ear.datagram(index).bytes) else {
                continue;
            };
            let is_answer = heard.verified && heard.topic.name() == topics::REPLAY_ANSWER.name;
            if let (true, Ok(answer)) = (is_answer, wire::decode::<ReplayAnswer>(heard.body)) {
                self.lock_step.take(&answer);
            }
        }
        if self.lock_step.count() != before {
            let nodes = self.lock_step.names().map(str::to_owned).collect();
            self.parts.status.lock().unwrap_or_else(PoisonError::into_inner).nodes = nodes;
        }
    }

    fn end(mut self) -> Result<Summary, PlayError> {
        self.state = ReplayState::Ended;
        for _ in 0..END_REPEATS {
            self.say_time(self.position, 0, false)?;
        }
        let lateness = &self.lateness;
        Ok(Summary {
            unsent: self.summary.unsent + self.parts.bus.failed(),
            measured: lateness.count(),
            lateness_median: lateness.quantile(0.5),
            lateness_p99: lateness.quantile(0.99),
            lateness_max: lateness.max(),
            ..self.summary
        })
    }
}

fn put(signer: &mut Signer, bus: &mut BusSender, summary: &mut Summary, message: Message<'_>) {
    match signer.seal(message) {
        Ok(Some(datagram)) => {
            bus.send(datagram);
            summary.messages += 1;
            summary.bytes += message.body.len() as u64;
        }
        Ok(None) => {}
        Err(error) => {
            summary.unsent += 1;
            if summary.unsent.is_power_of_two() {
                warn!(at = %message.at, %error, "a message that no datagram can be made of");
            }
        }
    }
}

/// Waits for an instant of the host's clock: asleep as far as the kernel is good for, then awake.
fn wait_until(due: Time) {
    let wake_at = due.saturating_add(-SPIN_SPAN).as_nanos().max(1);
    if wake_at > clock::now().as_nanos() {
        let at = Timespec { tv_sec: wake_at / 1_000_000_000, tv_nsec: wake_at % 1_000_000_000 };
        // Interrupted by a signal, the rest is waited awake: a few milliseconds at most.
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &at);
    }
    while clock::now() < due {
        std::hint::spin_loop();
    }
}
