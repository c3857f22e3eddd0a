use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    speeds_m_s: [Option<f64>; 3],
}

fn main() {}
