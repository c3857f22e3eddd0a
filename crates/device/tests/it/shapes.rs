//! One function per protocol that feeds its decoders any bytes: whatever they are, it must come back, soon; a
//! stream's portions must not matter; and what was understood, written again and read again, must be the same.
//! Fuzz targets include this file too (`#[path]`), so it uses nothing but the crate.
//!
//! Bytes behind a checksum are hard to come by at random, so each function takes its input also as what stands
//! under the checksum. Those are worked out here, from their definitions, not by the crate.

use device::crsf::{self, Frame};
use device::crtp::{self, LogReply, LogRequest, Packet};
use device::mavlink;
use device::natnet::{ModelDefinition, Request, ServerInfo, Version, message_number};
use device::sbus::{self, FrameFinder};
use device::vehicle_link::{ChannelMap, CommandFrame, Downlink, LINK_VERSION, PAYLOAD_BYTES_MAX, Uplink};
use device::xbee::{self, ApiMode};
use device::{natnet, vicon};

/// A protocol's name and its function.
pub type Shape = (&'static str, fn(&[u8]));

/// All of them.
pub const SHAPES: [Shape; 8] = [
    ("vicon", vicon_datagram),
    ("natnet", natnet_datagram),
    ("xbee", xbee_line),
    ("sbus", sbus_line),
    ("crsf", crsf_line),
    ("crtp", crtp_packet),
    ("mavlink", mavlink_line),
    ("vehicle link", vehicle_link),
];

/// Cuts bytes into portions of lengths that the bytes themselves choose, up to 40.
fn portions(mut bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        let length = usize::from(*bytes.first()?) % 40 + 1;
        let (portion, rest) = bytes.split_at(length.min(bytes.len()));
        bytes = rest;
        Some(portion)
    })
}

/// What `write` makes of what was read from so many bytes: twice as many at most, or a message of fixed length.
fn written<E: std::fmt::Debug>(
    read_bytes: usize,
    write: impl FnOnce(&mut [u8]) -> Result<usize, E>,
) -> Vec<u8> {
    let mut out = vec![0; 2 * read_bytes + 600];
    let length = write(&mut out).expect("what was read can be written");
    out.truncate(length);
    out
}

/// A check of sixteen bits, least significant bit first or last.
fn crc16(bytes: impl Iterator<Item = u8>, polynomial: u16, reflected: bool) -> u16 {
    bytes.fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc, |crc: u16, bit| match reflected {
            true if (crc ^ (u16::from(byte) >> bit)) & 1 == 1 => (crc >> 1) ^ polynomial,
            true => crc >> 1,
            false if ((crc >> 15) ^ (u16::from(byte) >> (7 - bit))) & 1 == 1 => (crc << 1) ^ polynomial,
            false => crc << 1,
        })
    })
}

/// A datagram of Tracker's object stream.
pub fn vicon_datagram(bytes: &[u8]) {
    let Ok(datagram) = vicon::Datagram::decode(bytes) else { return };
    let objects: Vec<_> = datagram.objects().collect();
    for object in &objects {
        assert_eq!(
            object.is_finite(),
            plain_object(object).1.iter().all(|bits| f64::from_bits(*bits).is_finite())
        );
        if let Some(attitude) = vicon::euler_to_rotation(object.rotation_rad) {
            assert!(attitude.is_finite());
        }
    }
    let again = written(bytes.len(), |out| vicon::encode(datagram.frame_number, &objects, out));
    let again = vicon::Datagram::decode(&again).expect("just written");
    assert_eq!(again.frame_number, datagram.frame_number);
    assert!(again.objects().map(|object| plain_object(&object)).eq(objects.iter().map(plain_object)));
}

/// An object with its numbers as bits: they need be no numbers.
fn plain_object(object: &vicon::Object<'_>) -> (Vec<u8>, [u64; 6]) {
    let ([a, b, c], [d, e, f]) = (object.translation_mm, object.rotation_rad);
    (object.name.to_vec(), [a, b, c, d, e, f].map(f64::to_bits))
}

