//! Definitions met at run time: ours come back as they went, foreign ones are read, and nothing else is
//! believed.

use proptest::prelude::*;
use reflect::{Definition, DefinitionFault, Leaf, PathFault, Shape, Value, ViewError};

/// As `rosmsg show --raw` and rosbag write it: short names of the same package, `Header`, deprecated types,
/// constants.
const FOREIGN: &str = "\
# A foreign message
Header header
byte OLD=-3
float32 GRAVITY = 9.81  # comment
string GREETING= hello # world
bool FLAG=True
char letter
duration length
Part[] parts
Part[2] pair
float64[3] xyz\t# trailing
string[] names
uint8[] data
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id

================================================================================
MSG: other/Part
int16 a
string b
";

fn foreign() -> Definition {
    Definition::parse("other/Message", FOREIGN).expect("valid ros1msg")
}

fn text(out: &mut Vec<u8>, content: &str) {
    out.extend((content.len() as u32).to_le_bytes());
    out.extend(content.as_bytes());
}

fn foreign_body() -> Vec<u8> {
    let mut body = Vec::new();
    body.extend(7_u32.to_le_bytes());
    body.extend([1, 0, 0, 0, 2, 0, 0, 0]);
    text(&mut body, "map");
    body.push(b'x');
    body.extend((-1_i32).to_le_bytes());
    body.extend(5_i32.to_le_bytes());
    body.extend(1_u32.to_le_bytes());
    for (a, b) in [(1_i16, "one"), (-2, ""), (3, "three")] {
        body.extend(a.to_le_bytes());
        text(&mut body, b);
    }
    for number in [0.5_f64, 1.5, 2.5] {
        body.extend(number.to_le_bytes());
    }
    body.extend(2_u32.to_le_bytes());
    text(&mut body, "a");
    text(&mut body, "bc");
    body.extend([2, 0, 0, 0, 8, 9]);
    body
}

#[test]
fn a_foreign_message_is_read() {
    let definition = foreign();
    let value = definition.decode(&foreign_body()).expect("a body of that type");
    assert_eq!(
        serde_json::to_string(&value).expect("it serialises"),
        concat!(
            r#"{"header":{"seq":7,"stamp":{"sec":1,"nsec":2},"frame_id":"map"},"letter":120,"#,
            r#""length":{"sec":-1,"nsec":5},"parts":[{"a":1,"b":"one"}],"#,
            r#""pair":[{"a":-2,"b":""},{"a":3,"b":"three"}],"xyz":[0.5,1.5,2.5],"#,
            r#""names":["a","bc"],"data":[8,9]}"#
        )
    );
}

#[test]
fn a_field_is_read_without_the_rest() {
    let (definition, body) = (foreign(), foreign_body());
    let read = |path: &str| {
        let reader = definition.field(path).expect("a field of that path");
        let value = reader.read(&body).expect("a body of that type");
        value.map(|value| serde_json::to_string(&value).expect("it serialises"))
    };
    let whole = definition.decode(&body).expect("a body of that type");
    for path in [
        "header",
        "header.stamp",
        "header.frame_id",
        "letter",
        "length",
        "parts",
        "parts.0",
        "parts.0.b",
        "pair.0.a",
        "pair.1.a",
        "pair.1.b",
        "xyz.0",
        "xyz.2",
        "names.1",
        "data",
        "data.1",
    ] {
        let expected = whole.at(path).expect("a value at that path");
        assert_eq!(read(path), Some(serde_json::to_string(expected).expect("it serialises")), "{path}");
    }
    assert_eq!(read("parts.1.a"), None, "there is one part in this body");
    assert_eq!(read("names.2"), None);
    // What stands behind the field is not looked at, what stands before it is.
    let reader = definition.field("letter").expect("a field");
    assert_eq!(reader.read(&body[..20]).expect("enough"), Some(Value::Unsigned(120)));
    assert_eq!(reader.read(&body[..19]), Err(ViewError::Short { needed: 1, left: 0 }));
}

