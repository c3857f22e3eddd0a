use reflect::Message;
use serde::{Deserialize, Serialize};

/// Something else.
#[derive(Serialize, Deserialize)]
struct Other {
    /// A field.
    count: u8,
}

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    other: Other,
}

fn main() {}
