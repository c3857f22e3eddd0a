//! What the simulated equipment and the bridges put on the wire, in decoders that are not ours. `run.sh` beside this
//! file asks packages of other languages; here are the ones that can be linked.

use std::collections::BTreeMap;

use crsf::{Packet, PacketParser};
use device::vehicle_link::{ChannelMap, CommandMode as LinkMode};
use front_door::experiment::message;
use natnet::{Decoder, Message};
use quantity::{Span, Time};
use schemas::{CommandMode, CommandSent, DeviceBytes, MocapFrame, topics};
use settings::{Arena, ChannelBits, CommandProtocol, MotionCaptureProtocol, NatNetVersion, Ports, UpAxis};

use crate::common::{Flight, arena};

/// What was on the wires and what the bridges said of it, in a take-off.
#[derive(Default)]
struct Heard {
    vicon_rx: Vec<DeviceBytes>,
    frames: Vec<MocapFrame>,
    radio_rx: Vec<DeviceBytes>,
    radio_tx: Vec<DeviceBytes>,
    sent: Vec<CommandSent>,
}

fn heard(change: impl FnOnce(&mut Arena)) -> Heard {
    let mut settings = arena("fleet");
    change(&mut settings);
    let mut flight = Flight::to_hover(settings, 71);
    let mut all = Heard::default();
    flight.arena.run_for(Span::from_secs(6), &mut |heard| {
        all.vicon_rx.extend(message::<DeviceBytes>(&heard, &topics::VICON_RX));
        all.frames.extend(message::<MocapFrame>(&heard, &topics::MOCAP_FRAME));
        all.radio_rx.extend(message::<DeviceBytes>(&heard, &topics::RADIO_RX));
        all.radio_tx.extend(message::<DeviceBytes>(&heard, &topics::RADIO_TX));
        all.sent.extend(message::<CommandSent>(&heard, &topics::COMMAND_SENT));
    });
    all
}

/// Half a unit in the last place of an `f32` below 16 m is under a micrometre.
const ROUNDING_M: f64 = 1e-6;

/// Compares one body of a frame as the crate read it with what the bridge made of it.
fn same_body(up: UpAxis, theirs: &natnet::RigidBody, ours: &schemas::MocapBody) {
    let ([x, y, z], [a, b, c, d]) = (theirs.position.map(f64::from), theirs.orientation.map(f64::from));
    // With y up: x stays, the hall's y is their negative z, its z their y.
    let ([x, y, z], [a, b, c]) = match up {
        UpAxis::Y => ([x, -z, y], [a, -c, b]),
        UpAxis::Z => ([x, y, z], [a, b, c]),
    };
    let off = quantity::Vector::new(x, y, z) - ours.position_m;
    assert!(off.norm() < ROUNDING_M, "{theirs:?}, {ours:?}");
    let theirs = quantity::Rotation::from_components(d, a, b, c).unwrap();
    assert!(theirs.angle_to(ours.orientation) < 1e-6, "{theirs:?}, {ours:?}");
}

#[test]
fn natnet_of_every_version_decodes_in_the_natnet_crate_as_in_the_bridge() {
    for (setting, version, up) in [
        (NatNetVersion::V3_0, [3, 0, 0, 0], UpAxis::Y),
        (NatNetVersion::V3_1, [3, 1, 0, 0], UpAxis::Z),
        (NatNetVersion::V4_0, [4, 0, 0, 0], UpAxis::Z),
        (NatNetVersion::V4_1, [4, 1, 0, 0], UpAxis::Y),
    ] {
        let all = heard(|settings| {
            let capture = &mut settings.network.devices.motion_capture;
            capture.protocol = MotionCaptureProtocol::Natnet;
            (capture.natnet.version, capture.natnet.up_axis) = (Some(setting), up);
        });
        let decoder = Decoder::new(natnet::Version::from_bytes(version)).unwrap();
        let frames: BTreeMap<u32, &MocapFrame> =
            all.frames.iter().map(|frame| (frame.frame as u32, frame)).collect();
        let (mut names, mut bodies, mut servers) = (BTreeMap::new(), 0, 0);
        for datagram in &all.vicon_rx {
            match decoder.parse(&datagram.bytes).unwrap().into_message() {
                Message::ServerInfo(info) => {
                    assert_eq!(info.protocol_version, natnet::Version::from_bytes(version));
                    servers += 1;
                }
                Message::ModelDef(model) => {
                    names.extend(model.rigid_bodies().map(|(name, id)| (id, name.to_owned())));
                }
                Message::FrameOfData(frame) => {
                    let Some(ours) = frames.get(&(frame.frame_number as u32)) else { continue };
                    let tracked = frame.rigid_bodies.iter().filter(|body| body.params & 1 == 1);
                    for theirs in tracked {
                        let ours = ours.bodies.iter().find(|body| body.subject.as_str() == names[&theirs.id]);
                        same_body(up, theirs, ours.expect("a tracked body is reported"));
                        bodies += 1;
                    }
                }
                other => panic!("the simulator says {other:?}"),
            }
        }
        assert!(servers > 0 && names.len() == 3 && bodies > 2_000, "{setting:?}: {names:?}, {bodies}");
    }
}

const fn mode(mode: CommandMode) -> LinkMode {
    match mode {
        CommandMode::Disarmed => LinkMode::Disarmed,
        CommandMode::Fly => LinkMode::Fly,
        CommandMode::Descend => LinkMode::Descend,
    }
}

/// The packets in bytes, each in one piece. The crate's parser takes 64 bytes off its buffer for a frame, however
/// short, so it gets one portion at a time.
fn packet(bytes: &DeviceBytes) -> Packet {
    let mut parser = PacketParser::<1024>::new();
    parser.push_bytes(&bytes.bytes);
    parser.next_packet().expect("a whole frame").expect("a frame in order").1
}

#[test]
fn crsf_of_the_bridge_and_of_the_module_decodes_in_the_crsf_crate() {
    for (bits, map) in [(ChannelBits::Eleven, ChannelMap::Full), (ChannelBits::Ten, ChannelMap::Compact)] {
        let all = heard(|settings| {
            let link = &mut settings.network.devices.command_link;
            (link.protocol, link.channel_bits) = (CommandProtocol::Crsf, bits);
        });
        let sent: BTreeMap<(u8, Time), &CommandSent> =
            all.sent.iter().map(|sent| ((sent.vehicle, sent.sent_at), sent)).collect();
        let mut commands = 0;
        for bytes in &all.radio_tx {
            let Some(vehicle) = Ports::vehicle_of_command_link(bytes.port) else { continue };
            let Packet::RcChannels(channels) = packet(bytes) else { panic!("{bytes:?}") };
            let (address, frame) = map.decode(&channels.0, vehicle).unwrap();
            let sent = sent[&(vehicle, bytes.at)];
            assert_eq!((address, frame.mode), (vehicle, mode(sent.mode)));
            assert_eq!((frame.rate_rad_s, frame.collective_m_s2), (sent.rate_rad_s, sent.collective_m_s2));
            commands += 1;
        }
        let mut statistics = 0;
        for bytes in all.radio_rx.iter().filter(|bytes| Ports::vehicle_of_command_link(bytes.port).is_some())
        {
            let Packet::LinkStatistics(link) = packet(bytes) else { panic!("{bytes:?}") };
            assert!(link.uplink_link_quality > 50, "{link:?}");
            statistics += 1;
        }
        assert!(commands > 500 && statistics > 10, "{bits:?}: {commands} commands, {statistics} statistics");
    }
}
