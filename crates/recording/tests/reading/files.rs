//! Recordings in memory, made by the writer.

use std::ops::Range;

use quantity::{Span, Time};
use wire::{Domain, Header, Kind};

use mcap::records::op;
use recording::{
    About, Compression, Definition, Ending, Entry, Message, ReadError, Recording, Selection, Writer,
};

/// A message, in a form that compares.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    pub topic: String,
    pub source: u32,
    pub sequence: u32,
    pub at: Time,
    pub published_at: Time,
    pub body: Vec<u8>,
}

impl Said {
    pub fn of(message: &Message<'_>) -> Self {
        Self {
            topic: message.channel.topic.clone(),
            source: message.channel.stream.as_ref().map_or(0, |stream| stream.source),
            sequence: message.sequence,
            at: message.at,
            published_at: message.published_at,
            body: message.body.to_vec(),
        }
    }
}

pub fn about() -> About {
    About {
        recording: 7,
        segment: 0,
        run: 8,
        domain: Domain::Sim,
        scenario: "hover".to_owned(),
        settings_digest: 9,
        started_at: Time::from_nanos(1_000_000_000),
        started_wall_ns: 1_700_000_000_000_000_000,
        host: "host".to_owned(),
        revision: "abc".to_owned(),
    }
}

/// The nominal time of the message of this number: a millisecond apart.
pub fn time(number: usize) -> Time {
    about().started_at + Span::from_millis(number as i64)
}

const TOPICS: [&str; 5] = ["vehicle/state", "vehicle/command", "mocap/frame", "vehicle/state", "arena/order"];

/// So many messages of several topics and two senders, now and then out of order by some milliseconds.
pub fn said(count: usize) -> Vec<Said> {
    let mut sequences = std::collections::BTreeMap::new();
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    (0..count)
        .map(|number| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let topic = TOPICS[number % TOPICS.len()].to_owned();
            let source = 1 + (number / TOPICS.len() % 2) as u32;
            let sequence = sequences.entry((topic.clone(), source)).or_insert(0_u32);
            *sequence += 1;
            let back = if number > 50 && random >> 60 == 0 { 3 } else { 0 };
            let at = time(number - back);
            let length = 24 + (random >> 40) as usize % 90;
            let body = (0..length).map(|byte| (byte as u64 ^ (random >> (byte % 7))) as u8).collect();
            let published_at = at + Span::from_micros(-40);
            Said { topic, source, sequence: *sequence, at, published_at, body }
        })
        .collect()
}

/// As a reader gives them: in order of time; of equal times, as they were written.
pub fn in_order(said: &[Said]) -> Vec<Said> {
    let mut said = said.to_vec();
    said.sort_by_key(|said| said.at);
    said
}

pub struct File<'a> {
    pub said: &'a [Said],
    pub compression: Compression,
    pub about: About,
}

impl<'a> File<'a> {
    pub fn new(said: &'a [Said], compression: Compression) -> Self {
        Self { said, compression, about: about() }
    }
}

fn written(file: &File<'_>) -> Writer<Vec<u8>> {
    let mut writer = Writer::new(Vec::new(), crate::options(file.compression), &file.about, None).unwrap();
    let text = "uint8[] data\n".to_owned();
    let id = reflect::fnv1a_64(&[b"flyarena/Blob\0", text.as_bytes()]);
    writer.define(&Definition { id, name: "flyarena/Blob".to_owned(), text }).unwrap();
    for said in file.said {
        let header = Header {
            kind: Kind::Data,
            domain: Domain::Sim,
            latched: said.topic == "arena/order",
            source: said.source,
            schema_id: if said.topic == "mocap/frame" { 1 } else { id },
            run: 8,
            incarnation: 3,
            sequence: u64::from(said.sequence),
            published_at: said.published_at,
        };
        let entry =
            Entry { at: said.at, header: &header, topic: &said.topic, verified: true, body: &said.body };
        writer.write(&entry).unwrap();
    }
    writer
}

pub fn write(file: File<'_>) -> Vec<u8> {
    let ending = Ending { reason: "stopped".to_owned(), ..Ending::default() };
    written(&file).finish(&ending, &[]).unwrap()
}

pub fn sealed(said: &[Said], compression: Compression) -> Vec<u8> {
    write(File::new(said, compression))
}

/// As a killed recorder leaves it, the last chunk closed.
pub fn torn(said: &[Said], compression: Compression) -> Vec<u8> {
    let mut writer = written(&File::new(said, compression));
    writer.close_chunk().unwrap();
    writer.sink().clone()
}

/// Sealed, its summary taken out.
pub fn without_summary(said: &[Said], compression: Compression) -> Vec<u8> {
    let mut bytes = sealed(said, compression);
    let end = records(&bytes, op::DATA_END).pop().unwrap().end;
    bytes.truncate(end);
    bytes.extend([op::FOOTER, 20, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend([0; 20]);
    bytes.extend(mcap::MAGIC);
    bytes
}

/// Where the top-level records of this code stand.
pub fn records(bytes: &[u8], code: u8) -> Vec<Range<usize>> {
    let mut at = mcap::MAGIC.len();
    let mut found = Vec::new();
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap());
        let Some(end) = usize::try_from(length).ok().and_then(|length| (at + 9).checked_add(length)) else {
            break;
        };
        if end > bytes.len() {
            break;
        }
        if bytes[at] == code {
            found.push(at..end);
        }
        at = end;
    }
    found
}

/// All messages of a selection, and the errors among them.
pub fn read_all(recording: &Recording, selection: &Selection) -> (Vec<Said>, Vec<ReadError>) {
    let (mut said, mut errors) = (Vec::new(), Vec::new());
    let mut messages = recording.messages(selection);
    while let Some(message) = messages.next() {
        match message {
            Ok(message) => said.push(Said::of(&message)),
            Err(error) => errors.push(error),
        }
    }
    (said, errors)
}
