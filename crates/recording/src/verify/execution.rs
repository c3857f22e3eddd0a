//! One start of one service, executed again.

use std::collections::VecDeque;
use std::ops::Range;

use quantity::Time;
use schemas::{JournalStep, NodeJournal, Topic, topics};
use service_core::{AnyCore, Said};

use super::difference::{Comparison, Typed, Types, compare};
use super::report::{Cause, Damage, Divergence, DivergenceKind, Input, Outcome, Reason, Verdict};
use super::window::{Absent, Kept, Key, Window};

/// What a node says besides its core: nothing of it follows from the core's inputs.
static BY_DRIVER: [&Topic; 4] =
    [&topics::NODE_HEALTH, &topics::NODE_JOURNAL, &topics::NODE_LATENCY, &topics::REPLAY_ANSWER];

/// A journalled step that waits for its turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub number: u64,
    pub at: Time,
    /// Nothing for the core's own deadline.
    pub cause: Option<(Key, u64)>,
    pub said: Said,
}

/// What a core says in one step; it keeps its memory from step to step.
#[derive(Debug, Default)]
struct Spoken {
    bodies: Vec<u8>,
    messages: Vec<(&'static Topic, Range<usize>)>,
}

/// What is executed.
pub(super) struct Execution {
    pub verdict: Verdict,
    /// Nothing once the outcome is known.
    core: Option<Box<dyn AnyCore>>,
    steps: VecDeque<Step>,
    newest_at: Time,
    spoken: Spoken,
    /// The newest number of each topic that the core writes.
    numbers: Vec<(u32, u64)>,
}

impl Spoken {
    fn clear(&mut self) {
        self.bodies.clear();
        self.messages.clear();
    }

    fn push(&mut self, topic: &'static Topic, body: &[u8]) {
        let start = self.bodies.len();
        self.bodies.extend_from_slice(body);
        self.messages.push((topic, start..self.bodies.len()));
    }

    fn iter(&self) -> impl Iterator<Item = (&'static Topic, &[u8])> {
        self.messages.iter().map(|(topic, range)| (*topic, &self.bodies[range.clone()]))
    }
}

impl Execution {
    pub fn new(
        service: String,
        source: u32,
        incarnation: u32,
        core: Result<Box<dyn AnyCore>, Reason>,
    ) -> Self {
        let (core, outcome) = match core {
            Ok(core) => (Some(core), Outcome::Identical),
            Err(reason) => (None, Outcome::Unverifiable { from_step: 0, at: None, reason }),
        };
        Self {
            verdict: Verdict {
                service,
                source,
                incarnation,
                steps_identical: 0,
                steps_journalled: 0,
                outcome,
                copies_identical: 0,
                copies_absent: 0,
                copies_damaged: 0,
                first_damage: None,
                settings: None,
            },
            core,
            steps: VecDeque::new(),
            newest_at: Time::ZERO,
            spoken: Spoken::default(),
            numbers: Vec::new(),
        }
    }

    /// When its next step is due.
    pub fn next_at(&self) -> Option<Time> {
        self.core.as_ref()?;
        self.steps.front().map(|step| step.at)
    }

    /// How many steps wait for their turn.
    pub fn waiting(&self) -> usize {
        self.steps.len()
    }

    /// Takes a batch of the journal.
    pub fn journal(&mut self, batch: &NodeJournal) {
        let expected = self.verdict.steps_journalled;
        let steps = batch.steps.len() as u64;
        self.verdict.steps_journalled = expected.max(batch.first_step.saturating_add(steps));
        let Some(first) = batch.steps.first().filter(|_| self.core.is_some()) else { return };
        if self.verdict.outcome != Outcome::Identical {
            return;
        }
        if batch.first_step != expected {
            let reason = match expected {
                0 => Reason::JournalBeginsLate,
                _ if batch.first_step > expected => {
                    Reason::JournalMissing { resumes_at_step: batch.first_step }
                }
                _ => Reason::JournalCorrupt { reason: format!("step {} comes twice", batch.first_step) },
            };
            self.stop_after_waiting(expected, Some(first.at), reason);
            return;
        }
        for (number, step) in (expected..).zip(&batch.steps) {
            match resolved(batch, number, step, self.newest_at) {
                Ok(step) => self.steps.push_back(step),
                Err(reason) => {
                    self.stop_after_waiting(number, Some(step.at), Reason::JournalCorrupt { reason });
                    return;
                }
            }
            self.newest_at = step.at;
        }
    }

    /// From this step on nobody can say; those before it still have their turn, unless one of them has an outcome of
    /// its own.
    pub fn stop_after_waiting(&mut self, from_step: u64, at: Option<Time>, reason: Reason) {
        if self.verdict.outcome == Outcome::Identical {
            self.verdict.outcome = Outcome::Unverifiable { from_step, at, reason };
        }
    }

