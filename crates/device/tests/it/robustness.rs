//! Every decoder against truncated, flipped and random bytes.

use device::crsf::{self, LinkStatistics, Route, TimingCorrection};
use device::crtp::{
    self, ExternalPose, LogReply, LogRequest, LogType, LogVariables, Packet, Setpoint, Supervisor,
};
use device::mavlink::{
    self, AttitudeTarget, ChannelsOverride, Header, Heartbeat, Key, ManualControl, Message, ParamId,
    ParamSet, ParamValue, Signer, TimeSync, Timestamp,
};
use device::natnet::{
    self, FrameHead, Request, RigidBody, RigidBodyName, SERVER_INFO_BYTES, ServerInfo, Timing, Version,
};
use device::vehicle_link::{CommandFrame, Downlink, FlipSet, Status, Uplink, UploadReply};
use device::{sbus, vicon, xbee};

use crate::random::Random;
use crate::shapes::SHAPES;

const RANDOM_INPUTS: usize = 20_000;

fn written(most: usize, write: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut out = vec![0; most];
    let length = write(&mut out);
    out.truncate(length);
    out
}

fn natnet_vectors(vectors: &mut Vec<Vec<u8>>) {
    let body = RigidBody { id: 7, position_m: [1.0, 2.0, 3.0], params: 1, ..RigidBody::default() };
    let timing = Timing { exposed_ticks: 1, transmitted_ticks: 9, ..Timing::default() };
    let head = FrameHead { number: 42, timing, flags: 0 };
    let names = [RigidBodyName { id: 7, name: b"quad1" }, RigidBodyName { id: 8, name: b"quad2" }];
    for version in Version::ALL {
        let frame = |out: &mut [u8]| natnet::encode_frame(version, &head, &[body; 3], out).unwrap();
        vectors.push(written(300, frame));
        vectors.push(written(200, |out| natnet::encode_model_definition(version, &names, out).unwrap()));
        vectors.push(written(300, |out| Request::connect(version).encode(out).unwrap()));
    }
    let info = ServerInfo {
        name: b"Motive",
        program_version: [3, 1, 0, 0],
        natnet_version: [4, 1, 0, 0],
        clock_hz: 10_000_000,
        data_port: 1511,
        multicast: true,
        group: natnet::MULTICAST_GROUP,
    };
    vectors.push(written(SERVER_INFO_BYTES, |out| info.encode(out).unwrap()));
}

fn radio_vectors(vectors: &mut Vec<Vec<u8>>) {
    let channels = CommandFrame::default().encode(3).unwrap();
    let route = Route::MODULE_TO_HANDSET;
    let line: Vec<u8> = [
        crsf::Frame::Channels(channels),
        crsf::Frame::LinkStatistics(LinkStatistics::default()),
        crsf::Frame::TimingCorrection(route, TimingCorrection::default()),
        crsf::Frame::ParameterRead { route, parameter: 1, chunk: 0 },
        crsf::Frame::ParameterWrite { route, parameter: 1, value: &[1, 2] },
        crsf::Frame::ParameterEntry { route, parameter: 1, chunks_remaining: 0, chunk: &[3; 56] },
    ]
    .iter()
    .flat_map(|frame| {
        let bytes = written(crsf::FRAME_BYTES_MAX, |out| frame.encode(crsf::SYNC, out).unwrap());
        vectors.push(bytes.clone());
        bytes
    })
    .collect();
    vectors.push(line);
    let sbus = sbus::Frame::new(channels).encode();
    vectors.push([&sbus[..], &sbus, &sbus].concat());
    let payload = written(100, |out| Uplink::Ping { token: 0x7E7D }.encode(3, out).unwrap());
    let frame = xbee::Frame::Receive16 { source: 0x5001, rssi: 40, options: 0, data: &payload };
    vectors.push(written(300, |out| frame.encode(xbee::ApiMode::Escaped, out).unwrap()));
    vectors.push(payload);
}

fn crtp_vectors(vectors: &mut Vec<Vec<u8>>) {
    for packet in [
        Packet::Setpoint(Setpoint::Rates { roll_deg_s: 1.0, pitch_deg_s: 2.0, yaw_deg_s: 3.0, thrust: 4 }),
        Packet::Setpoint(Setpoint::Position { position_m: [1.0; 3], yaw_deg: 2.0 }),
        Packet::ExternalPose(ExternalPose::default()),
        Packet::Supervisor(Supervisor::Arm(true)),
        Packet::Supervisor(Supervisor::Answer { command: 1, done: true, holds: true }),
        Packet::ReleaseSetpoints { hold_ms: 7 },
        Packet::Null(&[]),
    ] {
        vectors.push(written(crtp::PACKET_BYTES_MAX, |out| packet.encode(out).unwrap()));
    }
    let variables = LogVariables::new(&[(LogType::F32, 7); 3]).unwrap();
    for request in [LogRequest::Info, LogRequest::Create { block: 1, variables }] {
        vectors.push(written(crtp::PACKET_BYTES_MAX, |out| request.encode(out).unwrap()));
    }
    for reply in [
        LogReply::Info { count: 3, check: 4, blocks_max: 16, variables_max: 128 },
        LogReply::Item { id: 2, kind: LogType::F32, group: b"pm", name: b"vbat" },
        LogReply::Data { block: 1, time_ms: 1000, values: &[0, 0, 0x80, 0x3F] },
    ] {
        vectors.push(written(crtp::PACKET_BYTES_MAX, |out| reply.encode(out).unwrap()));
    }
}

