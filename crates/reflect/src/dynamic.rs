//! A body read by a definition met at run time.

use crate::view::Cursor;
use crate::{Choice, Definition, Shape, Value, ViewError};

pub(crate) fn decode<'n>(definition: &'n Definition, body: &[u8]) -> Result<Value<'n>, ViewError> {
    let mut cursor = Cursor::new(body);
    let value = record(&mut cursor, definition, 0, 0)?;
    cursor.end()?;
    Ok(value)
}

fn record<'n>(
    cursor: &mut Cursor<'_>,
    definition: &'n Definition,
    place: usize,
    depth: u32,
) -> Result<Value<'n>, ViewError> {
    cursor.check_depth(depth)?;
    let record = &definition.records()[place];
    let mut fields = Vec::with_capacity(record.fields.len());
    for field in &record.fields {
        fields.push((field.name.as_str(), value(cursor, definition, &field.shape, depth)?));
    }
    Ok(Value::Record(fields))
}

pub(crate) fn value<'n>(
    cursor: &mut Cursor<'_>,
    definition: &'n Definition,
    shape: &'n Shape,
    depth: u32,
) -> Result<Value<'n>, ViewError> {
    cursor.count_value()?;
    Ok(match shape {
        Shape::Primitive(primitive) => cursor.primitive(*primitive)?,
        Shape::Text { bound } => Value::Text(cursor.text(*bound)?.to_owned()),
        Shape::Seq { element, bound } => {
            let count = cursor.count(*bound)?;
            elements(cursor, definition, element, count, depth)?
        }
        Shape::Array { element, length } => elements(cursor, definition, element, *length, depth)?,
        Shape::Record(place) => record(cursor, definition, *place, depth + 1)?,
        Shape::Enumeration(choice) => enumeration(cursor, choice)?,
    })
}

fn elements<'n>(
    cursor: &mut Cursor<'_>,
    definition: &'n Definition,
    element: &'n Shape,
    count: u32,
    depth: u32,
) -> Result<Value<'n>, ViewError> {
    // No reservation by a count that the body may not hold: the vector grows as elements are found.
    let mut elements = Vec::new();
    for _ in 0..count {
        elements.push(value(cursor, definition, element, depth)?);
    }
    Ok(Value::Seq(elements))
}

fn enumeration<'n>(cursor: &mut Cursor<'_>, choice: &'n Choice) -> Result<Value<'n>, ViewError> {
    let value = if choice.width == 1 { cursor.u8()?.into() } else { cursor.u32()? };
    match choice.name_of(value) {
        Some(name) => Ok(Value::Enumeration { value, name }),
        None => Err(ViewError::UnknownValue { enumeration: choice.name.clone(), value }),
    }
}
