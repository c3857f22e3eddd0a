use reflect::Message;
use serde::{Deserialize, Serialize};

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Bad")]
struct Bad {
    /// A field.
    rows: reflect::Seq<reflect::Seq<u8, 3>, 3>,
}

fn main() {}
