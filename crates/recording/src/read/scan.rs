//! Reading a file from its beginning, where no summary says what is in it: it is torn, damaged, or was
//! written so.

use std::collections::BTreeMap;

use super::error::{Defect, ReadError};
use super::record::{self, Cursor, MessageHead, NamedIndex, RawChannel, Schema, op};
use super::segment::{Condition, Place, PlaceKind, Segment};
use super::source::{FRAME_BYTES, Frame, RECORD_BYTES_MAX, Source, frame_in};
use crate::ABOUT_RECORD;
use crate::chunk::{Chunk, Inside, walk};

/// How much of the file is read at a time.
const WINDOW_BYTES: u64 = 1 << 20;
/// How much of loose messages is taken as one place.
const LOOSE_BYTES: u64 = 1 << 18;

/// What follows a record that was read.
enum Next {
    /// Another.
    Record,
    /// Nothing: the file's data ended here.
    End,
}

/// Fills a segment with what its records say, up to the data's end, the file's end, or damage.
///
/// # Errors
/// Only what the system says: damage is noted in the segment.
pub(crate) fn scan(segment: &mut Segment) -> Result<(), ReadError> {
    let mut at = segment.first_record_at()?;
    let mut window = Window::default();
    let mut scanner = Scanner::default();
    scanner.checksum.update(window.get(&segment.source, 0, at)?);
    let length = segment.source.length;
    let (lost_from, defect) = loop {
        let frame = match length - at {
            0..FRAME_BYTES => None,
            _ => frame_in(window.get(&segment.source, at, FRAME_BYTES)?, at),
        };
        let Some(frame) = frame.filter(|frame| frame.length <= length - at - FRAME_BYTES) else {
            break (at, None);
        };
        if frame.length > RECORD_BYTES_MAX {
            let (found, limit) = (frame.length, RECORD_BYTES_MAX);
            break (at, Some(Defect::Limit { what: "a record's length", found, limit }));
        }
        let bytes = window.get(&segment.source, at, FRAME_BYTES + frame.length)?;
        match scanner.take(segment, frame, &bytes[FRAME_BYTES as usize..]) {
            Ok(Next::Record) => scanner.checksum.update(bytes),
            Ok(Next::End) => {
                segment.condition = Condition::WithoutSummary;
                return Ok(());
            }
            Err(defect) => break (at, Some(defect)),
        }
        at = frame.end();
    };
    let (whole_bytes, lost_bytes) = (lost_from, length - lost_from);
    segment.condition = match defect {
        None => Condition::Torn { whole_bytes, lost_bytes },
        Some(defect) => {
            segment.damage.push(segment.source.damaged(lost_from, defect));
            Condition::Damaged { whole_bytes, lost_bytes }
        }
    };
    Ok(())
}

/// Some of the file, in memory.
#[derive(Default)]
struct Window {
    start: u64,
    bytes: Vec<u8>,
}

impl Window {
    /// Bytes that are known to stand in the file.
    fn get(&mut self, source: &Source, at: u64, length: u64) -> Result<&[u8], ReadError> {
        let held = self.start..=self.start + self.bytes.len() as u64;
        if !held.contains(&at) || !held.contains(&(at + length)) {
            let length = length.max(WINDOW_BYTES).min(source.length - at);
            source.read(at, length, &mut self.bytes)?;
            self.start = at;
        }
        let from = (at - self.start) as usize;
        Ok(&self.bytes[from..from + length as usize])
    }
}

#[derive(Default)]
struct Scanner {
    checksum: crc32fast::Hasher,
    content: Vec<u8>,
    /// The latest log time of all chunks before.
    latest: u64,
}

impl Scanner {
    fn take(&mut self, segment: &mut Segment, frame: Frame, body: &[u8]) -> Result<Next, Defect> {
        let foreign = !segment.ours;
        match frame.code {
            op::CHUNK => self.take_chunk(segment, frame, body)?,
            op::MESSAGE_INDEX => check_message_index(body)?,
            op::SCHEMA if foreign => add_schema(&mut segment.schemas, body)?,
            op::CHANNEL if foreign => add_channel(&mut segment.channels, body)?,
            op::MESSAGE if foreign => take_loose(segment, frame, body)?,
            op::ATTACHMENT => {
                let (name, ..) = record::attachment(body).ok_or(Defect::Unparsable("an attachment"))?;
                segment.attachments.push(index_of(frame, name));
            }
            op::METADATA => {
                let (name, _) = record::metadata(body).ok_or(Defect::Unparsable("a metadata record"))?;
                segment.ours |= name == ABOUT_RECORD && segment.places.is_empty();
                segment.metadata.push(index_of(frame, &name));
            }
            op::DATA_END => {
                self.take_end(segment, frame, body)?;
                return Ok(Next::End);
            }
            // A file written without DataEnd, or a footer of one that was.
            op::FOOTER if foreign => return Ok(Next::End),
            // Codes that the format keeps free for others.
            0x80.. if foreign => {}
            other => return Err(Defect::Misplaced(other)),
        }
        Ok(Next::Record)
    }

    fn take_end(&mut self, segment: &mut Segment, frame: Frame, body: &[u8]) -> Result<(), Defect> {
        let stated = Cursor::new(body).u32().filter(|_| body.len() == 4);
        let stated = stated.ok_or(Defect::Unparsable("the data's end"))?;
        let actual = self.checksum.clone().finalize();
        if stated != 0 && stated != actual {
            let defect = Defect::checksum("the checksum of all data", actual, stated);
            segment.damage.push(segment.source.damaged(frame.at, defect));
        }
        Ok(())
    }

