//! Proof by re-execution: each core of a recording is fed what its node says it was fed, in that order and at those
//! instants, and has to say the same, bit for bit.
//!
//! A node's journal names, for every step of its core, the cause and a digest of what was said. [`Verifier`] goes
//! through a recording once: it keeps the messages of the last while, and steps every core as soon as all that its
//! journalled step can name has been read. All cores advance together in the order of their instants, so what a sender
//! says is held against the recorded copy before any reader of that copy has its turn: a damaged copy is told from a core
//! that has changed.
//!
//! What cannot be proven is said to be unverifiable, from which step on and why; only a step that had everything it had
//! then, and comes out otherwise, is a divergence.

mod difference;
mod execution;
mod report;
mod window;

use std::collections::{BTreeMap, BTreeSet};

use difference::Types;
pub use difference::{Comparison, FieldPair};
use execution::Execution;
use quantity::{Span, Time};
pub use report::{
    Cause, Damage, Divergence, DivergenceKind, Input, OtherSettings, Outcome, Reason, Report, Unjournalled,
    Verdict,
};
use schemas::{NodeHealth, NodeJournal, topics};
use service_core::{AnyCore, Seed, Start};
use settings::{Arena, ConfigError};
use window::{Kept, Key, Window};
use wire::Kind;

use crate::{Definition, Message, Recording, Selection, Stream};

/// Makes the core of a service by its name.
pub type CoreFactory<'f> = dyn Fn(&str, &Arena, Start) -> Result<Box<dyn AnyCore>, ConfigError> + 'f;

/// How long a step waits for its turn: longer than any running node keeps a journal to itself, so that the steps of
/// others that came before it are known.
const HOLD: Span = Span::from_secs(1);
/// A node that is heard so long after it reported its steps has published their journal, or never will.
const JOURNAL_DELAY_MAX: Span = Span::from_millis(500);
/// Starts of services in one recording, at most: each one costs memory.
const STARTS_MAX: usize = 4096;
/// Steps that wait for their turn, at most: far more than an arena makes in a second.
const WAITING_MAX: usize = 1 << 18;

/// One message of a recording, in the order of the recording.
#[derive(Clone, Copy, Debug)]
pub struct Recorded<'a> {
    /// Who said it on which topic.
    pub stream: &'a Stream,
    /// The low 32 bits of its number.
    pub sequence: u32,
    /// When it was recorded.
    pub at: Time,
    /// When it was sent.
    pub published_at: Time,
    /// Its body.
    pub body: &'a [u8],
}

/// Executes the services of a recording again, one of them or all, and says what it came to. `progress` is told the
/// instant of each message.
///
/// A chunk that cannot be read is noted in the report, and what was in it was not recorded.
pub fn verify(
    recording: &Recording,
    factory: &CoreFactory<'_>,
    settings: &Arena,
    only: Option<&str>,
    progress: &mut dyn FnMut(Time),
) -> Report {
    let mut verifier = Verifier::new(factory, settings, only);
    for definition in recording.definitions() {
        verifier.define(definition);
    }
    let mut messages = recording.messages(&Selection::all());
    while let Some(message) = messages.next() {
        match message {
            Ok(Message { channel, sequence, at, published_at, body }) => {
                // Others than our recorders write no journals.
                let Some(stream) = &channel.stream else { continue };
                verifier.take(&Recorded { stream, sequence, at, published_at, body });
                progress(at);
            }
            Err(error) => verifier.note_unreadable(error.to_string()),
        }
    }
    verifier.finish()
}

/// One start of one instance.
type Sender = (u32, u32);

/// What a node said of itself.
struct Heard {
    service: String,
    steps: u64,
    reported_at: Time,
    /// Steps that it reported so long before it was last heard that their journal is out.
    steps_past: u64,
}

/// Executes the services of a recording again, in one pass over it.
pub struct Verifier<'f> {
    factory: &'f CoreFactory<'f>,
    settings: &'f Arena,
    settings_digest: u64,
    only: Option<String>,
    window: Window,
    types: Types,
    executions: Vec<Execution>,
    /// Where the execution of a sender is; of one that is not asked for, nowhere.
    places: BTreeMap<Sender, Option<usize>>,
    /// Executions by the instant of their next step.
    due: BTreeSet<(Time, usize)>,
    /// Steps that wait for their turn, in all executions.
    waiting: usize,
    heard: BTreeMap<Sender, Heard>,
    report: Report,
}

impl<'f> Verifier<'f> {
    /// A verification with these settings, of one service or of all.
    #[must_use]
    pub fn new(factory: &'f CoreFactory<'f>, settings: &'f Arena, only: Option<&str>) -> Self {
        Self {
            factory,
            settings,
            settings_digest: settings.digest(),
            only: only.map(str::to_owned),
            window: Window::default(),
            types: Types::default(),
            executions: Vec::new(),
            places: BTreeMap::new(),
            due: BTreeSet::new(),
            waiting: 0,
            heard: BTreeMap::new(),
            report: Report::default(),
        }
    }

    /// Takes note of a message type of the recording: bodies of types that have changed since are shown by it.
    pub fn define(&mut self, definition: &Definition) {
        self.types.define(definition);
    }

