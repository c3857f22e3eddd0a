//! A recording: one file or several, as one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use quantity::{Span, Time};
use settings::Arena;

use super::error::{Defect, ReadError};
use super::group::{Group, Plan};
use super::messages::Messages;
use super::record::{self, op};
use super::segment::{Condition, Segment};
use super::source::Source;
use crate::select::Selection;
use crate::{
    ABOUT_RECORD, About, Definition, ENDING_RECORD, Ending, GAP_RECORD, Gap, LOSSES_RECORD, Loss,
    SCHEMA_ENCODING, SETTINGS_FILE, Stream, losses_from_metadata,
};

/// One channel: what one sender said on one topic, under one definition. The same channel in several segments
/// is one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its place in [`Recording::channels`].
    pub id: u32,
    /// The topic.
    pub topic: String,
    /// How bodies are encoded: `ros1` in files of ours.
    pub message_encoding: String,
    /// Who said it and how; `None` in a file that no recorder of ours wrote.
    pub stream: Option<Stream>,
    /// The definition of its bodies, if it is known and is `ros1msg`.
    pub definition: Option<Arc<Definition>>,
    /// The definition as it stands in the file, of whatever kind.
    pub schema: Option<Arc<Schema>>,
}

/// A definition as it stands in a file, of whatever kind.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Schema {
    /// The type's name.
    pub name: String,
    /// How it is written: `ros1msg` in files of ours.
    pub encoding: String,
    /// It.
    pub data: Vec<u8>,
}

/// A file that stands beside the messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Its name.
    pub name: String,
    /// What it is.
    pub media_type: String,
    /// Its content.
    pub data: Vec<u8>,
}

/// A message that was taken out of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// Its channel, by [`Channel::id`].
    pub channel: u32,
    /// The low 32 bits of its number on the bus.
    pub sequence: u32,
    /// When it arrived.
    pub at: Time,
    /// When it was sent, by its sender.
    pub published_at: Time,
    /// Its body.
    pub body: Vec<u8>,
}

/// One file of a recording.
#[derive(Clone, Debug)]
pub struct SegmentFacts {
    /// The file.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// In which condition it is.
    pub condition: Condition,
    /// Messages in it, as far as they can be read.
    pub messages: u64,
    /// Chunks in it.
    pub chunks: usize,
    /// What it says of itself.
    pub about: Option<About>,
    /// What it says of its end, if it was sealed.
    pub ending: Option<Ending>,
}

/// A recording, open for reading. Clones share one open file.
#[derive(Clone, Debug)]
pub struct Recording {
    pub(crate) inner: Arc<Inner>,
}

#[derive(Debug)]
pub(crate) struct Inner {
    pub segments: Vec<Segment>,
    pub channels: Vec<Channel>,
    /// Of each segment, of each of its channel ids: the number in `channels`.
    pub numbers: Vec<Vec<Option<u32>>>,
    facts: Vec<SegmentFacts>,
    definitions: Vec<Arc<Definition>>,
    counts: Vec<u64>,
    losses: Vec<Loss>,
    dropped: Vec<Gap>,
    damage: Vec<ReadError>,
}