/// A datagram of either of NatNet's channels.
pub fn natnet_datagram(bytes: &[u8]) {
    let _ = message_number(bytes);
    for version in Version::ALL {
        natnet_frame(version, bytes);
        natnet_model_definition(version, bytes);
    }
    natnet_command(bytes);
}

fn natnet_frame(version: Version, bytes: &[u8]) {
    let plain_body = |body: natnet::RigidBody| {
        let ([x, y, z], [a, b, c, d]) = (body.position_m, body.orientation_xyzw);
        (body.id, [x, y, z, a, b, c, d, body.marker_error_m].map(f32::to_bits), body.params)
    };
    let plain_head = |head: natnet::FrameHead| {
        let timestamp = head.timing.timestamp_s.to_bits();
        (natnet::FrameHead { timing: natnet::Timing { timestamp_s: 0.0, ..head.timing }, ..head }, timestamp)
    };
    let Ok(frame) = natnet::Frame::decode(version, bytes) else { return };
    let bodies: Vec<_> = frame.rigid_bodies().collect();
    assert!(bodies.len() * natnet::RIGID_BODY_BYTES <= bytes.len());
    let _ = frame.head.timing.latency(10_000_000);
    let again = written(bytes.len(), |out| natnet::encode_frame(version, &frame.head, &bodies, out));
    assert_eq!(again.len(), natnet::frame_bytes(version, bodies.len()));
    let again = natnet::Frame::decode(version, &again).expect("just written");
    assert_eq!(plain_head(again.head), plain_head(frame.head));
    assert!(again.rigid_bodies().map(plain_body).eq(bodies.into_iter().map(plain_body)));
}

fn natnet_model_definition(version: Version, bytes: &[u8]) {
    let Ok(model) = ModelDefinition::decode(version, bytes) else { return };
    let bodies: Vec<_> = model.rigid_bodies().collect();
    assert!(bodies.iter().map(|body| body.name.len() + 5).sum::<usize>() <= bytes.len());
    let mut out = vec![0; 2 * bytes.len() + 40 * bodies.len() + 8];
    // Without their markers they may be fewer bytes, with their parents' places more than a datagram's.
    if let Ok(length) = natnet::encode_model_definition(version, &bodies, &mut out) {
        let again = ModelDefinition::decode(version, &out[..length]).expect("just written");
        assert!(again.rigid_bodies().eq(bodies));
    }
}

fn natnet_command(bytes: &[u8]) {
    if let Ok(info) = ServerInfo::decode(bytes) {
        let _ = Version::from_bytes(info.natnet_version);
        // A name that fills its field is read, and not written: ours end in a NUL.
        if info.name.len() <= natnet::NAME_BYTES_MAX {
            let again = written(bytes.len(), |out| info.encode(out));
            assert_eq!(ServerInfo::decode(&again), Ok(info));
        }
    }
    if let Ok(request) = Request::decode(bytes) {
        let again = written(bytes.len(), |out| request.encode(out));
        assert_eq!(Request::decode(&again), Ok(request));
    }
}

/// The serial line of an XBee in both modes, and a single frame.
pub fn xbee_line(bytes: &[u8]) {
    for mode in [ApiMode::Plain, ApiMode::Escaped] {
        let (mut whole, mut frames) = (xbee::Decoder::new(mode), Vec::new());
        whole.receive(bytes, |frame| {
            frames.push(format!("{frame:?}"));
            xbee_again(frame, mode);
        });
        let (mut in_portions, mut same) = (xbee::Decoder::new(mode), Vec::new());
        for portion in portions(bytes) {
            in_portions.receive(portion, |frame| same.push(format!("{frame:?}")));
        }
        assert_eq!((frames, whole.errors()), (same, in_portions.errors()));
    }
    if let Ok(frame) = xbee::Frame::decode(bytes)
        && bytes.len() <= xbee::FRAME_DATA_BYTES_MAX
    {
        xbee_again(frame, ApiMode::Plain);
        xbee_again(frame, ApiMode::Escaped);
    }
}

