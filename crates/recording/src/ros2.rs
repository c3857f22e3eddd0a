//! Export for ROS 2's tools: an MCAP file of profile `ros2`, bodies in CDR, definitions as `ros2msg`.
//!
//! Types keep their names (`flyarena/VehicleState` becomes `flyarena/msg/VehicleState`), fields and
//! constants. Topics get the names that ROS 2 allows: `vehicle/command-sent` becomes `/vehicle/command_sent`;
//! the channel's metadata keep the first. The built-in `time` and `duration` become the messages that ROS 2
//! has for them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Seek, Write};

use quantity::Time;
use reflect::Definition as Shape;

use crate::cdr::{EMPTY_FIELD, HEADER, HEADER_SEQUENCE, Transcoder};
use crate::export::{ExportError, Outcome};
use crate::read::{Channel, Recording};
use crate::select::Selection;

const PROFILE: &str = "ros2";
const MESSAGE_ENCODING: &str = "cdr";
const SCHEMA_ENCODING: &str = "ros2msg";
const SEPARATOR: &str = "================================================================================";
const TIME: &str = "builtin_interfaces/Time";
const DURATION: &str = "builtin_interfaces/Duration";

/// Writes the selected messages as ROS 2's tools read them. Messages without a definition cannot be turned
/// into CDR: they are left out and counted.
///
/// # Errors
/// A sink that refuses, or two topics that would get one name.
pub fn export_ros2<W: Write + Seek>(
    recording: &Recording,
    selection: &Selection,
    sink: W,
) -> Result<Outcome, ExportError> {
    let options = mcap::WriteOptions::new()
        .profile(PROFILE)
        .library(concat!("flyarena ", env!("CARGO_PKG_VERSION")))
        .compression(Some(mcap::Compression::Lz4));
    let mut file = options.create(sink).map_err(ExportError::Library)?;
    let mut outcome = Outcome::default();
    let targets = targets(recording, selection, &mut file, &mut outcome)?;
    let mut transcoder = Transcoder::default();
    let mut messages = recording.messages(selection);
    while let Some(message) = messages.next() {
        let message = match message {
            Ok(message) => message,
            Err(error) => {
                outcome.damage.push(error);
                continue;
            }
        };
        let Some(target) = &targets[message.channel.id as usize] else {
            outcome.without_definition += 1;
            continue;
        };
        match transcoder.transcode(&target.shape, message.body) {
            Ok(body) => {
                let header = mcap::records::MessageHeader {
                    channel_id: target.channel,
                    sequence: message.sequence,
                    log_time: nanos(message.at),
                    publish_time: nanos(message.published_at),
                };
                file.write_to_known_channel(&header, body).map_err(ExportError::Library)?;
                outcome.written += 1;
            }
            Err(error) => outcome.note_undecodable(&message, &error),
        }
    }
    file.finish().map_err(ExportError::Library)?;
    outcome.clamped_times = transcoder.clamped;
    Ok(outcome)
}

/// A channel of the new file.
struct Target {
    channel: u16,
    shape: Shape,
}

fn targets<W: Write + Seek>(
    recording: &Recording,
    selection: &Selection,
    file: &mut mcap::Writer<W>,
    outcome: &mut Outcome,
) -> Result<Vec<Option<Target>>, ExportError> {
    let mut targets: Vec<Option<Target>> = Vec::new();
    let mut names: BTreeMap<String, &str> = BTreeMap::new();
    for channel in recording.channels() {
        let definition = channel.definition.as_ref().filter(|_| selection.wants(channel));
        let Some(definition) = definition else {
            targets.push(None);
            continue;
        };
        let shape = match Shape::parse(&definition.name, &definition.text) {
            Ok(shape) => shape,
            Err(error) => {
                outcome.note_bad_definition(channel, &error);
                targets.push(None);
                continue;
            }
        };
        let topic = topic_name(&channel.topic);
        let first = names.entry(topic.clone()).or_insert(&channel.topic);
        if *first != channel.topic {
            let (first, second) = ((*first).to_owned(), channel.topic.clone());
            return Err(ExportError::OneName { name: topic, first, second });
        }
        let text = definition_text(&shape, &definition.text);
        let name = type_name(&definition.name);
        let schema =
            file.add_schema(&name, SCHEMA_ENCODING, text.as_bytes()).map_err(ExportError::Library)?;
        let metadata = metadata(channel);
        let channel =
            file.add_channel(schema, &topic, MESSAGE_ENCODING, &metadata).map_err(ExportError::Library)?;
        targets.push(Some(Target { channel, shape }));
    }
    Ok(targets)
}

fn metadata(channel: &Channel) -> BTreeMap<String, String> {
    let mut metadata = channel.stream.as_ref().map(crate::Stream::metadata).unwrap_or_default();
    metadata.insert("topic".to_owned(), channel.topic.clone());
    metadata
}