impl Recording {
    /// Opens a recording: the file, and the segments of the same recording that follow it (`NAME.0001.mcap`
    /// and so on) where they are there.
    ///
    /// A file that is torn or damaged opens all the same, with what can be read; see [`Recording::damage`]
    /// and [`SegmentFacts::condition`].
    ///
    /// # Errors
    /// A file that cannot be read at all, or that does not begin as MCAP files do.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let first = Segment::open(Source::open(path)?)?;
        let mut damage = Vec::new();
        let mut segments = vec![first];
        let wanted = facts_of(&segments[0]).0.about.map(|about| about.recording);
        for path in wanted.iter().flat_map(|_| following(path)) {
            match Source::open(&path).and_then(Segment::open) {
                Ok(segment) => {
                    if facts_of(&segment).0.about.map(|about| about.recording) == wanted {
                        segments.push(segment);
                    }
                }
                Err(error) => damage.push(error),
            }
        }
        Ok(Self::assemble(segments, damage))
    }

    /// Opens one file, without the segments that follow it.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_alone(path: &Path) -> Result<Self, ReadError> {
        Ok(Self::assemble(vec![Segment::open(Source::open(path)?)?], Vec::new()))
    }

    /// Reads a file's bytes from memory; `name` is how errors name it.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Self, ReadError> {
        Ok(Self::assemble(vec![Segment::open(Source::memory(name, bytes))?], Vec::new()))
    }

    fn assemble(segments: Vec<Segment>, mut damage: Vec<ReadError>) -> Self {
        let (mut losses, mut dropped) = (Vec::new(), Vec::new());
        let mut facts = Vec::with_capacity(segments.len());
        for segment in &segments {
            damage.extend(segment.damage.iter().cloned());
            let (found, wrong) = facts_of(segment);
            facts.push(found);
            damage.extend(wrong);
            match losses_of(segment) {
                // Counted from the recorder's start: the last that was written holds for all.
                Ok(found) => losses = found.unwrap_or(losses),
                Err(error) => damage.push(error),
            }
            for found in gaps_of(segment) {
                found.map_or_else(|error| damage.push(error), |gap| dropped.push(gap));
            }
        }
        let mut catalogue = Catalogue::default();
        let numbers = segments.iter().map(|segment| catalogue.add(segment, &mut damage)).collect();
        let Catalogue { channels, counts, definitions, .. } = catalogue;
        Self {
            inner: Arc::new(Inner {
                segments,
                channels,
                numbers,
                facts,
                definitions,
                counts,
                losses,
                dropped,
                damage,
            }),
        }
    }

    /// What the first segment says of itself: `None` for a file that no recorder of ours wrote, or where it
    /// is damaged.
    #[must_use]
    pub fn about(&self) -> Option<&About> {
        self.inner.facts.first()?.about.as_ref()
    }

    /// What the last segment says of its end: `None` if it was not sealed.
    #[must_use]
    pub fn ending(&self) -> Option<&Ending> {
        self.inner.facts.last()?.ending.as_ref()
    }

    /// What the numbers of each stream told the recorder, from its start to the end of the last sealed
    /// segment.
    #[must_use]
    pub fn losses(&self) -> &[Loss] {
        &self.inner.losses
    }

    /// Where the recorder had to drop messages that it had received.
    #[must_use]
    pub fn dropped(&self) -> &[Gap] {
        &self.inner.dropped
    }

    /// What was found wrong on opening. Chunks of a sealed file are looked at when they are read.
    #[must_use]
    pub fn damage(&self) -> &[ReadError] {
        &self.inner.damage
    }

    /// The files.
    #[must_use]
    pub fn segments(&self) -> &[SegmentFacts] {
        &self.inner.facts
    }

    /// The profile that the first file names: `ros1` in files of ours.
    #[must_use]
    pub fn profile(&self) -> &str {
        &self.inner.segments[0].profile
    }

    /// The library that wrote the first file, as it says.
    #[must_use]
    pub fn library(&self) -> &str {
        &self.inner.segments[0].library
    }

    /// The settings that the arena ran with; `None` if none are attached.
    ///
    /// # Errors
    /// An attachment that is damaged, or no settings.
    pub fn settings(&self) -> Result<Option<Arena>, ReadError> {
        let path = &self.inner.segments[0].source.path;
        let failed = |source| ReadError::Settings { path: path.clone(), source: Arc::new(source) };
        let text = self.settings_text()?;
        text.map(|text| Arena::from_toml(SETTINGS_FILE, &text).map_err(failed)).transpose()
    }

    /// The text of the settings that the arena ran with; `None` if none are attached.
    ///
    /// # Errors
    /// An attachment that is damaged.
    pub fn settings_text(&self) -> Result<Option<String>, ReadError> {
        let Some(attachment) = self.attachment(SETTINGS_FILE)? else { return Ok(None) };
        let text = String::from_utf8(attachment.data);
        text.map(Some)
            .map_err(|_| self.inner.segments[0].source.damaged(0, Defect::Unparsable("the settings")))
    }

    /// Names of the files that stand beside the messages.
    #[must_use]
    pub fn attachments(&self) -> BTreeSet<&str> {
        let segments = self.inner.segments.iter();
        segments.flat_map(|segment| &segment.attachments).map(|index| index.name.as_str()).collect()
    }

    /// The first attachment of this name.
    ///
    /// # Errors
    /// One that is damaged.
    pub fn attachment(&self, name: &str) -> Result<Option<Attachment>, ReadError> {
        for segment in &self.inner.segments {
            let Some(index) = segment.attachments.iter().find(|index| index.name == name) else { continue };
            let body = segment.indexed(index, op::ATTACHMENT)?;
            let damaged = || segment.source.damaged(index.offset, Defect::Unparsable("an attachment"));
            let (found, media_type, data) = record::attachment(&body).ok_or_else(damaged)?;
            if found != name {
                return Err(damaged());
            }
            let (media_type, data) = (media_type.to_owned(), data.to_vec());
            return Ok(Some(Attachment { name: name.to_owned(), media_type, data }));
        }
        Ok(None)
    }

    /// The channels, of all segments.
    #[must_use]
    pub fn channels(&self) -> &[Channel] {
        &self.inner.channels
    }

    /// The definitions, each once.
    #[must_use]
    pub fn definitions(&self) -> &[Arc<Definition>] {
        &self.inner.definitions
    }

    /// Log times of the first and the last message; `None` if there are none.
    #[must_use]
    pub fn time_range(&self) -> Option<(Time, Time)> {
        // A chunk without a message says zero of both, and one that nobody could read says anything.
        let known = || {
            let places = self.inner.segments.iter().flat_map(|segment| &segment.places);
            places.filter(|place| place.channels.is_some() || (place.end != 0 && place.end != u64::MAX))
        };
        let start = known().map(|place| place.start).min()?;
        let end = known().map(|place| place.end).max()?;
        Some((time(start), time(end)))
    }

    /// What seconds are counted from: when it was begun, or its first message if it does not say.
    #[must_use]
    pub fn started_at(&self) -> Time {
        let begun = self.about().map(|about| about.started_at);
        begun.or_else(|| Some(self.time_range()?.0)).unwrap_or(Time::ZERO)
    }

    /// The instant so many seconds after [`Recording::started_at`].
    #[must_use]
    pub fn at_seconds(&self, seconds: f64) -> Time {
        self.started_at().saturating_add(Span::from_secs_f64(seconds))
    }

    /// Seconds from [`Recording::started_at`] to an instant.
    #[must_use]
    pub fn seconds_at(&self, at: Time) -> f64 {
        let nanos = i128::from(at.as_nanos()) - i128::from(self.started_at().as_nanos());
        nanos as f64 * 1e-9
    }

    /// Messages in all, as far as they can be read.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.inner.counts.iter().sum()
    }

    /// Messages of one channel, by [`Channel::id`].
    #[must_use]
    pub fn channel_count(&self, channel: u32) -> u64 {
        self.inner.counts.get(channel as usize).copied().unwrap_or(0)
    }

    /// The selected messages, in order of their log times; of equal times, in the order in which they were
    /// written.
    #[must_use]
    pub fn messages(&self, selection: &Selection) -> Messages {
        Messages::new(self.clone(), selection)
    }

    /// The newest message before `at` of each latched topic and sender that the selection wants, in order of
    /// time: what somebody who comes to the bus at that time is told first.
    ///
    /// # Errors
    /// A chunk that is damaged.
    pub fn latched_before(&self, at: Time, selection: &Selection) -> Result<Vec<Kept>, ReadError> {
        let latched = |channel: &&Channel| {
            selection.wants(channel) && channel.stream.as_ref().is_some_and(|stream| stream.latched)
        };
        let mut senders: BTreeMap<(&str, u32), Vec<u32>> = BTreeMap::new();
        for channel in self.inner.channels.iter().filter(latched) {
            let source = channel.stream.as_ref().map_or(0, |stream| stream.source);
            senders.entry((&channel.topic, source)).or_default().push(channel.id);
        }
        let before = at.saturating_add(Span::from_nanos(-1));
        let mut kept = Vec::new();
        for channels in senders.into_values() {
            let wanted = Selection::of_channels(channels).to(before);
            let plan = Plan::new(self, &wanted);
            for group in plan.groups().iter().rev() {
                if let Some(newest) = self.newest(&plan, group)? {
                    kept.push(newest);
                    break;
                }
            }
        }
        kept.sort_by_key(|message| message.at);
        Ok(kept)
    }

    fn newest(&self, plan: &Plan, group: &Group) -> Result<Option<Kept>, ReadError> {
        let mut merge = plan.merge(group);
        let mut newest = None;
        while let Some(message) = merge.next(self, plan) {
            let message = message?;
            newest = Some(Kept {
                channel: message.channel.id,
                sequence: message.sequence,
                at: message.at,
                published_at: message.published_at,
                body: message.body.to_vec(),
            });
        }
        Ok(newest)
    }
}

