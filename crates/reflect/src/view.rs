//! A body read without its Rust type: by its [`Schema`], or by a [`Definition`](crate::Definition) met at run
//! time.

mod cursor;
mod primitive;

use core::fmt;

use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};

pub(crate) use cursor::{Cursor, DEPTH_MAX};
pub use primitive::Primitive;

use crate::{EnumSchema, Kind, Schema};

/// A value of any message; the names in it are those of the schema or definition it was read by. Serialises
/// into what JSON readers expect: maps by field name, enumerations by name, times as `{sec, nsec}`.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'n> {
    /// True or false.
    Bool(bool),
    /// A signed number of any width.
    Signed(i64),
    /// An unsigned number of any width.
    Unsigned(u64),
    /// A float of four bytes.
    F32(f32),
    /// A float of eight bytes.
    F64(f64),
    /// An instant of the arena's clock.
    Time {
        /// Whole seconds.
        sec: u32,
        /// Nanoseconds past them.
        nsec: u32,
    },
    /// A signed length of time. No message of ours has one; those of others may.
    Duration {
        /// Whole seconds.
        sec: i32,
        /// Nanoseconds past them.
        nsec: i32,
    },
    /// Text.
    Text(String),
    /// The elements of a sequence or an array.
    Seq(Vec<Self>),
    /// The fields of a message, in wire order.
    Record(Vec<(&'n str, Self)>),
    /// A named value.
    Enumeration {
        /// The number on the wire.
        value: u32,
        /// Its name.
        name: &'n str,
    },
}

/// Why a body is not one of its schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewError {
    /// The body ends before its last field.
    Short {
        /// Bytes a value needed.
        needed: usize,
        /// Bytes that were left.
        left: usize,
    },
    /// Bytes left after the last field.
    Trailing {
        /// How many.
        left: usize,
    },
    /// A text or sequence longer than its bound.
    TooLong {
        /// Its length.
        length: u32,
        /// Its bound.
        bound: u32,
    },
    /// A `bool` neither 0 nor 1.
    NotBool {
        /// The byte.
        value: u8,
    },
    /// Text that is not UTF-8.
    NotUtf8,
    /// A number without a name.
    UnknownValue {
        /// The enumeration.
        enumeration: String,
        /// The number.
        value: u32,
    },
    /// A time of a second or more past its second.
    BadTime {
        /// Its nanoseconds.
        nsec: u32,
    },
    /// Messages nested too deep, or too many values.
    TooComplex,
}

impl Value<'static> {
    /// Reads a body by its schema.
    ///
    /// # Errors
    /// A [`ViewError`] for every body that the schema's Rust type would not decode either, and for one of
    /// absurd size. One thing is not checked here, since this is for looking, not for acting: a quaternion's
    /// length, and that floats are finite.
    pub fn decode(schema: &'static Schema, body: &[u8]) -> Result<Self, ViewError> {
        let mut cursor = Cursor::new(body);
        let value = record(&mut cursor, schema, 0)?;
        cursor.end()?;
        Ok(value)
    }
}

impl Value<'_> {
    /// The value at a path of field names and indices: `bodies.0.position_m.x`.
    #[must_use]
    pub fn at(&self, path: &str) -> Option<&Self> {
        path.split('.').try_fold(self, |value, step| match value {
            Self::Record(fields) => fields.iter().find(|(name, _)| *name == step).map(|(_, value)| value),
            Self::Seq(elements) => elements.get(step.parse::<usize>().ok()?),
            _ => None,
        })
    }

    /// The number this value stands for, for plotting: times in seconds, enumerations by value.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        Some(match *self {
            Self::Bool(value) => f64::from(u8::from(value)),
            Self::Signed(value) => value as f64,
            Self::Unsigned(value) => value as f64,
            Self::F32(value) => f64::from(value),
            Self::F64(value) => value,
            Self::Time { sec, nsec } => f64::from(sec) + f64::from(nsec) * 1e-9,
            Self::Duration { sec, nsec } => f64::from(sec) + f64::from(nsec) * 1e-9,
            Self::Enumeration { value, .. } => f64::from(value),
            Self::Text(_) | Self::Seq(_) | Self::Record(_) => return None,
        })
    }
}

fn record(cursor: &mut Cursor<'_>, schema: &'static Schema, depth: u32) -> Result<Value<'static>, ViewError> {
    cursor.check_depth(depth)?;
    let mut fields = Vec::with_capacity(schema.fields.len());
    for field in schema.fields {
        fields.push((field.name, value(cursor, &field.kind, depth)?));
    }
    Ok(Value::Record(fields))
}

