//! What can be a message, and what can be a field of one.

use quantity::{Frame, Rotation, Time, Vector};
use serde::de::{DeserializeOwned, Error as _, SeqAccess};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Serialize};

use crate::{Axes, EnumSchema, Field, Kind, Schema, bounded};

/// A type that crosses the bus; derive it.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a message",
    note = "derive `reflect::Message` for it"
)]
pub trait Message: Serialize + DeserializeOwned {
    /// Its description.
    const SCHEMA: &'static Schema;

    /// Whether every float in it is a finite number.
    fn all_finite(&self) -> bool;
}

/// A field-less enum with explicit values; derive it. It is written as its value, and an unknown value does
/// not decode.
pub trait Enumeration: Copy + Serialize + DeserializeOwned {
    /// Its description.
    const SCHEMA: &'static EnumSchema;

    /// Its value on the wire.
    fn value(self) -> u32;

    /// The one with that value.
    fn from_value(value: u32) -> Option<Self>;
}

/// A type that can be a field of a message: numbers, `bool`, `Time`, `Text`, `Seq`, arrays, enumerations and
/// other messages, each with a fixed form on the wire.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be a field of a message",
    label = "has no form on the wire",
    note = "a field is a number of fixed size, a bool, Time, Text, Seq, an array, an enumeration or a message"
)]
pub trait FieldType {
    /// What it is on the wire.
    const KIND: Kind;
    /// Whether the name of a field of this type must carry a unit.
    const NEEDS_UNIT: bool = false;
    /// The frames it is given in.
    const AXES: Option<Axes> = None;

    /// Whether every float in it is a finite number.
    fn all_finite(&self) -> bool {
        true
    }

    /// Writes the elements of a sequence, after its count; bytes do it faster than one by one.
    #[doc(hidden)]
    fn serialize_all<S: SerializeTuple>(items: &[Self], tuple: &mut S) -> Result<(), S::Error>
    where
        Self: Serialize + Sized,
    {
        items.iter().try_for_each(|item| tuple.serialize_element(item))
    }

    /// Reads the elements of a sequence, whose count was read and is within its bound.
    #[doc(hidden)]
    fn deserialize_all<'de, A: SeqAccess<'de>>(access: &mut A, count: usize) -> Result<Vec<Self>, A::Error>
    where
        Self: Deserialize<'de> + Sized,
    {
        let mut items = Vec::with_capacity(count);
        for _ in 0..count {
            items.push(access.next_element()?.ok_or_else(|| A::Error::custom("sequence cut short"))?);
        }
        Ok(items)
    }
}

macro_rules! exact {
    ($($primitive:ty => $kind:ident),* $(,)?) => {
        $(impl FieldType for $primitive {
            const KIND: Kind = Kind::$kind;
        })*
    };
}

exact! {
    bool => Bool, i8 => I8, i16 => I16, i32 => I32, i64 => I64, u16 => U16, u32 => U32, u64 => U64,
    Time => Time,
}

impl FieldType for u8 {
    const KIND: Kind = Kind::U8;

    fn serialize_all<S: SerializeTuple>(items: &[Self], tuple: &mut S) -> Result<(), S::Error> {
        bounded::serialize_bytes(items, tuple)
    }

    fn deserialize_all<'de, A: SeqAccess<'de>>(access: &mut A, count: usize) -> Result<Vec<Self>, A::Error> {
        let mut bytes = vec![0; count];
        bounded::deserialize_bytes(&mut bytes, access)?;
        Ok(bytes)
    }
}

impl FieldType for f32 {
    const KIND: Kind = Kind::F32;
    const NEEDS_UNIT: bool = true;

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}

impl FieldType for f64 {
    const KIND: Kind = Kind::F64;
    const NEEDS_UNIT: bool = true;

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}

impl<T: FieldType, const N: usize> FieldType for [T; N] {
    const KIND: Kind = Kind::Array { element: &T::KIND, length: N as u32 };
    const NEEDS_UNIT: bool = T::NEEDS_UNIT;
    const AXES: Option<Axes> = T::AXES;

    fn all_finite(&self) -> bool {
        self.iter().all(FieldType::all_finite)
    }
}

const fn component(name: &'static str, doc: &'static str) -> Field {
    Field { name, doc, kind: Kind::F64, unit: None, axes: None }
}

/// The well-known shape under its well-known name: viewers recognise it.
static VECTOR: Schema = Schema {
    name: "geometry_msgs/Vector3",
    doc: "Three components along the axes of a frame.",
    fields: &[
        component("x", "Along the x axis."),
        component("y", "Along the y axis."),
        component("z", "Along the z axis."),
    ],
};

/// The well-known shape under its well-known name: viewers recognise it.
static QUATERNION: Schema = Schema {
    name: "geometry_msgs/Quaternion",
    doc: "A rotation as a unit quaternion in Hamilton's convention.",
    fields: &[
        component("x", "First imaginary component."),
        component("y", "Second imaginary component."),
        component("z", "Third imaginary component."),
        component("w", "Real component."),
    ],
};

impl<F: Frame> Message for Vector<F> {
    const SCHEMA: &'static Schema = &VECTOR;

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}

impl<F: Frame> FieldType for Vector<F> {
    const KIND: Kind = Kind::Message(&VECTOR);
    const NEEDS_UNIT: bool = true;
    const AXES: Option<Axes> = Some(Axes::In(F::NAME));

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}

impl<A: Frame, B: Frame> Message for Rotation<A, B> {
    const SCHEMA: &'static Schema = &QUATERNION;

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}

impl<A: Frame, B: Frame> FieldType for Rotation<A, B> {
    const KIND: Kind = Kind::Message(&QUATERNION);
    const AXES: Option<Axes> = Some(Axes::Between(A::NAME, B::NAME));

    fn all_finite(&self) -> bool {
        self.is_finite()
    }
}
