//! Two bodies side by side, field by field.

use std::collections::BTreeMap;

use reflect::Value;
use schemas::Topic;
use serde::Serialize;

/// A sequence of more bytes than this is shown in one row, in hexadecimal.
const BYTES_APART_MAX: usize = 8;

/// One message as it was recorded, beside the one that is said now.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Comparison {
    /// The topic.
    pub topic: String,
    /// The message's number on it.
    pub sequence: u64,
    /// Whether the recording has it.
    pub is_recorded: bool,
    /// Whether it is said now.
    pub is_produced: bool,
    /// Its fields, in wire order.
    pub fields: Vec<FieldPair>,
}

/// One field of two messages.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FieldPair {
    /// Names and indices, with dots between.
    pub path: String,
    /// What is recorded.
    pub recorded: Option<String>,
    /// What is said now.
    pub produced: Option<String>,
}

/// A body with the id of its type.
#[derive(Clone, Copy, Debug)]
pub(super) struct Typed<'a> {
    pub schema_id: u64,
    pub body: &'a [u8],
}

impl Comparison {
    /// The fields that differ.
    pub fn differing(&self) -> impl Iterator<Item = &FieldPair> {
        self.fields.iter().filter(|field| field.differs())
    }
}

impl FieldPair {
    /// Whether there is a difference.
    #[must_use]
    pub fn differs(&self) -> bool {
        self.recorded != self.produced
    }
}

/// The message types of the recording, for bodies whose type is another today.
#[derive(Debug, Default)]
pub(super) struct Types(BTreeMap<u64, reflect::Definition>);

impl Types {
    /// Takes note of a definition; one that cannot be understood only leaves bodies of its type undecoded.
    pub fn define(&mut self, definition: &crate::Definition) {
        if let Ok(parsed) = reflect::Definition::parse(&definition.name, &definition.text) {
            self.0.insert(definition.id, parsed);
        }
    }

    /// A body's fields: path and value. One that does not decode is one field, its bytes.
    pub fn fields_of(&self, topic: &Topic, typed: Typed<'_>) -> Vec<(String, String)> {
        let Typed { schema_id, body } = typed;
        let decoded = if schema_id == topic.schema_id() {
            Value::decode(topic.schema, body).map_err(|error| error.to_string())
        } else if let Some(definition) = self.0.get(&schema_id) {
            definition.decode(body).map_err(|error| error.to_string())
        } else {
            Err(format!("its type {schema_id:016x} is not today's {:016x}", topic.schema_id()))
        };
        let mut fields = Vec::new();
        match decoded {
            Ok(value) => flatten(&value, &mut String::new(), &mut fields),
            Err(error) => fields.push(("(undecoded)".to_owned(), format!("{} ({error})", hexadecimal(body)))),
        }
        fields
    }
}

/// What is recorded beside what is said now.
pub(super) fn compare(
    types: &Types,
    topic: &Topic,
    sequence: u64,
    recorded: Option<Typed<'_>>,
    produced: Option<&[u8]>,
) -> Comparison {
    let now = topic.schema_id();
    let mut fields = pairs(
        recorded.map(|typed| types.fields_of(topic, typed)),
        produced.map(|body| types.fields_of(topic, Typed { schema_id: now, body })),
    );
    if let (Some(recorded), Some(produced)) = (recorded, produced)
        && recorded.body != produced
        && !fields.iter().any(FieldPair::differs)
    {
        // Bytes that no field shows.
        let (recorded, produced) = (Some(hexadecimal(recorded.body)), Some(hexadecimal(produced)));
        fields.push(FieldPair { path: "(bytes)".to_owned(), recorded, produced });
    }
    Comparison {
        topic: topic.name.to_owned(),
        sequence,
        is_recorded: recorded.is_some(),
        is_produced: produced.is_some(),
        fields,
    }
}

fn flatten(value: &Value<'_>, path: &mut String, fields: &mut Vec<(String, String)>) {
    let length = path.len();
    let mut descend = |step: &str, inner: &Value<'_>, path: &mut String| {
        if !path.is_empty() {
            path.push('.');
        }
        path.push_str(step);
        flatten(inner, path, fields);
        path.truncate(length);
    };
    match value {
        Value::Record(inner) => {
            for (name, inner) in inner {
                descend(name, inner, path);
            }
        }
        Value::Seq(elements) => match bytes_of(elements) {
            Some(bytes) => fields.push((path.clone(), hexadecimal(&bytes))),
            None if elements.is_empty() => fields.push((path.clone(), "[]".to_owned())),
            None => {
                for (index, inner) in elements.iter().enumerate() {
                    descend(&index.to_string(), inner, path);
                }
            }
        },
        leaf => fields.push((path.clone(), text_of(leaf))),
    }
}

