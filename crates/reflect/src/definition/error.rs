//! Why a text is no definition.

use core::fmt;

/// Characters of a line that an error repeats.
const SHOWN_CHARS: usize = 80;

/// Why a text is no definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DefinitionError {
    /// The line, from one; zero where the text as a whole is meant.
    pub line: u32,
    /// What stands there, shortened.
    pub text: String,
    /// What is wrong with it.
    pub fault: DefinitionFault,
}

/// What is wrong with a line of a definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DefinitionFault {
    /// The text is longer than any definition.
    TooLong {
        /// Its bytes.
        bytes: usize,
        /// Most bytes.
        bound: usize,
    },
    /// Not `package/Type`.
    BadTypeName,
    /// A separator, and no `MSG: package/Type` after it.
    NoTypeName,
    /// Two different definitions of one type.
    TwoDefinitions,
    /// Neither a field nor a constant.
    NoStatement,
    /// A name that is none: letters, digits and `_`, a letter first.
    BadName,
    /// Two fields of one name.
    TwoFields,
    /// An array's length that is none.
    BadLength,
    /// A constant of a type that has none, or a value that is none of its type.
    BadConstant,
    /// A type that is not defined in the text.
    UnknownType {
        /// The type.
        name: String,
    },
    /// Types within types, too deep or in a circle.
    TooDeep,
}

impl DefinitionError {
    pub(crate) fn new(line: u32, text: &str, fault: DefinitionFault) -> Self {
        let mut shown: String = text.chars().take(SHOWN_CHARS).collect();
        if shown.len() < text.len() {
            shown.push('…');
        }
        Self { line, text: shown, fault }
    }
}

impl fmt::Display for DefinitionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(f, "line {}, {:?}: ", self.line, self.text)?;
        } else {
            write!(f, "{:?}: ", self.text)?;
        }
        match &self.fault {
            DefinitionFault::TooLong { bytes, bound } => {
                write!(f, "a definition of {bytes} bytes, more than {bound}")
            }
            DefinitionFault::BadTypeName => f.write_str("a type is called package/Type"),
            DefinitionFault::NoTypeName => f.write_str("a separator is followed by MSG: package/Type"),
            DefinitionFault::TwoDefinitions => f.write_str("the type is defined twice, and differently"),
            DefinitionFault::NoStatement => f.write_str("neither a field nor a constant"),
            DefinitionFault::BadName => {
                f.write_str("a name has letters, digits and underscores, a letter first")
            }
            DefinitionFault::TwoFields => f.write_str("there is a field of that name already"),
            DefinitionFault::BadLength => f.write_str("an array's length is a number of 32 bits"),
            DefinitionFault::BadConstant => f.write_str("the value is none of the constant's type"),
            DefinitionFault::UnknownType { name } => write!(f, "type {name} is not defined in the text"),
            DefinitionFault::TooDeep => f.write_str("types within types too deep, or in a circle"),
        }
    }
}

impl core::error::Error for DefinitionError {}
