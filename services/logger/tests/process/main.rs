//! The logger as a process of its own: what it hears, it records; what it cannot, it says.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

mod rig;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use recording::{Recording, Selection};
use rig::Rig;
use schemas::{NodeHealth, topics};
use service_core::Observer;
use service_shell::{BusReceiver, Listen, block_on};
use wire::{Domain, Kind, Secret};

/// The numbers of a topic's messages, in the order of the recording.
fn numbers(recording: &Recording, topic: &str) -> Vec<u64> {
    let mut messages = recording.messages(&Selection::default());
    let mut found = Vec::new();
    while let Some(message) = messages.next() {
        let message = message.unwrap();
        if message.channel.topic == topic {
            found.push(u64::from_le_bytes(message.body[..8].try_into().unwrap()));
        }
    }
    found
}

fn body(number: u64) -> Vec<u8> {
    let mut body = vec![0; 200];
    body[..8].copy_from_slice(&number.to_le_bytes());
    body
}

#[test]
fn everything_is_recorded_and_sealed_on_sigterm_unknown_and_late_topics_too() {
    let rig = Rig::new("everything", 1);
    let logger = rig.logger("flight.mcap");
    rig.wait_for("flight.mcap.part");
    let mut known = rig.speaker("estimator", 4);
    let text = b"made/Up\0uint64 number\n";
    let late_id = reflect::fnv1a_64(&[text]);
    let mut unknown = rig.speaker("somebody", late_id);
    for number in 0..500 {
        known.say("vehicle/state", &body(number));
        if number % 10 == 0 {
            unknown.say("made/up", &body(number));
        }
        if number == 250 {
            unknown.say_as(Kind::Schema, "made/up", text);
        }
        std::thread::sleep(std::time::Duration::from_micros(500));
    }
    assert!(logger.end(), "it did not end well");
    let recording = Recording::open(&rig.folder.join("flight.mcap")).unwrap();
    assert_eq!(numbers(&recording, "vehicle/state"), (0..500).collect::<Vec<_>>());
    assert_eq!(numbers(&recording, "made/up"), (0..500).step_by(10).collect::<Vec<_>>());
    let made_up: Vec<_> = recording.channels().iter().filter(|channel| channel.topic == "made/up").collect();
    assert_eq!(made_up.len(), 2, "one before its definition came, one after");
    assert!(made_up.iter().all(|channel| !channel.stream.as_ref().unwrap().verified));
    assert_eq!(made_up.iter().filter(|channel| channel.definition.is_some()).count(), 1);
    let ending = recording.ending().unwrap();
    assert_eq!((ending.dropped_full, ending.dropped_stopped, ending.overflowed), (0, 0, 0));
    assert_eq!(ending.recorded, recording.message_count());
    assert!(!rig.folder.join("flight.mcap.reserve").exists());
    assert_eq!(recording.settings().unwrap().unwrap(), rig.arena);
}

