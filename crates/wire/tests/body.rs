//! Bodies: byte-identical to ROS 1 serialization, bounded, finite, and the same to the two readers there are.

use proptest::prelude::*;
use quantity::{Body, Rotation, Time, Vector, World};
use reflect::{Enumeration, Message, Seq, Text, Value};
use serde::{Deserialize, Serialize};
use wire::{BODY_BYTES_MAX, DecodeError, EncodeError, decode, encode};

/// What a vehicle does; the values are not the ordinals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Enumeration)]
#[repr(u32)]
enum State {
    /// On the ground.
    #[default]
    Idle = 0,
    /// On its way up.
    TakingOff = 1,
    /// On its way down.
    Landing = 7,
    /// Motors off.
    Emergency = 200,
}

/// The format page's example.
#[derive(Clone, Debug, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Status")]
struct Status {
    /// When.
    stamp: Time,
    /// Who.
    name: Text<16>,
    /// What it does.
    state: State,
    /// What it did.
    history: Seq<State, 8>,
    /// Charge left.
    battery_ratio: f32,
    /// Since its start.
    uptime_ns: u64,
    /// Ticks of its clock to ours.
    drift: i64,
}

#[test]
fn the_format_pages_example_is_met_bit_for_bit() {
    let status = Status {
        stamp: Time::from_nanos(1_700_000_000_020_000_000),
        name: Text::truncated("cf1"),
        state: State::Landing,
        history: vec![State::Idle, State::TakingOff, State::Emergency].try_into().expect("three fit"),
        battery_ratio: 0.75,
        uptime_ns: u64::MAX - 1,
        drift: i64::MIN + 1,
    };
    let bytes = [
        0x00, 0xf1, 0x53, 0x65, 0x00, 0x2d, 0x31, 0x01, // stamp
        0x03, 0x00, 0x00, 0x00, 0x63, 0x66, 0x31, // name
        0x07, 0x00, 0x00, 0x00, // state
        0x03, 0x00, 0x00, 0x00, // history
        0x00, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0xc8, 0x00, 0x00, 0x00, //
        0x00, 0x00, 0x40, 0x3f, // battery
        0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, // uptime
        0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x80, // drift
    ];
    assert_eq!(bytes.len(), 55);
    assert_eq!(encoded(&status), bytes);
    assert_eq!(decode::<Status>(&bytes), Ok(status));
}

/// How something is mounted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Enumeration)]
#[repr(u8)]
enum Mount {
    /// As drawn.
    #[default]
    Upright = 0,
    /// Turned over.
    Inverted = 9,
}

/// A part of the message that holds everything.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Part")]
struct Part {
    /// How it is mounted.
    mount: Mount,
    /// Its label.
    label: Text<20>,
    /// Where it is.
    position_m: Vector<World>,
}

/// A message with a field of every kind.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Everything")]
struct Everything {
    /// A truth.
    flag: bool,
    /// Signed, one byte.
    signed8: i8,
    /// Signed, two bytes.
    signed16: i16,
    /// Signed, four bytes.
    signed32: i32,
    /// Unsigned, two bytes.
    unsigned16: u16,
    /// Unsigned, four bytes.
    unsigned32: u32,
    /// Floats of a number known beforehand.
    levels_v: [f32; 3],
    /// Bytes of a number known beforehand.
    serial: [u8; 5],
    /// An instant.
    at: Time,
    /// An attitude.
    orientation: Rotation<Body, World>,
    /// Some bytes.
    bytes: Seq<u8, 40>,
    /// Some floats.
    thrusts_n: Seq<f64, 4>,
    /// Some messages.
    parts: Seq<Part, 3>,
}

fn encoded<M: Message>(message: &M) -> Vec<u8> {
    let mut body = Vec::new();
    encode(message, &mut body).expect("the message has a body");
    body
}

