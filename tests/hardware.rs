//! The arena before real equipment: the same programs, another domain, and nobody takes off before a person says so.
//!
//! The equipment is the simulator, started apart: from the bridges' side it cannot be told from the real one. It has the
//! domain of simulations and so no part in this arena's bus.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use recording::{Recording, Selection};
use schemas::{NodeHealth, VehicleState, topics};
use twox_hash::XxHash3_64;
use wire::Kind;

use crate::common::{front_door, place};
use crate::process::Process;

/// Devices and the bus elsewhere than in the folder's settings, and no demand on this disk.
const LAB: &str = "[network.live]
group = \"239.255.71.9\"
port = 47109
[network.devices.motion_capture]
url = \"udp://127.0.0.1:58001\"
[network.devices.command_link]
url = \"udp://127.0.0.1:58010\"
[network.devices.data_link]
url = \"udp://127.0.0.1:58000\"
[services.flip-manager.recording]
free_gib_min = 0.0
";

fn folder(name: &str, port_offset: u16) -> PathBuf {
    let folder = place(&format!("hardware-{name}"), port_offset);
    let shift = |text: String, port: u16| text.replace(&port.to_string(), &(port + port_offset).to_string());
    let lab = [58_000, 58_001, 58_010, 47_109].into_iter().fold(LAB.to_owned(), shift);
    fs::write(folder.join("lab.toml"), lab).unwrap();
    folder
}

fn command(line: &str) -> Command {
    let mut command = Command::new(front_door());
    command.args(line.split_whitespace());
    command.env_remove("FLYARENA_SETTINGS_FILE");
    command
}

fn start(folder: &Path, line: &str) -> Process {
    Process::start(folder.to_owned(), command(line))
}

/// The height in a vehicle's line, `at (x, y, z) m`.
fn height_of(line: &str) -> Option<f64> {
    let inside = line.split("at (").nth(1)?.split(')').next()?;
    inside.split(", ").nth(2)?.trim().parse().ok()
}

/// What each node of a recording says its program is.
fn programs(recording: &Path) -> Vec<(String, u64)> {
    let recording = Recording::open(recording).unwrap();
    let selection = Selection::default();
    let mut messages = recording.messages(&selection);
    let mut programs = Vec::new();
    while let Some(message) = messages.next() {
        let message = message.unwrap();
        let data = message.channel.stream.as_ref().is_some_and(|stream| stream.kind == Kind::Data);
        if message.channel.topic == topics::NODE_HEALTH.name && data {
            let health: NodeHealth = wire::decode(message.body).unwrap();
            let program = (health.node.to_string(), health.program_digest);
            if !programs.contains(&program) {
                programs.push(program);
            }
        }
    }
    programs.sort_unstable();
    programs
}

/// Where the vehicle was last believed to be.
fn last_height(recording: &Path) -> f64 {
    let recording = Recording::open(recording).unwrap();
    let selection = Selection::default();
    let mut messages = recording.messages(&selection);
    let mut last = f64::NAN;
    while let Some(message) = messages.next() {
        let message = message.unwrap();
        let data = message.channel.stream.as_ref().is_some_and(|stream| stream.kind == Kind::Data);
        if message.channel.topic == topics::VEHICLE_STATE.name && data {
            last = wire::decode::<VehicleState>(message.body).unwrap().estimate.position_m.z;
        }
    }
    last
}

/// Of the services alone.
fn of_services(programs: &[(String, u64)]) -> Vec<(String, u64)> {
    let is_service = |(node, _): &&(String, u64)| roster::SERVICES.contains(&node.as_str());
    programs.iter().filter(is_service).cloned().collect()
}

