//! Messages as a table: a row each, a column per field, units in the header.

use std::io::Write;

use quantity::Time;
use reflect::Value;

use crate::export::write_lines;
use crate::export::{Column, Columns, ExportError, Outcome, Types, Wanted};
use crate::read::{Message, Recording};

/// Writes the wanted fields as comma-separated values (RFC 4180, but lines end in LF).
///
/// The first column is `time_s`, seconds from [`Recording::started_at`] to the message's arrival, exact to
/// the nanosecond. Where messages name their vehicle, `vehicle` follows, unless one vehicle was asked for.
/// Then a column per field: its path, its topic before it where there are several, its unit behind it. A
/// message of one topic leaves the columns of the others empty. Sequences and messages within a cell are
/// JSON; numbers have as many digits as it takes to read the same number back; times are seconds on the
/// arena's clock.
///
/// # Errors
/// A topic or a field that is not there, or a sink that refuses.
pub fn export_csv(
    recording: &Recording,
    wanted: &Wanted,
    sink: &mut dyn Write,
) -> Result<Outcome, ExportError> {
    let types = Types::of(recording);
    let columns = Columns::new(recording, &types, wanted)?;
    sink.write_all(header(&columns).as_bytes())?;
    let started_at = recording.started_at();
    let mut outcome = write_lines(
        recording,
        wanted,
        &columns,
        |text, outcome, message| {
            if !columns.knows(message.channel.id) {
                outcome.without_definition += 1;
                return;
            }
            let length = text.len();
            match row(text, &columns, started_at, message) {
                Ok(()) => outcome.written += 1,
                Err(error) => {
                    text.truncate(length);
                    outcome.note_undecodable(message, &error);
                }
            }
        },
        sink,
    )?;
    types.note_bad(recording, &mut outcome);
    Ok(outcome)
}

fn header(columns: &Columns) -> String {
    let mut text = Vec::from(&b"time_s"[..]);
    if columns.by_vehicle {
        text.extend_from_slice(b",vehicle");
    }
    let first = columns.columns.first().map(|column| &column.topic);
    let several = columns.columns.iter().any(|column| Some(&column.topic) != first);
    for Column { topic, path, unit } in &columns.columns {
        let unit = unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
        let name = if several { format!("{topic}.{path}{unit}") } else { format!("{path}{unit}") };
        text.push(b',');
        write_text(&mut text, &name);
    }
    text.push(b'\n');
    String::from_utf8_lossy(&text).into_owned()
}

fn row(
    text: &mut Vec<u8>,
    columns: &Columns,
    started_at: Time,
    message: &Message<'_>,
) -> Result<(), reflect::ViewError> {
    let channel = message.channel.id;
    write_seconds(text, i128::from(message.at.as_nanos()) - i128::from(started_at.as_nanos()));
    if columns.by_vehicle {
        text.push(b',');
        if let Some(vehicle) = columns.vehicle(channel, message.body) {
            put(text, format_args!("{vehicle}"));
        }
    }
    let mut next = 0;
    for (place, reader) in columns.fields(channel) {
        text.extend(std::iter::repeat_n(b',', place + 1 - next));
        next = place + 1;
        if let Some(value) = reader.read(message.body)? {
            write_cell(text, &value);
        }
    }
    text.extend(std::iter::repeat_n(b',', columns.columns.len() - next));
    text.push(b'\n');
    Ok(())
}

/// Appends a value as a cell.
pub fn write_cell(text: &mut Vec<u8>, value: &Value<'_>) {
    match value {
        Value::Bool(value) => put(text, format_args!("{value}")),
        Value::Signed(value) => put(text, format_args!("{value}")),
        Value::Unsigned(value) => put(text, format_args!("{value}")),
        // Debug has the fewest digits that read back the same, and an exponent where it is shorter.
        Value::F32(value) => put(text, format_args!("{value:?}")),
        Value::F64(value) => put(text, format_args!("{value:?}")),
        Value::Time { sec, nsec } => put(text, format_args!("{sec}.{nsec:09}")),
        Value::Duration { sec, nsec } => {
            write_seconds(text, i128::from(*sec) * 1_000_000_000 + i128::from(*nsec));
        }
        Value::Text(value) => write_text(text, value),
        Value::Enumeration { name, .. } => write_text(text, name),
        Value::Seq(_) | Value::Record(_) => {
            let json = serde_json::to_string(value).expect("every key is text");
            write_text(text, &json);
        }
    }
}

fn write_seconds(text: &mut Vec<u8>, nanos: i128) {
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    put(text, format_args!("{sign}{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000));
}

fn write_text(text: &mut Vec<u8>, content: &str) {
    if content.contains([',', '"', '\n', '\r']) {
        put(text, format_args!("\"{}\"", content.replace('"', "\"\"")));
    } else {
        text.extend_from_slice(content.as_bytes());
    }
}

fn put(text: &mut Vec<u8>, content: std::fmt::Arguments<'_>) {
    text.write_fmt(content).expect("writing to memory does not fail");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(value: &Value<'_>) -> String {
        let mut text = Vec::new();
        write_cell(&mut text, value);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn cells_read_back_as_what_they_were() {
        assert_eq!(cell(&Value::F32(0.1)), "0.1");
        assert_eq!(cell(&Value::F64(1e-300)), "1e-300");
        assert_eq!(cell(&Value::Time { sec: 5, nsec: 7 }), "5.000000007");
        assert_eq!(cell(&Value::Duration { sec: -1, nsec: 500_000_000 }), "-0.500000000");
        assert_eq!(cell(&Value::Text("a,\"b\"\n".to_owned())), "\"a,\"\"b\"\"\n\"");
        let seq = Value::Seq(vec![Value::Unsigned(1), Value::Text("x".to_owned())]);
        assert_eq!(cell(&seq), "\"[1,\"\"x\"\"]\"");
    }
}
