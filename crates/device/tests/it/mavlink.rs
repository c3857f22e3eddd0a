//! MAVLink 2 against the `mavlink` crate, whose messages are generated from the protocol's own definitions.

use device::mavlink::{
    AttitudeTarget, ChannelsOverride, Decoder, FRAME_BYTES_MAX, Frame, Header, Heartbeat, Key, ManualControl,
    Message, PAYLOAD_BYTES_MAX, ParamId, ParamSet, ParamValue, Signer, TimeSync, Timestamp, Verifier,
    crc_extra,
};
use mavlink as oracle;
use oracle::dialects::common::{
    AttitudeTargetTypemask, HEARTBEAT_DATA, MANUAL_CONTROL_DATA, MavAutopilot, MavMessage, MavModeFlag,
    MavParamType, MavState, MavType, PARAM_SET_DATA, PARAM_VALUE_DATA, RC_CHANNELS_OVERRIDE_DATA,
    SET_ATTITUDE_TARGET_DATA, TIMESYNC_DATA,
};
use oracle::{
    MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion, Message as _,
};
use proptest::prelude::*;

use crate::random::Random;

/// Every message whose check is known, the ones without a form of their own last.
const KNOWN: [u32; 10] = [0, 22, 23, 69, 70, 82, 111, 104, 138, 331];

const TYPES: [(u8, MavType); 3] =
    [(0, MavType::MAV_TYPE_GENERIC), (2, MavType::MAV_TYPE_QUADROTOR), (6, MavType::MAV_TYPE_GCS)];
const AUTOPILOTS: [(u8, MavAutopilot); 3] = [
    (3, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA),
    (8, MavAutopilot::MAV_AUTOPILOT_INVALID),
    (12, MavAutopilot::MAV_AUTOPILOT_PX4),
];
const STATES: [(u8, MavState); 4] = [
    (3, MavState::MAV_STATE_STANDBY),
    (4, MavState::MAV_STATE_ACTIVE),
    (5, MavState::MAV_STATE_CRITICAL),
    (6, MavState::MAV_STATE_EMERGENCY),
];
const PARAMETER_TYPES: [(u8, MavParamType); 7] = [
    (1, MavParamType::MAV_PARAM_TYPE_UINT8),
    (2, MavParamType::MAV_PARAM_TYPE_INT8),
    (3, MavParamType::MAV_PARAM_TYPE_UINT16),
    (4, MavParamType::MAV_PARAM_TYPE_INT16),
    (5, MavParamType::MAV_PARAM_TYPE_UINT32),
    (6, MavParamType::MAV_PARAM_TYPE_INT32),
    (9, MavParamType::MAV_PARAM_TYPE_REAL32),
];

fn of<T: Copy>(table: &[(u8, T)], number: u8) -> T {
    table.iter().find(|(known, _)| *known == number).unwrap().1
}

fn any_of<T: Copy + std::fmt::Debug>(table: &'static [(u8, T)]) -> impl Strategy<Value = u8> {
    (0..table.len()).prop_map(|at| table[at].0)
}

fn encoded(message: &Message<'_>, header: Header) -> Vec<u8> {
    let mut payload = [0; PAYLOAD_BYTES_MAX];
    written(&message.frame(header, &mut payload).unwrap())
}

fn written(frame: &Frame<'_>) -> Vec<u8> {
    let mut out = [0; FRAME_BYTES_MAX];
    let length = frame.encode(&mut out).unwrap();
    out[..length].to_vec()
}

fn their_header(header: Header) -> MavHeader {
    let Header { sequence, system, component } = header;
    MavHeader { system_id: u32::from(system), component_id: component, sequence }
}

fn their_bytes(message: &MavMessage, header: Header) -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(their_header(header), message);
    raw.raw_bytes().to_vec()
}

/// The frames they find in a stream.
fn their_frames(bytes: &[u8]) -> Vec<MAVLinkV2MessageRaw> {
    let mut reader = MavlinkReader::new(bytes);
    let next = || reader.read_raw_message::<MavMessage>(MavlinkVersion::V2).ok();
    std::iter::from_fn(next)
        .map(|message| match message {
            MAVLinkMessageRaw::V2(raw) => raw,
            MAVLinkMessageRaw::V1(_) => panic!("asked for version 2 only"),
        })
        .collect()
}

