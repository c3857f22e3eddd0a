//! `arena doctor` on this host: with nothing there, beside equipment that answers, and beside an arena that runs.
//!
//! What it says of this host's clock and wake-ups is this host's business: the tests look at the rest.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::{front_door, place};
use crate::process::Process;

/// What depends on the machine and how busy it is.
const OF_THE_HOST: [&str; 5] = ["clock source", "wall clock", "wake-ups", "priority", "CPU frequency"];

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(front_door());
    command.args(arguments).current_dir(folder);
    command.env_remove("FLYARENA_SECRET_FILE").env_remove("FLYARENA_SETTINGS_FILE");
    command
}

fn doctor(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, &[&["doctor"], arguments].concat()).output().unwrap()
}

/// The verdict on each check, what was found, and the exit code.
struct Report {
    checks: Vec<Value>,
    code: Option<i32>,
}

fn report(folder: &Path, arguments: &[&str]) -> Report {
    let output = doctor(folder, &[arguments, &["--json"]].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    let report: Value = serde_json::from_str(&text).unwrap();
    let checks = report["checks"].as_array().unwrap().clone();
    let worst = if checks.iter().any(|check| check["verdict"] == "fail") { "fail" } else { "no failure" };
    assert_eq!(worst == "fail", report["verdict"] == "fail");
    assert_eq!(worst == "fail", output.status.code() == Some(1), "{text}");
    for check in &checks {
        assert_eq!(check["verdict"] == "ok", check["advice"].is_null(), "{check}");
    }
    Report { checks, code: output.status.code() }
}

impl Report {
    fn check(&self, name: &str) -> &Value {
        self.checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn assert(&self, name: &str, verdict: &str, words: &[&str]) {
        let check = self.check(name);
        let text = format!("{} {}", check["found"], check["advice"]);
        assert_eq!(check["verdict"], verdict, "{check}");
        assert!(words.iter().all(|word| text.contains(word)), "{check}");
    }

    /// How well is the machine's business.
    fn assert_no_failure(&self, name: &str, words: &[&str]) {
        let check = self.check(name);
        let found = check["found"].as_str().unwrap();
        assert_ne!(check["verdict"], "fail", "{check}");
        assert!(words.iter().all(|word| found.contains(word)), "{check}");
    }

    /// What fails.
    fn failing(&self) -> Vec<&str> {
        let failing = self.checks.iter().filter(|check| check["verdict"] == "fail");
        failing.map(|check| check["name"].as_str().unwrap()).collect()
    }
}

/// A folder whose disk has room enough, whatever the machine has.
fn folder(name: &str, port_offset: u16) -> PathBuf {
    let folder = place(&format!("doctor-{name}"), port_offset);
    fs::write(folder.join("config/services.toml"), "[flip-manager.recording]\nfree_gib_min = 0.0\n").unwrap();
    folder
}

#[test]
fn with_nothing_running_a_simulated_arena_needs_no_device() {
    let folder = folder("nothing", 4500);
    let report = report(&folder, &[]);
    assert_eq!((report.failing(), report.code), (Vec::new(), Some(0)), "{:?}", report.checks);
    for name in ["settings", "interface", "lifetime", "multicast", "secret", "run", "recordings", "arena"] {
        report.assert(name, "ok", &[]);
    }
    assert!(OF_THE_HOST.iter().all(|name| !report.check(name).is_null()));
    assert!(!folder.join(".flyarena").exists(), "a look leaves nothing behind");
    let text = String::from_utf8(doctor(&folder, &[]).stdout).unwrap();
    assert!(text.lines().any(|line| line.starts_with("ok    multicast ")), "{text}");
}

#[test]
fn equipment_that_is_not_there_fails_with_what_to_do() {
    let folder = folder("absent", 4600);
    fs::write(
        folder.join("lab.toml"),
        "[network.devices.command_link]\nurl = \"serial:///dev/no-such-line-{id}?baud=100000&framing=8E2\"\n",
    )
    .unwrap();
    let absent = report(&folder, &["--hardware", "lab.toml"]);
    assert_eq!(absent.failing(), ["motion capture", "data link", "radio of vehicle 1"]);
    absent.assert("motion capture", "fail", &["nothing came", "UDP Object Stream"]);
    absent.assert("data link", "fail", &["udp://127.0.0.1:56600"]);
    absent.assert("radio of vehicle 1", "fail", &["/dev/no-such-line-1", "plug the adapter in"]);
    fs::write(folder.join("file"), "").unwrap();
    let lab = format!(
        "[network.devices.data_link]\nurl = \"serial://{}?baud=115200\"\n\
         [network.devices.motion_capture]\nprotocol = \"natnet\"\n",
        folder.join("file").display()
    );
    fs::write(folder.join("lab.toml"), lab).unwrap();
    let file = report(&folder, &["--hardware", "lab.toml"]);
    file.assert("data link", "fail", &["no serial line", "by-id"]);
    file.assert("motion capture", "fail", &["Motive"]);
}

#[test]
fn a_bus_that_cannot_be_and_a_secret_that_others_may_read_fail() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = folder("bus", 4700);
    fs::create_dir(folder.join(".flyarena")).unwrap();
    fs::write(folder.join(".flyarena/secret"), [7; 32]).unwrap();
    fs::set_permissions(folder.join(".flyarena/secret"), fs::Permissions::from_mode(0o644)).unwrap();
    // For documentation (RFC 5737): nobody's address.
    fs::write(folder.join("lab.toml"), "[network]\ninterface = \"192.0.2.7\"\n").unwrap();
    let report = report(&folder, &["--hardware", "lab.toml", "--recordings", "no-such-folder"]);
    report.assert("interface", "fail", &["192.0.2.7", "network.interface"]);
    report.assert("multicast", "fail", &["239.255.71.1", "192.0.2.7"]);
    report.assert("secret", "fail", &["0644", "chmod 600"]);
    report.assert("recordings", "fail", &["no-such-folder", "--recordings"]);
}

#[test]
fn settings_that_cannot_be_used_are_a_misuse() {
    let folder = folder("settings", 4800);
    fs::write(folder.join("lab.toml"), "[network]\nttl = 9\n").unwrap();
    for arguments in
        [&["--hardware", "lab.toml"][..], &["--hardware", "absent.toml"], &["--config", "elsewhere"]]
    {
        let output = doctor(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(output.stdout.is_empty() && output.stderr.starts_with(b"error: "), "{output:?}");
    }
}

#[test]
fn equipment_that_answers_is_fine_and_that_of_a_running_arena_is_left_alone() {
    let folder = folder("equipment", 4900);
    fs::write(folder.join("lab.toml"), "[hall]\nmargin_m = 0.4\n").unwrap();
    // The simulator stands for the equipment; it needs a secret, as whoever speaks on a bus.
    let made = command(&folder, &["init", "--hardware", "lab.toml"]).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    let settings = ["--settings", ".flyarena/settings.toml"];
    let mut equipment =
        Process::start(folder.clone(), command(&folder, &[&["run", "simulator"], &settings[..]].concat()));
    let up = ["--hardware", "lab.toml"];
    // It takes a moment to begin.
    let answering = (0..20).map(|_| report(&folder, &up)).find(|report| report.failing().is_empty());
    let answering = answering.expect("equipment that answers");
    answering.assert_no_failure("motion capture", &["frames in a second, of quad1"]);
    answering.assert("data link", "ok", &["vehicles 1 answer"]);
    answering.assert("radio of vehicle 1", "ok", &["udp://127.0.0.1:57001"]);

    let mut arena = Process::start(folder.clone(), command(&folder, &["up", "--hardware", "lab.toml"]));
    arena.wait_for("tracked vehicle", |line| line.contains("Tracking"));
    let running = (0..20).map(|_| report(&folder, &up)).find(|report| report.failing().is_empty());
    let running = running.expect("an arena that runs");
    running.assert("arena", "ok", &["every service is heard"]);
    running.assert_no_failure("motion capture", &["by the bridge's account"]);
    running.assert("radios", "ok", &["telemetry of every vehicle"]);
    assert!(running.checks.iter().all(|check| check["name"] != "data link"), "its devices are its own");
    // A stranger hears that somebody is there, and keeps off.
    let elsewhere = place("doctor-elsewhere", 4900);
    let stranger = report(&elsewhere, &["--domain", "live"]);
    stranger.assert("arena", "warn", &["another one runs"]);
    assert!(stranger.checks.iter().all(|check| check["name"] != "motion capture"));
    arena.interrupt();
    arena.wait_for("end", |line| line == "landed");
    equipment.interrupt();
    equipment.child.wait().unwrap();
}
