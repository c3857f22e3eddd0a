//! A small core whose journal is written by hand: what no whole arena does.

use std::path::Path;

use reflect::Seq;
use schemas::{ArenaOrder, JournalStep, JournalStream, OrderKind, Topic, VehicleGoal, topics};
use serde::Deserialize;
use service_core::{Core, Event, Outbox, Stepper};
use wire::Domain;

use super::*;

service_core::inputs! {
    /// What it hears.
    pub enum Input {
        /// Orders.
        Order(ArenaOrder) = topics::ARENA_ORDER,
    }
}

service_core::outputs! {
    /// What it says.
    pub enum Output {
        /// A goal for each order, and for each deadline.
        Goal(VehicleGoal) = topics::VEHICLE_GOAL,
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Tuning {}

/// Counts its steps aloud, and wakes every `PERIOD_MS`.
#[derive(Debug)]
struct Counter<const PERIOD_MS: i64> {
    wake_at: Time,
    steps: u8,
}

impl<const PERIOD_MS: i64> Core for Counter<PERIOD_MS> {
    const NAME: &'static str = "flip-manager";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { wake_at: start.at + Span::from_millis(PERIOD_MS), steps: 0 })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.wake_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        self.steps = self.steps.wrapping_add(1);
        if event == Event::Deadline {
            self.wake_at = now + Span::from_millis(PERIOD_MS);
        }
        out.publish(VehicleGoal { vehicle: self.steps, ..VehicleGoal::default() });
    }
}

const BEGIN: Time = Time::from_nanos(5_000_000_000);
const SOURCE: u32 = 7;
const ORDERS: JournalStream =
    JournalStream { topic_hash: schemas::topic_hash("arena/order"), source: 1, incarnation: 1 };

fn after(millis: i64) -> Time {
    BEGIN + Span::from_millis(millis)
}

fn settings() -> Arena {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    Arena::load(&folder, "double-flip").unwrap()
}

fn make<const PERIOD_MS: i64>(
    _name: &str,
    arena: &Arena,
    start: Start,
) -> Result<Box<dyn AnyCore>, ConfigError> {
    Ok(Box::new(Stepper::<Counter<PERIOD_MS>>::new(arena, start)?))
}

fn stream(topic: &Topic, kind: Kind, source: u32, schema_id: u64) -> Stream {
    Stream {
        topic: topic.name.to_owned(),
        kind,
        source,
        incarnation: 1,
        domain: Domain::Sim,
        run: 1,
        schema_id,
        latched: false,
        verified: true,
    }
}

/// A life of the counter: an order, its deadline, an order, its deadline.
struct Life {
    orders: Stream,
    batch: NodeJournal,
    factory: Box<CoreFactory<'static>>,
}

impl Life {
    fn new() -> Self {
        let start = Start { at: BEGIN, seed: Seed(3), incarnation: 1 };
        let settings = settings();
        let mut core = make::<20>("", &settings, start).unwrap();
        let causes = [(10, Some(1)), (20, None), (30, Some(2)), (40, None)];
        let steps: Vec<JournalStep> = causes
            .into_iter()
            .map(|(millis, order)| {
                let at = after(millis);
                let said = match order {
                    Some(_) => core.step_input(at, 0, &order_body(), &mut |_, _| ()).unwrap(),
                    None => core.step_deadline(at, &mut |_, _| ()),
                };
                let stream = if order.is_some() { 0 } else { JournalStep::DEADLINE };
                let sequence = order.unwrap_or(0);
                JournalStep { at, stream, sequence, outputs: said.outputs, digest: said.digest }
            })
            .collect();
        let batch = NodeJournal {
            node: reflect::Text::truncated("flip-manager"),
            started_at: BEGIN,
            seed: 3,
            settings_digest: settings.digest(),
            first_step: 0,
            streams: [ORDERS][..].try_into().unwrap(),
            steps: steps[..].try_into().unwrap(),
        };
        let topic = &topics::ARENA_ORDER;
        Self { orders: stream(topic, Kind::Data, 1, topic.schema_id()), batch, factory: Box::new(make::<20>) }
    }

    fn with_steps(mut self, change: impl FnOnce(&mut Vec<JournalStep>)) -> Self {
        let mut steps = self.batch.steps.to_vec();
        change(&mut steps);
        self.batch.steps = Seq::try_from(steps).ok().unwrap();
        self
    }

    fn verdict(&self) -> Verdict {
        let settings = settings();
        let mut verifier = Verifier::new(&*self.factory, &settings, None);
        for (sequence, millis) in [(1, 9), (2, 29)] {
            let at = after(millis);
            let body = &order_body();
            verifier.take(&Recorded { stream: &self.orders, sequence, at, published_at: at, body });
        }
        let journal = &stream(&topics::NODE_JOURNAL, Kind::Journal, SOURCE, 0);
        let mut body = Vec::new();
        wire::encode(&self.batch, &mut body).unwrap();
        let at = after(110);
        verifier.take(&Recorded { stream: journal, sequence: 1, at, published_at: at, body: &body });
        let mut report = verifier.finish();
        assert_eq!(report.verdicts.len(), 1);
        report.verdicts.remove(0)
    }
}

fn order_body() -> Vec<u8> {
    let mut body = Vec::new();
    wire::encode(&ArenaOrder { kind: OrderKind::Hover, given_at: BEGIN }, &mut body).unwrap();
    body
}

fn unverifiable(verdict: &Verdict) -> (u64, &Reason) {
    match &verdict.outcome {
        Outcome::Unverifiable { from_step, reason, .. } => (*from_step, reason),
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_was_said_but_not_recorded_is_proven_all_the_same() {
    let verdict = Life::new().verdict();
    assert_eq!((&verdict.outcome, verdict.steps_identical), (&Outcome::Identical, 4));
    assert_eq!((verdict.copies_absent, verdict.copies_identical, verdict.settings), (4, 0, None));
}

#[test]
fn a_core_that_would_not_wake_yet_diverges_at_that_step() {
    let mut life = Life::new();
    life.factory = Box::new(make::<25>);
    let Outcome::Diverged(divergence) = life.verdict().outcome else { panic!() };
    assert_eq!((divergence.step, divergence.at), (1, after(20)));
    assert_eq!(divergence.kind, DivergenceKind::Deadline { now: Some(after(25)) });
}

#[test]
fn an_input_of_another_type_is_no_divergence() {
    let mut life = Life::new();
    life.orders.schema_id ^= 1;
    let verdict = life.verdict();
    let (step, reason) = unverifiable(&verdict);
    assert!(step == 0 && matches!(reason, Reason::InputUndecodable { .. }), "{reason:?}");
}

#[test]
fn what_was_not_authenticated_is_no_input() {
    let mut life = Life::new();
    life.orders.verified = false;
    let verdict = life.verdict();
    assert!(matches!(unverifiable(&verdict), (0, Reason::InputMissing(_))), "{verdict:?}");
}

#[test]
fn a_topic_that_the_core_takes_no_more_is_no_divergence() {
    let mut life = Life::new();
    let other = JournalStream { topic_hash: topics::VEHICLE_STATE.hash, ..ORDERS };
    life.batch.streams = [other][..].try_into().unwrap();
    let verdict = life.verdict();
    assert!(matches!(unverifiable(&verdict), (0, Reason::InputUnwanted(_))), "{verdict:?}");
}

#[test]
fn a_journal_that_contradicts_itself_is_told_from_a_divergence() {
    let backwards = Life::new().with_steps(|steps| steps[2].at = after(19)).verdict();
    let no_stream = Life::new().with_steps(|steps| steps[2].stream = 4).verdict();
    for verdict in [backwards, no_stream] {
        let (step, reason) = unverifiable(&verdict);
        assert!(step == 2 && matches!(reason, Reason::JournalCorrupt { .. }), "{reason:?}");
        assert_eq!(verdict.steps_identical, 2, "what came before it has its turn");
    }
}

#[test]
fn a_step_with_another_digest_is_a_divergence_even_if_nothing_of_it_was_recorded() {
    let verdict = Life::new().with_steps(|steps| steps[3].digest ^= 1).verdict();
    let Outcome::Diverged(divergence) = verdict.outcome else { panic!("{verdict:?}") };
    assert_eq!((divergence.step, &divergence.cause), (3, &Cause::Deadline));
    assert!(!divergence.recorded_proven);
    let [message] = &divergence.messages[..] else { panic!("{divergence:?}") };
    assert_eq!((message.topic.as_str(), message.sequence, message.is_recorded), ("vehicle/goal", 4, false));
}

#[test]
fn a_core_that_cannot_be_made_is_unverifiable_from_its_first_step() {
    let mut life = Life::new();
    life.factory = Box::new(|name, _, _| {
        Err(ConfigError::Malformed { file: "here".to_owned(), reason: format!("no {name}") })
    });
    let verdict = life.verdict();
    let (step, reason) = unverifiable(&verdict);
    assert!(step == 0 && reason.to_string().contains("no flip-manager"), "{reason}");
}
