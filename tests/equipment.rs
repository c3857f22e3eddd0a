//! The same double flip with each vendor's equipment, by configuration alone.

use std::fs;
use std::process::Command;

use front_door::campaign::Summary;
use front_door::experiment::learn;
use quantity::math;
use settings::{Arena, ChannelBits, CommandProtocol, MotionCaptureProtocol, NatNetVersion, UpAxis};

use crate::common::{arena, front_door, place};
use crate::process::Process;

/// Learns a double flip from 40 tries in virtual time.
fn learned(change: impl FnOnce(&mut Arena)) -> Summary {
    let mut settings = arena("double-flip");
    settings.scenario.flip.as_mut().unwrap().iterations = 40;
    change(&mut settings);
    Summary::of(&learn(&settings, 1, &mut ()).unwrap())
}

fn assert_learned(what: &str, summary: &Summary) {
    println!("{what}: {summary:?}");
    assert!(summary.settled_at.is_some_and(|flip| flip <= 25), "{what}: {summary:?}");
}

#[test]
fn a_double_flip_is_learned_with_each_motion_capture_and_each_command_link() {
    for capture in [MotionCaptureProtocol::Vicon, MotionCaptureProtocol::Natnet] {
        for (command, bits) in [
            (CommandProtocol::Sbus, ChannelBits::Eleven),
            (CommandProtocol::Crsf, ChannelBits::Eleven),
            (CommandProtocol::Crsf, ChannelBits::Ten),
        ] {
            let summary = learned(|settings| {
                let devices = &mut settings.network.devices;
                devices.motion_capture.protocol = capture;
                (devices.command_link.protocol, devices.command_link.channel_bits) = (command, bits);
            });
            assert_learned(&format!("{capture:?}, {command:?}, {bits:?}"), &summary);
        }
    }
}

#[test]
fn a_double_flip_is_learned_with_every_version_of_natnet() {
    for (version, up_axis) in [
        (NatNetVersion::V3_0, UpAxis::Y),
        (NatNetVersion::V3_1, UpAxis::Z),
        (NatNetVersion::V4_0, UpAxis::Y),
        (NatNetVersion::V4_1, UpAxis::Z),
    ] {
        let summary = learned(|settings| {
            let capture = &mut settings.network.devices.motion_capture;
            capture.protocol = MotionCaptureProtocol::Natnet;
            (capture.natnet.version, capture.natnet.up_axis) = (Some(version), up_axis);
        });
        assert_learned(&format!("{version:?}, up {up_axis:?}"), &summary);
    }
}

/// Equipment by the text of its settings.
struct Equipment {
    name: &'static str,
    capture: &'static str,
    command: &'static str,
    data: &'static str,
}

const VICON: &str = "protocol = \"vicon\"\nurl = \"udp://127.0.0.1:51001\"";
const NATNET: &str = "protocol = \"natnet\"\nurl = \"udp://127.0.0.1:51001\"";
const SBUS_UDP: &str = "protocol = \"sbus\"\nurl = \"udp://127.0.0.1:52100\"";
const SBUS_PTY: &str = "protocol = \"sbus\"\nurl = \"pty:.flyarena/pty/command-{id}\"";
const CRSF_PTY: &str = "protocol = \"crsf\"\nurl = \"pty:.flyarena/pty/command-{id}\"\nchannel_bits = 10";
const DATA_UDP: &str = "udp://127.0.0.1:52000";
const DATA_PTY: &str = "pty:.flyarena/pty/data";

const ALL: [Equipment; 6] = [
    Equipment { name: "vicon-udp", capture: VICON, command: SBUS_UDP, data: DATA_UDP },
    Equipment { name: "vicon-sbus-pty", capture: VICON, command: SBUS_PTY, data: DATA_PTY },
    Equipment { name: "vicon-crsf-pty", capture: VICON, command: CRSF_PTY, data: DATA_UDP },
    Equipment { name: "natnet-udp", capture: NATNET, command: SBUS_UDP, data: DATA_PTY },
    Equipment { name: "natnet-sbus-pty", capture: NATNET, command: SBUS_PTY, data: DATA_UDP },
    Equipment { name: "natnet-crsf-pty", capture: NATNET, command: CRSF_PTY, data: DATA_PTY },
];

