//! Real processes on loopback multicast: `arena up` as a user starts it.
//!
//! Nothing here asserts a wall-clock time: deadlines are only how long a test waits before it gives up.

use std::fs;
use std::process::Command;

use crate::common::{front_door, place};
use crate::process::Process;

/// A live arena in a folder of its own, on groups and ports of its own.
struct Live(Process);

impl Live {
    fn up(name: &str, port_offset: u16, scenario: &str) -> Self {
        let mut command = Command::new(front_door());
        command.args(["up", scenario]);
        Self(Process::start(place(&format!("live-{name}"), port_offset), command))
    }

    /// The process of a service, found by this arena's own child processes.
    fn process_of(&self, service: &str) -> u32 {
        for entry in fs::read_dir("/proc").unwrap().flatten() {
            let Ok(id) = entry.file_name().to_string_lossy().parse::<u32>() else { continue };
            let status = fs::read_to_string(entry.path().join("status")).unwrap_or_default();
            let parent = status.lines().find_map(|line| line.strip_prefix("PPid:"));
            if parent.is_none_or(|parent| parent.trim() != self.0.child.id().to_string()) {
                continue;
            }
            let line = fs::read_to_string(entry.path().join("cmdline")).unwrap_or_default();
            if line.split('\0').nth(2) == Some(service) {
                return id;
            }
        }
        panic!("no process runs {service}");
    }

    fn hover(&mut self) {
        self.0.wait_for("vehicle that tracks at its height", |line| {
            line.contains("Tracking") && height_of(line).is_some_and(|height| height > 3.5)
        });
    }
}

/// The height in a vehicle's line, `at (x, y, z) m`.
fn height_of(line: &str) -> Option<f64> {
    let inside = line.split("at (").nth(1)?.split(')').next()?;
    inside.split(", ").nth(2)?.trim().parse().ok()
}

#[test]
fn a_live_arena_hovers_completes_flips_and_lands_first_when_interrupted() {
    let mut live = Live::up("flips", 400, "double-flip");
    live.hover();
    live.0.wait_for("completed flip", |line| line.contains("flip   0 completed"));
    live.0.wait_for("second completed flip", |line| line.contains("flip   1 completed"));
    live.0.interrupt();
    live.0.wait_for("landing", |line| line == "landed");
    assert!(live.0.child.wait().unwrap().success());
}

#[test]
fn every_process_may_be_killed_in_hover_and_the_arena_goes_on() {
    let mut live = Live::up("kills", 500, "double-flip");
    live.hover();
    for service in
        ["learner", "flip-manager", "vicon-bridge", "estimator", "hover-controller", "radio-bridge"]
    {
        Process::signal(live.process_of(service), "KILL");
        live.0.wait_for("restart", |line| line == format!("{service} runs again"));
        live.0.wait_for("tracked vehicle after the restart", |line| line.contains("Tracking"));
    }
    live.0.interrupt();
    live.0.wait_for("end", |line| line == "landed");
}

#[test]
fn a_controller_killed_for_good_ends_in_a_landing() {
    let mut live = Live::up("for-good", 600, "double-flip");
    live.hover();
    for _ in 0..3 {
        Process::signal(live.process_of("hover-controller"), "KILL");
        live.0.wait_for("restart", |line| line == "hover-controller runs again");
    }
    Process::signal(live.process_of("hover-controller"), "KILL");
    live.0.wait_for("surrender", |line| line == "hover-controller ended too often; it stays down");
    // Down, the vehicle is done, and with it the arena.
    live.0.wait_for("vehicle on the floor", |line| {
        line == "every vehicle is done and down" || height_of(line).is_some_and(|height| height < 0.1)
    });
}
