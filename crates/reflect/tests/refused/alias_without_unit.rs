use reflect::Message;
use serde::{Deserialize, Serialize};

type Speed = f64;

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    speed: Speed,
}

fn main() {}