#[test]
fn before_equipment_nobody_takes_off_unasked_and_the_programs_are_those_of_the_simulated_arena() {
    let folder = folder("hover", 4100);
    let mut arena = start(&folder, "up --hardware lab.toml --record live.mcap --min-free 0");
    arena.wait_for("word of who gives the order", |line| line.contains("arena fly --domain live"));
    let equipment = "run simulator --settings .flyarena/live-settings.toml --run 1 --domain sim";
    let mut simulator = start(&folder, equipment);
    for _ in 0..3 {
        arena.wait_for("tracked vehicle on the floor", |line| line.contains("Tracking"));
    }
    assert!(
        arena.heard.iter().filter_map(|line| height_of(line)).all(|height| height < 0.2),
        "somebody took off: {:?}",
        arena.heard
    );

    let mut pilot = start(&folder, "fly --domain live --hover");
    pilot.wait_for("hover", |line| {
        line.contains("Tracking") && height_of(line).is_some_and(|height| height > 3.5)
    });
    pilot.interrupt();
    pilot.wait_for("landing", |line| line == "landed");
    assert!(pilot.child.wait().unwrap().success());

    // In the air again, the arena itself is told to end: it lands first, whoever gave the order.
    let mut pilot = start(&folder, "fly --domain live --hover");
    pilot.wait_for("hover", |line| height_of(line).is_some_and(|height| height > 3.5));
    arena.interrupt();
    arena.wait_for("landing", |line| line == "landed");
    assert!(arena.child.wait().unwrap().success());
    let last = last_height(&folder.join("live.mcap"));
    assert!(last < 0.2, "it ended at {last} m");
    pilot.interrupt();
    simulator.interrupt();
    simulator.child.wait().unwrap();

    let mut simulated = start(&folder, "up --record sim.mcap --min-free 0");
    simulated.wait_for("tracked vehicle", |line| line.contains("Tracking"));
    simulated.interrupt();
    simulated.wait_for("landing", |line| line == "landed");
    assert!(simulated.child.wait().unwrap().success());

    let digest = XxHash3_64::oneshot(&fs::read(front_door()).unwrap());
    let live = programs(&folder.join("live.mcap"));
    assert!(live.iter().all(|(node, _)| node != "simulator"), "{live:?}");
    let live = of_services(&live);
    assert_eq!(live, of_services(&programs(&folder.join("sim.mcap"))));
    let mut names: Vec<&str> = live.iter().map(|(node, _)| node.as_str()).collect();
    names.sort_unstable();
    let mut expected = roster::SERVICES.to_vec();
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert!(live.iter().all(|(_, program)| *program == digest), "{live:?} are not {digest:016x}");
}

#[test]
fn a_second_arena_before_the_same_equipment_is_refused() {
    let folder = folder("second", 4200);
    let mut arena = start(&folder, "up --hardware lab.toml");
    arena.wait_for("a vehicle's line", |line| line.starts_with("vehicle 1"));
    let said = command("up --hardware lab.toml").current_dir(&folder).output().unwrap();
    assert_eq!(said.status.code(), Some(1), "{said:?}");
    let errors = String::from_utf8(said.stderr).unwrap();
    assert!(errors.contains("a live arena is running"), "{errors}");
    arena.interrupt();
    arena.wait_for("end", |line| line == "landed");
}

#[test]
fn what_is_wrong_with_the_equipments_file_keeps_everything_down() {
    let folder = folder("wrong", 4300);
    for (text, words) in [
        ("[network]\nttl = 2\n", ["lab.toml", "ttl = 2", "0 and 1"]),
        ("[services.estimator]\nno_such_gain = 1.0\n", ["lab.toml", "[estimator]", "no_such_gain"]),
        ("[services.estimater]\n", ["lab.toml", "estimater", "estimator"]),
        ("[equipment]\nx = 1\n", ["lab.toml", "equipment", "hall, network, services"]),
        (
            "[network.devices.data_link]\nurl = \"radio://0/80/2M/E7E7E7E7E7\"\n",
            ["lab.toml", "radio://0", "XBee"],
        ),
    ] {
        fs::write(folder.join("lab.toml"), text).unwrap();
        for line in ["up --hardware lab.toml", "init --hardware lab.toml --domain live"] {
            let said = command(line).current_dir(&folder).output().unwrap();
            let errors = String::from_utf8(said.stderr).unwrap();
            assert_eq!(said.status.code(), Some(2), "{line}: {errors}");
            assert!(words.iter().all(|word| errors.contains(word)), "{line}: {errors}");
        }
    }
    assert!(!folder.join(".flyarena/live-run").exists(), "an arena that cannot come up has no run");
    let absent = command("up --hardware absent.toml").current_dir(&folder).output().unwrap();
    assert_eq!(absent.status.code(), Some(2), "{absent:?}");
    let seed = command("up --hardware lab.toml --seed 3").current_dir(&folder).output().unwrap();
    assert_eq!(seed.status.code(), Some(2), "{seed:?}");
}

#[test]
fn init_lays_the_equipments_file_under_single_changes() {
    let folder = folder("init", 4400);
    let line = "init --hardware lab.toml --set hall.margin_m=0.25 --set network.devices.data_link.url=udp://10.0.0.2:7 \
                --domain live";
    let said = command(line).current_dir(&folder).output().unwrap();
    assert!(said.status.success(), "{said:?}");
    let settings = fs::read_to_string(folder.join(".flyarena/settings.toml")).unwrap();
    let arena = settings::Arena::from_toml("settings.toml", &settings).unwrap();
    let devices = &arena.network.devices;
    assert_eq!(devices.motion_capture.url.to_string(), "udp://127.0.0.1:62401");
    assert_eq!((devices.data_link.url.to_string().as_str(), arena.hall.margin_m), ("udp://10.0.0.2:7", 0.25));
    assert!(!folder.join(".flyarena/draft").exists());
}
