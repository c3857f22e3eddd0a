//! One message as one line of JSON.

use quantity::Time;
use reflect::Value;
use serde::{Serialize, Serializer};

/// A message as one JSON object. The same for messages of a file and for those of a live bus.
#[derive(Debug, Serialize)]
pub struct Line<'a> {
    /// The topic.
    pub topic: &'a str,
    /// When it arrived, ns on the arena's clock.
    #[serde(serialize_with = "nanos")]
    pub at_ns: Time,
    /// When it was sent, ns on its sender's clock.
    #[serde(serialize_with = "nanos")]
    pub published_at_ns: Time,
    /// When it arrived, in seconds since the recording was begun.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// Who sent it, in hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "hexadecimal")]
    pub source: Option<u32>,
    /// The sender's incarnation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub incarnation: Option<u32>,
    /// Its number; of a recorded message the low 32 bits.
    pub sequence: u64,
    /// Whether its tag was checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verified: Option<bool>,
    /// Its type.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    pub type_name: Option<&'a str>,
    /// What it says.
    #[serde(flatten)]
    pub content: Content<'a>,
}

/// What a line says of a message's body.
#[derive(Debug)]
pub enum Content<'a> {
    /// All of it.
    Body(Value<'a>),
    /// Some fields, by path; `None` where a sequence has no such element.
    Fields(Vec<(&'a str, Option<Value<'a>>)>),
    /// Its bytes, and why they could not be read.
    Raw(&'a [u8], String),
}

impl Line<'_> {
    /// Appends the line, with its end.
    pub fn write(&self, out: &mut Vec<u8>) {
        serde_json::to_writer(&mut *out, self)
            .expect("writing to memory does not fail, and every key is text");
        out.push(b'\n');
    }
}

impl Serialize for Content<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let mut map = serializer.serialize_map(None)?;
        match self {
            Self::Body(value) => map.serialize_entry("body", value)?,
            Self::Fields(fields) => map.serialize_entry("fields", &Fields(fields))?,
            Self::Raw(bytes, reason) => {
                map.serialize_entry("raw", &Hexadecimal(bytes))?;
                map.serialize_entry("error", reason)?;
            }
        }
        map.end()
    }
}

struct Fields<'f>(&'f [(&'f str, Option<Value<'f>>)]);

impl Serialize for Fields<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(path, value)| (path, value)))
    }
}

struct Hexadecimal<'b>(&'b [u8]);

impl Serialize for Hexadecimal<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let digits =
            |byte: &u8| [byte >> 4, byte & 15].map(|digit| char::from_digit(digit.into(), 16).unwrap_or('0'));
        serializer.serialize_str(&self.0.iter().flat_map(digits).collect::<String>())
    }
}

fn nanos<S: Serializer>(time: &Time, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_i64(time.as_nanos())
}

fn hexadecimal<S: Serializer>(number: &Option<u32>, serializer: S) -> Result<S::Ok, S::Error> {
    match number {
        Some(number) => serializer.serialize_str(&format!("{number:08x}")),
        None => serializer.serialize_none(),
    }
}
