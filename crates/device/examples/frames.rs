//! Frames of ours for independent implementations to compare with: a JSON object a line, with the call that makes
//! the same frame in the field's own package, its arguments, and our bytes. `tests/devices` makes those calls.
//!
//! These are frames that no recording of the simulated arena has, or has in few kinds.

use device::crtp::{self, ExternalPose, Packet, Setpoint, Supervisor};
use device::xbee::{ApiMode, Frame, TransmitResult};
use quantity::{Body, Rotation, Vector};

#[path = "../tests/it/random.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod random;

use random::Random;

const ROUNDS: usize = 200;

fn say(package: &str, call: &str, arguments: &[String], bytes: &[u8]) {
    let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let arguments = arguments.join(", ");
    println!(r#"{{"package": "{package}", "call": "{call}", "arguments": [{arguments}], "hex": "{hex}"}}"#);
}

fn numbers(values: &[f64]) -> Vec<String> {
    // The shortest text that reads back as the same number.
    values.iter().map(|value| format!("{value:?}")).collect()
}

fn hex(bytes: &[u8]) -> String {
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("\"{digits}\"")
}

fn crtp(call: &str, arguments: &[String], packet: &Packet<'_>) {
    let mut out = [0; crtp::PACKET_BYTES_MAX];
    let length = packet.encode(&mut out).expect("a packet of finite numbers");
    say("cflib", call, arguments, &out[..length]);
}

fn xbee(call: &str, arguments: &[String], frame: &Frame<'_>) {
    for (mode, escaped) in [(ApiMode::Plain, "false"), (ApiMode::Escaped, "true")] {
        let mut out = [0; 600];
        let length = frame.encode(mode, &mut out).expect("a payload that fits");
        let arguments = [&[escaped.to_owned()], arguments].concat();
        say("digi-xbee", call, &arguments, &out[..length]);
    }
}

/// Between minus and plus `most`; some are zero.
fn number(random: &mut Random, most: f64) -> f64 {
    if random.below(8) == 0 { 0.0 } else { (random.next() as i32 as f64) / f64::from(i32::MAX) * most }
}

fn crtp_setpoints(random: &mut Random) {
    let [x, y, z] = [0; 3].map(|_| number(random, 30.0));
    let percent = random.below(101);
    let thrust = (10_001.0 + 0.01 * percent as f64 * 49_999.0) as u16;
    // The package takes degrees about the body's own axes, of which ours are radians.
    let rate = Vector::<Body>::new(x, y, z);
    let degrees = [x, y, z].map(|rate| rate * (180.0 / std::f64::consts::PI));
    let manual = [numbers(&degrees), vec![percent.to_string(), "true".to_owned()]].concat();
    crtp("send_setpoint_manual", &manual, &Packet::Setpoint(Setpoint::rates(rate, thrust)));

    let [a, b, c, d] = [0; 4].map(|_| number(random, 3.0) as f32);
    let said = numbers(&[a, b, c, d].map(f64::from));
    let (forward_m_s, left_m_s, yaw_deg_s, height_m) = (a, b, c, d);
    let hover = Setpoint::Hover { forward_m_s, left_m_s, yaw_deg_s, height_m };
    crtp("send_hover_setpoint", &said, &Packet::Setpoint(hover));
    let position = Setpoint::Position { position_m: [a, b, c], yaw_deg: d };
    crtp("send_position_setpoint", &said, &Packet::Setpoint(position));
    let hold_ms = random.next() as u32;
    crtp("send_notify_setpoint_stop", &[hold_ms.to_string()], &Packet::ReleaseSetpoints { hold_ms });
}

fn crtp_poses(random: &mut Random) {
    let [x, y, z] = [0; 3].map(|_| number(random, 10.0));
    let turn = Vector::<Body>::new(number(random, 2.0), number(random, 2.0), number(random, 2.0));
    let (position_m, orientation) = (Vector::new(x, y, z), Rotation::from_rotation_vector(turn));
    let pose = ExternalPose::new(position_m, orientation);
    let place = format!("[{}]", numbers(&[x, y, z]).join(", "));
    let Rotation { x: qx, y: qy, z: qz, w, .. } = orientation;
    let attitude = format!("[{}]", numbers(&[qx, qy, qz, w]).join(", "));
    crtp("send_extpose", &[place.clone(), attitude], &Packet::ExternalPose(pose));
    crtp("send_extpos", &[place], &Packet::ExternalPosition { position_m: pose.position_m });
}

fn xbee_frames(random: &mut Random) {
    let data: Vec<u8> = (0..1 + random.below(100))
        .map(|_| [random.next() as u8, 0x7E, 0x7D, 0x11, 0x13][random.below(5).min(random.below(5))])
        .collect();
    let [frame_id, options, rssi, radius, ..] = random.next().to_le_bytes();
    let (long, short) = (random.next(), random.next() as u16);
    let said = |bytes: &[u8]| hex(bytes);
    let (long_said, short_said) = (said(&long.to_be_bytes()), said(&short.to_be_bytes()));
    let [id, opts, power, hops] = [frame_id, options, rssi, radius].map(|byte| byte.to_string());
    let payload = said(&data);
    let data = &data[..];
    xbee(
        "TX16Packet",
        &[id.clone(), short_said.clone(), opts.clone(), payload.clone()],
        &Frame::Transmit16 { frame_id, destination: short, options, data },
    );
    xbee(
        "TX64Packet",
        &[id.clone(), long_said.clone(), opts.clone(), payload.clone()],
        &Frame::Transmit64 { frame_id, destination: long, options, data },
    );
    xbee(
        "TransmitPacket",
        &[id.clone(), long_said.clone(), short_said.clone(), hops, opts.clone(), payload.clone()],
        &Frame::TransmitMesh { frame_id, destination: long, destination_short: short, radius, options, data },
    );
    xbee(
        "RX16Packet",
        &[short_said.clone(), power.clone(), opts.clone(), payload.clone()],
        &Frame::Receive16 { source: short, rssi, options, data },
    );
    xbee(
        "RX64Packet",
        &[long_said.clone(), power, opts.clone(), payload.clone()],
        &Frame::Receive64 { source: long, rssi, options, data },
    );
    xbee(
        "ReceivePacket",
        &[long_said, short_said, opts, payload],
        &Frame::ReceiveMesh { source: long, source_short: short, options, data },
    );
    let (code, result) = [
        (0x00, TransmitResult::Success),
        (0x01, TransmitResult::NoAck),
        (0x02, TransmitResult::ChannelBusy),
        (0x03, TransmitResult::Purged),
        (0x74, TransmitResult::TooLarge),
        (0x21, TransmitResult::Other(0x21)),
    ][random.below(6)];
    xbee("TXStatusPacket", &[id, code.to_string()], &Frame::TransmitStatus { frame_id, result });
}

fn main() {
    let mut random = Random::new(31);
    crtp("send_stop_setpoint", &[], &Packet::Setpoint(Setpoint::Stop));
    for (arm, said) in [(true, "true"), (false, "false")] {
        crtp("send_arming_request", &[said.to_owned()], &Packet::Supervisor(Supervisor::Arm(arm)));
    }
    crtp("send_crash_recovery_request", &[], &Packet::Supervisor(Supervisor::Recover));
    crtp("send_emergency_stop", &[], &Packet::Supervisor(Supervisor::Stop));
    crtp("send_emergency_stop_watchdog", &[], &Packet::Supervisor(Supervisor::Watchdog));
    for status in [0u8, 1, 2, 3] {
        xbee("ModemStatusPacket", &[status.to_string()], &Frame::ModemStatus { status });
    }
    for _ in 0..ROUNDS {
        crtp_setpoints(&mut random);
        crtp_poses(&mut random);
        xbee_frames(&mut random);
    }
}
