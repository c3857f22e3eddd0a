//! Orders from people, faults, and how each node fares.

use quantity::Time;
use reflect::{Enumeration, Message, Text};
use serde::{Deserialize, Serialize};

/// What a person asks of the whole arena.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum OrderKind {
    /// Take off and work through the scenario.
    Fly = 0,
    /// Land everything; always granted.
    #[default]
    Land = 1,
    /// Take off and hover at the place of the scenario, without flipping.
    Hover = 2,
}

/// An order from the front door; repeated while it stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ArenaOrder")]
pub struct ArenaOrder {
    /// What is asked.
    pub kind: OrderKind,
    /// When it was first given.
    pub given_at: Time,
}

/// What an emergency order asks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum StopKind {
    /// Motors off now, latched.
    #[default]
    Stop = 0,
    /// A person releases the latch.
    Release = 1,
}

/// The emergency stop, and its release. Repeated at 50 Hz for a second; those with one `given_at` are one order, and one
/// given before the newest changes nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/StopOrder")]
pub struct StopOrder {
    /// What is asked.
    pub kind: StopKind,
    /// The vehicle; zero for all.
    pub vehicle: u8,
    /// When it was given.
    pub given_at: Time,
}

/// How grave an event is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum Severity {
    /// Worth a line in a log.
    #[default]
    Info = 0,
    /// Something degraded; the arena copes.
    Warning = 1,
    /// Something failed; a failsafe acted or work stopped.
    Fault = 2,
}

/// An operating fault or a turn of events, typed so that recordings can be searched and tests can assert on
/// it.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/NodeEvent")]
pub struct NodeEvent {
    /// How grave it is.
    pub severity: Severity,
    /// The vehicle it concerns, zero for none.
    pub vehicle: u8,
    /// When it happened.
    pub at: Time,
    /// The reporting service.
    pub node: Text<24>,
    /// What happened, in words with hyphens: the name to search for.
    pub name: Text<40>,
    /// The same in a sentence, with the values.
    pub detail: Text<160>,
}

/// How a node's bus fares: what came in, what was dropped and why.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/NodeHealth")]
pub struct NodeHealth {
    /// The node.
    pub node: Text<24>,
    /// When it started.
    pub started_at: Time,
    /// XXH3-64 of the program's file, by which the programs of two arenas are compared; zero in virtual time.
    pub program_digest: u64,
    /// Steps its core has made.
    pub steps: u64,
    /// Datagrams published.
    pub published: u64,
    /// Datagrams accepted.
    pub accepted: u64,
    /// Dropped: not of our length, magic or version.
    pub dropped_malformed: u64,
    /// Dropped: the tag does not hold.
    pub dropped_unauthentic: u64,
    /// Dropped: of another domain.
    pub dropped_domain: u64,
    /// Dropped: of another run.
    pub dropped_run: u64,
    /// Dropped: seen before, too old, or of an earlier incarnation.
    pub dropped_replayed: u64,
    /// Dropped: a body that does not decode, or of another schema.
    pub dropped_undecodable: u64,
    /// Sequence numbers that never came.
    pub lost: u64,
    /// Datagrams the kernel dropped because this node was slow.
    pub overflowed: u64,
}