fn time(nanos: u64) -> Time {
    Time::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX))
}

/// What a segment says of itself, and what of it is wrong.
fn facts_of(segment: &Segment) -> (SegmentFacts, Vec<ReadError>) {
    let mut wrong = Vec::new();
    let path = &segment.source.path;
    let failed = |source| ReadError::Format { path: path.clone(), source };
    let about = segment
        .metadata(ABOUT_RECORD)
        .and_then(|found| found.map(|found| About::from_metadata(&found).map_err(failed)).transpose());
    let ending = segment
        .metadata(ENDING_RECORD)
        .and_then(|found| found.map(|found| Ending::from_metadata(&found).map_err(failed)).transpose());
    let facts = SegmentFacts {
        path: path.clone(),
        bytes: segment.source.length,
        condition: segment.condition.clone(),
        messages: segment.counts.values().fold(0, |sum: u64, count| sum.saturating_add(*count)),
        chunks: segment.places.len(),
        about: about.unwrap_or_else(|error| {
            wrong.push(error);
            None
        }),
        ending: ending.unwrap_or_else(|error| {
            wrong.push(error);
            None
        }),
    };
    (facts, wrong)
}

fn losses_of(segment: &Segment) -> Result<Option<Vec<Loss>>, ReadError> {
    let failed = |source| ReadError::Format { path: segment.source.path.clone(), source };
    let found = segment.metadata(LOSSES_RECORD)?;
    found.map(|found| losses_from_metadata(&found).map_err(failed)).transpose()
}

