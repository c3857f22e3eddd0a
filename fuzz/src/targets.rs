//! What the fuzz targets do with an input. The test suite runs the same functions on inputs of its own.
//!
//! A target panics where a promise does not hold; whatever else happens to an input is its own affair.

// Each of the binaries uses one of them.
#![allow(dead_code, clippy::unwrap_used, reason = "a target says by panicking what it found")]

use std::ops::ControlFlow;

use quantity::Time;
use recording::{Message, Recording, Selection, Stream};
use reflect::{Definition, Value};
use schemas::topics;
use service_core::Observer;
use wire::{Domain, DropReason, Header, Kind, Role, Secret, SigningKey, TopicName};

const RUN: u64 = 11;

/// A datagram: raw as it may come from anywhere, and sealed by each topic's own writer.
pub fn datagram(input: &[u8]) {
    let secret = Secret::new([5; 32]);
    let mut observer = Observer::new(&secret, Domain::Sim, RUN);
    // Nobody guesses a tag: whatever is taken as verified was not sealed here.
    if let Ok(observed) = observer.observe(input) {
        assert!(!observed.verified, "a guessed tag was believed");
        assert!(topics::by_name(observed.topic.name()).is_none(), "a known topic went unverified");
    }
    let Some((&choice, body)) = input.split_first() else { return };
    let topic = topics::ALL[usize::from(choice) % topics::ALL.len()];
    let header = Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: topic.latched,
        source: 3,
        schema_id: topic.schema_id(),
        run: RUN,
        incarnation: 1,
        sequence: 1,
        published_at: Time::from_nanos(5),
    };
    let key = SigningKey::derive(&secret, Domain::Sim, RUN, Role::of(Kind::Data, topic.writer));
    let name = TopicName::new(topic.name).expect("names in the table are names");
    let mut sealed = Vec::new();
    if wire::seal(&header, name, body, &key, &mut sealed).is_err() {
        return;
    }
    let observed = observer.observe(&sealed).expect("its own writer sealed it");
    assert!(observed.verified && observed.body == body);
    assert_eq!(observer.observe(&sealed).unwrap_err(), DropReason::Replayed);
    bodies(body);
}

/// Reads a body as each type there is: the two readers without a Rust type agree, and take all that the codec
/// takes.
fn bodies(body: &[u8]) {
    macro_rules! typed {
        ($($name:ident),* $(,)?) => {
            $(body_of::<schemas::$name>(body);)*
        };
    }
    typed!(
        ArenaOrder,
        CommandSent,
        DeviceBytes,
        FlipStatus,
        LoggerOrder,
        LoggerStatus,
        ManeuverAbort,
        ManeuverParameters,
        ManeuverResult,
        ManeuverStart,
        ManeuverUpload,
        MocapFrame,
        NodeEvent,
        NodeHealth,
        NodeJournal,
        NodeLatency,
        PlantManeuver,
        PlantTruth,
        ReplayAnswer,
        ReplayClock,
        StopOrder,
        VehicleCommand,
        VehicleGoal,
        VehicleState,
        VehicleTelemetry,
    );
}

fn body_of<M: reflect::Message>(body: &[u8]) {
    let viewed = Value::decode(M::SCHEMA, body);
    if let Ok(message) = wire::decode::<M>(body) {
        assert!(viewed.is_ok(), "{}: the codec takes what the view refuses: {viewed:?}", M::SCHEMA.name);
        let mut again = Vec::new();
        wire::encode(&message, &mut again).expect("what was decoded can be encoded");
        let message = wire::decode::<M>(&again).expect("what was encoded can be decoded");
        let mut third = Vec::new();
        wire::encode(&message, &mut third).expect("what was decoded can be encoded");
        assert_eq!(again, third, "{}: each time other bytes", M::SCHEMA.name);
    }
}

