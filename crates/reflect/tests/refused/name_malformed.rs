use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "Bad")]
struct Bad {
    /// A field.
    count: u8,
}

fn main() {}
