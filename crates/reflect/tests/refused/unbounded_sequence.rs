use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    heights_m: Vec<f64>,
}

fn main() {}