fn padded(id: ParamId) -> [u8; 16] {
    let mut bytes = [0; 16];
    bytes[..id.name().len()].copy_from_slice(id.name());
    bytes
}

/// Ours as theirs. Extension fields that ours has none for stay zero.
fn convert(message: &Message<'_>) -> MavMessage {
    match *message {
        Message::Heartbeat(ours) => MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: ours.custom_mode,
            mavtype: of(&TYPES, ours.kind),
            autopilot: of(&AUTOPILOTS, ours.autopilot),
            base_mode: MavModeFlag::from_bits(ours.base_mode).unwrap(),
            system_status: of(&STATES, ours.system_status),
            mavlink_version: ours.version,
        }),
        Message::ParamValue(ours) => MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: f32::from_bits(ours.value_bits),
            param_count: ours.count,
            param_index: ours.index,
            param_id: padded(ours.id).into(),
            param_type: of(&PARAMETER_TYPES, ours.kind),
        }),
        Message::ParamSet(ours) => MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: f32::from_bits(ours.value_bits),
            target_system: ours.target_system,
            target_component: ours.target_component,
            param_id: padded(ours.id).into(),
            param_type: of(&PARAMETER_TYPES, ours.kind),
        }),
        Message::ManualControl(ManualControl { x, y, z, r, buttons, target_system: target }) => {
            let rest = MANUAL_CONTROL_DATA::default();
            MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA { x, y, z, r, buttons, target, ..rest })
        }
        Message::ChannelsOverride(ours) => convert_channels(&ours),
        Message::SetAttitudeTarget(ours) => {
            let [body_roll_rate, body_pitch_rate, body_yaw_rate] = ours.rate_frd_rad_s;
            MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
                time_boot_ms: ours.since_boot_ms,
                q: ours.orientation_wxyz,
                body_roll_rate,
                body_pitch_rate,
                body_yaw_rate,
                thrust: ours.thrust_ratio,
                target_system: ours.target_system,
                target_component: ours.target_component,
                type_mask: AttitudeTargetTypemask::from_bits(ours.ignored).unwrap(),
                thrust_body: [0.0; 3],
            })
        }
        Message::TimeSync(ours) => MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: ours.answered_ns,
            ts1: ours.asked_ns,
            target_system: ours.target_system,
            target_component: ours.target_component,
        }),
        Message::Other { id, .. } => panic!("message {id} has no form of its own"),
    }
}

fn convert_channels(ours: &ChannelsOverride) -> MavMessage {
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r] = ours.channels_us;
    MavMessage::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA {
        chan1_raw: a,
        chan2_raw: b,
        chan3_raw: c,
        chan4_raw: d,
        chan5_raw: e,
        chan6_raw: f,
        chan7_raw: g,
        chan8_raw: h,
        target_system: ours.target_system,
        target_component: ours.target_component,
        chan9_raw: i,
        chan10_raw: j,
        chan11_raw: k,
        chan12_raw: l,
        chan13_raw: m,
        chan14_raw: n,
        chan15_raw: o,
        chan16_raw: p,
        chan17_raw: q,
        chan18_raw: r,
    })
}

fn any_header() -> impl Strategy<Value = Header> {
    any::<[u8; 3]>().prop_map(|[sequence, system, component]| Header { sequence, system, component })
}

fn any_id() -> impl Strategy<Value = ParamId> {
    "[A-Z0-9_]{1,16}".prop_map(|name| ParamId::new(name.as_bytes()).unwrap())
}

/// A number, or zero: trailing zeros are trimmed.
fn any_f32() -> impl Strategy<Value = f32> {
    prop_oneof![3 => -1e6f32..1e6, 1 => Just(0.0), 1 => Just(-0.0)]
}