    fn stop(&mut self, outcome: Outcome) {
        self.verdict.outcome = outcome;
        self.core = None;
        self.steps = VecDeque::new();
    }

    /// Executes the next step, if there is one.
    pub fn step(&mut self, window: &mut Window, types: &Types) {
        let Some(step) = self.steps.pop_front() else { return };
        match self.execute(&step, window) {
            Ok(said) if said == step.said => {
                self.verdict.steps_identical += 1;
                self.check_copies(&step, window, types);
            }
            Ok(said) => {
                let kind =
                    DivergenceKind::Output { outputs_then: step.said.outputs, outputs_now: said.outputs };
                self.diverge(&step, kind, window, types);
            }
            Err(outcome) => match *outcome {
                Failure::Reason(reason) => {
                    let (from_step, at) = (step.number, Some(step.at));
                    self.stop(Outcome::Unverifiable { from_step, at, reason });
                }
                Failure::Deadline(now) => {
                    self.diverge(&step, DivergenceKind::Deadline { now }, window, types);
                }
            },
        }
    }

    fn execute(&mut self, step: &Step, window: &Window) -> Result<Said, Box<Failure>> {
        let Self { core, spoken, .. } = self;
        let core = core.as_mut().expect("a step has its turn only while there is a core");
        spoken.clear();
        let mut say = |topic: &'static Topic, body: &[u8]| spoken.push(topic, body);
        let Some((key, sequence)) = step.cause else {
            let deadline = core.deadline();
            if deadline.is_none_or(|deadline| deadline > step.at) {
                return Err(Box::new(Failure::Deadline(deadline)));
            }
            return Ok(core.step_deadline(step.at, &mut say));
        };
        let input = || input_of(key, sequence);
        let refused = |reason| Box::new(Failure::Reason(reason));
        let index = core.topics_in().iter().position(|topic| topic.hash == key.topic_hash);
        let index = index.ok_or_else(|| refused(Reason::InputUnwanted(input())))?;
        let kept = window.cause(key, sequence, step.at).map_err(|absent| match absent {
            Absent::Missed => refused(Reason::InputMissing(input())),
            Absent::Forgotten => refused(Reason::InputForgotten(input())),
        })?;
        if kept.damaged {
            return Err(refused(Reason::InputDamaged(input())));
        }
        let undecodable = |reason| refused(Reason::InputUndecodable { input: input(), reason });
        let (then, now) = (kept.schema_id, core.topics_in()[index].schema_id());
        if then != now {
            return Err(undecodable(format!("its type {then:016x} is not today's {now:016x}")));
        }
        core.step_input(step.at, index, &kept.body, &mut say).map_err(|error| undecodable(error.to_string()))
    }

    fn number_of(&self, topic: &Topic) -> u64 {
        self.numbers.iter().find(|(hash, _)| *hash == topic.hash).map_or(0, |(_, number)| *number)
    }

    fn next_number(&mut self, topic: &Topic) -> u64 {
        // A core writes a handful of topics.
        let place = self.numbers.iter().position(|(hash, _)| *hash == topic.hash).unwrap_or_else(|| {
            self.numbers.push((topic.hash, 0));
            self.numbers.len() - 1
        });
        self.numbers[place].1 += 1;
        self.numbers[place].1
    }

    fn key_of(&self, topic_hash: u32) -> Key {
        Key { topic_hash, source: self.verdict.source, incarnation: self.verdict.incarnation }
    }

    /// Holds what the recording has of a proven step's messages against what was said.
    fn check_copies(&mut self, step: &Step, window: &mut Window, types: &Types) {
        let spoken = std::mem::take(&mut self.spoken);
        for (topic, body) in spoken.iter() {
            let sequence = self.next_number(topic);
            let key = self.key_of(topic.hash);
            match window.get(key, sequence) {
                None => self.verdict.copies_absent += 1,
                Some(kept) if *kept.body == *body => self.verdict.copies_identical += 1,
                Some(kept) => {
                    let recorded = Typed { schema_id: kept.schema_id, body: &kept.body };
                    let damage = || Damage {
                        step: step.number,
                        at: step.at,
                        message: compare(types, topic, sequence, Some(recorded), Some(body)),
                    };
                    self.verdict.copies_damaged += 1;
                    self.verdict.first_damage.get_or_insert_with(|| Box::new(damage()));
                    window.mark_damaged(key, sequence);
                }
            }
        }
        self.spoken = spoken;
    }