#[test]
fn a_path_that_leads_nowhere_says_where_and_what_there_is() {
    let definition = foreign();
    let fault = |path: &str| definition.field(path).expect_err("no field of that path");
    let known = vec!["a".to_owned(), "b".to_owned()];
    assert_eq!(fault("parts.0.c").fault, PathFault::NoField { record: "other/Part".to_owned(), known });
    assert_eq!(fault("parts.x").fault, PathFault::NotIndex);
    assert_eq!(fault("xyz.3").fault, PathFault::IndexTooGreat { length: 3 });
    assert_eq!(fault("letter.x").fault, PathFault::NoParts);
    assert!(fault("").to_string().contains("it has header, letter"), "{}", fault(""));
    assert!(fault("parts.0.c").to_string().starts_with("parts.0.c: other/Part has no field \"c\""));
}

#[test]
fn leaves_are_columns() {
    let paths: Vec<String> = foreign().leaves().expect("few").into_iter().map(|leaf| leaf.path).collect();
    assert_eq!(
        paths,
        [
            "header.seq",
            "header.stamp",
            "header.frame_id",
            "letter",
            "length",
            "parts",
            "pair.0.a",
            "pair.0.b",
            "pair.1.a",
            "pair.1.b",
            "xyz.0",
            "xyz.1",
            "xyz.2",
            "names",
            "data",
        ]
    );
}

#[test]
fn units_and_named_values_come_back_from_comments() {
    let text = "\
# State: What it does.
uint32 STATE_IDLE=0  # On the ground.
uint32 STATE_GONE=200  # Away.
# What it does.
# [values of State]
uint32 state

# Mount: Which way
# up it is.
uint8 MOUNT_UPRIGHT=0
# [at most 2 elements, values of Mount]
uint8[] mounts

# [unit m, frame world]
geometry_msgs/Vector3 position_m
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
";
    let definition = Definition::parse("example/Both", text).expect("ours");
    let Shape::Enumeration(state) = &definition.root().fields[0].shape else { panic!("no enumeration") };
    assert_eq!((state.name_of(200), state.name_of(1)), (Some("GONE"), None));
    let leaf = |path: &str, unit: Option<&str>| Leaf { path: path.to_owned(), unit: unit.map(str::to_owned) };
    let expected = [
        leaf("state", None),
        leaf("mounts", None),
        leaf("position_m.x", Some("m")),
        leaf("position_m.y", Some("m")),
    ];
    assert_eq!(definition.leaves().expect("few"), expected);
    assert_eq!(definition.field("position_m.y").expect("a field").unit(), Some("m"));
    let mut body = vec![200, 0, 0, 0, 1, 0, 0, 0, 0];
    body.extend([0; 16]);
    let value = definition.decode(&body).expect("a body");
    assert_eq!(value.at("state"), Some(&Value::Enumeration { value: 200, name: "GONE" }));
    assert_eq!(value.at("mounts.0"), Some(&Value::Enumeration { value: 0, name: "UPRIGHT" }));
    body[4] = 3;
    assert_eq!(definition.decode(&body), Err(ViewError::TooLong { length: 3, bound: 2 }));
    let unknown = ViewError::UnknownValue { enumeration: "State".to_owned(), value: 1 };
    assert_eq!(definition.decode(&[1, 0, 0, 0]), Err(unknown));
}

