//! A body read by its schema, without its Rust type.

use core::fmt;

use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};

use crate::{EnumSchema, Kind, Schema};

/// Messages within messages, at most.
const DEPTH_MAX: u32 = 16;
/// Values in one body, at most.
const VALUES_MAX: u32 = 65_536;

/// A value of any message. Serialises into what JSON readers expect: maps by field name, enumerations by
/// name, times as `{sec, nsec}`.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
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
    /// Text.
    Text(String),
    /// The elements of a sequence or an array.
    Seq(Vec<Self>),
    /// The fields of a message, in wire order.
    Record(Vec<(&'static str, Self)>),
    /// A named value.
    Enumeration {
        /// The number on the wire.
        value: u32,
        /// Its name.
        name: &'static str,
    },
}

/// Why a body is not one of its schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
        enumeration: &'static str,
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

impl Value {
    /// Reads a body by its schema.
    ///
    /// # Errors
    /// A [`ViewError`] for every body that the schema's Rust type would not decode either, and for one of
    /// absurd size. One thing is not checked here, since this is for looking, not for acting: a quaternion's
    /// length, and that floats are finite.
    pub fn decode(schema: &'static Schema, body: &[u8]) -> Result<Self, ViewError> {
        let mut reader = Reader { rest: body, values: 0 };
        let value = reader.record(schema, 0)?;
        if reader.rest.is_empty() { Ok(value) } else { Err(ViewError::Trailing { left: reader.rest.len() }) }
    }

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
            Self::Enumeration { value, .. } => f64::from(value),
            Self::Text(_) | Self::Seq(_) | Self::Record(_) => return None,
        })
    }
}

struct Reader<'a> {
    rest: &'a [u8],
    values: u32,
}

impl<'a> Reader<'a> {
    fn bytes(&mut self, needed: usize) -> Result<&'a [u8], ViewError> {
        let left = self.rest.len();
        let (taken, rest) = self.rest.split_at_checked(needed).ok_or(ViewError::Short { needed, left })?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ViewError> {
        let left = self.rest.len();
        let (taken, rest) = self.rest.split_first_chunk().ok_or(ViewError::Short { needed: N, left })?;
        self.rest = rest;
        Ok(*taken)
    }

    fn u32(&mut self) -> Result<u32, ViewError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn count(&mut self, bound: u32) -> Result<u32, ViewError> {
        let length = self.u32()?;
        if length > bound { Err(ViewError::TooLong { length, bound }) } else { Ok(length) }
    }

    fn record(&mut self, schema: &'static Schema, depth: u32) -> Result<Value, ViewError> {
        if depth > DEPTH_MAX {
            return Err(ViewError::TooComplex);
        }
        let mut fields = Vec::with_capacity(schema.fields.len());
        for field in schema.fields {
            fields.push((field.name, self.value(&field.kind, depth)?));
        }
        Ok(Value::Record(fields))
    }

    fn value(&mut self, kind: &Kind, depth: u32) -> Result<Value, ViewError> {
        self.values += 1;
        if self.values > VALUES_MAX {
            return Err(ViewError::TooComplex);
        }
        Ok(match *kind {
            Kind::Bool => match self.array()? {
                [0] => Value::Bool(false),
                [1] => Value::Bool(true),
                [value] => return Err(ViewError::NotBool { value }),
            },
            Kind::I8 => Value::Signed(i8::from_le_bytes(self.array()?).into()),
            Kind::I16 => Value::Signed(i16::from_le_bytes(self.array()?).into()),
            Kind::I32 => Value::Signed(i32::from_le_bytes(self.array()?).into()),
            Kind::I64 => Value::Signed(i64::from_le_bytes(self.array()?)),
            Kind::U8 => Value::Unsigned(u8::from_le_bytes(self.array()?).into()),
            Kind::U16 => Value::Unsigned(u16::from_le_bytes(self.array()?).into()),
            Kind::U32 => Value::Unsigned(self.u32()?.into()),
            Kind::U64 => Value::Unsigned(u64::from_le_bytes(self.array()?)),
            Kind::F32 => Value::F32(f32::from_le_bytes(self.array()?)),
            Kind::F64 => Value::F64(f64::from_le_bytes(self.array()?)),
            Kind::Time => self.time()?,
            Kind::Text { bound } => self.text(bound)?,
            Kind::Seq { element, bound } => {
                let count = self.count(bound)?;
                self.elements(element, count, depth)?
            }
            Kind::Array { element, length } => self.elements(element, length, depth)?,
            Kind::Message(schema) => self.record(schema, depth + 1)?,
            Kind::Enumeration(schema) => self.enumeration(schema)?,
        })
    }

    fn time(&mut self) -> Result<Value, ViewError> {
        let (sec, nsec) = (self.u32()?, self.u32()?);
        if nsec < 1_000_000_000 { Ok(Value::Time { sec, nsec }) } else { Err(ViewError::BadTime { nsec }) }
    }

    fn text(&mut self, bound: u32) -> Result<Value, ViewError> {
        let count = self.count(bound)?;
        let text = core::str::from_utf8(self.bytes(count as usize)?).map_err(|_| ViewError::NotUtf8)?;
        Ok(Value::Text(text.to_owned()))
    }

    fn elements(&mut self, element: &Kind, count: u32, depth: u32) -> Result<Value, ViewError> {
        // No reservation by a count that the body may not hold: the vector grows as elements are found.
        let mut elements = Vec::new();
        for _ in 0..count {
            elements.push(self.value(element, depth)?);
        }
        Ok(Value::Seq(elements))
    }

    fn enumeration(&mut self, schema: &'static EnumSchema) -> Result<Value, ViewError> {
        let value = if schema.width == 1 { self.array::<1>()?[0].into() } else { self.u32()? };
        match schema.name_of(value) {
            Some(name) => Ok(Value::Enumeration { value, name }),
            None => Err(ViewError::UnknownValue { enumeration: schema.name, value }),
        }
    }
}

impl Serialize for Value {
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
