//! Messages as other programs take them: tables, lines of JSON, files for ROS 2.
//!
//! Nothing here has types compiled in: whatever definitions the recording carries are what bodies are read
//! by. What cannot be read is counted and named in the [`Outcome`], never left out in silence.

mod address;
mod columns;
mod line;
mod lines;

use quantity::Time;
use reflect::PathError;
use thiserror::Error;

pub use crate::csv::{export_csv, write_cell};
pub use crate::ros2::export_ros2;
pub use address::{Address, FieldOf};
pub use columns::{Column, Columns, Types};
pub use line::{Content, Line};
pub use lines::export_json;
pub(crate) use lines::write_lines;

use crate::read::{Channel, Message, ReadError};
use crate::select::Selection;

/// What of a recording is wanted.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// Topics, whole or a field of them; everything, if there are none.
    pub addresses: Vec<Address>,
    /// Only messages from this time on.
    pub from: Option<Time>,
    /// Only messages up to this time.
    pub to: Option<Time>,
    /// Only messages that name this vehicle.
    pub vehicle: Option<u64>,
}

impl Wanted {
    /// The messages that are looked at.
    #[must_use]
    pub fn selection(&self) -> Selection {
        let mut topics: Vec<String> = self.addresses.iter().map(|address| address.topic.clone()).collect();
        topics.sort_unstable();
        topics.dedup();
        Selection { from: self.from, to: self.to, topics, ..Selection::default() }
    }
}

/// What became of an export.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Messages written.
    pub written: u64,
    /// Messages whose body is none of their type.
    pub undecodable: u64,
    /// The first of them, in words.
    pub first_undecodable: Option<String>,
    /// Messages whose definition is not in the recording, or is none.
    pub without_definition: u64,
    /// Definitions that are none, in words.
    pub bad_definitions: Vec<String>,
    /// Times later than the target can say, which stand as the last that it can.
    pub clamped_times: u64,
    /// Chunks that could not be read.
    pub damage: Vec<ReadError>,
}

/// Why an export cannot be done.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The sink refuses.
    #[error("{0}")]
    Sink(#[from] std::io::Error),
    /// The library that writes MCAP files refuses.
    #[error("{0}")]
    Library(mcap::McapError),
    /// A topic that the recording does not have.
    #[error("there is no topic {wanted}; there are {known}", known = known.join(", "))]
    NoTopic {
        /// What was asked for.
        wanted: String,
        /// Topics there are.
        known: Vec<String>,
    },
    /// A field that the topic's type does not have.
    #[error("{topic}: {source}")]
    NoField {
        /// The topic.
        topic: String,
        /// Which part of the path leads nowhere.
        source: PathError,
    },
    /// A topic whose definition is not there, so that there are no fields to be found.
    #[error("{topic}: its definition is not there, or is none, so it has no fields")]
    NoDefinition {
        /// The topic.
        topic: String,
    },
    /// No topic that was asked for names a vehicle.
    #[error("{topics}: no message names a vehicle", topics = topics.join(", "))]
    NoVehicle {
        /// The topics.
        topics: Vec<String>,
    },
    /// A message with more parts than a table has columns.
    #[error("{topic}: too many fields for a table; name those that are wanted")]
    TooWide {
        /// The topic.
        topic: String,
    },
    /// Two topics that ROS 2 would call by one name.
    #[error("{first} and {second} would both be called {name}")]
    OneName {
        /// The name.
        name: String,
        /// One topic.
        first: String,
        /// The other.
        second: String,
    },
}

impl ExportError {
    /// Whether it was asked wrongly, rather than that something failed.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        !matches!(self, Self::Sink(_) | Self::Library(_))
    }
}

impl Outcome {
    pub(crate) fn note_undecodable(&mut self, message: &Message<'_>, error: &dyn std::fmt::Display) {
        self.undecodable += 1;
        if self.first_undecodable.is_none() {
            self.first_undecodable = Some(format!("{} at {}: {error}", message.channel.topic, message.at));
        }
    }

    pub(crate) fn note_bad_definition(&mut self, channel: &Channel, error: &dyn std::fmt::Display) {
        let name = channel.definition.as_ref().map_or("", |definition| definition.name.as_str());
        self.bad_definitions.push(format!("{}: {name}: {error}", channel.topic));
    }

    /// Adds what was found later.
    pub fn absorb(&mut self, later: Self) {
        self.written += later.written;
        self.undecodable += later.undecodable;
        self.first_undecodable = self.first_undecodable.take().or(later.first_undecodable);
        self.without_definition += later.without_definition;
        self.bad_definitions.extend(later.bad_definitions);
        self.clamped_times += later.clamped_times;
        self.damage.extend(later.damage);
    }

    /// What a user has to know, a line each; nothing where all went well.
    #[must_use]
    pub fn complaints(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.damage.iter().map(ToString::to_string).collect();
        lines.extend(self.bad_definitions.iter().cloned());
        if let Some(first) = &self.first_undecodable {
            lines.push(format!("{} messages are none of their type, the first: {first}", self.undecodable));
        }
        if self.without_definition > 0 {
            lines.push(format!("{} messages have no definition in the recording", self.without_definition));
        }
        if self.clamped_times > 0 {
            let count = self.clamped_times;
            lines.push(format!("{count} times are later than ROS 2 can say and stand as the last it can"));
        }
        lines
    }

    /// Whether everything that was wanted was written as it was.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.undecodable == 0 && self.without_definition == 0 && self.damage.is_empty()
    }
}
