//! The fields that were asked for, ready to be read from the messages of each channel.

use reflect::{Definition, DefinitionError, FieldReader, Leaf, Shape};

use super::{Address, ExportError, Outcome, Wanted};
use crate::read::Recording;

/// The field by which messages name their vehicle.
const VEHICLE: &str = "vehicle";

/// The definitions of a recording's channels, parsed, by the channel's number.
#[derive(Debug)]
pub struct Types(Vec<Option<Result<Definition, DefinitionError>>>);

/// One field of one topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// The topic.
    pub topic: String,
    /// The path of the field.
    pub path: String,
    /// Its unit.
    pub unit: Option<String>,
}

/// Fields, and how to read them from the messages of each channel.
#[derive(Debug)]
pub struct Columns {
    /// The fields, in the order in which they were asked for.
    pub columns: Vec<Column>,
    /// Whether messages name their vehicle, and no single vehicle was asked for.
    pub by_vehicle: bool,
    readers: Vec<Option<Readers>>,
    wanted_vehicle: Option<u64>,
}

/// How to read a channel's messages.
#[derive(Debug)]
struct Readers {
    vehicle: Option<FieldReader>,
    /// By place among the columns; `None` for those of other topics, and for fields that this version lacks.
    fields: Vec<(usize, FieldReader)>,
}

impl Types {
    /// Parses the definitions of a recording.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let parse = |channel: &crate::read::Channel| {
            channel.definition.as_ref().map(|given| Definition::parse(&given.name, &given.text))
        };
        Self(recording.channels().iter().map(parse).collect())
    }

    /// The definition of a channel's messages.
    #[must_use]
    pub fn get(&self, channel: u32) -> Option<&Definition> {
        self.0.get(channel as usize)?.as_ref()?.as_ref().ok()
    }

    pub(crate) fn note_bad(&self, recording: &Recording, outcome: &mut Outcome) {
        for (channel, parsed) in recording.channels().iter().zip(&self.0) {
            if let Some(Err(error)) = parsed {
                outcome.note_bad_definition(channel, error);
            }
        }
    }
}

impl Columns {
    /// The columns for what is wanted. A topic without a field stands for all its fields, a field with parts
    /// for all its parts.
    ///
    /// # Errors
    /// A topic or a field that is not there.
    pub fn new(recording: &Recording, types: &Types, wanted: &Wanted) -> Result<Self, ExportError> {
        let mut columns: Vec<Column> = Vec::new();
        for address in addresses(recording, wanted) {
            // The column of vehicles says it already.
            let doubled = |column: &Column| {
                address.field.is_none() && wanted.vehicle.is_none() && column.path == VEHICLE
            };
            for column in expand(recording, types, &address)? {
                if !columns.contains(&column) && !doubled(&column) {
                    columns.push(column);
                }
            }
        }
        Self::with(columns, recording, types, wanted)
    }

    fn with(
        columns: Vec<Column>,
        recording: &Recording,
        types: &Types,
        wanted: &Wanted,
    ) -> Result<Self, ExportError> {
        let selection = wanted.selection();
        let mut readers: Vec<Option<Readers>> = Vec::new();
        for channel in recording.channels() {
            let definition = types.get(channel.id).filter(|_| selection.wants(channel));
            readers.push(definition.map(|definition| {
                Readers {
                    vehicle: vehicle_of(definition),
                    fields: columns
                        .iter()
                        .enumerate()
                        .filter(|(_, column)| column.topic == channel.topic)
                        .filter_map(|(place, column)| Some((place, definition.field(&column.path).ok()?)))
                        .collect(),
                }
            }));
        }
        let named = readers.iter().flatten().any(|readers| readers.vehicle.is_some());
        if wanted.vehicle.is_some() && !named {
            return Err(ExportError::NoVehicle { topics: selection.topics });
        }
        let by_vehicle = wanted.vehicle.is_none() && named;
        Ok(Self { columns, by_vehicle, readers, wanted_vehicle: wanted.vehicle })
    }

