//! The tools on a recording.

use std::fs;

use serde_json::{Value, json};

use super::rig::{PERIOD, Place, UNKNOWN, record, sent_at, state};

const COUNT: u64 = 400;

fn place(name: &str) -> Place {
    let place = Place::new(&format!("file-{name}"), 0);
    record(&place.0.join("a.mcap"), COUNT, |_| false);
    place
}

fn x_of(number: u64) -> f64 {
    state(number).estimate.position_m.x
}

#[test]
fn echo_says_what_was_published() {
    let place = place("echo");
    let lines = place.run(&["echo", "vehicle/state", "a.mcap", "--json"]).json_lines();
    assert_eq!(lines.len() as u64, COUNT);
    for (number, line) in (1..).zip(&lines) {
        let state = state(number);
        assert_eq!(line["sequence"], number);
        assert_eq!(line["published_at_ns"], sent_at(number).as_nanos());
        assert_eq!(line["at_ns"], sent_at(number).as_nanos() + 250_000);
        assert_eq!((&line["type"], &line["verified"]), (&json!("flyarena/VehicleState"), &json!(true)));
        let body = &line["body"];
        assert_eq!((&body["vehicle"], &body["accepted_frames"]), (&json!(state.vehicle), &json!(number)));
        assert_eq!(body["tracking"], if number < 10 { "COASTING" } else { "TRACKING" });
        let position = state.estimate.position_m;
        assert_eq!(
            body["estimate"]["position_m"],
            json!({"x": position.x, "y": position.y, "z": position.z})
        );
        let nanos = sent_at(number).as_nanos();
        assert_eq!(
            body["estimated_for"],
            json!({"sec": nanos / 1_000_000_000, "nsec": nanos % 1_000_000_000})
        );
    }
    let unknown = place.run(&["echo", UNKNOWN, "a.mcap", "--json", "--count", "2"]).json_lines();
    assert_eq!((unknown.len(), &unknown[1]["verified"]), (2, &json!(false)));
    assert_eq!(unknown[1]["body"], json!({"level_v": 0.2, "names": ["o,\""]}));
}

#[test]
fn echo_says_one_field_one_vehicle_one_stretch() {
    let place = place("field");
    let field = "vehicle/state.estimate.position_m.x";
    let said = place.run(&["echo", field, "a.mcap", "--vehicle", "1", "--count", "3"]);
    let numbers: Vec<f64> = said.fine().lines().map(|line| line.parse().unwrap()).collect();
    assert_eq!(numbers, [x_of(1), x_of(3), x_of(5)]);
    let lines =
        place.run(&["echo", field, "a.mcap", "--json", "--from", "0.5", "--to", "0.511"]).json_lines();
    let sequences: Vec<&Value> = lines.iter().map(|line| &line["sequence"]).collect();
    assert_eq!(sequences, [100, 101, 102]);
    assert_eq!(lines[0]["fields"], json!({"estimate.position_m.x": x_of(100)}));
    let said = place.run(&["echo", "vehicle/state", "a.mcap", "--count", "1"]);
    for words in [
        "# vehicle/state at 0.005250 s from estimator, number 1, flyarena/VehicleState",
        "tracking: COASTING",
    ] {
        assert!(said.fine().contains(words), "{}", said.out);
    }
}

#[test]
fn topics_and_hz_count_what_is_there_and_what_is_not() {
    let place = Place::new("file-rates", 0);
    record(&place.0.join("a.mcap"), COUNT, |number| (100..107).contains(&number));
    let rows = place.run(&["topics", "a.mcap", "--json"]).json_lines();
    assert_eq!(rows.len(), 2);
    let row = |topic: &str| rows.iter().find(|row| row["topic"] == topic).unwrap();
    let known = row("vehicle/state");
    assert_eq!(known["type"], json!(["flyarena/VehicleState"]));
    assert_eq!(known["sources"], json!(["estimator"]));
    assert_eq!(
        (&known["messages"], &known["lost"], &known["verified"]),
        (&json!(COUNT - 7), &json!(7), &json!(true))
    );
    assert_eq!((&row(UNKNOWN)["lost"], &row(UNKNOWN)["verified"]), (&json!(7), &json!(false)));
    let answers = place.run(&["hz", UNKNOWN, "a.mcap", "--json"]).json_lines();
    let [answer] = answers.as_slice() else { panic!("{answers:?}") };
    let number = |key: &str| answer[key].as_f64().unwrap();
    assert_eq!((number("messages"), number("lost")), ((COUNT - 7) as f64, 7.0));
    let period_ms = PERIOD.as_nanos() as f64 * 1e-6;
    assert_eq!((number("period_ms_min"), number("period_ms_max")), (period_ms, 8.0 * period_ms));
    let mean = 399.0 * period_ms / 392.0;
    assert!((number("period_ms") - mean).abs() < 1e-9 && (number("rate_hz") * mean - 1e3).abs() < 1e-6);
    assert!((number("lateness_ms") - 0.25).abs() < 1e-9);
    // Vehicles take turns: each has half the rate.
    let answers = place.run(&["hz", "vehicle/state", "a.mcap", "--json", "--from", "0.6"]).json_lines();
    assert_eq!(answers.len(), 2);
    for answer in answers {
        assert!((answer["rate_hz"].as_f64().unwrap() - 100.0).abs() < 1e-6, "{answer}");
    }
}

