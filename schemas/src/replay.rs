//! The time of a replay, and how its nodes keep in step.

use quantity::Time;
use reflect::{Enumeration, Message, Text};
use serde::{Deserialize, Serialize};

/// What playback is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum ReplayState {
    /// Messages go out as their time comes.
    #[default]
    Playing = 0,
    /// Time stands still.
    Paused = 1,
    /// Nothing more will come.
    Ended = 2,
}

/// The time of a replay. In the replay domain no node looks at the host's clock: its `now` is the newest time that
/// playback has said, here or as the publish time of a replayed message. It never goes back within an epoch; after a
/// jump (a loop, a seek) the epoch is higher, and every node starts afresh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ReplayClock")]
pub struct ReplayClock {
    /// What playback is doing.
    pub state: ReplayState,
    /// The time of the recording.
    pub at: Time,
    /// Seconds of the recording per second; zero for as fast as possible, in lock step.
    pub rate_ratio: f64,
    /// Rises with every jump in time.
    pub epoch: u32,
    /// Number of this tick.
    pub tick: u64,
    /// How often this tick was said before: in lock step it is repeated until no node has had anything left to do.
    pub round: u32,
    /// Whether nodes shall answer.
    pub answer: bool,
}

/// What a node answers to a tick in lock step, after it has done all that was due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/ReplayAnswer")]
pub struct ReplayAnswer {
    /// The node.
    pub node: Text<24>,
    /// The tick it answers.
    pub tick: u64,
    /// The round it answers.
    pub round: u32,
    /// Steps its core has made since its last answer.
    pub steps: u64,
    /// When it wants to be woken next: playback stops there on its way, so that what it says then is heard in time.
    pub due_at: Time,
}
