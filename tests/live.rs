//! Real processes on loopback multicast: `arena up` as a user starts it.
//!
//! Nothing here asserts a wall-clock time: deadlines are only how long a test waits before it gives up.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use crate::common::{config, copy, front_door};

/// Long enough for a crowded machine; a healthy one needs a tenth.
const PATIENCE: Duration = Duration::from_secs(120);

/// A live arena in a folder of its own, on groups and ports of its own.
struct Live {
    child: Child,
    lines: Receiver<String>,
    heard: Vec<String>,
    folder: PathBuf,
}

impl Live {
    fn up(name: &str, port_offset: u16, scenario: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("live-{name}"));
        let _ = fs::remove_dir_all(&folder);
        copy(&config(), &folder.join("config"));
        let network = folder.join("config/network.toml");
        let text = fs::read_to_string(&network).unwrap();
        let text = [47101_u16, 47102, 47103, 51001, 52000, 52100]
            .iter()
            .fold(text, |text, port| text.replace(&port.to_string(), &(port + port_offset).to_string()));
        fs::write(&network, text).unwrap();
        let mut child = Command::new(front_door())
            .args(["up", scenario])
            .current_dir(&folder)
            .env_remove("FLYARENA_SECRET_FILE")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let out = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, lines, heard: Vec::new(), folder }
    }

    /// Waits for a line that satisfies `wanted`.
    fn wait_for(&mut self, what: &str, wanted: impl Fn(&str) -> bool) -> String {
        let give_up = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(Duration::from_millis(500)) {
                Ok(line) => {
                    self.heard.push(line.clone());
                    if wanted(&line) {
                        return line;
                    }
                }
                Err(RecvTimeoutError::Timeout) if Instant::now() < give_up => {}
                Err(_) => panic!("no {what}; the arena said:\n{}\n{}", self.heard.join("\n"), self.logs()),
            }
        }
    }

    fn logs(&self) -> String {
        let mut text = String::new();
        for entry in fs::read_dir(self.folder.join(".flyarena/logs")).into_iter().flatten().flatten() {
            let log = fs::read_to_string(entry.path()).unwrap_or_default();
            text.push_str(&format!("-- {}\n{log}\n", entry.path().display()));
        }
        text
    }

    /// The process of a service, found by this arena's own child processes.
    fn process_of(&self, service: &str) -> i32 {
        for entry in fs::read_dir("/proc").unwrap().flatten() {
            let Ok(id) = entry.file_name().to_string_lossy().parse::<i32>() else { continue };
            let status = fs::read_to_string(entry.path().join("status")).unwrap_or_default();
            let parent = status.lines().find_map(|line| line.strip_prefix("PPid:"));
            if parent.is_none_or(|parent| parent.trim() != self.child.id().to_string()) {
                continue;
            }
            let line = fs::read_to_string(entry.path().join("cmdline")).unwrap_or_default();
            if line.split('\0').nth(2) == Some(service) {
                return id;
            }
        }
        panic!("no process runs {service}");
    }

    fn signal(id: i32, name: &str) {
        assert!(
            Command::new("kill").args([&format!("-{name}"), &id.to_string()]).status().unwrap().success()
        );
    }

    fn interrupt(&self) {
        Self::signal(i32::try_from(self.child.id()).unwrap(), "INT");
    }

    fn hover(&mut self) {
        self.wait_for("vehicle that tracks at its height", |line| {
            line.contains("Tracking") && height_of(line).is_some_and(|height| height > 3.5)
        });
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // Its services end with it, or by themselves soon after.
        if matches!(self.child.try_wait(), Ok(None)) {
            self.interrupt();
            std::thread::sleep(Duration::from_millis(300));
            self.interrupt();
            let _ = self.child.wait();
        }
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
    live.wait_for("completed flip", |line| line.contains("flip   0 completed"));
    live.wait_for("second completed flip", |line| line.contains("flip   1 completed"));
    live.interrupt();
    live.wait_for("landing", |line| line == "landed");
    assert!(live.child.wait().unwrap().success());
}

#[test]
fn every_process_may_be_killed_in_hover_and_the_arena_goes_on() {
    let mut live = Live::up("kills", 500, "double-flip");
    live.hover();
    for service in
        ["learner", "flip-manager", "vicon-bridge", "estimator", "hover-controller", "radio-bridge"]
    {
        Live::signal(live.process_of(service), "KILL");
        live.wait_for("restart", |line| line == format!("{service} runs again"));
        live.wait_for("tracked vehicle after the restart", |line| line.contains("Tracking"));
    }
    live.interrupt();
    live.wait_for("end", |line| line == "landed");
}

#[test]
fn a_controller_killed_for_good_ends_in_a_landing() {
    let mut live = Live::up("for-good", 600, "double-flip");
    live.hover();
    for _ in 0..3 {
        Live::signal(live.process_of("hover-controller"), "KILL");
        live.wait_for("restart", |line| line == "hover-controller runs again");
    }
    Live::signal(live.process_of("hover-controller"), "KILL");
    live.wait_for("surrender", |line| line == "hover-controller ended too often; it stays down");
    // Down, the vehicle is done, and with it the arena.
    live.wait_for("vehicle on the floor", |line| {
        line == "every vehicle is done and down" || height_of(line).is_some_and(|height| height < 0.1)
    });
}
