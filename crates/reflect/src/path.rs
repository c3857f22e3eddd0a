//! One field of a message, found by its path and read without the rest.

use core::fmt;
use std::sync::Arc;

use crate::definition::Layout;
use crate::view::Cursor;
use crate::{Definition, Primitive, Shape, Value, ViewError, dynamic};

/// Reads one field from bodies of one type. What stands before it is stepped over, at a constant offset where
/// all of it is of fixed size; what stands behind it is not looked at.
#[derive(Clone, Debug)]
pub struct FieldReader {
    definition: Definition,
    steps: Vec<Step>,
    shape: Shape,
    unit: Option<String>,
}

/// What leads from a body's beginning to the field.
#[derive(Clone, Debug)]
enum Step {
    Over(Arc<Layout>),
    /// Into a sequence, to this element.
    Element {
        index: u32,
        element: Arc<Layout>,
        bound: u32,
    },
}

/// A path that leads to no field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathError {
    /// The path.
    pub path: String,
    /// The part of it that leads nowhere.
    pub step: String,
    /// Why.
    pub fault: PathFault,
}

/// Why a part of a path leads nowhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathFault {
    /// The message has no such field.
    NoField {
        /// The message's type.
        record: String,
        /// The fields it has.
        known: Vec<String>,
    },
    /// A sequence or an array has numbers for fields.
    NotIndex,
    /// More than there can be.
    IndexTooGreat {
        /// How many elements there can be.
        length: u32,
    },
    /// What was reached has no parts.
    NoParts,
}

impl Definition {
    /// The field at a path of names and indices: `bodies.0.position_m.x`. It may lead to a message or a
    /// sequence, too.
    ///
    /// # Errors
    /// The part of the path that leads nowhere, with what there is instead.
    pub fn field(&self, path: &str) -> Result<FieldReader, PathError> {
        let mut steps = Vec::new();
        let mut at = Shape::Record(0);
        let mut unit = None;
        for step in path.split('.') {
            let refused = |fault| PathError { path: path.to_owned(), step: step.to_owned(), fault };
            at = match &at {
                Shape::Record(place) => {
                    let record = &self.records()[*place];
                    let known = || record.fields.iter().map(|field| field.name.clone()).collect();
                    let index = record.fields.iter().position(|field| field.name == step);
                    let index = index.ok_or_else(|| {
                        refused(PathFault::NoField { record: record.name.clone(), known: known() })
                    })?;
                    let before = record.fields[..index].iter().map(|field| self.layout(&field.shape));
                    steps.push(Step::Over(Arc::new(Layout::sequence(before))));
                    unit = record.fields[index].unit.clone().or(unit);
                    record.fields[index].shape.clone()
                }
                Shape::Seq { element, bound } => {
                    let index = index_below(step, *bound).map_err(refused)?;
                    steps.push(Step::Element { index, element: self.layout(element), bound: *bound });
                    Shape::clone(element)
                }
                Shape::Array { element, length } => {
                    let index = index_below(step, *length).map_err(refused)?;
                    steps.push(Step::Over(Arc::new(Layout::array(self.layout(element), index))));
                    Shape::clone(element)
                }
                Shape::Primitive(_) | Shape::Text { .. } | Shape::Enumeration(_) => {
                    return Err(refused(PathFault::NoParts));
                }
            };
        }
        Ok(FieldReader { definition: self.clone(), steps: merged(steps), shape: at, unit })
    }

    fn layout(&self, shape: &Shape) -> Arc<Layout> {
        Arc::new(match shape {
            Shape::Primitive(primitive) => Layout::Fixed(primitive.size().into()),
            Shape::Enumeration(choice) => Layout::Fixed(choice.width.into()),
            Shape::Text { bound } => Layout::Text { bound: *bound },
            Shape::Seq { element, bound } => Layout::Seq { element: self.layout(element), bound: *bound },
            Shape::Array { element, length } => Layout::array(self.layout(element), *length),
            Shape::Record(place) => return Arc::clone(&self.records()[*place].layout),
        })
    }
}

fn index_below(step: &str, length: u32) -> Result<u32, PathFault> {
    let index: u32 = step.parse().map_err(|_| PathFault::NotIndex)?;
    if index < length { Ok(index) } else { Err(PathFault::IndexTooGreat { length }) }
}

/// Consecutive steps over bytes of fixed number become one.
fn merged(steps: Vec<Step>) -> Vec<Step> {
    let mut merged: Vec<Step> = Vec::new();
    for step in steps {
        match (merged.last_mut(), step) {
            (Some(Step::Over(before)), Step::Over(layout)) => {
                *before = Arc::new(Layout::sequence([Arc::clone(before), layout]));
            }
            (_, step) => merged.push(step),
        }
    }
    merged
}

impl FieldReader {
    /// The field in a body; `None` where a sequence has no such element.
    ///
    /// # Errors
    /// A [`ViewError`] for a body that is cut short or impossible before or within the field. What stands
    /// behind it is not looked at.
    pub fn read(&self, body: &[u8]) -> Result<Option<Value<'_>>, ViewError> {
        let Some(mut cursor) = self.find(body)? else { return Ok(None) };
        dynamic::value(&mut cursor, &self.definition, &self.shape, 0).map(Some)
    }

    fn find<'d>(&self, body: &'d [u8]) -> Result<Option<Cursor<'d>>, ViewError> {
        let mut cursor = Cursor::new(body);
        for step in &self.steps {
            match step {
                Step::Over(layout) => layout.skip(&mut cursor)?,
                Step::Element { index, element, bound } => {
                    if *index >= cursor.count(*bound)? {
                        return Ok(None);
                    }
                    element.skip_times(*index, &mut cursor)?;
                }
            }
        }
        Ok(Some(cursor))
    }

    /// Whether it reads bodies of this very definition, and not of another version of the type.
    #[must_use]
    pub fn is_of(&self, definition: &Definition) -> bool {
        self.definition.is_same(definition)
    }

    /// What the field is on the wire.
    #[must_use]
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Its unit, its own or that of the vector it belongs to.
    #[must_use]
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Whether it stands for a number ([`Value::number`]): it can be drawn.
    #[must_use]
    pub fn is_number(&self) -> bool {
        matches!(self.shape, Shape::Primitive(_) | Shape::Enumeration(_))
    }

    /// Whether it is a whole number or a named value, as whatever tells messages apart is.
    #[must_use]
    pub fn is_whole_number(&self) -> bool {
        match self.shape {
            Shape::Primitive(primitive) => !matches!(
                primitive,
                Primitive::Bool | Primitive::F32 | Primitive::F64 | Primitive::Time | Primitive::Duration
            ),
            Shape::Enumeration(_) => true,
            _ => false,
        }
    }
}

impl fmt::Display for PathError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, step, fault } = self;
        if path != step {
            write!(f, "{path}: ")?;
        }
        match fault {
            PathFault::NoField { record, known } => {
                write!(f, "{record} has no field {step:?}; it has {}", known.join(", "))
            }
            PathFault::NotIndex => write!(f, "{step:?} is no number of an element"),
            PathFault::IndexTooGreat { length } => {
                write!(f, "there is no element {step}: there are {length} at most, counted from 0")
            }
            PathFault::NoParts => write!(f, "what stands before {step:?} has no parts"),
        }
    }
}

impl core::error::Error for PathError {}