fn mavlink_vectors(vectors: &mut Vec<Vec<u8>>) {
    let id = ParamId::new(b"FLIP_T1").unwrap();
    let mut signer = Signer::new(Key::new([7; 32]), 1);
    let header = Header { sequence: 3, system: 255, component: 190 };
    let rates = AttitudeTarget::rates(quantity::Vector::new(1.0, 2.0, 3.0), 0.5);
    let mut line = Vec::new();
    for message in [
        Message::Heartbeat(Heartbeat::GROUND_STATION),
        Message::ParamSet(ParamSet { value_bits: 1.5f32.to_bits(), id, kind: 9, ..ParamSet::default() }),
        Message::ParamValue(ParamValue { count: 10, id, kind: 6, ..ParamValue::default() }),
        Message::ManualControl(ManualControl { z: 500, target_system: 1, ..ManualControl::default() }),
        Message::ChannelsOverride(ChannelsOverride { channels_us: [1500; 18], ..Default::default() }),
        Message::SetAttitudeTarget(rates),
        Message::TimeSync(TimeSync { asked_ns: 7, ..TimeSync::default() }),
        Message::Other { id: 331, payload: &[0xFD; 233] },
    ] {
        let mut payload = [0; mavlink::PAYLOAD_BYTES_MAX];
        let frame = message.frame(header, &mut payload).unwrap();
        vectors.push(written(mavlink::FRAME_BYTES_MAX, |out| frame.encode(out).unwrap()));
        line.extend(vectors.last().unwrap());
        let signed = frame.signed(&mut signer, Timestamp::new(9).unwrap()).unwrap();
        line.extend(written(mavlink::FRAME_BYTES_MAX, |out| signed.encode(out).unwrap()));
    }
    vectors.push(line);
}

fn link_vectors(vectors: &mut Vec<Vec<u8>>) {
    for message in Uplink::upload(7, &FlipSet::default()) {
        vectors.push(written(100, |out| message.encode(3, out).unwrap()));
    }
    for message in [Downlink::Status(Status::default()), Downlink::UploadReply(UploadReply::default())] {
        vectors.push(written(100, |out| message.encode(3, out).unwrap()));
    }
    let channels = CommandFrame::default().encode(3).unwrap();
    vectors.push(channels.iter().flat_map(|channel| channel.to_le_bytes()).collect());
}

/// One message of every kind at least.
fn vectors() -> Vec<Vec<u8>> {
    let mut vectors = Vec::new();
    natnet_vectors(&mut vectors);
    radio_vectors(&mut vectors);
    crtp_vectors(&mut vectors);
    mavlink_vectors(&mut vectors);
    link_vectors(&mut vectors);
    let object = vicon::Object { name: b"quad1", translation_mm: [1.0; 3], rotation_rad: [0.1; 3] };
    vectors.push(written(512, |out| vicon::encode(1, &[object; 3], out).unwrap()));
    vectors
}

fn feed_all(bytes: &[u8]) {
    for (_, shape) in SHAPES {
        shape(bytes);
    }
}

#[test]
fn every_truncation_of_every_message_is_survived() {
    for vector in vectors() {
        for length in 0..=vector.len() {
            feed_all(&vector[..length]);
            feed_all(&vector[length..]);
        }
    }
}

#[test]
fn every_flipped_bit_and_every_value_of_every_byte_is_survived() {
    for mut vector in vectors() {
        for at in 0..vector.len() {
            let byte = vector[at];
            for value in (0..8).map(|bit| byte ^ (1 << bit)).chain([0, 1, 0x7F, 0x80, 0xFF]) {
                vector[at] = value;
                feed_all(&vector);
            }
            vector[at] = byte;
        }
    }
}

#[test]
fn every_four_bytes_as_a_hostile_count_are_survived() {
    for mut vector in vectors() {
        for at in 0..vector.len().saturating_sub(3) {
            let bytes: [u8; 4] = vector[at..at + 4].try_into().unwrap();
            for count in [i32::MAX, i32::MIN, -1, 0x1000_0000, 0x0000_FFFF] {
                vector[at..at + 4].copy_from_slice(&count.to_le_bytes());
                feed_all(&vector);
            }
            vector[at..at + 4].copy_from_slice(&bytes);
        }
    }
}

#[test]
fn random_bytes_are_survived() {
    let mut random = Random::new(1);
    for _ in 0..RANDOM_INPUTS {
        feed_all(&random.bytes(400));
    }
}

#[test]
fn random_bytes_behind_a_message_number_are_survived() {
    let mut random = Random::new(2);
    for _ in 0..RANDOM_INPUTS {
        let mut bytes = vec![[1, 4, 5, 7, 0][random.below(5)], 0, 0, 0];
        bytes.extend(random.bytes(400));
        feed_all(&bytes);
    }
}

#[test]
fn damaged_messages_are_survived() {
    let (mut random, vectors) = (Random::new(3), vectors());
    for _ in 0..RANDOM_INPUTS {
        let vector = &vectors[random.below(vectors.len())];
        feed_all(&random.damaged(vector));
    }
}

/// What could be used as an amplifier: a datagram as long as UDP has them, all of it counts that do not end.
#[test]
fn the_longest_datagram_of_nothing_but_entries_is_walked_once() {
    for version in Version::ALL {
        for byte in [0, 1] {
            let mut bytes = vec![byte; 65_507];
            for number in [7, 5] {
                bytes[..4].copy_from_slice(&[number, 0, 0, 0]);
                bytes[8..12].copy_from_slice(&i32::MAX.to_le_bytes());
                let _ = natnet::Frame::decode(version, &bytes);
                let _ = natnet::ModelDefinition::decode(version, &bytes);
            }
        }
    }
}
