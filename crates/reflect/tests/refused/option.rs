use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    speed_m_s: Option<f64>,
}

fn main() {}