#[test]
fn what_is_no_definition_is_named_with_its_line() {
    let cases: [(&str, u32, DefinitionFault); 17] = [
        ("uint8", 1, DefinitionFault::NoStatement),
        ("uint8 a b", 1, DefinitionFault::NoStatement),
        ("uint8 a\nuint8 a", 2, DefinitionFault::TwoFields),
        ("uint8 1a", 1, DefinitionFault::BadName),
        ("uint8[-1] a", 1, DefinitionFault::BadLength),
        ("uint8[4294967296] a", 1, DefinitionFault::BadLength),
        ("uint8] a", 1, DefinitionFault::BadLength),
        ("a/b/c d", 1, DefinitionFault::BadTypeName),
        ("uint8 A=256", 1, DefinitionFault::BadConstant),
        ("time A=1", 1, DefinitionFault::BadConstant),
        ("float32 A=x", 1, DefinitionFault::BadConstant),
        ("Other a", 1, DefinitionFault::UnknownType { name: "p/Other".to_owned() }),
        ("T a", 1, DefinitionFault::TooDeep),
        ("\n===\nuint8 a", 3, DefinitionFault::NoTypeName),
        ("===\nMSG: nothing", 2, DefinitionFault::BadTypeName),
        ("uint8 a\n===", 2, DefinitionFault::NoTypeName),
        ("uint8 a\n===\nMSG: p/T\nuint16 a", 4, DefinitionFault::TwoDefinitions),
    ];
    for (text, line, fault) in cases {
        let error = Definition::parse("p/T", text).expect_err(text);
        assert_eq!((error.line, &error.fault), (line, &fault), "{text}");
        assert!(!error.to_string().is_empty());
    }
    for name in ["T", "p/", "/T", "p/T/U", "p p/T"] {
        assert!(Definition::parse(name, "").is_err(), "{name}");
    }
    let error = Definition::parse("p/T", &format!("# {}", "x".repeat(1 << 20))).expect_err("too long");
    assert!(matches!(error.fault, DefinitionFault::TooLong { .. }));
}

/// A chain of types, each holding ten of the next: what is small as text is not small as a message.
fn bomb(leaf: &str) -> String {
    let mut text = String::new();
    for level in 0..12 {
        for field in 0..10 {
            text += &format!("L{} f{field}\n", level + 1);
        }
        text += &format!("===\nMSG: p/L{}\n", level + 1);
    }
    text + leaf
}

#[test]
fn a_definition_that_unfolds_without_end_costs_nothing() {
    for leaf in ["", "uint8 a\n", "string a\n", "string[4000000000] a\nEmpty[] b\n===\nMSG: p/Empty\n"] {
        let definition = Definition::parse("p/T", &bomb(leaf)).expect("valid");
        assert!(definition.decode(&[0; 400]).is_err());
        let reader = definition.field("f9.f9").expect("a field");
        assert!(leaf.is_empty() || reader.read(&[0; 400]).is_err());
        assert!(definition.leaves().is_none_or(|leaves| leaves.is_empty()));
    }
    let deep = bomb("").replace("p/L12\n", "p/L12\nL1 again\n");
    let error = Definition::parse("p/T", &deep).expect_err("a circle");
    assert_eq!(error.fault, DefinitionFault::TooDeep);
    let wide = Definition::parse("p/T", "Empty[4294967295] a\nuint8 b\n===\nMSG: p/Empty\n").expect("valid");
    assert_eq!(wide.decode(&[1]), Err(ViewError::TooComplex));
    let reader = wide.field("b").expect("a field");
    assert_eq!(reader.read(&[7]), Ok(Some(Value::Unsigned(7))));
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(
        text in "(([a-z]{0,6}|uint8|string|time|===|MSG:|#|=|\\[|\\]|[0-9]|/| |\n|[A-Z])){0,60}"
    ) {
        if let Ok(definition) = Definition::parse("p/T", &text) {
            let _ = definition.decode(&[0; 64]);
            let _ = definition.leaves();
        }
    }

    #[test]
    fn any_body_is_read_or_refused_and_fields_agree_with_the_whole(
        body in prop::collection::vec(any::<u8>(), 0..200), cut in 0_usize..200,
        flip in 0_usize..200, byte: u8
    ) {
        let definition = foreign();
        let _ = definition.decode(&body);
        let mut body = foreign_body();
        body.truncate(cut);
        if let Some(target) = body.get_mut(flip) {
            *target = byte;
        }
        if let Ok(value) = definition.decode(&body) {
            for leaf in definition.leaves().expect("few") {
                let reader = definition.field(&leaf.path).expect("a leaf");
                prop_assert_eq!(reader.read(&body), Ok(value.at(&leaf.path).cloned()));
            }
        }
    }
}
