//! What the derives write down: text, ids, units, frames, enumerations.

use expect_test::expect;
use quantity::{Body, Rotation, Time, Vector, World};
use reflect::{Axes, Enumeration, Kind, Message, Schema, Seq, Text, Value, ViewError, fnv1a_64};
use serde::{Deserialize, Serialize};

/// What a vehicle does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Enumeration)]
#[repr(u32)]
enum State {
    /// On the ground.
    #[default]
    Idle = 0,
    /// On its way up.
    TakingOff = 1,
    /// Motors off.
    Emergency = 200,
}

/// Which way up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Enumeration)]
#[repr(u8)]
enum Mount {
    /// As drawn.
    #[default]
    Upright = 0,
    /// Turned over.
    Inverted = 9,
}

/// Something with a place.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Thing")]
struct Thing {
    /// Which way up it is.
    mount: Mount,
    /// Where it is.
    position_m: Vector<World>,
}

/// A message that shows every form
/// a definition can take.
///
/// With a second paragraph.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Show")]
struct Show {
    /// When.
    stamp: Time,
    /// What it does.
    state: State,
    /// What it did, oldest first.
    history: Seq<State, 8>,
    /// Its name.
    name: Text<16>,
    /// Attitude.
    orientation: Rotation<Body, World>,
    /// Rates about its axes.
    rate_rad_s: Vector<Body>,
    /// Fastest rate allowed.
    rate_rad_s_max: f32,
    /// Motors.
    thrusts_n: [f32; 4],
    /// Things around it.
    things: Seq<Thing, 3>,
}

/// A message with two enumerations.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "example/Both")]
struct Both {
    /// What it does.
    state: State,
    /// Which way up.
    mount: Mount,
    /// Which way up it was.
    mount_before: Mount,
}

