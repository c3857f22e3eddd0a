use reflect::{Enumeration, Message};
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
enum Bad {
    /// A variant.
    Height(f64),
}

/// A choice.
#[derive(Clone, Copy, Enumeration)]
#[repr(u8)]
enum Choice {
    /// A value.
    Height(u8) = 1,
}

fn main() {}