/// A long sequence of numbers that all fit a byte.
fn bytes_of(elements: &[Value<'_>]) -> Option<Vec<u8>> {
    let byte = |element: &Value<'_>| match element {
        Value::Unsigned(value) => u8::try_from(*value).ok(),
        _ => None,
    };
    (elements.len() > BYTES_APART_MAX).then(|| elements.iter().map(byte).collect()).flatten()
}

fn text_of(leaf: &Value<'_>) -> String {
    match leaf {
        Value::Bool(value) => value.to_string(),
        Value::Signed(value) => value.to_string(),
        Value::Unsigned(value) => value.to_string(),
        // The shortest digits that read back to the same bits: other bits, other digits.
        Value::F32(value) => format!("{value:?}"),
        Value::F64(value) => format!("{value:?}"),
        Value::Time { sec, nsec } => format!("{sec}.{nsec:09}"),
        Value::Duration { sec, nsec } => format!("{sec} s {nsec:+} ns"),
        Value::Text(text) => format!("{text:?}"),
        Value::Enumeration { value, name } => format!("{name} ({value})"),
        Value::Seq(_) | Value::Record(_) => String::new(),
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        // A string takes whatever is written to it.
        let _ = write!(text, "{byte:02x}");
    }
    text
}

/// Pairs fields by their paths, in the order of the recorded ones, those that only the other has after them.
fn pairs(recorded: Option<Vec<(String, String)>>, produced: Option<Vec<(String, String)>>) -> Vec<FieldPair> {
    let mut produced = produced.unwrap_or_default();
    let mut found = Vec::new();
    for (place, (path, value)) in recorded.unwrap_or_default().into_iter().enumerate() {
        // Of one type, they stand at one place.
        let same = |(candidate, _): &(String, String)| *candidate == path;
        let other = match produced.get_mut(place) {
            Some(pair) if same(pair) => Some(pair),
            _ => produced.iter_mut().find(|pair| same(pair)),
        };
        let produced = other.map(|(path, value)| {
            path.clear();
            std::mem::take(value)
        });
        found.push(FieldPair { path, recorded: Some(value), produced });
    }
    let only_now = produced.into_iter().filter(|(path, _)| !path.is_empty());
    found.extend(only_now.map(|(path, value)| FieldPair { path, recorded: None, produced: Some(value) }));
    found
}

#[cfg(test)]
mod tests {
    use schemas::{DeviceBytes, NodeEvent, Severity, topics};

    use super::*;

    fn body(event: &NodeEvent) -> Vec<u8> {
        let mut body = Vec::new();
        wire::encode(event, &mut body).unwrap();
        body
    }

    #[test]
    fn what_differs_is_named_by_its_path() {
        let mut event = NodeEvent { severity: Severity::Info, vehicle: 3, ..NodeEvent::default() };
        let then = body(&event);
        event.vehicle = 4;
        let now = body(&event);
        let topic = &topics::NODE_EVENT;
        let recorded = Typed { schema_id: topic.schema_id(), body: &then };
        let comparison = compare(&Types::default(), topic, 7, Some(recorded), Some(&now));
        let differing: Vec<_> = comparison.differing().collect();
        assert_eq!(differing.len(), 1, "{comparison:?}");
        assert_eq!(differing[0].path, "vehicle");
        assert_eq!(differing[0].recorded.as_deref(), Some("3"));
        assert_eq!(differing[0].produced.as_deref(), Some("4"));
    }

    #[test]
    fn a_message_that_only_one_has_differs_in_every_field() {
        let now = body(&NodeEvent::default());
        let comparison = compare(&Types::default(), &topics::NODE_EVENT, 1, None, Some(&now));
        assert!(!comparison.fields.is_empty());
        assert_eq!(comparison.differing().count(), comparison.fields.len());
        assert!(!comparison.is_recorded && comparison.is_produced);
    }

    #[test]
    fn bytes_are_one_row_and_bodies_of_another_type_are_shown_as_they_are() {
        let topic = &topics::RADIO_TX;
        let bytes = DeviceBytes { bytes: vec![0xab; 100].try_into().unwrap(), ..DeviceBytes::default() };
        let mut body = Vec::new();
        wire::encode(&bytes, &mut body).unwrap();
        let fields = Types::default().fields_of(topic, Typed { schema_id: topic.schema_id(), body: &body });
        assert!(fields.contains(&("bytes".to_owned(), "ab".repeat(100))), "{fields:?}");
        let fields = Types::default().fields_of(topic, Typed { schema_id: 1, body: &body });
        assert_eq!(fields.len(), 1);
        assert!(fields[0].1.starts_with(&hexadecimal(&body)), "{fields:?}");
    }
}