fn gaps_of(segment: &Segment) -> impl Iterator<Item = Result<Gap, ReadError>> {
    let failed = |source| ReadError::Format { path: segment.source.path.clone(), source };
    let gaps = segment.metadata.iter().filter(|index| index.name == GAP_RECORD);
    gaps.map(move |index| Gap::from_metadata(&segment.metadata_at(index)?).map_err(failed))
}

/// Files that may be segments after this one, in order: `NAME.0001.mcap` and so on, a torn one as
/// `….mcap.part`.
fn following(path: &Path) -> Vec<PathBuf> {
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return Vec::new() };
    let Some((stem, number)) = segment_name(name) else { return Vec::new() };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found = BTreeMap::new();
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some((other, later)) = name.to_str().and_then(segment_name) else { continue };
        let sealed = name.to_str().is_some_and(|name| name.ends_with(".mcap"));
        if other == stem && later > number && (sealed || !found.contains_key(&later)) {
            found.insert(later, entry.path());
        }
    }
    found.into_values().collect()
}

/// What all segments of a recording are called, and the number of this one; the first has none in its name.
fn segment_name(name: &str) -> Option<(&str, u32)> {
    let stem = name.strip_suffix(".part").unwrap_or(name).strip_suffix(".mcap")?;
    let number = stem.rsplit_once('.').filter(|(_, number)| number.len() >= 4);
    match number.and_then(|(stem, number)| Some((stem, number.parse().ok()?))) {
        Some((stem, number)) => Some((stem, number)),
        None => Some((stem, 0)),
    }
}

