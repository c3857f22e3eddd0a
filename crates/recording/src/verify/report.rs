//! What a verification came to.

use std::fmt;

use quantity::{Span, Time};
use serde::{Serialize, Serializer};

use super::difference::Comparison;

/// What a verification came to, service by service.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// One for each start of each service that published a journal, in the order of their first batches.
    pub verdicts: Vec<Verdict>,
    /// Nodes that were heard and published no journal: people or devices drive them.
    pub unjournalled: Vec<Unjournalled>,
    /// Messages read.
    pub messages: u64,
    /// When the first of them was recorded.
    #[serde(rename = "from_ns", serialize_with = "nanos")]
    pub from: Time,
    /// When the last of them was recorded.
    #[serde(rename = "to_ns", serialize_with = "nanos")]
    pub to: Time,
    /// What of the recording could not be read, if anything.
    pub unreadable: Option<String>,
}

/// A node that published no journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unjournalled {
    /// The node.
    pub service: String,
    /// Its incarnation.
    pub incarnation: u32,
}

/// What re-executing one start of one service came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The service.
    pub service: String,
    /// Which instance of it.
    pub source: u32,
    /// Which start of that instance.
    pub incarnation: u32,
    /// Steps that came out as they are journalled.
    pub steps_identical: u64,
    /// Steps in the journal, as far as it was recorded.
    pub steps_journalled: u64,
    /// How it ended.
    pub outcome: Outcome,
    /// Said messages of which the recording holds the same bytes.
    pub copies_identical: u64,
    /// Said messages that nobody recorded; what was said is proven by the journal all the same.
    pub copies_absent: u64,
    /// Said messages of which the recording holds other bytes.
    pub copies_damaged: u64,
    /// The first of these.
    pub first_damage: Option<Box<Damage>>,
    /// Where other settings were used than the service had.
    pub settings: Option<OtherSettings>,
}

/// Other settings than those the service had.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct OtherSettings {
    /// Digest of what it had.
    pub had: u64,
    /// Digest of what it was executed with.
    pub given: u64,
}

/// How a re-execution ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// Every journalled step came out the same.
    Identical,
    /// A step came out otherwise.
    Diverged(Box<Divergence>),
    /// From a step on, nobody can say.
    Unverifiable {
        /// The first step that cannot be executed.
        from_step: u64,
        /// When it happened; nothing if there is no such step in the recording.
        #[serde(rename = "at_ns", serialize_with = "nanos_if_any")]
        at: Option<Time>,
        /// Why.
        reason: Reason,
    },
}

/// Why a step cannot be executed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The message that caused it is not in the recording.
    InputMissing(Input),
    /// The message that caused it was recorded too long before the journal that names it.
    InputForgotten(Input),
    /// The message that caused it is not what its sender said.
    InputDamaged(Input),
    /// The message that caused it does not decode as what the core takes.
    InputUndecodable {
        /// The message.
        input: Input,
        /// Why.
        reason: String,
    },
    /// The core as it is now does not take what caused it.
    InputUnwanted(Input),
    /// The recording begins after the service did.
    JournalBeginsLate,
    /// Some steps of the journal are not in the recording.
    JournalMissing {
        /// The first step after them.
        resumes_at_step: u64,
    },
    /// The journal stops, though the node went on.
    JournalEnds {
        /// How many steps the node said it had made.
        steps_reported: u64,
    },
    /// The journal contradicts itself.
    JournalCorrupt {
        /// How.
        reason: String,
    },
    /// There is no such core, or it refuses the settings.
    NoCore {
        /// Why.
        reason: String,
    },
}

/// A message by its address.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Input {
    /// The topic; its hash in hexadecimal if it is not in the table.
    pub topic: String,
    /// Its sender.
    pub source: u32,
    /// Its sender's incarnation.
    pub incarnation: u32,
    /// Its number.
    pub sequence: u64,
}

/// The first step that came out otherwise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Divergence {
    /// Its number, counted from zero at the node's start.
    pub step: u64,
    /// When it happened.
    #[serde(rename = "at_ns", serialize_with = "nanos")]
    pub at: Time,
    /// What caused it.
    pub cause: Cause,
    /// In what it differs.
    pub kind: DivergenceKind,
    /// What was said then beside what is said now, message by message.
    pub messages: Vec<Comparison>,
    /// Whether the recorded messages are proven to be all that was said, by the journal's digest.
    pub recorded_proven: bool,
}

/// What caused a step.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// The core's own deadline.
    Deadline,
    /// A message, field by field.
    Message {
        /// The message.
        input: Input,
        /// Its fields: path and value.
        fields: Vec<(String, String)>,
    },
}

/// In what a step differs from its journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DivergenceKind {
    /// It says something else.
    Output {
        /// How much was said then.
        outputs_then: u16,
        /// How much is said now.
        outputs_now: u16,
    },
    /// It was woken then, and would not be now: its deadline has not come.
    Deadline {
        /// The deadline now.
        #[serde(rename = "deadline_ns", serialize_with = "nanos_if_any")]
        now: Option<Time>,
    },
}

/// A recorded message that is not what its sender said.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Damage {
    /// The step in which it was said.
    pub step: u64,
    /// When.
    #[serde(rename = "at_ns", serialize_with = "nanos")]
    pub at: Time,
    /// What is recorded beside what was said.
    pub message: Comparison,
}

impl Report {
    /// Whether every journalled step of every service came out the same, and nothing recorded contradicts it. A
    /// recording without any journal proves nothing, and does not hold.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.unreadable.is_none() && !self.verdicts.is_empty() && self.verdicts.iter().all(Verdict::holds)
    }

    /// The recorded span.
    #[must_use]
    pub fn span(&self) -> Span {
        Span::from_nanos(self.to.as_nanos().saturating_sub(self.from.as_nanos()))
    }
}

impl Verdict {
    /// Whether every journalled step came out the same, and the recorded copies of what was said are true.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.outcome == Outcome::Identical && self.copies_damaged == 0
    }
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { topic, source, incarnation, sequence } = self;
        write!(f, "{topic} number {sequence} of source {source:08x}, incarnation {incarnation}")
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InputMissing(input) => write!(f, "{input} was not recorded"),
            Self::InputForgotten(input) => {
                write!(f, "{input} was recorded too long before the journal that names it")
            }
            Self::InputDamaged(input) => write!(f, "{input}, as recorded, is not what its sender said"),
            Self::InputUndecodable { input, reason } => write!(f, "{input} does not decode: {reason}"),
            Self::InputUnwanted(input) => write!(f, "{input} is nothing the core takes now"),
            Self::JournalBeginsLate => f.write_str("the recording begins after the service did"),
            Self::JournalMissing { resumes_at_step } => {
                write!(f, "its journal was not recorded up to step {resumes_at_step}")
            }
            Self::JournalEnds { steps_reported } => {
                write!(f, "its journal ends here, though the node reported {steps_reported} steps")
            }
            Self::JournalCorrupt { reason } => write!(f, "its journal contradicts itself: {reason}"),
            Self::NoCore { reason } => write!(f, "no core to execute: {reason}"),
        }
    }
}

fn nanos<S: Serializer>(time: &Time, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_i64(time.as_nanos())
}

fn nanos_if_any<S: Serializer>(time: &Option<Time>, serializer: S) -> Result<S::Ok, S::Error> {
    time.map(Time::as_nanos).serialize(serializer)
}