/// Flies so many flips live with this equipment; answers the norm of each one's final error.
fn fly_live(equipment: &Equipment, port_offset: u16, flips: usize) -> Vec<f64> {
    let Equipment { name, capture, command, data } = equipment;
    let folder = place(&format!("equipment-{name}"), port_offset);
    let network = folder.join("config/network.toml");
    let text = fs::read_to_string(&network).unwrap();
    let (bus, _) = text.split_once("[devices.motion_capture]").unwrap();
    let devices = format!(
        "[devices.motion_capture]\n{capture}\n[devices.command_link]\n{command}\n\
         [devices.data_link]\nurl = \"{data}\"\n[devices.crazyflie]\nurl = \"udp://127.0.0.1:19849\"\n"
    );
    let devices = [51001_u16, 52000, 52100]
        .iter()
        .fold(devices, |devices, port| devices.replace(&port.to_string(), &(port + port_offset).to_string()));
    fs::write(&network, format!("{bus}{devices}")).unwrap();
    let mut command = Command::new(front_door());
    command.args(["up", "double-flip"]);
    let mut live = Process::start(folder, command);
    let norms = (0..flips).map(|flip| {
        let line = live.wait_for("completed flip", |line| line.contains(&format!("flip {flip:3} completed")));
        norm_of(&line)
    });
    let norms = norms.collect();
    live.interrupt();
    live.wait_for("landing", |line| line == "landed");
    assert!(live.child.wait().unwrap().success());
    norms
}

/// The norm of the five errors in a flip's line.
fn norm_of(line: &str) -> f64 {
    let mut words = line.split_whitespace();
    let mut sum = 0.0;
    while let Some(word) = words.next() {
        if ["x", "z", "vx", "vz", "theta"].contains(&word) {
            let error: f64 = words.next().unwrap().parse().unwrap();
            sum += error * error;
        }
    }
    assert!(sum > 0.0, "no errors in {line:?}");
    math::sqrt(sum)
}

fn gets_better(index: usize) {
    let norms = fly_live(&ALL[index], 5000 + 20 * index as u16, 5);
    println!("{}: {norms:.3?}", ALL[index].name);
    assert!(norms[4] < 0.9 * norms[0], "{}: {norms:?}", ALL[index].name);
}

#[test]
fn vicon_and_a_command_link_over_udp_learn_live() {
    gets_better(0);
}

#[test]
fn vicon_and_sbus_over_a_serial_line_learn_live() {
    gets_better(1);
}

#[test]
fn vicon_and_crsf_over_a_serial_line_learn_live() {
    gets_better(2);
}

#[test]
fn natnet_and_a_command_link_over_udp_learn_live() {
    gets_better(3);
}

#[test]
fn natnet_and_sbus_over_a_serial_line_learn_live() {
    gets_better(4);
}

#[test]
fn natnet_and_crsf_over_a_serial_line_learn_live() {
    gets_better(5);
}

/// The whole of it: `cargo test --release -p tests equipment::all -- --ignored --nocapture`, some twelve minutes.
#[test]
#[ignore = "some twelve minutes of flight in real time"]
fn all_equipment_learns_a_double_flip_live() {
    for (index, equipment) in ALL.iter().enumerate() {
        let norms = fly_live(equipment, 5200 + 20 * index as u16, 25);
        let mut last = norms[15..].to_vec();
        last.sort_by(f64::total_cmp);
        println!("{}: first {:.3}, median of the last ten {:.3}", equipment.name, norms[0], last[5]);
        assert!(last[5] < 0.35 * norms[0], "{}: {norms:?}", equipment.name);
    }
}