/// The view that a dynamic reader must come to, written down by hand.
fn view(message: &Everything) -> Value<'static> {
    let vector = |v: Vector<World>| {
        Value::Record(vec![("x", Value::F64(v.x)), ("y", Value::F64(v.y)), ("z", Value::F64(v.z))])
    };
    let part = |part: &Part| {
        let mount = Value::Enumeration { value: part.mount.value(), name: part.mount.name() };
        Value::Record(vec![
            ("mount", mount),
            ("label", Value::Text(part.label.to_string())),
            ("position_m", vector(part.position_m)),
        ])
    };
    let nanos = message.at.as_nanos();
    let turn = message.orientation;
    Value::Record(vec![
        ("flag", Value::Bool(message.flag)),
        ("signed8", Value::Signed(message.signed8.into())),
        ("signed16", Value::Signed(message.signed16.into())),
        ("signed32", Value::Signed(message.signed32.into())),
        ("unsigned16", Value::Unsigned(message.unsigned16.into())),
        ("unsigned32", Value::Unsigned(message.unsigned32.into())),
        ("levels_v", Value::Seq(message.levels_v.iter().map(|level| Value::F32(*level)).collect())),
        ("serial", Value::Seq(message.serial.iter().map(|byte| Value::Unsigned((*byte).into())).collect())),
        ("at", Value::Time { sec: (nanos / 1_000_000_000) as u32, nsec: (nanos % 1_000_000_000) as u32 }),
        (
            "orientation",
            Value::Record(vec![
                ("x", Value::F64(turn.x)),
                ("y", Value::F64(turn.y)),
                ("z", Value::F64(turn.z)),
                ("w", Value::F64(turn.w)),
            ]),
        ),
        ("bytes", Value::Seq(message.bytes.iter().map(|byte| Value::Unsigned((*byte).into())).collect())),
        ("thrusts_n", Value::Seq(message.thrusts_n.iter().map(|thrust| Value::F64(*thrust)).collect())),
        ("parts", Value::Seq(message.parts.iter().map(part).collect())),
    ])
}

fn parts() -> impl Strategy<Value = Part> {
    (any::<bool>(), "\\PC{0,5}", prop::array::uniform3(-1e9..1e9f64)).prop_map(
        |(inverted, label, [x, y, z])| Part {
            mount: if inverted { Mount::Inverted } else { Mount::Upright },
            label: Text::truncated(label),
            position_m: Vector::new(x, y, z),
        },
    )
}

prop_compose! {
    fn everything()(
        (flag, signed8, signed16, signed32) in any::<(bool, i8, i16, i32)>(),
        (unsigned16, unsigned32, serial) in any::<(u16, u32, [u8; 5])>(),
        levels_v in prop::array::uniform3(-1e9..1e9f32),
        nanos in 0..i64::from(u32::MAX) * 1_000_000_000,
        turn in prop::array::uniform3(-1.7..1.7f64),
        bytes in prop::collection::vec(any::<u8>(), 0..=40),
        thrusts in prop::collection::vec(-1e9..1e9f64, 0..=4),
        parts in prop::collection::vec(parts(), 0..=3),
    ) -> Everything {
        Everything {
            flag, signed8, signed16, signed32, unsigned16, unsigned32, levels_v, serial,
            at: Time::from_nanos(nanos),
            orientation: Rotation::from_rotation_vector(Vector::new(turn[0], turn[1], turn[2])),
            bytes: bytes.try_into().expect("within the bound"),
            thrusts_n: thrusts.try_into().expect("within the bound"),
            parts: parts.try_into().expect("within the bound"),
        }
    }
}

proptest! {
    #[test]
    fn every_message_comes_back_as_it_went(message in everything()) {
        prop_assert_eq!(decode::<Everything>(&encoded(&message)), Ok(message));
    }

    #[test]
    fn the_dynamic_reader_sees_the_same(message in everything()) {
        prop_assert_eq!(Value::decode(Everything::SCHEMA, &encoded(&message)), Ok(view(&message)));
    }

    /// Two independent readers of the format agree on what is a body of this type. The one thing the dynamic
    /// reader lets pass is what only arithmetic minds: floats that are not finite, quaternions not of unit
    /// length.
    #[test]
    fn both_readers_agree_on_damaged_bodies(
        message in everything(), at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in 0..3_usize,
    ) {
        let mut body = encoded(&message);
        let at = at.index(body.len());
        body[at] = byte;
        body.truncate(body.len() - cut);
        let viewed = Value::decode(Everything::SCHEMA, &body);
        match decode::<Everything>(&body) {
            Ok(message) => prop_assert_eq!(viewed, Ok(view(&message))),
            Err(DecodeError::NotFinite { .. }) => prop_assert!(viewed.is_ok()),
            Err(_) => prop_assert!(viewed.is_err() || !has_unit_quaternion(&viewed)),
        }
    }

    #[test]
    fn arbitrary_bytes_never_panic(body in prop::collection::vec(any::<u8>(), 0..300)) {
        if let Ok(message) = decode::<Everything>(&body) {
            prop_assert_eq!(encoded(&message), body.clone());
        }
        let _ = Value::decode(Everything::SCHEMA, &body);
        let _ = Value::decode(Status::SCHEMA, &body);
    }

    #[test]
    fn every_truncation_is_refused(message in everything()) {
        let body = encoded(&message);
        for length in 0..body.len() {
            prop_assert!(decode::<Everything>(&body[..length]).is_err());
            prop_assert!(Value::decode(Everything::SCHEMA, &body[..length]).is_err());
        }
    }
}

