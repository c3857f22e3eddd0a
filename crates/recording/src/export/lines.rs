//! Text made of messages, on all cores, written in order.

use std::io::Write;
use std::ops::ControlFlow;

use super::{Columns, Content, ExportError, Line, Outcome, Types, Wanted};
use crate::read::{Message, Recording};

/// Text made of some of the messages.
#[derive(Default)]
struct Part {
    text: Vec<u8>,
    outcome: Outcome,
}

/// Writes what `each` appends for every message that the columns want; what was written before something
/// failed stays counted.
pub(crate) fn write_lines(
    recording: &Recording,
    wanted: &Wanted,
    columns: &Columns,
    each: impl Fn(&mut Vec<u8>, &mut Outcome, &Message<'_>) + Sync,
    sink: &mut dyn Write,
) -> Result<Outcome, ExportError> {
    let mut outcome = Outcome::default();
    let mut failed = None;
    recording.visit(
        &wanted.selection(),
        Part::default,
        |part: &mut Part, message| {
            if columns.wants(message.channel.id, message.body) {
                each(&mut part.text, &mut part.outcome, &message);
            }
        },
        |part| match part {
            Ok(part) => {
                outcome.absorb(part.outcome);
                match sink.write_all(&part.text) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(error) => {
                        failed = Some(error);
                        ControlFlow::Break(())
                    }
                }
            }
            Err(damage) => {
                outcome.damage.push(damage);
                ControlFlow::Continue(())
            }
        },
    );
    match failed {
        Some(error) => Err(error.into()),
        None => Ok(outcome),
    }
}

/// Writes every wanted message as one line of JSON: whole, or the fields that were asked for. What cannot be
/// read is written as its bytes, with the reason.
///
/// # Errors
/// A topic or a field that is not there, or a sink that refuses.
pub fn export_json(
    recording: &Recording,
    wanted: &Wanted,
    sink: &mut dyn Write,
) -> Result<Outcome, ExportError> {
    let types = Types::of(recording);
    let of_fields = wanted.addresses.iter().any(|address| address.field.is_some());
    // Whole messages need no columns, which a type with too many parts does not have.
    let columns = if of_fields {
        Columns::new(recording, &types, wanted)?
    } else {
        Columns::without_fields(recording, &types, wanted)?
    };
    let mut outcome = write_lines(
        recording,
        wanted,
        &columns,
        |text, outcome, message| {
            let content = match types.get(message.channel.id) {
                None => Err("no definition".to_owned()),
                Some(_) if of_fields => fields(&columns, message).map_err(|error| error.to_string()),
                Some(definition) => {
                    definition.decode(message.body).map(Content::Body).map_err(|error| error.to_string())
                }
            };
            let content = content.unwrap_or_else(|error| {
                if types.get(message.channel.id).is_none() {
                    outcome.without_definition += 1;
                } else {
                    outcome.note_undecodable(message, &error);
                }
                Content::Raw(message.body, error)
            });
            outcome.written += 1;
            line(recording, message, content).write(text);
        },
        sink,
    )?;
    types.note_bad(recording, &mut outcome);
    Ok(outcome)
}

fn fields<'a>(columns: &'a Columns, message: &Message<'_>) -> Result<Content<'a>, reflect::ViewError> {
    let read = columns
        .fields(message.channel.id)
        .map(|(place, reader)| Ok((columns.columns[place].path.as_str(), reader.read(message.body)?)));
    read.collect::<Result<Vec<_>, _>>().map(Content::Fields)
}

fn line<'a>(recording: &Recording, message: &Message<'a>, content: Content<'a>) -> Line<'a> {
    let stream = message.channel.stream.as_ref();
    Line {
        topic: &message.channel.topic,
        at_ns: message.at,
        published_at_ns: message.published_at,
        time_s: Some(recording.seconds_at(message.at)),
        source: stream.map(|stream| stream.source),
        incarnation: stream.map(|stream| stream.incarnation),
        sequence: message.sequence.into(),
        verified: stream.map(|stream| stream.verified),
        type_name: message.channel.schema.as_ref().map(|schema| schema.name.as_str()),
        content,
    }
}
