//! The `ros1msg` text of a schema, as rosbag embeds it and MCAP's `ros1` profile expects it.

use core::fmt::Write as _;

use crate::{EnumSchema, Field, Kind, Schema};

const SEPARATOR: &str = "================================================================================";

/// The definition of `schema`, then those of all types it contains, each once, in the order they are met.
pub(crate) fn text(schema: &Schema) -> String {
    let mut out = String::new();
    definition(&mut out, schema);
    for nested in schema.nested() {
        out.push_str(SEPARATOR);
        out.push_str("\nMSG: ");
        out.push_str(nested.name);
        out.push('\n');
        definition(&mut out, nested);
    }
    out
}

fn definition(out: &mut String, schema: &Schema) {
    comment(out, schema.doc);
    let enums = enums_of(schema);
    let mut written: Vec<&str> = Vec::new();
    for field in schema.fields {
        out.push('\n');
        if let Kind::Enumeration(choice) = field.kind.innermost()
            && !written.contains(&choice.name)
        {
            written.push(choice.name);
            constants(out, choice, enums.len() > 1);
        }
        field_text(out, field);
    }
}

fn enums_of(schema: &Schema) -> Vec<&'static str> {
    let mut names = Vec::new();
    for field in schema.fields {
        if let Kind::Enumeration(choice) = field.kind.innermost()
            && !names.contains(&choice.name)
        {
            names.push(choice.name);
        }
    }
    names
}

/// The values of an enum, right before the first field that holds one: viewers then label that field with
/// their names. Where a message holds several enums, each prefixes its own values, since a definition has one
/// space of names.
fn constants(out: &mut String, choice: &EnumSchema, prefixed: bool) {
    let prefix = if prefixed { upper_snake(choice.name) + "_" } else { String::new() };
    comment(out, &format!("{}: {}", choice.name, choice.doc));
    for constant in choice.constants {
        let (name, value) = (constant.name, constant.value);
        // On one line: a comment after a number is a comment to every reader of the format.
        let doc = constant.doc.replace('\n', " ");
        let _ = writeln!(out, "{} {prefix}{name}={value}  # {doc}", enum_type(choice));
    }
}

fn field_text(out: &mut String, field: &Field) {
    comment(out, field.doc);
    let mut notes: Vec<String> = Vec::new();
    notes.extend(field.unit.map(|unit| format!("unit {unit}")));
    notes.extend(field.axes.map(|axes| axes.to_string()));
    bounds(field.kind, &mut notes);
    if let Kind::Enumeration(choice) = field.kind.innermost() {
        notes.push(format!("values of {}", choice.name));
    }
    if !notes.is_empty() {
        let _ = writeln!(out, "# [{}]", notes.join(", "));
    }
    let _ = writeln!(out, "{} {}", type_text(field.kind), field.name);
}

fn bounds(kind: Kind, notes: &mut Vec<String>) {
    match kind {
        Kind::Text { bound } => notes.push(format!("at most {bound} bytes")),
        Kind::Seq { element, bound } => {
            notes.push(format!("at most {bound} elements"));
            bounds(*element, notes);
        }
        Kind::Array { element, .. } => bounds(*element, notes),
        _ => {}
    }
}

fn comment(out: &mut String, doc: &str) {
    for line in doc.lines() {
        let _ = writeln!(out, "{}", format!("# {line}").trim_end());
    }
}

fn type_text(kind: Kind) -> String {
    let name = match kind {
        Kind::Bool => "bool",
        Kind::I8 => "int8",
        Kind::I16 => "int16",
        Kind::I32 => "int32",
        Kind::I64 => "int64",
        Kind::U8 => "uint8",
        Kind::U16 => "uint16",
        Kind::U32 => "uint32",
        Kind::U64 => "uint64",
        Kind::F32 => "float32",
        Kind::F64 => "float64",
        Kind::Time => "time",
        Kind::Text { .. } => "string",
        Kind::Message(schema) => schema.name,
        Kind::Enumeration(choice) => enum_type(choice),
        Kind::Seq { element, .. } => return type_text(*element) + "[]",
        Kind::Array { element, length } => return format!("{}[{length}]", type_text(*element)),
    };
    name.to_owned()
}

fn enum_type(choice: &EnumSchema) -> &'static str {
    if choice.width == 1 { "uint8" } else { "uint32" }
}

/// `FlightMode` as `FLIGHT_MODE`.
pub(crate) fn upper_snake(camel: &str) -> String {
    let mut out = String::new();
    for (i, letter) in camel.char_indices() {
        if i > 0 && letter.is_ascii_uppercase() {
            out.push('_');
        }
        out.push(letter.to_ascii_uppercase());
    }
    out
}
