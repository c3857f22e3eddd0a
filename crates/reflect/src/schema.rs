//! The static description of a message type.

use core::fmt;

use crate::{Unit, fnv1a_64, ros1msg};

/// A message type: its published name, meaning and fields in wire order.
#[derive(Debug)]
pub struct Schema {
    /// `package/Type`, as ROS names types.
    pub name: &'static str,
    /// What a message of this type says.
    pub doc: &'static str,
    /// The fields, in wire order.
    pub fields: &'static [Field],
}

/// One field of a message type.
#[derive(Debug)]
pub struct Field {
    /// Name, lower snake case, with its unit.
    pub name: &'static str,
    /// Meaning.
    pub doc: &'static str,
    /// What it is on the wire.
    pub kind: Kind,
    /// Unit, where the name carries one.
    pub unit: Option<Unit>,
    /// Frame or frames, where the type carries them.
    pub axes: Option<Axes>,
}

/// What a field is on the wire; multi-byte numbers are little endian and of fixed size.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// One byte, 0 or 1.
    Bool,
    /// Signed, one byte.
    I8,
    /// Signed, two bytes.
    I16,
    /// Signed, four bytes.
    I32,
    /// Signed, eight bytes.
    I64,
    /// Unsigned, one byte.
    U8,
    /// Unsigned, two bytes.
    U16,
    /// Unsigned, four bytes.
    U32,
    /// Unsigned, eight bytes.
    U64,
    /// IEEE 754, four bytes.
    F32,
    /// IEEE 754, eight bytes.
    F64,
    /// Seconds and nanoseconds, two `u32`.
    Time,
    /// A `u32` count of bytes, then that much UTF-8.
    Text {
        /// Most bytes.
        bound: u32,
    },
    /// A `u32` count, then that many elements.
    Seq {
        /// What each element is.
        element: &'static Kind,
        /// Most elements.
        bound: u32,
    },
    /// Elements of a number known beforehand, without a count.
    Array {
        /// What each element is.
        element: &'static Kind,
        /// How many.
        length: u32,
    },
    /// The fields of another message, one after another.
    Message(&'static Schema),
    /// One of a few named values, as an unsigned number.
    Enumeration(&'static EnumSchema),
}

/// A field-less enum: on the wire its value, not its ordinal.
#[derive(Debug)]
pub struct EnumSchema {
    /// The Rust type's name.
    pub name: &'static str,
    /// What the choice is about.
    pub doc: &'static str,
    /// Bytes on the wire: 1 or 4.
    pub width: u8,
    /// The values, in the order of the source.
    pub constants: &'static [Constant],
}

/// A named value of a field-less enum.
#[derive(Debug)]
pub struct Constant {
    /// Name, upper case.
    pub name: &'static str,
    /// Meaning.
    pub doc: &'static str,
    /// Value on the wire.
    pub value: u32,
}

/// The frame a quantity is given in, or the two a rotation goes between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Components along this frame's axes.
    In(&'static str),
    /// Takes components along the first frame's axes to components along the second's.
    Between(&'static str, &'static str),
}

impl Schema {
    /// The definition as `ros1msg` text: fields in wire order, meaning and units as comments, the definitions
    /// of nested types appended as rosbag embeds them.
    #[must_use]
    pub fn text(&self) -> String {
        ros1msg::text(self)
    }

    /// The id that datagrams carry: FNV-1a-64 of name, NUL and text. Any change of the definition, even of a
    /// comment, changes it.
    #[must_use]
    pub fn id(&self) -> u64 {
        fnv1a_64(&[self.name.as_bytes(), &[0], self.text().as_bytes()])
    }

    /// The message types within this one, each once, in the order they are met.
    #[must_use]
    pub fn nested(&self) -> Vec<&'static Self> {
        fn collect(schema: &Schema, found: &mut Vec<&'static Schema>) {
            for field in schema.fields {
                if let Kind::Message(inner) = field.kind.innermost()
                    && !found.iter().any(|known| known.name == inner.name)
                {
                    found.push(inner);
                    collect(inner, found);
                }
            }
        }
        let mut found = Vec::new();
        collect(self, &mut found);
        found
    }

    /// The field of that name.
    #[must_use]
    pub fn field(&self, name: &str) -> Option<&'static Field> {
        self.fields.iter().find(|field| field.name == name)
    }
}

impl Kind {
    /// What the elements of a sequence or an array are; itself for anything else.
    #[must_use]
    pub const fn innermost(self) -> Self {
        match self {
            Self::Seq { element, .. } | Self::Array { element, .. } => element.innermost(),
            other => other,
        }
    }

    /// Whether ROS 1 has a type for it: it knows no sequences of sequences.
    #[must_use]
    pub const fn has_ros1_type(&self) -> bool {
        match self {
            Self::Seq { element, .. } | Self::Array { element, .. } => {
                !matches!(element, Self::Seq { .. } | Self::Array { .. })
            }
            _ => true,
        }
    }
}

impl EnumSchema {
    /// The name of a value, if it has one.
    #[must_use]
    pub fn name_of(&self, value: u32) -> Option<&'static str> {
        self.constants.iter().find(|constant| constant.value == value).map(|constant| constant.name)
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::In(frame) => write!(f, "frame {frame}"),
            Self::Between(from, to) => write!(f, "takes {from} to {to}"),
        }
    }
}
