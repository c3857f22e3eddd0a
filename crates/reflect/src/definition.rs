//! Message types met at run time: parsed from the `ros1msg` text that the bus announces and recordings carry.
//!
//! A [`Definition`] is to a tool what a [`Schema`](crate::Schema) is to a program with the type compiled in.
//! It takes any valid `ros1msg` text, also one that we did not write; from the comments of ours it recovers
//! what the format has no words for: units, bounds, and which constants are the values of which field.

mod error;
mod layout;
mod parse;
mod resolve;

use std::sync::Arc;

pub use error::{DefinitionError, DefinitionFault};
pub(crate) use layout::Layout;

use crate::{Primitive, Value, ViewError, dynamic};

/// Parts of one message, at most, where each shall be a column of a table.
const VISITS_MAX: usize = 4096;
/// Elements of an array that are leaves of their own; longer ones are one leaf.
const ELEMENT_LEAVES_MAX: u32 = 64;

/// A message type, with all types within it. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Definition {
    records: Arc<[RecordType]>,
}

/// One message type of a definition.
#[derive(Debug)]
pub struct RecordType {
    /// `package/Type`.
    pub name: String,
    /// The fields, in wire order.
    pub fields: Vec<RecordField>,
    pub(crate) layout: Arc<Layout>,
}

/// One field of a message type.
#[derive(Debug)]
pub struct RecordField {
    /// Its name.
    pub name: String,
    /// What it is on the wire.
    pub shape: Shape,
    /// Its unit, for people, where a comment of ours says one.
    pub unit: Option<String>,
}

/// What a field is on the wire.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A value of fixed size.
    Primitive(Primitive),
    /// A `u32` count of bytes, then that much UTF-8.
    Text {
        /// Most bytes; `u32::MAX` where nothing says so.
        bound: u32,
    },
    /// A `u32` count, then that many elements.
    Seq {
        /// What each element is.
        element: Box<Self>,
        /// Most elements; `u32::MAX` where nothing says so.
        bound: u32,
    },
    /// Elements of a number known beforehand, without a count.
    Array {
        /// What each element is.
        element: Box<Self>,
        /// How many.
        length: u32,
    },
    /// The fields of another message: its place among [`Definition::records`].
    Record(usize),
    /// A number, of which some values have names.
    Enumeration(Arc<Choice>),
}

/// The named values of a field.
#[derive(Debug, PartialEq, Eq)]
pub struct Choice {
    /// What the choice is called.
    pub name: String,
    /// Bytes on the wire: 1 or 4.
    pub width: u8,
    /// Value and name of each, in the order of the text.
    pub constants: Vec<(u32, String)>,
}

/// A value within a message that has no parts, or a sequence of any length.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leaf {
    /// Its path: `estimate.position_m.x`.
    pub path: String,
    /// Its unit, its own or that of the vector it belongs to.
    pub unit: Option<String>,
}

impl Definition {
    /// Reads `ros1msg` text that defines the type `name` (`package/Type`), the types within it appended as
    /// rosbag embeds them.
    ///
    /// # Errors
    /// The line that is no definition, or the type that is missing.
    pub fn parse(name: &str, text: &str) -> Result<Self, DefinitionError> {
        let sections = parse::sections(name, text)?;
        Ok(Self { records: resolve::records(&sections)?.into() })
    }

    /// The type's name, `package/Type`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.root().name
    }

    /// The type itself, then those within it.
    #[must_use]
    pub fn records(&self) -> &[RecordType] {
        &self.records
    }

    /// The type itself.
    #[must_use]
    pub fn root(&self) -> &RecordType {
        &self.records[0]
    }

    /// Whether both are one definition, parsed once.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.records, &other.records)
    }

    /// Reads a body.
    ///
    /// # Errors
    /// A [`ViewError`] for a body that is not exactly one message of this type, and for one of absurd size.
    pub fn decode(&self, body: &[u8]) -> Result<Value<'_>, ViewError> {
        dynamic::decode(self, body)
    }

    /// Every value without parts, in wire order, by path. Sequences are one leaf, since they have no length
    /// of their own. `None` if there are more than a table can have columns.
    #[must_use]
    pub fn leaves(&self) -> Option<Vec<Leaf>> {
        let mut walk = Walk { definition: self, leaves: Vec::new(), visits: 0 };
        walk.record(self.root(), "", None).then_some(walk.leaves)
    }
}

/// A walk over all that a message is made of. Messages without fields have no leaves, so visits are counted,
/// too.
struct Walk<'d> {
    definition: &'d Definition,
    leaves: Vec<Leaf>,
    visits: usize,
}

impl Walk<'_> {
    fn record(&mut self, record: &RecordType, path: &str, unit: Option<&String>) -> bool {
        record.fields.iter().all(|field| {
            let path = if path.is_empty() { field.name.clone() } else { format!("{path}.{}", field.name) };
            self.shape(&field.shape, path, field.unit.as_ref().or(unit))
        })
    }

    fn shape(&mut self, shape: &Shape, path: String, unit: Option<&String>) -> bool {
        self.visits += 1;
        match shape {
            _ if self.visits > VISITS_MAX => false,
            Shape::Record(place) => self.record(&self.definition.records()[*place], &path, unit),
            Shape::Array { element, length } if *length <= ELEMENT_LEAVES_MAX => {
                (0..*length).all(|index| self.shape(element, format!("{path}.{index}"), unit))
            }
            _ => {
                self.leaves.push(Leaf { path, unit: unit.cloned() });
                true
            }
        }
    }
}

impl RecordType {
    /// The field of that name.
    #[must_use]
    pub fn field(&self, name: &str) -> Option<&RecordField> {
        self.fields.iter().find(|field| field.name == name)
    }
}

impl Choice {
    /// The name of a value, if it has one.
    #[must_use]
    pub fn name_of(&self, value: u32) -> Option<&str> {
        self.constants.iter().find(|constant| constant.0 == value).map(|constant| constant.1.as_str())
    }
}