fn has_unit_quaternion<E>(viewed: &Result<Value, E>) -> bool {
    let Ok(value) = viewed else { return false };
    let squares = ["x", "y", "z", "w"].map(|name| {
        let component =
            value.at(&format!("orientation.{name}")).and_then(Value::number).expect("a component");
        component * component
    });
    (squares.iter().sum::<f64>() - 1.0).abs() < 1e-3
}

#[test]
fn bytes_after_the_last_field_are_an_error() {
    let mut body = encoded(&Part::default());
    body.push(0);
    let expected =
        DecodeError::Trailing { message: "example/Part", read: body.len() - 1, length: body.len() };
    assert_eq!(decode::<Part>(&body), Err(expected));
}

#[test]
fn numbers_that_are_not_finite_are_refused_both_ways() {
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut body = encoded(&Part::default());
        let start = body.len();
        let part = Part { position_m: Vector::new(0.0, poison, 0.0), ..Part::default() };
        let refused = encode(&part, &mut body);
        assert_eq!(refused, Err(EncodeError::NotFinite { message: "example/Part" }));
        assert_eq!(body.len(), start, "nothing is left behind");
        body[start - 8..].copy_from_slice(&poison.to_le_bytes());
        assert_eq!(decode::<Part>(&body), Err(DecodeError::NotFinite { message: "example/Part" }));
    }
}

#[test]
fn an_instant_before_the_clocks_zero_is_not_written() {
    let message = Everything { at: Time::from_nanos(-1), ..Everything::default() };
    let mut body = vec![7];
    let refused = encode(&message, &mut body);
    assert_eq!(refused, Err(EncodeError::Unwritable { message: "example/Everything" }));
    assert_eq!(body, [7]);
}

#[test]
fn a_value_without_a_name_is_refused() {
    let mut body = encoded(&Part::default());
    body[0] = 1;
    assert_eq!(
        decode::<Part>(&body),
        Err(DecodeError::Unreadable { message: "example/Part", length: body.len() })
    );
}

#[test]
fn a_hostile_count_is_refused() {
    let mut body = encoded(&Part::default());
    for count in [21, 60_000, u32::MAX] {
        body[1..5].copy_from_slice(&count.to_le_bytes());
        assert!(matches!(decode::<Part>(&body), Err(DecodeError::Unreadable { .. })), "{count}");
    }
}

/// More than a datagram carries.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Huge")]
struct Huge {
    /// Very many bytes.
    bytes: Seq<u8, 70_000>,
}

#[test]
fn a_body_has_a_limit() {
    let huge = |length: usize| Huge { bytes: vec![1; length].try_into().expect("within the bound") };
    let mut body = Vec::new();
    assert_eq!(encode(&huge(BODY_BYTES_MAX - 4), &mut body), Ok(()));
    assert_eq!(body.len(), BODY_BYTES_MAX);
    assert_eq!(decode(&body), Ok(huge(BODY_BYTES_MAX - 4)));
    body.clear();
    let refused = encode(&huge(BODY_BYTES_MAX - 3), &mut body);
    assert_eq!(refused, Err(EncodeError::TooLong { message: "example/Huge" }));
    let long = vec![0; BODY_BYTES_MAX + 1];
    assert_eq!(decode::<Huge>(&long), Err(DecodeError::TooLong { length: BODY_BYTES_MAX + 1 }));
}