#[test]
fn every_injected_gap_is_counted_and_stored_exactly() {
    let rig = Rig::new("gaps", 2);
    let logger = rig.logger("flight.mcap --segment-bytes 50000");
    rig.wait_for("flight.mcap.part");
    let mut speakers = BTreeMap::from([
        ("vehicle/state", (rig.speaker("estimator", 4), 0_u64)),
        ("mocap/frame", (rig.speaker("vicon-bridge", 5), 0_u64)),
    ]);
    for number in 0..2000_u64 {
        for (topic, (speaker, lost)) in &mut speakers {
            let skipped = if number % 97 == 50 { number % 7 + topic.len() as u64 % 3 } else { 0 };
            speaker.skip(skipped);
            *lost += skipped;
            speaker.say(topic, &body(number));
        }
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
    assert!(logger.end());
    let recording = Recording::open(&rig.folder.join("flight.mcap")).unwrap();
    for (topic, (_, lost)) in &speakers {
        // Nothing is lost over the joints between segments.
        assert_eq!(numbers(&recording, topic), (0..2000).collect::<Vec<_>>(), "{topic}");
        let loss = recording.losses().iter().find(|loss| loss.topic == *topic).unwrap();
        assert_eq!((loss.counts.lost, loss.counts.accepted), (*lost, 2000), "{topic}");
    }
    assert!(rig.folder.join("flight.0003.mcap").exists());
}

#[test]
fn a_name_that_is_taken_is_refused_and_a_supervised_logger_finds_another() {
    let rig = Rig::new("taken", 3);
    fs::write(rig.folder.join("flight.mcap.part"), "torn").unwrap();
    let mut refused = rig.logger("flight.mcap");
    assert_eq!(refused.child.wait().unwrap().code(), Some(1));
    let logger = rig.logger("flight.mcap --supervised");
    rig.wait_for("flight-2.mcap.part");
    assert!(logger.end());
    assert!(rig.folder.join("flight-2.mcap").exists());
    assert_eq!(fs::read(rig.folder.join("flight.mcap.part")).unwrap(), b"torn");
}

#[test]
fn a_snapshot_keeps_the_last_seconds_and_writes_them_when_asked() {
    let rig = Rig::new("snapshot", 4);
    let logger = rig.logger("kept.mcap --snapshot 60");
    let mut speaker = rig.speaker("estimator", 4);
    // Before it listens for signals it would die of one, and it has no file yet to be seen by.
    let status = format!("/proc/{}/status", logger.child.id());
    while !fs::read_to_string(&status).is_ok_and(|status| catches_usr1(&status)) {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let mut kept = Vec::new();
    for round in 1..=20 {
        for number in 0..100 {
            speaker.say("vehicle/state", &body(number));
        }
        std::thread::sleep(std::time::Duration::from_millis(200));
        logger.signal("USR1");
        let name = if round == 1 { "kept.mcap".to_owned() } else { format!("kept-{round}.mcap") };
        let recording = Recording::open(&rig.wait_for(&name)).unwrap();
        assert_eq!(recording.ending().unwrap().reason, "snapshot");
        kept.push(numbers(&recording, "vehicle/state").len());
        if kept.len() > 1 && kept.last() >= Some(&200) {
            break;
        }
    }
    assert!(logger.end());
    assert!(kept.is_sorted() && kept.last() >= Some(&200), "{kept:?}");
    assert_eq!(segments(&rig.folder).len(), kept.len(), "an order is one file");
}

fn catches_usr1(status: &str) -> bool {
    let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or("0");
    u64::from_str_radix(caught.trim(), 16).is_ok_and(|mask| mask & (1 << 9) != 0)
}

#[test]
fn its_account_names_its_program_and_its_writers_turns_rise() {
    let rig = Rig::new("account", 6);
    let mut observer = Observer::new(&Secret::new(rig::SECRET), Domain::Sim, rig::RUN);
    let mut accounts: Vec<NodeHealth> = Vec::new();
    block_on(async {
        let listen = Listen::Topics(&[&topics::NODE_HEALTH]);
        let mut receiver = BusReceiver::join(&rig.arena.network, Domain::Sim, listen)?;
        let logger = rig.logger("flight.mcap");
        while accounts.len() < 2 {
            let batch = tokio::time::timeout(rig::PATIENCE, receiver.next_batch()).await;
            for index in 0..batch.expect("the logger gives no account")? {
                let observed = observer.observe(receiver.datagram(index).bytes).unwrap();
                assert!(observed.verified && observed.topic.name() == topics::NODE_HEALTH.name);
                accounts.push(service_core::decode(observed.body).unwrap());
            }
        }
        assert!(logger.end());
        Ok(())
    })
    .unwrap();
    assert!(accounts.iter().all(|account| account.node.as_str() == "logger" && account.program_digest != 0));
    assert!(accounts.is_sorted_by_key(|account| account.steps) && accounts[0].steps < accounts[1].steps);
}

#[test]
fn a_file_size_limit_goes_on_in_further_segments() {
    let rig = Rig::new("file-size", 5);
    let line = rig.arguments("flight.mcap --compression none").join(" ");
    // In blocks of 1024 bytes.
    let script = format!("ulimit -f 1000; exec {} {line}", env!("CARGO_BIN_EXE_logger"));
    let child = Command::new("bash").args(["-c", &script]).current_dir(&rig.folder).spawn().unwrap();
    let logger = rig::Logger { child };
    rig.wait_for("flight.mcap.part");
    let mut speaker = rig.speaker("estimator", 4);
    for number in 0..6000 {
        speaker.say("vehicle/state", &body(number));
        std::thread::sleep(std::time::Duration::from_micros(300));
    }
    assert!(logger.end());
    let files = segments(&rig.folder);
    assert!(files.len() >= 2, "{files:?}");
    let mut found = Vec::new();
    for file in &files {
        let recording = Recording::open_alone(&rig.folder.join(file)).unwrap();
        assert!(recording.damage().is_empty(), "{file}: {:?}", recording.damage());
        found.extend(numbers(&recording, "vehicle/state"));
    }
    assert!(found.is_sorted_by(|one, other| one < other));
    let last = Recording::open_alone(&rig.folder.join(files.last().unwrap())).unwrap();
    let dropped = last.ending().unwrap().dropped_stopped;
    assert!(found.len() as u64 + dropped >= 6000 && found.len() <= 6000, "{} + {dropped}", found.len());
}

fn segments(folder: &Path) -> Vec<String> {
    let mut files: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.ends_with(".mcap"))
        .collect();
    files.sort_by_key(|name| (name.len(), name.clone()));
    files
}