    /// Ends with a step that came out otherwise.
    fn diverge(&mut self, step: &Step, kind: DivergenceKind, window: &Window, types: &Types) {
        let cause = match step.cause {
            None => Cause::Deadline,
            Some((key, sequence)) => {
                let known = topic_of(key.topic_hash).zip(window.get(key, sequence));
                let fields = known.map_or_else(Vec::new, |(topic, kept)| {
                    types.fields_of(topic, Typed { schema_id: kept.schema_id, body: &kept.body })
                });
                Cause::Message { input: input_of(key, sequence), fields }
            }
        };
        let recorded = self.recorded_in(step, window);
        let proven = Said::of(recorded.iter().map(|(topic, _, kept)| (*topic, &*kept.body))) == step.said;
        let messages = self.side_by_side(&recorded, types);
        self.stop(Outcome::Diverged(Box::new(Divergence {
            step: step.number,
            at: step.at,
            cause,
            kind,
            messages,
            recorded_proven: proven,
        })));
    }

    /// What the recording has of a step's messages, in the order they were said: those of its instant that follow what
    /// the steps before it said.
    fn recorded_in<'w>(&self, step: &Step, window: &'w Window) -> Vec<(&'static Topic, u64, &'w Kept)> {
        let Verdict { service, source, incarnation, .. } = &self.verdict;
        let is_output = |topic: &&'static Topic| {
            let by_driver = BY_DRIVER.contains(topic);
            // What a service both writes and takes are its device's bytes.
            let own = self.core.as_ref().is_some_and(|core| core.topics_in().contains(topic));
            let by_device = own && topic.writer == service;
            !by_driver && !by_device
        };
        let mut found = Vec::new();
        for topic in window.topics_of(*source, *incarnation).filter_map(topic_of).filter(is_output) {
            let first = self.number_of(topic) + 1;
            let of_step = (first..first + u64::from(step.said.outputs))
                .filter_map(|sequence| {
                    Some((topic, sequence, window.get(self.key_of(topic.hash), sequence)?))
                })
                .filter(|(_, _, kept)| kept.published_at == step.at);
            found.extend(of_step);
        }
        found.sort_by_key(|(_, _, kept)| kept.order);
        found.truncate(step.said.outputs.into());
        found
    }

    /// Pairs what is recorded with what is said now, by topic and number.
    fn side_by_side(&self, recorded: &[(&'static Topic, u64, &Kept)], types: &Types) -> Vec<Comparison> {
        let mut said_of_topic: Vec<(u32, u64)> = Vec::new();
        let mut produced = Vec::new();
        for (topic, body) in self.spoken.iter() {
            let earlier = said_of_topic.iter().filter(|(hash, _)| *hash == topic.hash).count() as u64;
            let sequence = self.number_of(topic) + 1 + earlier;
            said_of_topic.push((topic.hash, sequence));
            produced.push((topic, sequence, body));
        }
        let mut messages = Vec::new();
        for (topic, sequence, kept) in recorded {
            let same = produced.iter().find(|(other, number, _)| other == topic && number == sequence);
            let typed = Typed { schema_id: kept.schema_id, body: &kept.body };
            messages.push(compare(types, topic, *sequence, Some(typed), same.map(|(_, _, body)| *body)));
        }
        for (topic, sequence, body) in produced {
            if !recorded.iter().any(|(other, number, _)| *other == topic && *number == sequence) {
                messages.push(compare(types, topic, sequence, None, Some(body)));
            }
        }
        messages
    }
}

/// Why a step was not executed.
enum Failure {
    Reason(Reason),
    /// The core would not be woken yet: its deadline.
    Deadline(Option<Time>),
}

fn resolved(batch: &NodeJournal, number: u64, step: &JournalStep, newest_at: Time) -> Result<Step, String> {
    let cause = if step.stream == JournalStep::DEADLINE {
        None
    } else {
        let stream = batch.streams.get(usize::from(step.stream)).ok_or_else(|| {
            format!("step {number} names stream {} of {}", step.stream, batch.streams.len())
        })?;
        let key =
            Key { topic_hash: stream.topic_hash, source: stream.source, incarnation: stream.incarnation };
        Some((key, step.sequence))
    };
    if step.at < newest_at {
        return Err(format!("step {number} is at {}, the one before it at {newest_at}", step.at));
    }
    Ok(Step { number, at: step.at, cause, said: Said { outputs: step.outputs, digest: step.digest } })
}

fn topic_of(hash: u32) -> Option<&'static Topic> {
    topics::ALL.iter().copied().find(|topic| topic.hash == hash)
}

fn input_of(key: Key, sequence: u64) -> Input {
    let Key { topic_hash, source, incarnation } = key;
    let topic =
        topic_of(topic_hash).map_or_else(|| format!("{topic_hash:08x}"), |topic| topic.name.to_owned());
    Input { topic, source, incarnation, sequence }
}
