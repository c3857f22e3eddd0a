//! What is to be played, where, and how.

use std::fmt;

use quantity::Span;
use settings::Network;
use wire::Secret;

use crate::lockstep::LockStep;
use crate::pace::Rate;
use crate::selection::Selection;

/// Who must be there before time begins to go on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Await {
    /// So many nodes, whoever they are.
    Count(usize),
    /// These.
    Nodes(Vec<String>),
}

impl Default for Await {
    fn default() -> Self {
        Self::Count(0)
    }
}

impl Await {
    pub(crate) fn is_met(&self, lock_step: &LockStep) -> bool {
        match self {
            Self::Count(count) => lock_step.count() >= *count,
            Self::Nodes(names) => names.iter().all(|name| lock_step.has(name)),
        }
    }
}

impl fmt::Display for Await {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(f, "{count} nodes"),
            Self::Nodes(names) => f.write_str(&names.join(", ")),
        }
    }
}

/// What is played of a recording, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The streams.
    pub selection: Selection,
    /// How fast.
    pub rate: Rate,
    /// Where to begin, from the recording's beginning.
    pub start: Option<Span>,
    /// Where to end, from the recording's beginning.
    pub end: Option<Span>,
    /// Whether to begin again at the end.
    pub looped: bool,
    /// Whether to stand still at first.
    pub paused: bool,
    /// Who must be there at the beginning.
    pub awaits: Await,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            selection: Selection::default(),
            rate: Rate::REAL_TIME,
            start: None,
            end: None,
            looped: false,
            paused: false,
            awaits: Await::default(),
        }
    }
}

/// Where a recording is played: the replay domain of a network, always.
#[derive(Clone, Debug)]
pub struct Place {
    /// The network.
    pub network: Network,
    /// The secret all keys come from.
    pub secret: Secret,
    /// The replay's run.
    pub run: u64,
    /// This playback's incarnation.
    pub incarnation: u32,
}