    /// Takes the next message of the recording.
    pub fn take(&mut self, message: &Recorded<'_>) {
        self.note_progress(message.at);
        let stream = message.stream;
        // Of a topic that is not in the table no core has heard, and no key has vouched for it.
        let Some(topic) = topics::by_name(&stream.topic).filter(|_| stream.verified) else { return };
        let sender = (stream.source, stream.incarnation);
        match stream.kind {
            Kind::Journal => self.take_journal(sender, message),
            Kind::Data => {
                self.note_heard(sender, message);
                let Stream { source, incarnation, schema_id, .. } = *stream;
                let kept = Kept {
                    order: 0,
                    at: message.at,
                    published_at: message.published_at,
                    schema_id,
                    body: message.body.into(),
                    damaged: false,
                };
                self.window.keep(Key { topic_hash: topic.hash, source, incarnation }, message.sequence, kept);
            }
            Kind::Schema | Kind::SchemaRequest => {}
        }
        self.advance(message.at);
    }

    /// Executes what still waits, and says what it all came to.
    #[must_use]
    pub fn finish(mut self) -> Report {
        self.advance(Time::FAR_FUTURE);
        for (sender, heard) in &self.heard {
            match self.places.get(sender) {
                Some(Some(place)) => end_of_journal(&mut self.executions[*place], heard),
                Some(None) => {}
                None if heard.steps > 0 && self.only.as_ref().is_none_or(|only| *only == heard.service) => {
                    let (service, incarnation) = (heard.service.clone(), sender.1);
                    self.report.unjournalled.push(Unjournalled { service, incarnation });
                }
                None => {}
            }
        }
        self.report.verdicts = self.executions.into_iter().map(|execution| execution.verdict).collect();
        self.report
    }

    /// Notes that the recording has something that nobody can read; the first counts.
    pub fn note_unreadable(&mut self, reason: String) {
        self.report.unreadable.get_or_insert(reason);
    }

    fn note_progress(&mut self, at: Time) {
        let report = &mut self.report;
        if report.messages == 0 {
            (report.from, report.to) = (at, at);
        }
        report.messages += 1;
        report.to = report.to.max(at);
    }

    fn note_heard(&mut self, sender: Sender, message: &Recorded<'_>) {
        let heard = self.heard.get_mut(&sender);
        if let Some(heard) = heard
            && message.at > heard.reported_at.saturating_add(JOURNAL_DELAY_MAX)
        {
            heard.steps_past = heard.steps;
        }
        if message.stream.topic != topics::NODE_HEALTH.name {
            return;
        }
        let Ok(health) = wire::decode::<NodeHealth>(message.body) else { return };
        if self.heard.len() < STARTS_MAX || self.heard.contains_key(&sender) {
            let (steps, reported_at) = (health.steps, message.at);
            let steps_past = self.heard.get(&sender).map_or(0, |heard| heard.steps_past);
            let service = health.node.to_string();
            self.heard.insert(sender, Heard { service, steps, reported_at, steps_past });
        }
    }

    fn take_journal(&mut self, sender: Sender, message: &Recorded<'_>) {
        let batch = match wire::decode::<NodeJournal>(message.body) {
            Ok(batch) => batch,
            Err(error) => {
                let (source, incarnation) = sender;
                return self.note_unreadable(format!(
                    "a journal of source {source:08x}, incarnation {incarnation}, at {}: {error}",
                    message.at
                ));
            }
        };
        let place = match self.places.get(&sender) {
            Some(place) => *place,
            None if self.places.len() >= STARTS_MAX => {
                return self.note_unreadable(format!("more than {STARTS_MAX} starts of services"));
            }
            None => {
                let wanted = self.only.as_ref().is_none_or(|only| *only == batch.node.as_str());
                let place = wanted.then(|| self.begin(sender, &batch));
                self.places.insert(sender, place);
                place
            }
        };
        let Some(place) = place else { return };
        let execution = &mut self.executions[place];
        let (before, waiting) = (execution.next_at(), execution.waiting());
        execution.journal(&batch);
        self.waiting += execution.waiting() - waiting;
        if before.is_none()
            && let Some(at) = execution.next_at()
        {
            self.due.insert((at, place));
        }
    }

    /// Begins to execute a service; its place among the executions.
    fn begin(&mut self, (source, incarnation): Sender, batch: &NodeJournal) -> usize {
        let start = Start { at: batch.started_at, seed: Seed(batch.seed), incarnation };
        let core = (self.factory)(&batch.node, self.settings, start)
            .map_err(|error| Reason::NoCore { reason: error.to_string() });
        let mut execution = Execution::new(batch.node.to_string(), source, incarnation, core);
        let (had, given) = (batch.settings_digest, self.settings_digest);
        execution.verdict.settings = (had != given).then_some(OtherSettings { had, given });
        self.executions.push(execution);
        self.executions.len() - 1
    }

    /// Gives every step its turn that is due once all up to `now` has been read.
    fn advance(&mut self, now: Time) {
        while let Some(&(at, place)) = self.due.first() {
            if at.saturating_add(HOLD) > now && self.waiting <= WAITING_MAX {
                return;
            }
            self.due.pop_first();
            let execution = &mut self.executions[place];
            self.waiting -= execution.waiting();
            execution.step(&mut self.window, &self.types);
            self.waiting += execution.waiting();
            if let Some(next) = execution.next_at() {
                self.due.insert((next, place));
            }
        }
    }
}

/// A journal that stops while its node goes on: the recorder missed the rest, or somebody gave the core orders that no
/// message tells of.
fn end_of_journal(execution: &mut Execution, heard: &Heard) {
    let journalled = execution.verdict.steps_journalled;
    let steps_reported = heard.steps_past;
    if steps_reported > journalled {
        execution.stop_after_waiting(journalled, None, Reason::JournalEnds { steps_reported });
    }
}

#[cfg(test)]
mod tests;
