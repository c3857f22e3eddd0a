//! Messages that describe themselves: fields, units, frames, schema text and ids.
//!
//! A message is a plain struct that derives [`Message`] beside serde's two traits. The derive writes down, as
//! constants, what the struct says anyway: its fields in wire order, their types, units (from their names),
//! frames (from their types) and meaning (from their doc comments). From that one [`Schema`] come the
//! `ros1msg` text that recordings carry ([`Schema::text`]), the id by which receivers know a type
//! ([`Schema::id`]), and a view of a body without its Rust type ([`Value::decode`]).
//!
//! Tools have no types compiled in. They parse the text again: a [`Definition`] reads bodies to the same [`Value`]s, and
//! a [`FieldReader`] reads one field without looking at more than it must.
//!
//! What cannot stand on the wire does not compile: `Option`, enums with data, `usize`, `char`, maps,
//! unbounded text, a field without a doc comment, a float whose name carries no known unit.

mod bounded;
mod definition;
mod dynamic;
mod fnv;
mod message;
mod path;
mod ros1msg;
mod schema;
mod unit;
mod view;

pub use bounded::{Seq, Text, TooLong};
pub use definition::{
    Choice, Definition, DefinitionError, DefinitionFault, Leaf, RecordField, RecordType, Shape,
};
pub use fnv::{fnv1a_32, fnv1a_64};
pub use message::{Enumeration, FieldType, Message};
pub use path::{FieldReader, PathError, PathFault};
pub use reflect_derive::{Enumeration, Message};
pub use schema::{Axes, Constant, EnumSchema, Field, Kind, Schema};
pub use unit::{UNITS, Unit};
pub use view::{Primitive, Value, ViewError};

/// What generated code names, so that a crate with messages need not name serde in its own way.
#[doc(hidden)]
pub mod private {
    pub use serde;
}
