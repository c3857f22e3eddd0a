//! From text to statements, section by section; types are still names.

use super::{Choice, DefinitionError, DefinitionFault};
use crate::Primitive;
use crate::ros1msg::upper_snake;

/// No definition is longer. Ours fit a datagram; the longest of ROS have some ten thousand bytes.
const TEXT_BYTES_MAX: usize = 1 << 20;

/// One type's part of the text.
#[derive(Debug, PartialEq)]
pub(super) struct Section<'t> {
    pub name: &'t str,
    pub fields: Vec<RawField<'t>>,
    pub choices: Vec<Choice>,
}

/// A field whose type is still a name.
#[derive(Debug)]
pub(super) struct RawField<'t> {
    pub line: u32,
    pub text: &'t str,
    pub type_name: &'t str,
    pub repeated: Repeated,
    pub name: &'t str,
    pub notes: Notes<'t>,
}

/// Two fields are the same wherever they stand.
impl PartialEq for RawField<'_> {
    fn eq(&self, other: &Self) -> bool {
        (self.type_name, self.repeated, self.name) == (other.type_name, other.repeated, other.name)
            && self.notes == other.notes
    }
}

/// How often a field holds its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repeated {
    Once,
    Counted,
    Times(u32),
}

/// What our generator says in the comment right above a field: `# [unit m/s, at most 16 elements]`.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Notes<'t> {
    pub unit: Option<&'t str>,
    pub bytes_max: Option<u32>,
    pub elements_max: Option<u32>,
    pub values_of: Option<&'t str>,
}

/// The sections of a text, the type itself first.
pub(super) fn sections<'t>(name: &'t str, text: &'t str) -> Result<Vec<Section<'t>>, DefinitionError> {
    if text.len() > TEXT_BYTES_MAX {
        let fault = DefinitionFault::TooLong { bytes: text.len(), bound: TEXT_BYTES_MAX };
        return Err(DefinitionError::new(0, name, fault));
    }
    if !is_full_name(name) {
        return Err(DefinitionError::new(0, name, DefinitionFault::BadTypeName));
    }
    let mut reader = Reader { sections: Vec::new(), open: Open::new(name), expects_name: false };
    for (number, line) in (1_u32..).zip(text.lines()) {
        reader.line(number, line.trim())?;
    }
    reader.finish(text)
}

struct Reader<'t> {
    sections: Vec<Section<'t>>,
    open: Open<'t>,
    expects_name: bool,
}

/// The section being read.
struct Open<'t> {
    section: Section<'t>,
    comments: Vec<&'t str>,
    in_constants: bool,
}

impl<'t> Open<'t> {
    fn new(name: &'t str) -> Self {
        let section = Section { name, fields: Vec::new(), choices: Vec::new() };
        Self { section, comments: Vec::new(), in_constants: false }
    }
}

impl<'t> Reader<'t> {
    fn line(&mut self, number: u32, line: &'t str) -> Result<(), DefinitionError> {
        let refused = |fault| DefinitionError::new(number, line, fault);
        if line.starts_with("===") && line.bytes().all(|byte| byte == b'=') {
            if self.expects_name {
                return Err(refused(DefinitionFault::NoTypeName));
            }
            self.expects_name = true;
        } else if self.expects_name && !line.is_empty() {
            let name = line.strip_prefix("MSG:").map(str::trim);
            let name = name.ok_or_else(|| refused(DefinitionFault::NoTypeName))?;
            if !is_full_name(name) {
                return Err(refused(DefinitionFault::BadTypeName));
            }
            self.expects_name = false;
            self.begin(name).map_err(refused)?;
        } else if line.is_empty() {
            self.open.comments.clear();
            self.open.in_constants = false;
        } else if let Some(comment) = line.strip_prefix('#') {
            self.open.comments.push(comment.trim());
        } else {
            self.open.statement(number, line).map_err(refused)?;
        }
        Ok(())
    }

    fn begin(&mut self, name: &'t str) -> Result<(), DefinitionFault> {
        let before = std::mem::replace(&mut self.open, Open::new(name)).close();
        keep(&mut self.sections, before)
    }

    fn finish(mut self, text: &str) -> Result<Vec<Section<'t>>, DefinitionError> {
        let refused = |fault| DefinitionError::new(text.lines().count() as u32, "", fault);
        if self.expects_name {
            return Err(refused(DefinitionFault::NoTypeName));
        }
        keep(&mut self.sections, self.open.close()).map_err(refused)?;
        Ok(self.sections)
    }
}

/// Some writers append a type as often as it is used; that is no fault as long as they agree with themselves.
fn keep<'t>(sections: &mut Vec<Section<'t>>, section: Section<'t>) -> Result<(), DefinitionFault> {
    match sections.iter().find(|known| known.name == section.name) {
        None => sections.push(section),
        Some(known) if *known == section => {}
        Some(_) => return Err(DefinitionFault::TwoDefinitions),
    }
    Ok(())
}

impl<'t> Open<'t> {
    fn statement(&mut self, line: u32, text: &'t str) -> Result<(), DefinitionFault> {
        let (type_text, rest) = text.split_once(char::is_whitespace).ok_or(DefinitionFault::NoStatement)?;
        let rest = rest.trim_start();
        let code = rest.split('#').next().unwrap_or(rest).trim_end();
        if let Some((name, value)) = code.split_once('=') {
            // Text takes all that follows, also what looks like a comment.
            let value =
                if type_text == "string" { rest.split_once('=').map_or("", |part| part.1) } else { value };
            return self.constant(type_text, name.trim(), value.trim());
        }
        let (type_name, repeated) = parse_type(type_text)?;
        if code.contains(char::is_whitespace) {
            return Err(DefinitionFault::NoStatement);
        }
        check_name(code)?;
        if self.section.fields.iter().any(|field| field.name == code) {
            return Err(DefinitionFault::TwoFields);
        }
        let notes = Notes::of(&self.comments);
        self.section.fields.push(RawField { line, text, type_name, repeated, name: code, notes });
        self.comments.clear();
        self.in_constants = false;
        Ok(())
    }

