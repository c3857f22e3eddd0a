//! Looking at messages, of a live arena and of recordings alike, by the definitions that come with them.

pub mod budget;
mod live;
pub mod neighbours;
pub mod rates;
mod requests;
mod text;

use std::ops::ControlFlow;

use quantity::Time;
use recording::export::Types;
use recording::{ReadError, Recording, Selection};
use reflect::{Definition, FieldReader};
use service_core::source_of;
use service_shell::ShellError;
use thiserror::Error;
use wire::Kind;

pub use live::{Ear, Tick};
pub use text::write_message;

/// The field by which messages name their vehicle.
const VEHICLE: &str = "vehicle";

/// One message that was heard, on the bus or in a recording.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'a> {
    /// The topic.
    pub topic: &'a str,
    /// Data or journal.
    pub kind: Kind,
    /// Who sent it; not known in files of others.
    pub source: Option<u32>,
    /// Which start of the sender.
    pub incarnation: Option<u32>,
    /// Its number; of a recorded message the low 32 bits.
    pub sequence: u64,
    /// When it arrived.
    pub at: Time,
    /// When it was sent.
    pub published_at: Time,
    /// Whether its tag was checked.
    pub verified: Option<bool>,
    /// Its body.
    pub body: &'a [u8],
    /// Its type's name.
    pub type_name: Option<&'a str>,
    /// Its type, if it is known.
    pub definition: Option<&'a Definition>,
}

/// Why listening ended early.
#[derive(Debug, Error)]
pub enum ToolError {
    /// The bus cannot be heard.
    #[error(transparent)]
    Shell(#[from] ShellError),
    /// Standard output refuses.
    #[error("standard output: {0}")]
    Output(#[from] std::io::Error),
}

impl Heard<'_> {
    /// The vehicle that the message names, if its type has such a field.
    #[must_use]
    pub fn vehicle(&self) -> Option<u64> {
        let reader = self.definition?.field(VEHICLE).ok().filter(FieldReader::is_whole_number)?;
        reader.read(self.body).ok()??.number().map(|number| number as u64)
    }
}

/// Goes through the selected messages of a recording in order of time. Damaged chunks are skipped and
/// returned.
///
/// # Errors
/// Whatever `each` says.
pub fn replay(
    recording: &Recording,
    selection: &Selection,
    each: &mut dyn FnMut(&Heard<'_>) -> Result<ControlFlow<()>, ToolError>,
) -> Result<Vec<ReadError>, ToolError> {
    let types = Types::of(recording);
    let mut damage = Vec::new();
    let mut messages = recording.messages(selection);
    while let Some(message) = messages.next() {
        let message = match message {
            Ok(message) => message,
            Err(error) => {
                damage.push(error);
                continue;
            }
        };
        let stream = message.channel.stream.as_ref();
        let heard = Heard {
            topic: &message.channel.topic,
            kind: stream.map_or(Kind::Data, |stream| stream.kind),
            source: stream.map(|stream| stream.source),
            incarnation: stream.map(|stream| stream.incarnation),
            sequence: message.sequence.into(),
            at: message.at,
            published_at: message.published_at,
            verified: stream.map(|stream| stream.verified),
            body: message.body,
            type_name: message.channel.schema.as_ref().map(|schema| schema.name.as_str()),
            definition: types.get(message.channel.id),
        };
        if each(&heard)?.is_break() {
            break;
        }
    }
    Ok(damage)
}

/// What people call a sender: the service's name, or its number if nobody here is called so.
#[must_use]
pub fn name_of_source(source: u32) -> String {
    let others = ["simulator", "arena", "logger", "playback"];
    let mut names = roster::SERVICES.iter().copied().chain(others);
    names.find(|name| source_of(name) == source).map_or_else(|| format!("{source:08x}"), str::to_owned)
}
