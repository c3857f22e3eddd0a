//! Which streams of a recording are played, and under which topic.

use recording::Stream;
use schemas::topics;
use service_core::source_of;
use thiserror::Error;
use wire::{Kind, TopicName};

use crate::source::Channel;

/// What a person wants to hear of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Topics to play, all if empty; a `*` at the end stands for any ending.
    pub include: Vec<String>,
    /// Topics not to play.
    pub exclude: Vec<String>,
    /// Topics to play under another name.
    pub rename: Vec<(String, String)>,
    /// Whether to play the nodes' journals: accounts of what they did, of which no service takes notice.
    pub journals: bool,
    /// Services that run in the replay themselves: what they say is not played.
    pub running: Vec<String>,
}

/// A wish that cannot be granted.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SelectionError {
    /// A topic that the recording does not have.
    #[error("no topic of the recording is {wanted:?}; there are {}", known.join(", "))]
    Absent {
        /// What was asked for.
        wanted: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A name that no topic can have.
    #[error("{name:?} is no name of a topic: it takes 1 to 255 bytes")]
    Name {
        /// The name.
        name: String,
    },
    /// A topic that is playback's own.
    #[error("{name} is what playback itself says, and cannot be renamed to or from")]
    Reserved {
        /// The topic.
        name: String,
    },
    /// Nothing is left to play.
    #[error("nothing of the recording is left to play")]
    Nothing,
}

impl Selection {
    /// The topic under which each channel is played, `None` for those that are not.
    ///
    /// # Errors
    /// A wish that cannot be granted: a topic that is not there is more likely misspelt than meant.
    pub fn topics(&self, channels: &[Channel]) -> Result<Vec<Option<String>>, SelectionError> {
        self.check(channels)?;
        let topics: Vec<Option<String>> =
            channels.iter().map(|channel| self.topic(&channel.stream)).collect();
        if topics.iter().all(Option::is_none) { Err(SelectionError::Nothing) } else { Ok(topics) }
    }

    fn check(&self, channels: &[Channel]) -> Result<(), SelectionError> {
        let renamed = self.rename.iter().map(|(from, _)| from);
        for wanted in self.include.iter().chain(&self.exclude).chain(renamed) {
            if !channels.iter().any(|channel| matches(wanted, &channel.stream.topic)) {
                let mut known: Vec<String> =
                    channels.iter().map(|channel| channel.stream.topic.clone()).collect();
                known.sort_unstable();
                known.dedup();
                return Err(SelectionError::Absent { wanted: wanted.clone(), known });
            }
        }
        for (from, to) in &self.rename {
            if TopicName::new(to).is_none() {
                return Err(SelectionError::Name { name: to.clone() });
            }
            if let Some(name) = [from, to].into_iter().find(|name| is_reserved(name)) {
                return Err(SelectionError::Reserved { name: name.clone() });
            }
        }
        Ok(())
    }

    fn topic(&self, stream: &Stream) -> Option<String> {
        let topic = stream.topic.as_str();
        let among = |patterns: &[String]| patterns.iter().any(|pattern| matches(pattern, topic));
        let chosen = (self.include.is_empty() || among(&self.include)) && !among(&self.exclude);
        if !chosen || is_reserved(topic) || self.is_said_anew(stream) {
            return None;
        }
        if stream.kind == Kind::Journal && !self.journals {
            return None;
        }
        let renamed = self.rename.iter().find(|(from, _)| from == topic);
        Some(renamed.map_or(topic, |(_, to)| to).to_owned())
    }

    /// Whether a running service says this itself. What it hears of its own devices it does not: in a replay it has none.
    fn is_said_anew(&self, stream: &Stream) -> bool {
        let runs = |name: &str| self.running.iter().any(|running| running == name);
        match topics::by_name(&stream.topic) {
            Some(topic) if topic.writer == "*" => {
                self.running.iter().any(|name| source_of(name) == stream.source)
            }
            Some(topic) => runs(topic.writer) && !topic.readers.contains(&topic.writer),
            None => false,
        }
    }
}

/// What playback and the nodes of a replay say of that replay: another replay's would confuse this one's.
fn is_reserved(topic: &str) -> bool {
    [topics::REPLAY_CLOCK.name, topics::REPLAY_ANSWER.name].contains(&topic)
}

fn matches(pattern: &str, topic: &str) -> bool {
    match pattern.strip_suffix('*') {
        Some(beginning) => topic.starts_with(beginning),
        None => pattern == topic,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::stream;

    fn channels() -> Vec<Channel> {
        let names = ["vicon/rx", "mocap/frame", "vehicle/state", "vehicle/goal", "radio/tx", "lab/wind"];
        let mut streams: Vec<Stream> = names.iter().map(|name| stream(name, 1)).collect();
        streams.push(stream("node/health", source_of("estimator")));
        streams.push(stream("node/health", source_of("learner")));
        streams.push(Stream { kind: Kind::Journal, ..stream("node/journal", 1) });
        streams.push(stream("replay/clock", 1));
        streams.push(stream("node/replay-answer", 1));
        streams.into_iter().map(|stream| Channel { stream, definition: None }).collect()
    }

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    fn played(selection: &Selection) -> Vec<String> {
        selection.topics(&channels()).unwrap().into_iter().flatten().collect()
    }

    #[test]
    fn everything_is_played_but_journals_and_what_another_replay_said() {
        let all =
            owned(&["vicon/rx", "mocap/frame", "vehicle/state", "vehicle/goal", "radio/tx", "lab/wind"]);
        let health = owned(&["node/health", "node/health"]);
        assert_eq!(played(&Selection::default()), [all.clone(), health.clone()].concat());
        let with = Selection { journals: true, ..Selection::default() };
        assert_eq!(played(&with), [all, health, owned(&["node/journal"])].concat());
    }

    #[test]
    fn topics_are_chosen_left_out_and_renamed() {
        let selection = Selection {
            include: owned(&["vehicle/*", "radio/tx"]),
            exclude: owned(&["vehicle/goal"]),
            rename: vec![("vehicle/state".to_owned(), "old/state".to_owned())],
            ..Selection::default()
        };
        assert_eq!(played(&selection), owned(&["old/state", "radio/tx"]));
    }

    #[test]
    fn what_a_running_service_says_is_left_to_it_and_its_device_bytes_are_not() {
        let running = owned(&["vicon-bridge", "estimator"]);
        let selection = Selection { running, ..Selection::default() };
        assert_eq!(
            played(&selection),
            owned(&["vicon/rx", "vehicle/goal", "radio/tx", "lab/wind", "node/health"])
        );
    }

    #[test]
    fn what_cannot_be_granted_is_refused_by_name() {
        let refuse = |selection: Selection| selection.topics(&channels()).unwrap_err().to_string();
        let misspelt = Selection { exclude: owned(&["vehicle/stat"]), ..Selection::default() };
        let text = refuse(misspelt);
        assert!(text.contains("\"vehicle/stat\"") && text.contains("vehicle/state"), "{text}");
        let rename = |from: &str, to: &str| Selection {
            rename: vec![(from.to_owned(), to.to_owned())],
            ..Selection::default()
        };
        assert!(refuse(rename("radio/tx", "")).contains("1 to 255"));
        assert!(refuse(rename("radio/tx", "replay/clock")).contains("replay/clock"));
        let nothing = Selection { exclude: owned(&["*"]), ..Selection::default() };
        assert_eq!(refuse(nothing), "nothing of the recording is left to play");
    }
}
