//! The logger under load: 20 000 messages a second of 200 bytes over loopback multicast into the real
//! process. Nothing may be lost, every gap that the sender makes has to be reported, and the logger's share
//! of a core is measured.
//!
//! `cargo bench -p logger --bench load [-- SECONDS [MESSAGES_PER_SECOND]]`

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

#[path = "../tests/process/rig.rs"]
mod rig;

use std::fs;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use recording::{Recording, Selection};
use rig::Rig;

const BODY_BYTES: usize = 200;
const TICK: Duration = Duration::from_millis(1);
/// What the logger may take of one core.
const SHARE_MAX: f64 = 0.25;

fn main() -> ExitCode {
    let mut numbers = std::env::args().filter_map(|argument| argument.parse::<u64>().ok());
    let seconds = numbers.next().unwrap_or(60);
    let rate = numbers.next().unwrap_or(20_000);
    let rig = Rig::new("load", 90);
    let logger = rig.logger("load.mcap");
    rig.wait_for("load.mcap.part");
    let mut speaker = rig.speaker("estimator", 4);
    let body = vec![0x5a; BODY_BYTES];
    let (mut sent, mut skipped) = (0, 0);
    let before = (Instant::now(), cpu_seconds(logger.child.id()));
    for tick in 0..seconds * 1000 {
        let due = before.0 + TICK * tick as u32;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        for _ in 0..rate / 1000 {
            if sent % 4999 == 4998 {
                let gap = 1 + sent % 3;
                speaker.skip(gap);
                skipped += gap;
            }
            speaker.say("vehicle/state", &body);
            sent += 1;
        }
    }
    let wall_s = before.0.elapsed().as_secs_f64();
    let cpu_s = cpu_seconds(logger.child.id()) - before.1;
    assert!(logger.end(), "the logger did not end well");

    let recording = Recording::open(&rig.folder.join("load.mcap")).expect("a recording");
    let selection = Selection::default();
    let mut messages = recording.messages(&selection);
    let mut recorded = 0;
    while let Some(message) = messages.next() {
        recorded += u64::from(message.expect("a message").channel.topic == "vehicle/state");
    }
    let reported = recording
        .losses()
        .iter()
        .find(|loss| loss.topic == "vehicle/state")
        .map_or(0, |loss| loss.counts.lost);
    let ending = recording.ending().expect("an ending");
    let share = cpu_s / wall_s;
    println!("{:.0} messages/s of {BODY_BYTES} bytes for {wall_s:.1} s", sent as f64 / wall_s);
    println!("sent {sent}, recorded {recorded}, lost {}", sent - recorded);
    println!("gaps injected {skipped}, reported {reported}");
    println!("dropped by the ring {}, by the kernel {}", ending.dropped_full, ending.overflowed);
    println!("{:.1} % of one core", share * 100.0);
    fs::remove_dir_all(&rig.folder).expect("the folder is ours");
    let holds = recorded == sent && reported == skipped && share <= SHARE_MAX;
    if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Time on processors that a process has had, in user and kernel mode together.
fn cpu_seconds(id: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).expect("the process runs");
    // The name, in brackets, may hold blanks; user and system time are the 12th and 13th fields after it.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks: u64 = fields[11..13].iter().map(|field| field.parse::<u64>().expect("a number")).sum();
    ticks as f64 / 100.0
}