/// `package/Type` as `package/msg/Type`.
fn type_name(name: &str) -> String {
    name.replacen('/', "/msg/", 1)
}

/// A name that ROS 2 allows: absolute, and without `-`.
fn topic_name(topic: &str) -> String {
    let mut name = String::from("/");
    name.extend(
        topic
            .trim_start_matches('/')
            .chars()
            .map(|letter| if letter.is_ascii_alphanumeric() || letter == '/' { letter } else { '_' }),
    );
    name
}

fn nanos(at: Time) -> u64 {
    u64::try_from(at.as_nanos()).unwrap_or(0)
}

/// The `ros1msg` text as `ros2msg`, comments and constants as they were.
fn definition_text(shape: &Shape, text: &str) -> String {
    let mut out = String::new();
    let mut within = Some(shape.name());
    for line in text.lines() {
        let words = line.trim();
        if words.starts_with("===") && words.bytes().all(|byte| byte == b'=') {
            close_record(&mut out, shape, within);
            within = None;
            out.push_str(SEPARATOR);
        } else if let Some(name) = words.strip_prefix("MSG:").filter(|_| within.is_none()) {
            within = Some(name.trim());
            let _ = write!(out, "MSG: {}", name.trim());
        } else {
            out.push_str(&statement(line, within == Some(HEADER)));
        }
        out.push('\n');
    }
    close_record(&mut out, shape, within);
    for (name, word, seconds) in [(TIME, "time", "int32"), (DURATION, "duration", "int32")] {
        let used = text.lines().any(|line| base_type(line) == Some(word));
        if used && shape.records().iter().all(|record| record.name != name) {
            let _ = write!(out, "{SEPARATOR}\nMSG: {name}\n{seconds} sec\nuint32 nanosec\n");
        }
    }
    out
}

/// ROS 2 has no message without fields.
fn close_record(out: &mut String, shape: &Shape, within: Option<&str>) {
    let empty = |name| shape.records().iter().any(|record| record.name == name && record.fields.is_empty());
    if within.is_some_and(empty) {
        let _ = writeln!(out, "uint8 {EMPTY_FIELD}");
    }
}

/// A field or constant with the name that ROS 2 has for its type; anything else as it stands.
fn statement(line: &str, in_header: bool) -> String {
    let (Some(base), line) = (base_type(line), line.trim_start()) else { return line.to_owned() };
    let rest = &line[base.len()..];
    let name = rest.split_whitespace().next().unwrap_or("");
    if in_header && name == HEADER_SEQUENCE {
        return format!("# {line}");
    }
    let base = match base {
        "time" => TIME,
        "duration" => DURATION,
        "byte" => "int8",
        "char" => "uint8",
        "Header" => HEADER,
        other => other,
    };
    match rest.split_once('=') {
        // ROS 1 takes all that follows as it stands.
        Some((name, value)) if base == "string" && !name.contains('#') => {
            let quoted = value.trim().replace('\\', "\\\\").replace('"', "\\\"");
            format!("{base}{name}=\"{quoted}\"")
        }
        _ => format!("{base}{rest}"),
    }
}

/// The type that a line begins with, without what makes it an array.
fn base_type(line: &str) -> Option<&str> {
    let word = line.split_whitespace().next()?;
    let base = word.split('[').next()?;
    (!base.is_empty() && !base.starts_with(['#', '='])).then_some(base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_ros_2_allows() {
        assert_eq!(topic_name("vehicle/command-sent"), "/vehicle/command_sent");
        assert_eq!(topic_name("/already/absolute"), "/already/absolute");
        assert_eq!(type_name("flyarena/VehicleState"), "flyarena/msg/VehicleState");
    }

    #[test]
    fn built_in_types_become_messages_and_comments_stay() {
        let text = "# [unit s]\ntime[2] stamp # when\nbyte B=-1\nstring S=a \"b\" # c\nNothing none\n\
                    ===\nMSG: p/Nothing\n# empty\n";
        let shape = Shape::parse("p/T", text).unwrap();
        let expected = format!(
            "# [unit s]\n{TIME}[2] stamp # when\nint8 B=-1\nstring S=\"a \\\"b\\\" # c\"\nNothing none\n\
             {SEPARATOR}\nMSG: p/Nothing\n# empty\nuint8 {EMPTY_FIELD}\n\
             {SEPARATOR}\nMSG: {TIME}\nint32 sec\nuint32 nanosec\n"
        );
        assert_eq!(definition_text(&shape, text), expected);
    }

    #[test]
    fn a_header_is_that_of_ros_2() {
        let text = "Header header\n===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
        let shape = Shape::parse("p/T", text).unwrap();
        let out = definition_text(&shape, text);
        assert!(out.starts_with("std_msgs/Header header\n"), "{out}");
        assert!(out.contains("# uint32 seq\n"), "{out}");
    }
}