fn value(cursor: &mut Cursor<'_>, kind: &Kind, depth: u32) -> Result<Value<'static>, ViewError> {
    cursor.count_value()?;
    Ok(match *kind {
        Kind::Text { bound } => Value::Text(cursor.text(bound)?.to_owned()),
        Kind::Seq { element, bound } => {
            let count = cursor.count(bound)?;
            elements(cursor, element, count, depth)?
        }
        Kind::Array { element, length } => elements(cursor, element, length, depth)?,
        Kind::Message(schema) => record(cursor, schema, depth + 1)?,
        Kind::Enumeration(schema) => enumeration(cursor, schema)?,
        Kind::Bool => cursor.primitive(Primitive::Bool)?,
        Kind::I8 => cursor.primitive(Primitive::I8)?,
        Kind::I16 => cursor.primitive(Primitive::I16)?,
        Kind::I32 => cursor.primitive(Primitive::I32)?,
        Kind::I64 => cursor.primitive(Primitive::I64)?,
        Kind::U8 => cursor.primitive(Primitive::U8)?,
        Kind::U16 => cursor.primitive(Primitive::U16)?,
        Kind::U32 => cursor.primitive(Primitive::U32)?,
        Kind::U64 => cursor.primitive(Primitive::U64)?,
        Kind::F32 => cursor.primitive(Primitive::F32)?,
        Kind::F64 => cursor.primitive(Primitive::F64)?,
        Kind::Time => cursor.primitive(Primitive::Time)?,
    })
}

fn elements(
    cursor: &mut Cursor<'_>,
    element: &Kind,
    count: u32,
    depth: u32,
) -> Result<Value<'static>, ViewError> {
    // No reservation by a count that the body may not hold: the vector grows as elements are found.
    let mut elements = Vec::new();
    for _ in 0..count {
        elements.push(value(cursor, element, depth)?);
    }
    Ok(Value::Seq(elements))
}

fn enumeration(cursor: &mut Cursor<'_>, schema: &'static EnumSchema) -> Result<Value<'static>, ViewError> {
    let value = if schema.width == 1 { cursor.u8()?.into() } else { cursor.u32()? };
    match schema.name_of(value) {
        Some(name) => Ok(Value::Enumeration { value, name }),
        None => Err(ViewError::UnknownValue { enumeration: schema.name.to_owned(), value }),
    }
}

impl Serialize for Value<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Signed(value) => serializer.serialize_i64(*value),
            Self::Unsigned(value) => serializer.serialize_u64(*value),
            Self::F32(value) => serializer.serialize_f32(*value),
            Self::F64(value) => serializer.serialize_f64(*value),
            Self::Time { sec, nsec } => {
                let mut map = serializer.serialize_map(Some(2))?;
                map.serialize_entry("sec", sec)?;
                map.serialize_entry("nsec", nsec)?;
                map.end()
            }
            Self::Duration { sec, nsec } => {
                let mut map = serializer.serialize_map(Some(2))?;
                map.serialize_entry("sec", sec)?;
                map.serialize_entry("nsec", nsec)?;
                map.end()
            }
            Self::Text(text) => serializer.serialize_str(text),
            Self::Seq(elements) => {
                let mut seq = serializer.serialize_seq(Some(elements.len()))?;
                for element in elements {
                    seq.serialize_element(element)?;
                }
                seq.end()
            }
            Self::Record(fields) => {
                let mut map = serializer.serialize_map(Some(fields.len()))?;
                for (name, value) in fields {
                    map.serialize_entry(name, value)?;
                }
                map.end()
            }
            Self::Enumeration { name, .. } => serializer.serialize_str(name),
        }
    }
}

impl fmt::Display for ViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { needed, left } => write!(f, "a value needs {needed} bytes and {left} are left"),
            Self::Trailing { left } => write!(f, "{left} bytes after the last field"),
            Self::TooLong { length, bound } => write!(f, "length {length} exceeds the bound {bound}"),
            Self::NotBool { value } => write!(f, "{value} is no bool"),
            Self::NotUtf8 => f.write_str("text that is not UTF-8"),
            Self::UnknownValue { enumeration, value } => write!(f, "{value} is no value of {enumeration}"),
            Self::BadTime { nsec } => write!(f, "{nsec} ns past the second of a time"),
            Self::TooComplex => f.write_str("messages nested too deep, or too many values"),
        }
    }
}

impl core::error::Error for ViewError {}