fn any_heartbeat() -> impl Strategy<Value = Message<'static>> {
    let modes = prop::sample::select(vec![0, 128, 193, 255]);
    (any::<u32>(), any_of(&TYPES), any_of(&AUTOPILOTS), modes, any_of(&STATES)).prop_map(
        |(custom_mode, kind, autopilot, base_mode, system_status)| {
            let version = 3;
            Message::Heartbeat(Heartbeat { custom_mode, kind, autopilot, base_mode, system_status, version })
        },
    )
}

fn any_parameter() -> impl Strategy<Value = Message<'static>> {
    let value_bits = any_f32().prop_map(f32::to_bits);
    (value_bits, any::<[u16; 2]>(), any_id(), any_of(&PARAMETER_TYPES), any::<bool>()).prop_map(
        |(value_bits, [count, index], id, kind, set)| match set {
            true => {
                let ([target_system, _], [target_component, _]) = (count.to_le_bytes(), index.to_le_bytes());
                Message::ParamSet(ParamSet { value_bits, target_system, target_component, id, kind })
            }
            false => Message::ParamValue(ParamValue { value_bits, count, index, id, kind }),
        },
    )
}

fn any_sticks() -> impl Strategy<Value = Message<'static>> {
    (any::<[i16; 4]>(), any::<u16>(), any::<u8>()).prop_map(|([x, y, z, r], buttons, target_system)| {
        Message::ManualControl(ManualControl { x, y, z, r, buttons, target_system })
    })
}

fn any_channels() -> impl Strategy<Value = Message<'static>> {
    (any::<[u16; 18]>(), 0usize..=18, any::<[u8; 2]>()).prop_map(
        |(mut channels_us, used, [target_system, target_component])| {
            channels_us[used..].fill(0);
            Message::ChannelsOverride(ChannelsOverride { channels_us, target_system, target_component })
        },
    )
}

fn any_target() -> impl Strategy<Value = Message<'static>> {
    let numbers = prop::collection::vec(any_f32(), 8);
    let ignored = prop::sample::select(vec![0, 7, 0x80, 0x87, 0x20]);
    (any::<u32>(), numbers, ignored, any::<[u8; 2]>()).prop_map(
        |(since_boot_ms, numbers, ignored, [target_system, target_component])| {
            let [a, b, c, d, x, y, z, thrust_ratio] = numbers.try_into().unwrap();
            Message::SetAttitudeTarget(AttitudeTarget {
                since_boot_ms,
                orientation_wxyz: [a, b, c, d],
                rate_frd_rad_s: [x, y, z],
                thrust_ratio,
                target_system,
                target_component,
                ignored,
            })
        },
    )
}

fn any_time_sync() -> impl Strategy<Value = Message<'static>> {
    (any::<[i64; 2]>(), any::<[u8; 2]>()).prop_map(
        |([answered_ns, asked_ns], [target_system, target_component])| {
            Message::TimeSync(TimeSync { answered_ns, asked_ns, target_system, target_component })
        },
    )
}

fn any_message() -> impl Strategy<Value = Message<'static>> {
    prop_oneof![any_heartbeat(), any_parameter(), any_sticks(), any_channels(), any_target(), any_time_sync(),]
}

proptest! {
    #[test]
    fn what_we_write_they_read_and_the_other_way_round(message in any_message(), header in any_header()) {
        let (bytes, converted) = (encoded(&message, header), convert(&message));
        let read = MavlinkReader::new(&bytes[..]).read_message::<MavMessage>(MavlinkVersion::V2);
        let (their_sender, their_message) = read.expect("they read it");
        prop_assert_eq!(their_sender, their_header(header));
        prop_assert_eq!(&their_message, &converted);
        let their_bytes = their_bytes(&converted, header);
        let frame = Frame::decode(&their_bytes).expect("we read it");
        prop_assert_eq!((frame.header, frame.message()), (header, message));
        prop_assert_eq!(their_bytes, bytes);
    }

    #[test]
    fn signatures_are_the_same_and_believed_both_ways(
        message in any_message(), header in any_header(), key: [u8; 32], link: u8, ticks in 1u64..1 << 48,
    ) {
        let now = Timestamp::new(ticks).unwrap();
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let mut signer = Signer::new(Key::new(key), link);
        let frame = message.frame(header, &mut payload).unwrap().signed(&mut signer, now).unwrap();
        let ours = written(&frame);

        let mut theirs = MAVLinkV2MessageRaw::new();
        theirs.serialize_message_for_signing(their_header(header), &convert(&message));
        theirs.signature_timestamp_bytes_mut().copy_from_slice(&ticks.to_le_bytes()[..6]);
        *theirs.signature_link_id_mut() = link;
        let mut tag = [0; 6];
        theirs.calculate_signature(&key, &mut tag);
        theirs.signature_value_mut().copy_from_slice(&tag);
        prop_assert_eq!(theirs.raw_bytes(), &ours[..]);

        let read = &their_frames(&ours)[0];
        prop_assert_eq!(read.signature_value(), &tag[..]);
        let mut verifier = Verifier::new(Key::new(key));
        prop_assert_eq!(verifier.verify(&Frame::decode(theirs.raw_bytes()).unwrap(), now), Ok(()));
    }
}

