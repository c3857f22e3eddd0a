//! The tools on a live bus.

use std::fs;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};
use service_shell::{BusSender, clock};
use settings::Arena;
use wire::Domain;

use super::rig::{Place, RUN, Said, Sender, UNKNOWN, state};

/// Somebody who says messages until it is dropped, every seventh number left out.
struct Talk {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Talk {
    fn begin(place: &Place) -> Self {
        let arena = Arena::load(&place.0.join("config"), "double-flip").unwrap();
        let mut bus = BusSender::open(&arena.network, Domain::Sim).unwrap();
        let over = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&over);
        let thread = std::thread::spawn(move || {
            let mut sender = Sender::new();
            for number in 1.. {
                if ended.load(Ordering::Relaxed) {
                    return;
                }
                let now = clock::now();
                sender.say(number, now, &mut |datagram| {
                    if number % 7 != 0 {
                        bus.send(datagram);
                    }
                });
                // Late, and again and again: who listens first hears messages of unknown type.
                if number % 50 == 49 {
                    sender.announce(now, &mut |datagram| bus.send(datagram));
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        Self { over, thread: Some(thread) }
    }
}

impl Drop for Talk {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn run_id() -> String {
    format!("{RUN:x}")
}

#[test]
fn echo_says_what_is_said() {
    let place = Place::new("bus-echo", 700);
    let _talk = Talk::begin(&place);
    let run = run_id();
    let lines = place.run(&["echo", "vehicle/state", "--json", "--count", "150", "--run", &run]).json_lines();
    assert_eq!(lines.len(), 150);
    let mut before = 0;
    for line in &lines {
        let number = line["sequence"].as_u64().unwrap();
        assert!(number > before && !number.is_multiple_of(7), "{number} after {before}");
        before = number;
        let position = state(number).estimate.position_m;
        let expected = json!({"x": position.x, "y": position.y, "z": position.z});
        assert_eq!(line["body"]["estimate"]["position_m"], expected);
        assert_eq!(line["verified"], true);
    }
    let lines = place.run(&["echo", UNKNOWN, "--json", "--count", "20", "--run", &run]).json_lines();
    for line in lines {
        let number = line["sequence"].as_u64().unwrap();
        assert_eq!(line["body"]["level_v"].as_f64().unwrap() as f32, number as f32 * 0.1);
        assert_eq!(line["verified"], false);
    }
    let said = place.run(&[
        "echo",
        "vehicle/state.accepted_frames",
        "--count",
        "5",
        "--vehicle",
        "1",
        "--run",
        &run,
    ]);
    for line in said.fine().lines() {
        assert_eq!(line.parse::<u64>().unwrap() % 2, 1);
    }
    place.run(&["echo", "vehicle/state.speed", "--run", &run]).assert_refused(&["speed", "estimate"]);
}

#[test]
fn topics_and_hz_tell_rate_and_loss() {
    let place = Place::new("bus-rates", 710);
    let _talk = Talk::begin(&place);
    let run = run_id();
    let rows = place.run(&["topics", "--json", "--duration", "2", "--run", &run]).json_lines();
    let row = |topic: &str| rows.iter().find(|row| row["topic"] == topic).unwrap();
    for (topic, verified) in [("vehicle/state", true), (UNKNOWN, false)] {
        let (messages, lost) =
            (row(topic)["messages"].as_u64().unwrap(), row(topic)["lost"].as_u64().unwrap());
        assert!(messages > 10, "{messages}");
        // One of seven, wherever in a round of seven the listening began and ended.
        assert!(lost * 6 <= messages + 6 && messages <= lost * 6 + 12, "{messages} came, {lost} did not");
        assert_eq!(row(topic)["verified"], verified);
        assert_eq!(row(topic)["sources"], json!(["estimator"]));
    }
    assert_eq!(row(UNKNOWN)["type"], json!(["extra/Thing"]));
    let answers = place.run(&["hz", UNKNOWN, "--json", "--count", "100", "--run", &run]).json_lines();
    let last: &Value = answers.last().unwrap();
    assert_eq!((last["messages"].as_u64(), &last["source"]), (Some(100), &json!("estimator")));
    assert!(last["period_ms_min"].as_f64() <= last["period_ms"].as_f64());
    assert!((14..=17).contains(&last["lost"].as_u64().unwrap()), "{last}");
}

#[test]
fn a_closed_pipe_and_an_interrupt_are_no_failures() {
    let place = Place::new("bus-ends", 720);
    let _talk = Talk::begin(&place);
    let spawn = |line: &[&str]| -> Child {
        place.command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let run = run_id();
    let mut piped = spawn(&["echo", "vehicle/state", "--json", "--run", &run]);
    drop(piped.stdout.take());
    let said = Said::from(piped.wait_with_output().unwrap());
    assert_eq!(said.fine(), "");
    let mut interrupted = spawn(&["hz", "vehicle/state", "--run", &run]);
    // Its first line says that it listens.
    let mut first = [0];
    std::io::Read::read_exact(interrupted.stdout.as_mut().unwrap(), &mut first).unwrap();
    let id = interrupted.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let said = Said::from(interrupted.wait_with_output().unwrap());
    assert!(said.fine().contains("vehicle 1"), "{said:?}");
}

#[test]
fn without_an_arena_it_says_what_is_missing() {
    let place = Place::new("bus-none", 730);
    place.run(&["topics"]).assert_refused(&["run file", "arena up"]);
    fs::remove_file(place.0.join(".flyarena/secret")).unwrap();
    place.run(&["echo", "vehicle/state", "--run", "ab"]).assert_refused(&["secret"]);
    let said = Place::new("bus-silent", 740).run(&["topics", "--duration", "0.3", "--run", "ab"]);
    assert_eq!((said.code, said.out.as_str()), (Some(1), ""));
    assert!(said.errors.contains("nothing was heard"));
}
