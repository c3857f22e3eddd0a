//! A live arena that is recorded: from the first step to the last words, and on a disk that fills.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use recording::{Recording, Selection};
use schemas::{NodeJournal, topics};
use wire::Kind;

use crate::common::{front_door, place};
use crate::process::Process;

/// A recorded arena in a folder of its own, on groups and ports of its own.
struct Recorded(Process);

fn folder(name: &str, port_offset: u16) -> PathBuf {
    let folder = place(&format!("recording-{name}"), port_offset);
    // The disks here are small on purpose; nobody shall stay on the ground for it.
    let services = folder.join("config/services.toml");
    let mut text = fs::read_to_string(&services).unwrap();
    text.push_str("\n[flip-manager.recording]\nfree_gib_min = 0.0\n");
    fs::write(&services, text).unwrap();
    folder
}

impl Drop for Recorded {
    fn drop(&mut self) {
        if matches!(self.0.child.try_wait(), Ok(None)) {
            // The arena that a script has started does not end with the script.
            for line in self.0.heard.iter().filter_map(|line| line.strip_prefix("process ")) {
                let arena = line.parse().unwrap();
                terminate(arena);
                std::thread::sleep(Duration::from_millis(300));
                terminate(arena);
            }
        }
    }
}

/// One that has ended already needs no signal.
fn terminate(id: u32) {
    let _ = Command::new("kill").args(["-TERM", &id.to_string()]).status();
}

/// Steps of each node's journal: the first number, the number after the last, and whether there is a hole.
fn journalled(recording: &Recording) -> Vec<(String, u64, u64, bool)> {
    let mut nodes: Vec<(String, u64, u64, bool)> = Vec::new();
    let selection = Selection::default();
    let mut messages = recording.messages(&selection);
    while let Some(message) = messages.next() {
        let message = message.unwrap();
        if message.channel.stream.as_ref().unwrap().kind != Kind::Journal {
            continue;
        }
        let batch: NodeJournal = wire::decode(message.body).unwrap();
        let (first, end) = (batch.first_step, batch.first_step + batch.steps.len() as u64);
        match nodes.iter_mut().find(|(node, ..)| *node == batch.node.to_string()) {
            Some((_, _, known_end, holed)) => {
                *holed |= *known_end != first;
                *known_end = end;
            }
            None => nodes.push((batch.node.to_string(), first, end, false)),
        }
    }
    nodes
}

#[test]
fn a_flight_is_recorded_from_every_nodes_first_step_to_its_last() {
    let folder = folder("flight", 3100);
    let mut command = Command::new(front_door());
    command.args(["up", "double-flip", "--record", "flight.mcap", "--min-free", "0"]);
    let mut flight = Recorded(Process::start(folder, command));
    flight.0.wait_for("vehicle that tracks", |line| line.contains("Tracking"));
    terminate(flight.0.child.id());
    flight.0.wait_for("landing", |line| line == "landed");
    assert!(flight.0.child.wait().unwrap().success());
    let recording = Recording::open(&flight.0.folder.join("flight.mcap")).unwrap();
    assert!(recording.damage().is_empty(), "{:?}", recording.damage());
    let ending = recording.ending().unwrap();
    assert_eq!((ending.dropped_full, ending.dropped_stopped), (0, 0));
    let journalled = journalled(&recording);
    for service in roster::SERVICES {
        let (_, first, end, holed) =
            journalled.iter().find(|(node, ..)| node == service).unwrap_or_else(|| panic!("no {service}"));
        assert!(*first == 0 && *end > 0 && !holed, "{service}: {first} to {end}, holed {holed}");
    }
    let defined = |topic: &str| {
        let mut channels = recording.channels().iter().filter(|channel| channel.topic == topic);
        channels.all(|channel| channel.definition.is_some())
    };
    assert!(topics::ALL.iter().all(|topic| defined(topic.name)), "a message came before its definition");
}

#[test]
fn a_disk_that_fills_in_flight_costs_the_recording_and_nothing_else() {
    let mount = "mkdir -p disk && mount -t tmpfs -o size=1m tmpfs disk";
    let folder = folder("full", 3200);
    let allowed = Command::new("unshare")
        .args(["-rm", "sh", "-c", mount])
        .current_dir(&folder)
        .status()
        .is_ok_and(|status| status.success());
    if !allowed {
        eprintln!("SKIPPED: this kernel lets nobody mount a file system in a namespace of their own");
        return;
    }
    let arena = front_door();
    let script = format!(
        "{mount} || exit 9; {} up double-flip --record disk/flight.mcap --min-free 0 & echo process $!; \
         wait $!; code=$?; cp disk/* .; exit $code",
        arena.display()
    );
    let mut command = Command::new("unshare");
    command.args(["-rm", "sh", "-c", &script]);
    let mut flight = Recorded(Process::start(folder, command));
    let process = flight.0.wait_for("process", |line| line.starts_with("process "));
    flight.0.wait_for("word of the full disk", |line| line.starts_with("logger: recording-stopped"));
    flight.0.wait_for("completed flip", |line| line.contains("flip   0 completed"));
    flight.0.wait_for("second completed flip", |line| line.contains("flip   1 completed"));
    terminate(process.trim_start_matches("process ").parse().unwrap());
    flight.0.wait_for("landing", |line| line == "landed");
    assert!(flight.0.child.wait().unwrap().success());
    let told = flight.0.heard.iter().filter(|line| line.starts_with("logger: ")).count();
    assert_eq!(told, 1, "one clear message: {:?}", flight.0.heard);
    let recording = Recording::open(&flight.0.folder.join("flight.mcap")).unwrap();
    assert!(recording.damage().is_empty(), "{:?}", recording.damage());
    assert!(recording.message_count() > 100);
    assert!(recording.ending().unwrap().reason.contains("No space left"), "{:?}", recording.ending());
    assert!(!flight.0.folder.join("flight.mcap.part").exists());
}