    /// No columns: only which messages are wanted.
    pub(crate) fn without_fields(
        recording: &Recording,
        types: &Types,
        wanted: &Wanted,
    ) -> Result<Self, ExportError> {
        Self::with(Vec::new(), recording, types, wanted)
    }

    /// Whether the channel's messages can be read.
    #[must_use]
    pub fn knows(&self, channel: u32) -> bool {
        self.readers.get(channel as usize).is_some_and(Option::is_some)
    }

    /// The vehicle that a message names; nothing where it names none, or cannot be read.
    #[must_use]
    pub fn vehicle(&self, channel: u32, body: &[u8]) -> Option<u64> {
        let reader = self.readers.get(channel as usize)?.as_ref()?.vehicle.as_ref()?;
        reader.read(body).ok()??.number().map(|number| number as u64)
    }

    /// Whether a message is one of those that were asked for.
    #[must_use]
    pub fn wants(&self, channel: u32, body: &[u8]) -> bool {
        self.wanted_vehicle.is_none_or(|wanted| self.vehicle(channel, body) == Some(wanted))
    }

    /// The fields of a channel's messages: place among the columns, and how to read it.
    pub fn fields(&self, channel: u32) -> impl Iterator<Item = (usize, &FieldReader)> {
        let readers = self.readers.get(channel as usize).and_then(Option::as_ref);
        readers.into_iter().flat_map(|readers| readers.fields.iter().map(|(place, reader)| (*place, reader)))
    }
}

/// How to read which vehicle a message speaks of.
fn vehicle_of(definition: &Definition) -> Option<FieldReader> {
    definition.field(VEHICLE).ok().filter(FieldReader::is_whole_number)
}

/// What was asked for, or everything.
fn addresses(recording: &Recording, wanted: &Wanted) -> Vec<Address> {
    if !wanted.addresses.is_empty() {
        return wanted.addresses.clone();
    }
    let mut topics: Vec<&str> = recording
        .channels()
        .iter()
        .filter(|channel| channel.definition.is_some())
        .map(|channel| channel.topic.as_str())
        .collect();
    topics.sort_unstable();
    topics.dedup();
    topics.into_iter().map(|topic| Address { topic: topic.to_owned(), field: None }).collect()
}

/// The columns of an address, over all versions of the topic's type.
fn expand(recording: &Recording, types: &Types, address: &Address) -> Result<Vec<Column>, ExportError> {
    let topic = &address.topic;
    let channels = recording.channels().iter().filter(|channel| channel.topic == *topic);
    let mut columns: Vec<Column> = Vec::new();
    let mut refused = ExportError::NoDefinition { topic: topic.clone() };
    for definition in channels.filter_map(|channel| types.get(channel.id)) {
        match leaves(definition, address) {
            Ok(leaves) => {
                let new =
                    leaves.into_iter().map(|Leaf { path, unit }| Column { topic: topic.clone(), path, unit });
                let new: Vec<Column> = new.filter(|column| !columns.contains(column)).collect();
                columns.extend(new);
            }
            Err(error) => refused = error,
        }
    }
    if columns.is_empty() { Err(refused) } else { Ok(columns) }
}

fn leaves(definition: &Definition, address: &Address) -> Result<Vec<Leaf>, ExportError> {
    let topic = || address.topic.clone();
    let all = || definition.leaves().ok_or_else(|| ExportError::TooWide { topic: topic() });
    let Some(field) = &address.field else { return all() };
    let reader = definition.field(field).map_err(|source| ExportError::NoField { topic: topic(), source })?;
    if matches!(reader.shape(), Shape::Record(_) | Shape::Array { .. }) {
        let below = format!("{field}.");
        let leaves: Vec<Leaf> = all()?.into_iter().filter(|leaf| leaf.path.starts_with(&below)).collect();
        if !leaves.is_empty() {
            return Ok(leaves);
        }
    }
    Ok(vec![Leaf { path: field.clone(), unit: reader.unit().map(str::to_owned) }])
}
