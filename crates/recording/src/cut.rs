//! Cutting a piece out of a recording: the piece is a recording itself.

use std::io::Write;

use quantity::Time;
use thiserror::Error;
use wire::Header;

use crate::{
    Channel, Ending, Entry, Message, ReadError, Recording, Selection, WriteError, WriteOptions, Writer,
};

/// Why nothing could be cut.
#[derive(Debug, Error)]
pub enum CutError {
    /// The recording cannot be read. Damaged chunks are none of these: they are left out, and told.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The piece cannot be written.
    #[error("the piece cannot be written: {0}")]
    Write(#[from] WriteError),
    /// The recording does not say who sent what, so no recorder of ours wrote it.
    #[error(
        "{topic}: not from an arena, so nothing is known of its sender; only an arena's recordings can be cut"
    )]
    Foreign {
        /// The topic.
        topic: String,
    },
    /// The recording does not say where it comes from.
    #[error("the recording has no description of itself; only an arena's recordings can be cut")]
    NoDescription,
}

/// What was cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Messages in it.
    pub messages: u64,
    /// How many of them are older than its beginning: the newest of each latched topic and sender.
    pub latched: u64,
    /// Chunks that could not be read; what stood in them is not in the piece.
    pub damage: Vec<String>,
}

/// Writes the selected messages as a recording of its own: with their numbers, times, channels, definitions,
/// the settings, and the same identity. It begins at the selection's beginning, and its end says what it was
/// cut from. Before its own messages it has the newest older one of each latched topic and sender, since
/// those still held.
///
/// `name` is how the recording's end calls what it was cut from.
///
/// # Errors
/// A recording that is not an arena's, or settings that cannot be read; a sink that refuses.
pub fn cut<W: Write>(
    recording: &Recording,
    selection: &Selection,
    options: WriteOptions,
    name: &str,
    sink: W,
) -> Result<(W, Piece), CutError> {
    let mut about = recording.about().ok_or(CutError::NoDescription)?.clone();
    if let Some(channel) = foreign(recording, selection) {
        return Err(CutError::Foreign { topic: channel.topic.clone() });
    }
    if let Some(from) = selection.from {
        let moved = i128::from(from.as_nanos()) - i128::from(about.started_at.as_nanos());
        let wall = i128::from(about.started_wall_ns) + moved;
        about.started_wall_ns = i64::try_from(wall).unwrap_or(about.started_wall_ns);
        about.started_at = from;
    }
    about.segment = 0;
    let settings = recording.settings()?;
    let mut writer = Writer::new(sink, options, &about, settings.as_ref())?;
    for channel in recording.channels().iter().filter(|channel| selection.wants(channel)) {
        if let Some(definition) = &channel.definition {
            writer.define(definition)?;
        }
    }
    let mut piece = Piece { messages: 0, latched: 0, damage: Vec::new() };
    if let Some(from) = selection.from {
        for kept in recording.latched_before(from, selection)? {
            let channel = &recording.channels()[kept.channel as usize];
            let (at, published_at, body) = (kept.at, kept.published_at, kept.body.as_slice());
            let message = Message { channel, sequence: kept.sequence, at, published_at, body };
            write(&mut writer, &message)?;
            piece.latched += 1;
        }
        writer.close_chunk()?;
    }
    let within =
        |at: Time| selection.from.is_none_or(|from| at >= from) && selection.to.is_none_or(|to| at <= to);
    for gap in recording.dropped().iter().filter(|gap| within(gap.from) || within(gap.until)) {
        writer.note_gap(gap)?;
    }
    let mut stopped_at = about.started_at;
    let mut messages = recording.messages(selection);
    while let Some(message) = messages.next() {
        match message {
            Ok(message) => {
                write(&mut writer, &message)?;
                stopped_at = message.at;
            }
            Err(error) => piece.damage.push(error.to_string()),
        }
    }
    piece.messages = writer.messages();
    let ending = Ending {
        stopped_at: selection.to.map_or(stopped_at, |to| to.min(stopped_at)),
        reason: format!("cut: {} of {name}", span_in_words(recording, selection)),
        recorded: piece.messages,
        ..recording.ending().cloned().unwrap_or_default()
    };
    Ok((writer.finish(&ending, &[])?, piece))
}

fn foreign<'a>(recording: &'a Recording, selection: &Selection) -> Option<&'a Channel> {
    let mut wanted = recording.channels().iter().filter(|channel| selection.wants(channel));
    wanted.find(|channel| channel.stream.is_none())
}

fn write<W: Write>(writer: &mut Writer<W>, message: &Message<'_>) -> Result<(), CutError> {
    if writer.chunk_due_at().is_some_and(|due| message.at >= due) {
        writer.close_chunk()?;
    }
    let Some(stream) = &message.channel.stream else {
        return Err(CutError::Foreign { topic: message.channel.topic.clone() });
    };
    let header = Header {
        kind: stream.kind,
        domain: stream.domain,
        latched: stream.latched,
        source: stream.source,
        schema_id: stream.schema_id,
        run: stream.run,
        incarnation: stream.incarnation,
        sequence: u64::from(message.sequence),
        published_at: message.published_at,
    };
    let (topic, verified) = (message.channel.topic.as_str(), stream.verified);
    writer.write(&Entry { at: message.at, header: &header, topic, verified, body: message.body })?;
    Ok(())
}

fn span_in_words(recording: &Recording, selection: &Selection) -> String {
    let at = |at: Time| format!("{:.3} s", recording.seconds_at(at));
    match (selection.from, selection.to) {
        (Some(from), Some(to)) => format!("{} to {}", at(from), at(to)),
        (Some(from), None) => format!("from {} on", at(from)),
        (None, Some(to)) => format!("up to {}", at(to)),
        (None, None) => "all".to_owned(),
    }
}
