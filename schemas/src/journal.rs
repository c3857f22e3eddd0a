//! What a node publishes of its own steps, so that a recording can be executed again.

use quantity::Time;
use reflect::{Message, Seq, Text};
use serde::{Deserialize, Serialize};

/// Where a step's cause came from: one sender's datagrams on one topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/JournalStream")]
pub struct JournalStream {
    /// FNV-1a-32 of the topic.
    pub topic_hash: u32,
    /// The sender; the node itself where the bytes came from its own device.
    pub source: u32,
    /// The sender's incarnation.
    pub incarnation: u32,
}

/// One step of a core: what caused it, when, and what came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/JournalStep")]
pub struct JournalStep {
    /// The `now` the core was given.
    pub at: Time,
    /// Which of the batch's streams the cause came on; 255 for the core's own deadline.
    pub stream: u8,
    /// The cause's sequence number; zero for a deadline.
    pub sequence: u64,
    /// Messages and events that the core said in this step.
    pub outputs: u16,
    /// XXH3-64 over what it said, in order: of each, the topic's hash, the body's length as `u32`, the body. Zero where
    /// it said nothing.
    pub digest: u64,
}

impl JournalStep {
    /// The stream number of a step that the core's own deadline caused.
    pub const DEADLINE: u8 = 255;
}

/// Some consecutive steps of a node. With the settings and the messages that it names, they are all that it takes to
/// execute the node's core again.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/NodeJournal")]
pub struct NodeJournal {
    /// The node.
    pub node: Text<24>,
    /// When its core was made.
    pub started_at: Time,
    /// The seed its core was made with.
    pub seed: u64,
    /// Digest of the settings its core was made with.
    pub settings_digest: u64,
    /// Number of the first of these steps, counted from zero at the node's start.
    pub first_step: u64,
    /// Where the causes of these steps came from.
    pub streams: Seq<JournalStream, 32>,
    /// The steps, in order.
    pub steps: Seq<JournalStep, 48>,
}