#[test]
fn a_table_reads_back_as_what_was_published() {
    let place = place("csv");
    let fields = ["vehicle/state.estimate.position_m", "extra/unknown.topic.level_v"];
    let said = place.run(&["export", "a.mcap", "--csv", fields[0], fields[1]]);
    let mut lines = said.fine().lines();
    let position = |axis: &str| format!("vehicle/state.estimate.position_m.{axis} [m]");
    let header = format!(
        "time_s,vehicle,{},{},{},extra/unknown.topic.level_v [V]",
        position("x"),
        position("y"),
        position("z")
    );
    assert_eq!(lines.next(), Some(header.as_str()));
    for number in 1..=COUNT {
        let cells: Vec<&str> = lines.next().unwrap().split(',').collect();
        let state = state(number);
        let nanos = PERIOD.as_nanos() * number as i64 + 250_000;
        assert_eq!(cells[0], format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000));
        assert_eq!((cells[1], cells[5]), (&*state.vehicle.to_string(), ""));
        let read: Vec<f64> = cells[2..5].iter().map(|cell| cell.parse().unwrap()).collect();
        let position = state.estimate.position_m;
        assert_eq!(read, [position.x, position.y, position.z]);
        let cells: Vec<&str> = lines.next().unwrap().split(',').collect();
        assert_eq!(cells[1..5], ["", "", "", ""]);
        assert_eq!(cells[5].parse::<f32>().unwrap(), number as f32 * 0.1);
    }
    assert_eq!(lines.next(), None);
    place.run(&["export", "a.mcap", "--csv", "--output", "tables/"]).fine();
    for (file, columns) in [
        ("vehicle_state.csv", "time_s,vehicle,tracking,"),
        ("extra_unknown.topic.csv", "time_s,level_v [V],names"),
    ] {
        let text = fs::read_to_string(place.0.join("tables").join(file)).unwrap();
        assert!(text.starts_with(columns), "{text}");
        assert_eq!(text.lines().count() as u64, COUNT + 1);
    }
}

#[test]
fn json_is_what_echo_says() {
    let place = place("json");
    let echoed = place.run(&["echo", "vehicle/state", "a.mcap", "--json"]);
    let exported = place.run(&["export", "a.mcap", "--json", "--topic", "vehicle/state"]);
    assert_eq!(exported.fine(), echoed.fine());
}

#[test]
fn a_plot_is_a_picture_of_either_kind() {
    let place = place("plot");
    let fields = ["vehicle/state.estimate.position_m.x", "vehicle/state.tracking"];
    place.run(&["plot", "a.mcap", fields[0], fields[1], "--output", "p.svg"]).fine();
    let svg = fs::read_to_string(place.0.join("p.svg")).unwrap();
    for words in ["estimate.position_m.x, vehicle 1", "tracking, vehicle 2", "[m]", "time [s]"] {
        assert!(svg.contains(words), "{words}");
    }
    place.run(&["plot", "a.mcap", "extra/unknown.topic.level_v", "--output", "p.png"]).fine();
    assert!(fs::read(place.0.join("p.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn what_is_asked_wrongly_is_named() {
    let place = place("wrong");
    place.run(&["echo", "vehicle/stat", "a.mcap"]).assert_refused(&[
        "vehicle/stat",
        "vehicle/state",
        UNKNOWN,
    ]);
    place.run(&["echo", "vehicle/state.speed", "a.mcap"]).assert_refused(&[
        "speed",
        "flyarena/VehicleState",
        "estimate",
    ]);
    place.run(&["export", "a.mcap", "--csv", "vehicle/state.vehicle.x"]).assert_refused(&["vehicle.x"]);
    place.run(&["export", "a.mcap"]).assert_refused(&["--csv", "--json", "--ros2"]);
    place.run(&["export", "a.mcap", "--ros2", "vehicle/state.vehicle"]).assert_refused(&["whole topics"]);
    place
        .run(&["export", "a.mcap", "--ros2", "--output", "a.mcap"])
        .assert_refused(&["the recording itself"]);
    place
        .run(&["export", "a.mcap", "--json", UNKNOWN, "--vehicle", "1"])
        .assert_refused(&["names a vehicle"]);
    place.run(&["plot", "a.mcap", "extra/unknown.topic.names"]).assert_refused(&["no number"]);
    place
        .run(&["plot", "a.mcap", "vehicle/state.vehicle", "--output", "x.jpg"])
        .assert_refused(&[".svg or .png"]);
    place.run(&["hz", "vehicle/state.vehicle", "a.mcap"]).assert_refused(&["whole topic"]);
    place.run(&["echo", "vehicle/state", "--from", "1"]).assert_refused(&["name a file"]);
}

#[test]
fn damage_costs_what_it_hit_and_is_told() {
    let place = place("damage");
    let path = place.0.join("a.mcap");
    let mut bytes = fs::read(&path).unwrap();
    // In the middle of a chunk's data, which is where a disk's damage shows.
    let chunks: Vec<usize> = bytes
        .windows(11)
        .enumerate()
        .filter(|(_, bytes)| bytes.starts_with(b"lz4"))
        .map(|(at, _)| at)
        .collect();
    bytes[chunks[chunks.len() / 4] + 100] ^= 0xff;
    fs::write(&path, bytes).unwrap();
    let said = place.run(&["export", "a.mcap", "--csv", "vehicle/state.vehicle"]);
    assert_eq!(said.code, Some(1), "{}", said.errors);
    assert!(said.errors.contains("a.mcap") && said.errors.contains("damaged at byte"), "{}", said.errors);
    let rows = said.out.lines().count() as u64;
    assert!(rows > COUNT / 2 && rows < COUNT, "{rows}");
}
