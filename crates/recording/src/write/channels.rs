//! Which channel a message belongs on, and which definition the channel has.

use std::collections::BTreeMap;

use mcap::write::NoSeek;
use wire::Kind;

use super::{WriteError, Writing};
use crate::{Definition, Entry, MESSAGE_ENCODING, SCHEMA_ENCODING, Stream};

/// Channels of senders whose tags were checked. The format counts to 65 535; an arena has some hundreds.
const VERIFIED_MAX: usize = 32_768;
/// Channels of senders that anybody on the network can pretend to be: they must not use up the others' room.
const UNVERIFIED_MAX: usize = 2048;
/// Definitions. Only nodes can announce them.
const DEFINITIONS_MAX: usize = 8192;

/// What tells most streams apart, compared without an allocation; two topics of one hash share a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    topic_hash: u32,
    source: u32,
    schema_id: u64,
    incarnation: u32,
    run: u64,
}

/// The channels of one file.
#[derive(Debug, Default)]
pub(super) struct Channels {
    places: BTreeMap<Place, Vec<(Stream, u16)>>,
    /// The library's number of each definition.
    definitions: BTreeMap<u64, u16>,
    verified: usize,
    unverified: usize,
}

impl Channels {
    pub(super) fn knows(&self, schema_id: u64) -> bool {
        self.definitions.contains_key(&schema_id)
    }

    /// Writes a definition, if it was not.
    pub(super) fn define(
        &mut self,
        mcap: &mut mcap::Writer<NoSeek<Writing>>,
        definition: &Definition,
    ) -> Result<(), WriteError> {
        if self.knows(definition.id) {
            return Ok(());
        }
        if self.definitions.len() >= DEFINITIONS_MAX {
            return Err(WriteError::NoRoom { topic: definition.name.clone(), channels: DEFINITIONS_MAX });
        }
        let id = mcap
            .add_schema(&definition.name, SCHEMA_ENCODING, definition.text.as_bytes())
            .map_err(WriteError::Format)?;
        self.definitions.insert(definition.id, id);
        // Streams that had to do without get a channel with it.
        self.places.retain(|place, _| place.schema_id != definition.id);
        Ok(())
    }

    /// The message's channel, written if it was not.
    pub(super) fn id_of(
        &mut self,
        mcap: &mut mcap::Writer<NoSeek<Writing>>,
        entry: &Entry<'_>,
    ) -> Result<u16, WriteError> {
        let place = Place::of(entry);
        let known = self.places.get(&place).into_iter().flatten();
        if let Some((_, id)) = known.into_iter().find(|(stream, _)| is_of(stream, entry)) {
            return Ok(*id);
        }
        let (count, limit) = if entry.verified {
            (&mut self.verified, VERIFIED_MAX)
        } else {
            (&mut self.unverified, UNVERIFIED_MAX)
        };
        if *count >= limit {
            return Err(WriteError::NoRoom { topic: entry.topic.to_owned(), channels: limit });
        }
        let stream = Stream::of(entry);
        let schema = self.definitions.get(&stream.schema_id).copied().unwrap_or(0);
        let id = mcap
            .add_channel(schema, &stream.topic, MESSAGE_ENCODING, &stream.metadata())
            .map_err(WriteError::Format)?;
        *count += 1;
        self.places.entry(place).or_default().push((stream, id));
        Ok(id)
    }
}

impl Place {
    fn of(entry: &Entry<'_>) -> Self {
        let header = entry.header;
        Self {
            topic_hash: reflect::fnv1a_32(entry.topic.as_bytes()),
            source: header.source,
            schema_id: header.schema_id,
            incarnation: header.incarnation,
            run: header.run,
        }
    }
}

/// Whether a message is of a stream whose place it has.
fn is_of(stream: &Stream, entry: &Entry<'_>) -> bool {
    let header = entry.header;
    let kind = if header.kind == Kind::Journal { Kind::Journal } else { Kind::Data };
    let of_stream = if stream.kind == Kind::Journal { Kind::Journal } else { Kind::Data };
    stream.topic == entry.topic
        && of_stream == kind
        && stream.domain == header.domain
        && stream.latched == header.latched
        && stream.verified == entry.verified
}