/// A schema, its number among all, and its definition if it is one.
type Interned = (Arc<Schema>, usize, Option<Arc<Definition>>);

/// Channels and definitions of all segments, each once.
#[derive(Default)]
struct Catalogue {
    channels: Vec<Channel>,
    counts: Vec<u64>,
    definitions: Vec<Arc<Definition>>,
    schemas: BTreeMap<Arc<Schema>, (usize, Option<Arc<Definition>>)>,
    /// By topic, encoding, stream and number of the schema.
    numbers: BTreeMap<(String, String, Option<Stream>, Option<usize>), u32>,
}

impl Catalogue {
    /// Adds a segment's channels; of each of its channel ids, gives the number in the list of all.
    fn add(&mut self, segment: &Segment, damage: &mut Vec<ReadError>) -> Vec<Option<u32>> {
        let schemas: BTreeMap<u16, Interned> =
            segment.schemas.iter().map(|(id, schema)| (*id, self.schema(schema))).collect();
        let length = segment.channels.keys().next_back().map_or(0, |id| usize::from(*id) + 1);
        let mut numbers = vec![None; length];
        for (id, raw) in &segment.channels {
            let stream = segment.ours.then(|| Stream::from_metadata(&raw.topic, &raw.metadata)).transpose();
            let stream = stream.unwrap_or_else(|source| {
                damage.push(ReadError::Format { path: segment.source.path.clone(), source });
                None
            });
            let schema = schemas.get(&raw.schema);
            let key = (raw.topic.clone(), raw.encoding.clone(), stream, schema.map(|(_, number, _)| *number));
            let number = match self.numbers.get(&key) {
                Some(number) => *number,
                None => {
                    let number = self.channels.len() as u32;
                    // A definition that is not the one the sender named would make something else of its
                    // bodies.
                    let named = key.2.as_ref().map(|stream| stream.schema_id);
                    let definition = schema.and_then(|(_, _, definition)| definition.clone());
                    self.channels.push(Channel {
                        id: number,
                        topic: key.0.clone(),
                        message_encoding: key.1.clone(),
                        stream: key.2.clone(),
                        definition: definition.filter(|found| named.is_none_or(|id| id == found.id)),
                        schema: schema.map(|(schema, ..)| Arc::clone(schema)),
                    });
                    self.counts.push(0);
                    self.numbers.insert(key, number);
                    number
                }
            };
            let sum = &mut self.counts[number as usize];
            *sum = sum.saturating_add(segment.counts.get(id).copied().unwrap_or(0));
            numbers[usize::from(*id)] = Some(number);
        }
        numbers
    }

    fn schema(&mut self, raw: &record::Schema) -> Interned {
        let (name, encoding, data) = (raw.name.clone(), raw.encoding.clone(), raw.data.clone());
        let schema = Arc::new(Schema { name, encoding, data });
        if let Some((there, (number, definition))) = self.schemas.get_key_value(&schema) {
            return (Arc::clone(there), *number, definition.clone());
        }
        let number = self.schemas.len();
        let text = std::str::from_utf8(&schema.data).ok().filter(|_| schema.encoding == SCHEMA_ENCODING);
        let definition = text.map(|text| {
            let id = reflect::fnv1a_64(&[schema.name.as_bytes(), &[0], text.as_bytes()]);
            Arc::new(Definition { id, name: schema.name.clone(), text: text.to_owned() })
        });
        self.definitions.extend(definition.clone());
        self.schemas.insert(Arc::clone(&schema), (number, definition.clone()));
        (schema, number, definition)
    }
}
