//! What a person tells playback, and what it tells about itself.

use std::str::FromStr;

use quantity::{Span, Time};
use schemas::ReplayState;

use crate::pace::Rate;

/// What a person wants.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Time goes on.
    Play,
    /// Time stands still.
    Pause,
    /// The other of the two.
    Toggle,
    /// Time goes on to the next message, or to the next of a topic, and then stands still.
    Step(Option<String>),
    /// Time jumps to so long after the recording's beginning.
    Seek(Span),
    /// Time goes on faster or slower.
    Rate(Rate),
    /// Nobody will give orders any more: what stands still ends.
    HangUp,
    /// That was all.
    Quit,
}

/// The commands as people write them.
pub const COMMANDS: &str =
    "play, pause, step [TOPIC], seek SECONDS, rate RATE, quit; an empty line plays or pauses";

impl FromStr for Command {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            [] => Ok(Self::Toggle),
            ["play" | "p"] => Ok(Self::Play),
            ["pause"] => Ok(Self::Pause),
            ["step" | "." | "s"] => Ok(Self::Step(None)),
            ["step" | "." | "s", topic] => Ok(Self::Step(Some((*topic).to_owned()))),
            ["seek", seconds] => match seconds.parse::<f64>() {
                Ok(seconds) if seconds >= 0.0 && seconds.is_finite() => {
                    Ok(Self::Seek(Span::from_secs_f64(seconds)))
                }
                _ => Err(format!("{seconds:?} is no time: seconds from the recording's beginning")),
            },
            ["rate", rate] => rate.parse().map(Self::Rate),
            ["quit" | "q" | "exit"] => Ok(Self::Quit),
            _ => Err(format!("{line:?} is no command; there are {COMMANDS}")),
        }
    }
}

/// How playback fares.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// Playing, paused or at its end.
    pub state: ReplayState,
    /// Time of the recording.
    pub at: Time,
    /// Rate, as the replay's clock says it.
    pub rate_ratio: f64,
    /// Messages played.
    pub messages: u64,
    /// Nodes in lock step, or awaited at the beginning, that have answered.
    pub nodes: Vec<String>,
}

/// What playback did, once it is over.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Messages played.
    pub messages: u64,
    /// Bytes of their bodies.
    pub bytes: u64,
    /// Messages that no datagram could be made of, or that the kernel did not take.
    pub unsent: u64,
    /// Messages whose lateness was measured: those that were played by the clock.
    pub measured: u64,
    /// Half the messages went out at most so late.
    pub lateness_median: Span,
    /// All but one in a hundred went out at most so late.
    pub lateness_p99: Span,
    /// None went out later.
    pub lateness_max: Span,
    /// How much longer than the recording says it took from the first message of the last stretch without a pause, a
    /// seek or another rate to its last.
    pub drift: Span,
    /// From a seek asked for to its first message sent, the longest.
    pub seek_max: Span,
    /// Nodes that stopped answering.
    pub dropped_nodes: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_what_people_write() {
        for (line, command) in [
            ("", Command::Toggle),
            ("  pause ", Command::Pause),
            ("play", Command::Play),
            ("step", Command::Step(None)),
            ("step vehicle/state", Command::Step(Some("vehicle/state".to_owned()))),
            ("seek 12.5", Command::Seek(Span::from_millis(12_500))),
            ("rate max", Command::Rate(Rate::Max)),
            ("rate 2", Command::Rate(Rate::Ratio(2.0))),
            ("quit", Command::Quit),
        ] {
            assert_eq!(line.parse(), Ok(command), "{line:?}");
        }
    }

    #[test]
    fn what_is_no_command_is_refused_with_what_there_is() {
        for (line, words) in [
            ("stop", "play, pause"),
            ("seek", "seek SECONDS"),
            ("seek back", "seconds"),
            ("seek -1", "seconds"),
            ("seek NaN", "seconds"),
            ("rate 100", "0.1 to 20"),
        ] {
            let error = line.parse::<Command>().unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