#[test]
fn layouts_have_the_same_check() {
    for id in 0..70_000 {
        if let Some(extra) = crc_extra(id) {
            assert!(KNOWN.contains(&id));
            assert_eq!(extra, MavMessage::extra_crc(id), "message {id}");
        }
    }
    assert!(KNOWN.iter().all(|id| crc_extra(*id).is_some()));
}

/// Of any known message with any payload: (id, sequence, payload).
fn random_frame(random: &mut Random) -> Vec<u8> {
    let most = [255, 60, 60, 60][random.below(4)];
    let payload = random.bytes(most);
    let [sequence, system, component, compatibility_flags, ..] = random.next().to_le_bytes();
    let header = Header { sequence, system, component };
    let message_id = KNOWN[random.below(KNOWN.len())];
    written(&Frame { header, compatibility_flags, message_id, payload: &payload, signature: None })
}

#[test]
fn we_agree_on_which_damaged_frames_are_none() {
    let (mut random, mut agreed) = (Random::new(21), [0u32; 2]);
    for round in 0..20_000 {
        let mut bytes = random_frame(&mut random);
        for _ in 0..random.below(3) {
            // Length and flags stay, since the oracle would wait for what does not come, and so does the number,
            // since it knows more messages than we do.
            let at =
                [3 + random.below(4), 10 + random.below(bytes.len() - 10)][usize::from(random.below(4) > 0)];
            bytes[at] ^= 1 << random.below(8);
        }
        let ours = Frame::decode(&bytes).ok().map(|frame| (frame.message_id, frame.payload.to_vec()));
        // They may find another frame within a damaged one's bytes; what counts is the whole.
        let theirs = their_frames(&bytes)
            .iter()
            .find(|raw| raw.raw_bytes() == bytes)
            .map(|raw| (raw.message_id(), raw.payload().to_vec()));
        assert_eq!(ours, theirs, "round {round}: {bytes:02x?}");
        agreed[usize::from(ours.is_some())] += 1;
    }
    assert!(agreed.iter().all(|count| *count > 5_000), "{agreed:?}");
}

#[test]
fn we_find_the_frames_in_a_noisy_stream_that_they_find() {
    let mut random = Random::new(22);
    let (mut line, mut sent) = (Vec::new(), Vec::new());
    for _ in 0..2_000 {
        // Noise without a beginning: where it has one, they may give up a frame that follows, and we do not.
        let noise = random.bytes(20).into_iter().filter(|byte| !matches!(byte, 0xFD | 0xFE));
        line.extend(noise);
        let frame = random_frame(&mut random);
        line.extend(&frame);
        sent.push(frame);
    }
    let (mut decoder, mut ours) = (Decoder::new(), Vec::new());
    for portion in line.chunks(41) {
        decoder.receive(portion, |frame| ours.push(written(&frame)));
    }
    let theirs: Vec<Vec<u8>> = their_frames(&line).iter().map(|raw| raw.raw_bytes().to_vec()).collect();
    assert!(ours == sent, "{} of {} frames", ours.len(), sent.len());
    assert!(theirs == sent, "{} of {} frames", theirs.len(), sent.len());
}
