use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    age: std::time::Duration,
}

fn main() {}