    fn take_chunk(&mut self, segment: &mut Segment, frame: Frame, body: &[u8]) -> Result<(), Defect> {
        let chunk = Chunk::parse(body).ok_or(Defect::Unparsable("a chunk"))?;
        let place = |start, end, channels| Place {
            kind: PlaceKind::Chunk,
            at: frame.at,
            length: FRAME_BYTES + frame.length,
            start,
            end,
            channels,
        };
        let counted = chunk
            .unpack(&mut self.content, !segment.ours)
            .and_then(|()| count(&self.content, &segment.schemas, &segment.channels));
        let counted = match counted {
            Ok(counted) => counted,
            Err(defect) => {
                // Its frame is whole, so what follows may well be. Whoever wants messages from here on hears
                // of it.
                segment.places.push(place(self.latest, u64::MAX, None));
                segment.damage.push(segment.source.damaged(frame.at, defect));
                return Ok(());
            }
        };
        segment.schemas.extend(counted.schemas);
        segment.channels.extend(counted.channels);
        if let Some((start, end)) = counted.times {
            for (id, count) in &counted.counts {
                *segment.counts.entry(*id).or_default() += count;
            }
            self.latest = self.latest.max(end);
            segment.places.push(place(start, end, Some(counted.counts.into_keys().collect())));
        }
        Ok(())
    }
}

/// What one chunk adds.
#[derive(Default)]
struct Counted {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, RawChannel>,
    counts: BTreeMap<u16, u64>,
    /// Log times of its first and last message.
    times: Option<(u64, u64)>,
}

fn count(
    content: &[u8],
    schemas: &BTreeMap<u16, Schema>,
    channels: &BTreeMap<u16, RawChannel>,
) -> Result<Counted, Defect> {
    let mut counted = Counted::default();
    walk(content, |inside| {
        match inside {
            Inside::Schema(body) => {
                let schema = Schema::parse(body).ok_or(Defect::Unparsable("a schema"))?;
                let conflict = Defect::Conflict { what: "schema", id: schema.id };
                add_new(schemas, &mut counted.schemas, schema.id, schema, conflict)?;
            }
            Inside::Channel(body) => {
                let channel = RawChannel::parse(body).ok_or(Defect::Unparsable("a channel"))?;
                let conflict = Defect::Conflict { what: "channel", id: channel.id };
                add_new(channels, &mut counted.channels, channel.id, channel, conflict)?;
            }
            Inside::Message { head, .. } => {
                let id = head.channel;
                if !channels.contains_key(&id) && !counted.channels.contains_key(&id) {
                    return Err(Defect::UnknownChannel(id));
                }
                *counted.counts.entry(id).or_default() += 1;
                let (first, last) = counted.times.get_or_insert((head.log_time, head.log_time));
                (*first, *last) = ((*first).min(head.log_time), (*last).max(head.log_time));
            }
        }
        Ok(())
    })?;
    Ok(counted)
}

/// Adds what is not known yet; what is known must be the same.
fn add_new<T: PartialEq>(
    known: &BTreeMap<u16, T>,
    new: &mut BTreeMap<u16, T>,
    id: u16,
    value: T,
    conflict: Defect,
) -> Result<(), Defect> {
    match known.get(&id).or_else(|| new.get(&id)) {
        Some(there) if *there != value => Err(conflict),
        Some(_) => Ok(()),
        None => {
            new.insert(id, value);
            Ok(())
        }
    }
}

fn add_schema(schemas: &mut BTreeMap<u16, Schema>, body: &[u8]) -> Result<(), Defect> {
    let schema = Schema::parse(body).ok_or(Defect::Unparsable("a schema"))?;
    let conflict = Defect::Conflict { what: "schema", id: schema.id };
    add_new(&BTreeMap::new(), schemas, schema.id, schema, conflict)
}

fn add_channel(channels: &mut BTreeMap<u16, RawChannel>, body: &[u8]) -> Result<(), Defect> {
    let channel = RawChannel::parse(body).ok_or(Defect::Unparsable("a channel"))?;
    let conflict = Defect::Conflict { what: "channel", id: channel.id };
    add_new(&BTreeMap::new(), channels, channel.id, channel, conflict)
}

/// A message outside of any chunk, in a file that is not ours.
fn take_loose(segment: &mut Segment, frame: Frame, body: &[u8]) -> Result<(), Defect> {
    let head = MessageHead::parse(body).ok_or(Defect::Unparsable("a message"))?;
    if !segment.channels.contains_key(&head.channel) {
        return Err(Defect::UnknownChannel(head.channel));
    }
    *segment.counts.entry(head.channel).or_default() += 1;
    let (time, length) = (head.log_time, FRAME_BYTES + frame.length);
    match segment.places.last_mut() {
        Some(run)
            if run.kind == PlaceKind::Loose
                && run.at + run.length == frame.at
                && run.length < LOOSE_BYTES =>
        {
            run.length += length;
            (run.start, run.end) = (run.start.min(time), run.end.max(time));
        }
        _ => segment.places.push(Place {
            kind: PlaceKind::Loose,
            at: frame.at,
            length,
            start: time,
            end: time,
            channels: None,
        }),
    }
    Ok(())
}

/// Indexes of chunks are not used, but they must be what their code says: a chunk whose code was damaged is
/// not.
fn check_message_index(body: &[u8]) -> Result<(), Defect> {
    let mut cursor = Cursor::new(body);
    let entries = cursor.u16().and_then(|_| cursor.bytes_u32());
    let whole = entries.is_some_and(|entries| entries.len() % 16 == 0) && cursor.rest.is_empty();
    whole.then_some(()).ok_or(Defect::Unparsable("a message index"))
}

fn index_of(frame: Frame, name: &str) -> NamedIndex {
    NamedIndex { offset: frame.at, length: FRAME_BYTES + frame.length, name: name.to_owned() }
}