#[test]
fn a_definition_is_written_as_rosbag_embeds_it() {
    expect![[r#"
        # A message that shows every form
        # a definition can take.
        #
        # With a second paragraph.

        # When.
        time stamp

        # State: What a vehicle does.
        uint32 IDLE=0  # On the ground.
        uint32 TAKING_OFF=1  # On its way up.
        uint32 EMERGENCY=200  # Motors off.
        # What it does.
        # [values of State]
        uint32 state

        # What it did, oldest first.
        # [at most 8 elements, values of State]
        uint32[] history

        # Its name.
        # [at most 16 bytes]
        string name

        # Attitude.
        # [takes body to world]
        geometry_msgs/Quaternion orientation

        # Rates about its axes.
        # [unit rad/s, frame body]
        geometry_msgs/Vector3 rate_rad_s

        # Fastest rate allowed.
        # [unit rad/s]
        float32 rate_rad_s_max

        # Motors.
        # [unit N]
        float32[4] thrusts_n

        # Things around it.
        # [at most 3 elements]
        example/Thing[] things
        ================================================================================
        MSG: geometry_msgs/Quaternion
        # A rotation as a unit quaternion in Hamilton's convention.

        # First imaginary component.
        float64 x

        # Second imaginary component.
        float64 y

        # Third imaginary component.
        float64 z

        # Real component.
        float64 w
        ================================================================================
        MSG: geometry_msgs/Vector3
        # Three components along the axes of a frame.

        # Along the x axis.
        float64 x

        # Along the y axis.
        float64 y

        # Along the z axis.
        float64 z
        ================================================================================
        MSG: example/Thing
        # Something with a place.

        # Mount: Which way up.
        uint8 UPRIGHT=0  # As drawn.
        uint8 INVERTED=9  # Turned over.
        # Which way up it is.
        # [values of Mount]
        uint8 mount

        # Where it is.
        # [unit m, frame world]
        geometry_msgs/Vector3 position_m
    "#]]
    .assert_eq(&Show::SCHEMA.text());
}

#[test]
fn several_enumerations_prefix_their_values() {
    expect![[r#"
        # A message with two enumerations.

        # State: What a vehicle does.
        uint32 STATE_IDLE=0  # On the ground.
        uint32 STATE_TAKING_OFF=1  # On its way up.
        uint32 STATE_EMERGENCY=200  # Motors off.
        # What it does.
        # [values of State]
        uint32 state

        # Mount: Which way up.
        uint8 MOUNT_UPRIGHT=0  # As drawn.
        uint8 MOUNT_INVERTED=9  # Turned over.
        # Which way up.
        # [values of Mount]
        uint8 mount

        # Which way up it was.
        # [values of Mount]
        uint8 mount_before
    "#]]
    .assert_eq(&Both::SCHEMA.text());
}

#[test]
fn the_id_is_of_name_nul_and_text() {
    let text = Show::SCHEMA.text();
    assert_eq!(Show::SCHEMA.id(), fnv1a_64(&[format!("example/Show\0{text}").as_bytes()]));
    let renamed = Schema { name: "example/Other", doc: Show::SCHEMA.doc, fields: Show::SCHEMA.fields };
    assert_ne!(Show::SCHEMA.id(), renamed.id());
}

#[test]
fn names_carry_units_and_types_carry_frames() {
    let field = |name| Show::SCHEMA.field(name).expect("a field of that name");
    let unit = |name| field(name).unit.map(|unit| unit.symbol);
    assert_eq!(unit("rate_rad_s"), Some("rad/s"));
    assert_eq!(unit("rate_rad_s_max"), Some("rad/s"));
    assert_eq!(unit("thrusts_n"), Some("N"));
    assert_eq!(unit("orientation"), None);
    assert_eq!(field("rate_rad_s").axes, Some(Axes::In("body")));
    assert_eq!(field("orientation").axes, Some(Axes::Between("body", "world")));
    assert!(matches!(field("things").kind, Kind::Seq { element: Kind::Message(inner), bound: 3 }
        if inner.name == "example/Thing"));
}

#[test]
fn an_enumeration_is_its_value() {
    assert_eq!(State::Emergency.value(), 200);
    assert_eq!(State::Emergency.name(), "EMERGENCY");
    assert_eq!(State::from_value(1), Some(State::TakingOff));
    assert_eq!(State::from_value(2), None);
    assert_eq!(<State as Enumeration>::SCHEMA.name_of(1), Some("TAKING_OFF"));
    assert_eq!(serde_json::to_string(&Mount::Inverted).expect("it serialises"), "9");
    assert_eq!(serde_json::from_str::<Mount>("9").expect("a known value"), Mount::Inverted);
    let error = serde_json::from_str::<Mount>("8").expect_err("an unknown value");
    assert_eq!(error.to_string(), "8 is no value of Mount");
}

#[test]
fn floats_that_are_not_finite_are_found_wherever_they_are() {
    assert!(Show::default().all_finite());
    let nan = Vector::new(0.0, 0.0, f64::NAN);
    let thing = Thing { position_m: nan, ..Thing::default() };
    for poisoned in [
        Show { rate_rad_s: nan.into_body(), ..Show::default() },
        Show { rate_rad_s_max: f32::INFINITY, ..Show::default() },
        Show { thrusts_n: [0.0, 0.0, 0.0, f32::NAN], ..Show::default() },
        Show { things: vec![Thing::default(), thing].try_into().expect("two fit"), ..Show::default() },
    ] {
        assert!(!poisoned.all_finite(), "{poisoned:?}");
    }
}

trait IntoBody {
    fn into_body(self) -> Vector<Body>;
}

impl IntoBody for Vector<World> {
    fn into_body(self) -> Vector<Body> {
        Vector::new(self.x, self.y, self.z)
    }
}

/// A body of `example/Both`.
const BOTH: [u8; 6] = [200, 0, 0, 0, 9, 0];

#[test]
fn a_body_is_read_by_its_schema() {
    let value = Value::decode(Both::SCHEMA, &BOTH).expect("a body of that type");
    expect![[r#"{"state":"EMERGENCY","mount":"INVERTED","mount_before":"UPRIGHT"}"#]]
        .assert_eq(&serde_json::to_string(&value).expect("it serialises"));
    assert_eq!(value.at("state").and_then(Value::number), Some(200.0));
    assert_eq!(value.at("nothing"), None);
    assert_eq!(value.at("state.0"), None);
}

#[test]
fn a_path_leads_through_sequences_and_messages() {
    let position = Value::Record(vec![("x", Value::F64(2.5))]);
    let thing = Value::Record(vec![("position_m", position)]);
    let value = Value::Record(vec![("things", Value::Seq(vec![thing]))]);
    assert_eq!(value.at("things.0.position_m.x").and_then(Value::number), Some(2.5));
    assert_eq!(value.at("things.1.position_m.x"), None);
}

#[test]
fn what_is_no_body_says_why() {
    let read = |body: &[u8]| Value::decode(Both::SCHEMA, body).expect_err("no body of that type");
    assert_eq!(read(&BOTH[..3]), ViewError::Short { needed: 4, left: 3 });
    assert_eq!(read(&[&BOTH[..], &[0, 0]].concat()), ViewError::Trailing { left: 2 });
    assert_eq!(
        read(&[200, 0, 0, 0, 8, 0]),
        ViewError::UnknownValue { enumeration: "Mount".to_owned(), value: 8 }
    );
    let read = |body: &[u8]| Value::decode(Show::SCHEMA, body).expect_err("no body of that type");
    let late = [0, 0, 0, 0, 0, 0xca, 0x9a, 0x3b];
    assert_eq!(read(&late), ViewError::BadTime { nsec: 1_000_000_000 });
    let mut many = [0; 16];
    many[12] = 9;
    assert_eq!(read(&many), ViewError::TooLong { length: 9, bound: 8 });
    let mut text = [0; 22];
    text[16] = 1;
    text[20] = 0xff;
    assert_eq!(read(&text), ViewError::NotUtf8);
}