/// A definition's text, and a body read by it. What stands before the first zero byte is the text.
pub fn schema_text(input: &[u8]) {
    let end = input.iter().position(|byte| *byte == 0).unwrap_or(input.len());
    let (text, body) = (&input[..end], input.get(end + 1..).unwrap_or(&[]));
    let Ok(text) = std::str::from_utf8(text) else { return };
    let definition = match Definition::parse("package/Type", text) {
        Ok(definition) => definition,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    let whole = definition.decode(body);
    if let Ok(value) = &whole {
        serde_json::to_string(value).expect("every value is JSON");
    }
    for leaf in definition.leaves().unwrap_or_default().iter().take(64) {
        let reader = definition.field(&leaf.path).expect("a leaf is a field");
        let read = reader.read(body);
        assert!(whole.is_err() || read.is_ok(), "{}: {read:?} in a body that decodes", leaf.path);
    }
}

/// A recording: the input as a file, and as the content of a chunk whose checksum holds.
pub fn mcap_reader(input: &[u8]) {
    read(input.to_vec(), false);
    read(wrapped(input), true);
}

fn read(bytes: Vec<u8>, whole: bool) {
    let Ok(recording) = Recording::from_bytes("fuzzed", bytes) else {
        assert!(!whole, "a file with a sound beginning does not open");
        return;
    };
    let told = |message: Message<'_>| (message.at, message.channel.id, message.sequence, message.body.len());
    let (mut read, mut errors) = (Vec::new(), 0);
    let mut messages = recording.messages(&Selection::all());
    while let Some(message) = messages.next() {
        match message {
            Ok(message) => read.push(told(message)),
            Err(_) => errors += 1,
        }
    }
    assert!(read.is_sorted_by_key(|(at, ..)| *at), "out of order");
    let (mut visited, mut visit_errors) = (Vec::new(), 0);
    recording.visit(
        &Selection::all(),
        Vec::new,
        |rows, message| rows.push(told(message)),
        |rows| {
            match rows {
                Ok(rows) => visited.extend(rows),
                Err(_) => visit_errors += 1,
            }
            ControlFlow::Continue(())
        },
    );
    assert_eq!((&read, errors), (&visited, visit_errors), "two ways to read differ");
    let gaps = recording.gaps(&Selection::all(), |_| ());
    assert_eq!(gaps.messages, read.len() as u64);
    for stream in &gaps.streams {
        let span = stream.highest - stream.lowest + 1;
        assert_eq!(stream.messages - stream.repeated + stream.missing(), span, "{stream:?}");
    }
    if let Some((first, last)) = recording.time_range() {
        let middle = Time::from_nanos(first.as_nanos().midpoint(last.as_nanos()));
        let _ = recording.latched_before(middle, &Selection::all());
    }
    let _ = recording.settings();
    for name in recording.attachments() {
        let _ = recording.attachment(name);
    }
}

/// A file with the input as the content of one chunk, after two channels of ours to say something on.
pub fn wrapped(input: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    for id in 1..=2 {
        let mut channel = vec![id, 0, 0, 0];
        text(&mut channel, "a/b");
        text(&mut channel, "ros1");
        let stream = Stream {
            topic: "a/b".to_owned(),
            kind: Kind::Data,
            source: 7,
            incarnation: u32::from(id),
            domain: Domain::Sim,
            run: RUN,
            schema_id: 5,
            latched: true,
            verified: true,
        };
        let mut metadata = Vec::new();
        for (key, value) in stream.metadata() {
            text(&mut metadata, &key);
            text(&mut metadata, &value);
        }
        channel.extend((metadata.len() as u32).to_le_bytes());
        channel.extend(metadata);
        record(&mut content, 4, &channel);
    }
    content.extend(input);
    let mut file = b"\x89MCAP0\r\n".to_vec();
    let mut header = Vec::new();
    text(&mut header, "ros1");
    text(&mut header, "flyarena fuzz");
    record(&mut file, 1, &header);
    let mut chunk = vec![0; 16];
    chunk.extend((content.len() as u64).to_le_bytes());
    chunk.extend(crc32fast::hash(&content).to_le_bytes());
    text(&mut chunk, "");
    chunk.extend((content.len() as u64).to_le_bytes());
    chunk.extend(content);
    record(&mut file, 6, &chunk);
    record(&mut file, 15, &[0; 4]);
    file
}

fn text(into: &mut Vec<u8>, text: &str) {
    into.extend((text.len() as u32).to_le_bytes());
    into.extend(text.as_bytes());
}

fn record(into: &mut Vec<u8>, code: u8, body: &[u8]) {
    into.push(code);
    into.extend((body.len() as u64).to_le_bytes());
    into.extend(body);
}
