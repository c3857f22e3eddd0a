//! A recording in memory, to be tampered with.

use std::collections::BTreeMap;

use front_door::experiment::core;
use quantity::Time;
use recording::Stream;
use recording::verify::{Outcome, Recorded, Report, Verdict, Verifier};
use schemas::{JournalStep, JournalStream, NodeJournal, Topic, topic_hash};
use settings::Arena;
use virtual_arena::Heard;
use wire::Kind;

/// One message.
#[derive(Clone, Debug)]
pub struct Message {
    pub stream: Stream,
    pub sequence: u64,
    pub at: Time,
    pub published_at: Time,
    pub body: Vec<u8>,
}

/// All messages of a flight.
#[derive(Clone, Debug, Default)]
pub struct Tape(pub Vec<Message>);

/// A journalled step, and its node's number of it.
#[derive(Clone, Debug)]
pub struct Journalled {
    pub number: u64,
    pub step: JournalStep,
    pub stream: Option<JournalStream>,
}

impl Message {
    pub fn is_of(&self, topic: &Topic) -> bool {
        self.stream.kind == Kind::Data && self.stream.topic == topic.name
    }

    pub fn batch(&self) -> Option<NodeJournal> {
        (self.stream.kind == Kind::Journal).then(|| wire::decode(&self.body).unwrap())
    }

    /// Whether this message caused that step.
    pub fn caused(&self, journalled: &Journalled) -> bool {
        self.stream.kind == Kind::Data
            && journalled.step.sequence == self.sequence
            && journalled.stream.is_some_and(|stream| {
                stream.topic_hash == topic_hash(&self.stream.topic)
                    && stream.source == self.stream.source
                    && stream.incarnation == self.stream.incarnation
            })
    }
}

impl Tape {
    pub fn hear(&mut self, heard: &Heard<'_>) {
        let opened = wire::open(heard.published.datagram).unwrap();
        let header = *opened.claimed();
        if header.kind == Kind::Schema {
            return;
        }
        self.0.push(Message {
            stream: Stream {
                topic: heard.published.topic.name.to_owned(),
                kind: header.kind,
                source: header.source,
                incarnation: header.incarnation,
                domain: header.domain,
                run: header.run,
                schema_id: header.schema_id,
                latched: header.latched,
                verified: true,
            },
            sequence: header.sequence,
            at: heard.at,
            published_at: header.published_at,
            body: heard.published.body.to_vec(),
        });
    }

    pub fn verify(&self, settings: &Arena, only: Option<&str>) -> Report {
        let mut verifier = Verifier::new(&core, settings, only);
        for message in &self.0 {
            verifier.take(&Recorded {
                stream: &message.stream,
                sequence: message.sequence as u32,
                at: message.at,
                published_at: message.published_at,
                body: &message.body,
            });
        }
        verifier.finish()
    }

    /// The steps that a service has journalled in its first start.
    pub fn journal(&self, service: &str) -> Vec<Journalled> {
        let batches =
            self.0.iter().filter(|message| message.stream.incarnation == 1).filter_map(Message::batch);
        let of_batch = |batch: NodeJournal| {
            let NodeJournal { streams, steps, first_step, .. } = batch;
            let journalled = |(number, step): (u64, &JournalStep)| Journalled {
                number,
                step: *step,
                stream: (step.stream != JournalStep::DEADLINE).then(|| streams[usize::from(step.stream)]),
            };
            (first_step..).zip(&*steps).map(journalled).collect::<Vec<_>>()
        };
        batches.filter(|batch| batch.node.as_str() == service).flat_map(of_batch).collect()
    }

    /// Every message by its address.
    pub fn by_address(&self) -> BTreeMap<(u32, u32, u32, u64), &Message> {
        let data = self.0.iter().filter(|message| message.stream.kind == Kind::Data);
        data.map(|message| {
            let Stream { topic, source, incarnation, .. } = &message.stream;
            ((topic_hash(topic), *source, *incarnation, message.sequence), message)
        })
        .collect()
    }
}

/// The verdict on the first start of a service.
pub fn verdict_on<'r>(report: &'r Report, service: &str) -> &'r Verdict {
    let found = report.verdicts.iter().find(|verdict| verdict.service == service && verdict.incarnation == 1);
    found.unwrap_or_else(|| panic!("no verdict on {service}: {report:?}"))
}

/// Asserts that all but these are identical.
pub fn assert_identical_but(report: &Report, others: &[&str]) {
    for verdict in report.verdicts.iter().filter(|verdict| !others.contains(&verdict.service.as_str())) {
        assert!(verdict.holds(), "{verdict:#?}");
        assert_eq!(verdict.steps_identical, verdict.steps_journalled, "{verdict:#?}");
        assert!(verdict.steps_identical > 0, "{verdict:#?}");
    }
}

/// The first step that is unverifiable, and why; panics if there is none.
pub fn unverifiable(verdict: &Verdict) -> (u64, &recording::verify::Reason) {
    match &verdict.outcome {
        Outcome::Unverifiable { from_step, reason, .. } => {
            assert_eq!(verdict.steps_identical, *from_step, "all before it are identical: {verdict:#?}");
            (*from_step, reason)
        }
        other => panic!("{}: {other:#?}", verdict.service),
    }
}