fn xbee_again(frame: xbee::Frame<'_>, mode: ApiMode) {
    let line = written(0, |out| frame.encode(mode, out));
    let (mut decoder, mut count) = (xbee::Decoder::new(mode), 0);
    decoder.receive(&line, |again| {
        assert_eq!(again, frame);
        count += 1;
    });
    assert_eq!((count, decoder.errors()), (1, xbee::DecoderErrors::default()));
}

/// An SBUS line, with silences here and there.
pub fn sbus_line(bytes: &[u8]) {
    let (mut finder, mut frames) = (FrameFinder::new(), 0);
    for byte in bytes {
        if let Some(frame) = finder.push(*byte) {
            frames += 1;
            assert_eq!(sbus::Frame::decode(&frame.encode()), Ok(frame));
            assert!(frame.channels.iter().all(|channel| *channel <= 2047));
            let _ = CommandFrame::decode(&frame.channels);
        }
        if byte & 63 == 0 {
            finder.gap();
        }
    }
    finder.gap();
    assert_eq!(finder.skipped_bytes() + frames * sbus::FRAME_BYTES as u64, bytes.len() as u64);
}

/// A CRSF line, with and without silences, and a single frame.
pub fn crsf_line(bytes: &[u8]) {
    let (mut whole, mut frames) = (crsf::Decoder::new(), Vec::new());
    whole.receive(bytes, |frame| {
        frames.push(format!("{frame:?}"));
        crsf_again(frame);
    });
    let (mut in_portions, mut same) = (crsf::Decoder::new(), Vec::new());
    for portion in portions(bytes) {
        in_portions.receive(portion, |frame| same.push(format!("{frame:?}")));
    }
    assert_eq!((frames, whole.errors()), (same, in_portions.errors()));

    let (mut with_silences, mut count) = (crsf::Decoder::new(), 0);
    for portion in portions(bytes) {
        with_silences.receive(portion, |_| count += 1);
        if portion.last().is_some_and(|byte| byte & 7 == 0) {
            with_silences.gap(|_| count += 1);
        }
    }
    with_silences.gap(|_| count += 1);
    assert!(count * 4 + with_silences.errors().skipped_bytes <= bytes.len() as u64);

    // As type and payload.
    if let Some(content) =
        bytes.get(..bytes.len().min(crsf::FRAME_BYTES_MAX - 3)).filter(|some| !some.is_empty())
    {
        let check = content.iter().fold(0u8, |crc, byte| {
            (0..8).fold(crc ^ byte, |crc, _| (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { 0xD5 })
        });
        let frame = [&[crsf::SYNC, content.len() as u8 + 1][..], content, &[check]].concat();
        match Frame::decode(&frame) {
            Ok(frame) => crsf_again(frame),
            Err(error) => assert!(matches!(error, crsf::CrsfError::Payload { .. }), "{error}"),
        }
    }
}

fn crsf_again(frame: Frame<'_>) {
    let bytes = written(0, |out| frame.encode(crsf::SYNC, out));
    assert_eq!(Frame::decode(&bytes), Ok(frame));
    if let Frame::Channels(channels) = frame {
        let _ = CommandFrame::decode(&channels);
    }
}

/// A packet of a Crazyflie's.
pub fn crtp_packet(bytes: &[u8]) {
    if let Ok(packet) = Packet::decode(bytes) {
        let mut out = [0; crtp::PACKET_BYTES_MAX];
        // A setpoint that is no number is read, and not sent.
        if let Ok(length) = packet.encode(&mut out) {
            assert!(length <= bytes.len());
            assert_eq!(Packet::decode(&out[..length]), Ok(packet));
        }
        if let Packet::Setpoint(setpoint) = packet {
            let _ = setpoint.rate_rad_s();
        }
    }
    let mut out = [0; crtp::PACKET_BYTES_MAX];
    if let Ok(Some(request)) = LogRequest::decode(bytes) {
        let length = request.encode(&mut out).expect("what was read can be written");
        assert_eq!(LogRequest::decode(&out[..length]), Ok(Some(request)));
    }
    if let Ok(Some(reply)) = LogReply::decode(bytes) {
        let length = reply.encode(&mut out).expect("what was read can be written");
        assert_eq!(LogReply::decode(&out[..length]), Ok(Some(reply)));
    }
}

/// A stream of MAVLink 2, with and without silences, and a single frame.
pub fn mavlink_line(bytes: &[u8]) {
    let (mut whole, mut frames) = (mavlink::Decoder::new(), Vec::new());
    whole.receive(bytes, |frame| {
        frames.push(format!("{frame:?}"));
        mavlink_again(&frame);
    });
    let (mut in_portions, mut same) = (mavlink::Decoder::new(), Vec::new());
    for portion in portions(bytes) {
        in_portions.receive(portion, |frame| same.push(format!("{frame:?}")));
    }
    assert_eq!((frames, whole.errors()), (same, in_portions.errors()));

    let (mut with_silences, mut taken) = (mavlink::Decoder::new(), 0);
    let mut count = |frame: mavlink::Frame<'_>| taken += 12 + frame.payload.len() as u64;
    for portion in portions(bytes) {
        with_silences.receive(portion, &mut count);
        if portion.last().is_some_and(|byte| byte & 7 == 0) {
            with_silences.gap(&mut count);
        }
    }
    with_silences.gap(&mut count);
    assert!(taken + with_silences.errors().skipped_bytes <= bytes.len() as u64);

    // As what stands between the first byte and the check, the length put right.
    if let [_, flags, _, _, _, _, id, middle, high, payload @ ..] = bytes {
        let extra = mavlink::crc_extra(u32::from_le_bytes([*id, *middle, *high, 0])).unwrap_or(0);
        let payload = &payload[..payload.len().min(mavlink::PAYLOAD_BYTES_MAX)];
        let head = [&[payload.len() as u8], &bytes[1..9], payload].concat();
        let check = crc16(head.iter().copied().chain([extra]), 0x8408, true).to_le_bytes();
        let signature = if flags & 1 == 1 { &[0x5A; 13][..] } else { &[] };
        let frame = [&[mavlink::START][..], &head, &check, signature].concat();
        match mavlink::Frame::decode(&frame) {
            Ok(frame) => mavlink_again(&frame),
            Err(error) => assert!(
                matches!(
                    error,
                    mavlink::MavlinkError::UnknownMessage { .. } | mavlink::MavlinkError::Incompatible { .. }
                ),
                "{error}"
            ),
        }
    }
}

fn mavlink_again(frame: &mavlink::Frame<'_>) {
    let bytes = written(0, |out| frame.encode(out));
    assert_eq!(mavlink::Frame::decode(&bytes), Ok(*frame));
    let message = frame.message();
    match message {
        mavlink::Message::SetAttitudeTarget(target) => {
            let _ = (target.rate_rad_s(), target.orientation());
        }
        mavlink::Message::ParamSet(mavlink::ParamSet { value_bits, kind, .. })
        | mavlink::Message::ParamValue(mavlink::ParamValue { value_bits, kind, .. }) => {
            for encoding in [mavlink::ParamEncoding::Bytewise, mavlink::ParamEncoding::CStyle] {
                let _ = mavlink::ParamNumber::from_wire(value_bits, kind, encoding);
            }
        }
        _ => {}
    }
    let mut payload = [0; mavlink::PAYLOAD_BYTES_MAX];
    // A setpoint that is no number, or asks for no thrust, is read, and not sent.
    if let Ok(again) = message.frame(frame.header, &mut payload) {
        assert_eq!(again.message(), message);
    }
}

/// A payload of the data link, either way, and the channels of a command.
pub fn vehicle_link(bytes: &[u8]) {
    link_payload(bytes);
    let most = bytes.len().min(PAYLOAD_BYTES_MAX - 2);
    let check = crc16(bytes[..most].iter().copied(), 0x1021, false).to_le_bytes();
    link_payload(&[&bytes[..most], &check].concat());

    let mut channels = [0; 16];
    for (channel, pair) in channels.iter_mut().zip(bytes.chunks_exact(2)) {
        *channel = u16::from_le_bytes([pair[0], pair[1]]);
    }
    let vehicle = bytes.last().copied().unwrap_or_default();
    for map in [ChannelMap::Full, ChannelMap::Compact] {
        command(map, &channels, vehicle);
        command(map, &channels.map(|channel| channel & 0x7FF), vehicle);
        let in_order = match map {
            ChannelMap::Full => full_in_order(channels),
            ChannelMap::Compact => compact_in_order(channels, vehicle),
        };
        assert!(command(map, &in_order, vehicle), "a frame with all in order is refused: {in_order:?}");
    }
}

/// A check over the lower bits of words, most significant bit first.
fn crc_of_words(words: &[u16], bits: u16, polynomial: u16) -> u16 {
    words.iter().flat_map(|word| (0..bits).rev().map(move |bit| (word >> bit) & 1)).fold(0, |crc, bit| {
        let shifted = (crc << 1) & ((1 << bits) - 1);
        if ((crc >> (bits - 1)) ^ bit) & 1 == 1 { shifted ^ polynomial } else { shifted }
    })
}

/// Channels of eleven bits with fields in their ranges and the right check.
fn full_in_order(channels: [u16; 16]) -> [u16; 16] {
    let mut channels = channels.map(|channel| channel & 0x7FF);
    channels[9..11].iter_mut().for_each(|channel| *channel &= 0xFF);
    (channels[11], channels[14]) = (channels[11] & 3, LINK_VERSION);
    channels[15] = crc_of_words(&channels[..15], 11, 0x307);
    channels
}

/// Channels as ExpressLRS leaves them with fields that agree and the right check.
fn compact_in_order(channels: [u16; 16], vehicle: u8) -> [u16; 16] {
    let mut channels = channels.map(|channel| channel & 0x7FF);
    let state = ((channels[7] / 2) & !3) | u16::from(vehicle & 3);
    let armed = matches!(state / 256, 1 | 2);
    channels[4] = if armed { 1811 } else { 172 };
    channels[7] = 2 * state;
    let [a, b, c, d, e, f, g] = [0, 1, 2, 3, 5, 6, 7].map(|channel| channels[channel] / 2);
    let words = [u16::from(vehicle), u16::from(armed), a, b, c, d, e, f, g];
    channels[8] = 2 * crc_of_words(&words, 10, 0x233);
    channels
}

/// There is one way to write each message, so what was read is written as it was, to the bit.
fn link_payload(bytes: &[u8]) {
    if let Ok((vehicle, message)) = Uplink::decode(bytes) {
        assert_eq!(written(bytes.len(), |out| message.encode(vehicle, out)), bytes);
    }
    if let Ok((vehicle, message)) = Downlink::decode(bytes) {
        assert_eq!(written(bytes.len(), |out| message.encode(vehicle, out)), bytes);
    }
}

/// Whether these channels are a command.
fn command(map: ChannelMap, channels: &[u16; 16], vehicle: u8) -> bool {
    let Ok((vehicle, frame)) = map.decode(channels, vehicle) else { return false };
    let again = map.encode(&frame, vehicle).expect("what was read can be written");
    assert_eq!(map.decode(&again, vehicle), Ok((vehicle, frame)));
    true
}
