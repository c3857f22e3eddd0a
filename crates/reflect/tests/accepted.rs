//! What looks like the refused cases and is right.

use reflect::{Message, Seq, Text};
use serde::{Deserialize, Serialize};

type Speed = f64;

/// A message with a well-known name: its floats have the names everyone knows.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "geometry_msgs/Point")]
struct Point {
    /// Along the x axis.
    x: f64,
    /// Along the y axis.
    y: f64,
    /// Along the z axis.
    z: f64,
}

/// A message.
#[derive(Message, Serialize, Deserialize)]
#[message(name = "example/Good")]
struct Good {
    /// A speed.
    speed_m_s: Speed,
    /// A largest speed.
    speed_m_s_max: f32,
    /// Heights.
    heights_m: Seq<f64, 4>,
    /// A name.
    name: Text<8>,
    /// A place.
    place: Point,
    /// Attitudes need no unit.
    orientation: quantity::Rotation<quantity::Body, quantity::World>,
}

fn main() {
    assert_eq!(Good::SCHEMA.fields.len(), 6);
}