    fn constant(&mut self, type_name: &str, name: &str, value: &str) -> Result<(), DefinitionFault> {
        check_name(name)?;
        let value = constant_value(type_name, value)?;
        if !self.in_constants {
            self.in_constants = true;
            if let Some(choice) = choice_of(&self.comments, type_name) {
                self.section.choices.push(choice);
            }
        }
        self.comments.clear();
        let width = choice_width(type_name);
        if let (Some(choice), Some(value)) = (self.section.choices.last_mut(), value)
            && Some(choice.width) == width
        {
            choice.constants.push((value, name.to_owned()));
        }
        Ok(())
    }

    /// Takes the prefixes away that our generator sets before the values of an enumeration beside others.
    fn close(mut self) -> Section<'t> {
        if self.section.choices.len() > 1 {
            for choice in &mut self.section.choices {
                let prefix = upper_snake(&choice.name) + "_";
                for (_, name) in &mut choice.constants {
                    if let Some(bare) = name.strip_prefix(&prefix) {
                        *name = bare.to_owned();
                    }
                }
            }
        }
        self.section
    }
}

/// The choice whose values follow a comment that begins with its name, as in `# FlightMode: what it does.`
fn choice_of(comments: &[&str], type_name: &str) -> Option<Choice> {
    let width = choice_width(type_name)?;
    let (name, _) = comments.first()?.split_once(':')?;
    check_name(name).ok()?;
    Some(Choice { name: name.to_owned(), width, constants: Vec::new() })
}

fn choice_width(type_name: &str) -> Option<u8> {
    match type_name {
        "uint8" => Some(1),
        "uint32" => Some(4),
        _ => None,
    }
}

impl<'t> Notes<'t> {
    fn of(comments: &[&'t str]) -> Self {
        let mut notes = Self::default();
        let last = comments.last().and_then(|last| last.strip_prefix('[')?.strip_suffix(']'));
        for note in last.into_iter().flat_map(|notes| notes.split(", ")) {
            let at_most = note.strip_prefix("at most ").and_then(|bound| bound.split_once(' '));
            match (note.split_once(' '), at_most) {
                (_, Some((bound, "bytes"))) => notes.bytes_max = bound.parse().ok(),
                (_, Some((bound, "elements"))) => notes.elements_max = bound.parse().ok(),
                (Some(("unit", unit)), None) => notes.unit = Some(unit),
                (Some(("values", of)), None) => notes.values_of = of.strip_prefix("of "),
                _ => {}
            }
        }
        notes
    }
}

fn parse_type(text: &str) -> Result<(&str, Repeated), DefinitionFault> {
    let Some(inside) = text.strip_suffix(']') else {
        return Ok((checked_type(text)?, Repeated::Once));
    };
    let (base, length) = inside.split_once('[').ok_or(DefinitionFault::BadLength)?;
    let repeated = match length {
        "" => Repeated::Counted,
        digits if digits.bytes().all(|byte| byte.is_ascii_digit()) => {
            Repeated::Times(digits.parse().map_err(|_| DefinitionFault::BadLength)?)
        }
        _ => return Err(DefinitionFault::BadLength),
    };
    Ok((checked_type(base)?, repeated))
}

fn checked_type(name: &str) -> Result<&str, DefinitionFault> {
    if is_full_name(name) || check_name(name).is_ok() { Ok(name) } else { Err(DefinitionFault::BadTypeName) }
}

fn is_full_name(name: &str) -> bool {
    name.split_once('/')
        .is_some_and(|(package, name)| check_name(package).is_ok() && check_name(name).is_ok())
}

fn check_name(name: &str) -> Result<(), DefinitionFault> {
    let valid = name.starts_with(|first: char| first.is_ascii_alphabetic())
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    if valid { Ok(()) } else { Err(DefinitionFault::BadName) }
}

/// The constant's value, where a named value of a field could have it.
fn constant_value(type_name: &str, text: &str) -> Result<Option<u32>, DefinitionFault> {
    fn held<T: std::str::FromStr>(text: &str) -> Result<T, DefinitionFault> {
        text.parse().map_err(|_| DefinitionFault::BadConstant)
    }
    Ok(match (type_name, Primitive::of_ros1(type_name)) {
        ("string", _) => None,
        ("bool", _) if matches!(text, "True" | "False" | "true" | "false") => None,
        (_, Some(Primitive::Bool | Primitive::U8)) => Some(held::<u8>(text)?.into()),
        (_, Some(Primitive::U16)) => Some(held::<u16>(text)?.into()),
        (_, Some(Primitive::U32)) => Some(held(text)?),
        (_, Some(Primitive::U64)) => u32::try_from(held::<u64>(text)?).ok(),
        (_, Some(Primitive::I8)) => u32::try_from(held::<i8>(text)?).ok(),
        (_, Some(Primitive::I16)) => u32::try_from(held::<i16>(text)?).ok(),
        (_, Some(Primitive::I32)) => u32::try_from(held::<i32>(text)?).ok(),
        (_, Some(Primitive::I64)) => u32::try_from(held::<i64>(text)?).ok(),
        (_, Some(Primitive::F32 | Primitive::F64)) => {
            held::<f64>(text)?;
            None
        }
        (_, Some(Primitive::Time | Primitive::Duration) | None) => {
            return Err(DefinitionFault::BadConstant);
        }
    })
}
