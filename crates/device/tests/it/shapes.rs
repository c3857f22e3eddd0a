//! One function per decoder that feeds it any bytes and takes everything out of what it makes of them:
//! whatever they are, it must come back, soon. Fuzz targets include this file too (`#[path]`), so it uses
//! nothing but the crate.

use device::crsf::{self, Frame};
use device::crtp::{self, Packet};
use device::natnet::{ModelDefinition, Request, ServerInfo, Version, message_number};
use device::sbus::FrameFinder;
use device::vehicle_link::{CommandFrame, Downlink, Uplink};
use device::xbee::{ApiMode, Decoder};
use device::{natnet, vicon};

/// A decoder's name and its function.
pub type Shape = (&'static str, fn(&[u8]));

/// All of them.
pub const SHAPES: [Shape; 10] = [
    ("natnet frame", natnet_frame),
    ("natnet model definition", natnet_model_definition),
    ("natnet command", natnet_command),
    ("crsf frame", crsf_frame),
    ("crsf line", crsf_line),
    ("crtp packet", crtp_packet),
    ("sbus line", sbus_line),
    ("vicon datagram", vicon_datagram),
    ("xbee line", xbee_line),
    ("vehicle link payload", vehicle_link_payload),
];

/// A frame, in each version; one that is understood is written again as far as it is kept.
pub fn natnet_frame(bytes: &[u8]) {
    for version in Version::ALL {
        let Ok(frame) = natnet::Frame::decode(version, bytes) else { continue };
        let bodies: Vec<_> = frame.rigid_bodies().collect();
        assert!(bodies.len() * natnet::RIGID_BODY_BYTES <= bytes.len());
        let _ = frame.head.timing.latency(10_000_000);
        let mut out = vec![0; natnet::frame_bytes(version, bodies.len())];
        let length = natnet::encode_frame(version, &frame.head, &bodies, &mut out).expect("it came in one");
        let again = natnet::Frame::decode(version, &out[..length]).expect("just written");
        assert_eq!(again.rigid_bodies().len(), bodies.len());
        assert_eq!(again.head.number, frame.head.number);
    }
}

/// A model definition, in each version.
pub fn natnet_model_definition(bytes: &[u8]) {
    for version in Version::ALL {
        let Ok(model) = ModelDefinition::decode(version, bytes) else { continue };
        let bodies: Vec<_> = model.rigid_bodies().collect();
        assert!(bodies.iter().map(|body| body.name.len() + 5).sum::<usize>() <= bytes.len());
        let mut out = vec![0; 2 * bytes.len() + 40 * bodies.len() + 8];
        if let Ok(length) = natnet::encode_model_definition(version, &bodies, &mut out) {
            let again = ModelDefinition::decode(version, &out[..length]).expect("just written");
            assert!(again.rigid_bodies().eq(bodies));
        }
    }
}

/// What goes over the command channel, either way.
pub fn natnet_command(bytes: &[u8]) {
    let _ = message_number(bytes);
    let mut out = [0; 300];
    if let Ok(info) = ServerInfo::decode(bytes) {
        let _ = Version::from_bytes(info.natnet_version);
        if let Ok(length) = info.encode(&mut out) {
            assert_eq!(ServerInfo::decode(&out[..length]), Ok(info));
        }
    }
    if let Ok(request) = Request::decode(bytes) {
        let length = request.encode(&mut out).expect("room for the longest");
        assert_eq!(Request::decode(&out[..length]), Ok(request));
    }
}

/// One frame.
pub fn crsf_frame(bytes: &[u8]) {
    if let Ok(frame) = Frame::decode(bytes) {
        let mut out = [0; crsf::FRAME_BYTES_MAX];
        let length = frame.encode(bytes[0], &mut out).expect("it came in one");
        assert_eq!(Frame::decode(&out[..length]), Ok(frame));
        if let Frame::Channels(channels) = frame {
            let _ = CommandFrame::decode(&channels);
        }
    }
}

/// A serial line, with silences here and there.
pub fn crsf_line(bytes: &[u8]) {
    let (mut decoder, mut frames) = (crsf::Decoder::new(), 0);
    for chunk in bytes.chunks(37) {
        decoder.receive(chunk, |_| frames += 1);
        if chunk.last().is_some_and(|byte| byte & 7 == 0) {
            decoder.gap(|_| frames += 1);
        }
    }
    decoder.gap(|_| frames += 1);
    assert!(frames * 4 + decoder.errors().skipped_bytes <= bytes.len() as u64);
}

/// One packet.
pub fn crtp_packet(bytes: &[u8]) {
    if let Ok(packet) = Packet::decode(bytes) {
        let mut out = [0; crtp::PACKET_BYTES_MAX];
        if let Ok(length) = packet.encode(&mut out) {
            assert!(length <= bytes.len());
            assert_eq!(Packet::decode(&out[..length]), Ok(packet));
        }
        if let Packet::Setpoint(setpoint) = packet {
            let _ = setpoint.rate_rad_s();
        }
    }
}

/// A serial line, with silences here and there.
pub fn sbus_line(bytes: &[u8]) {
    let mut finder = FrameFinder::new();
    for byte in bytes {
        if let Some(frame) = finder.push(*byte) {
            let _ = CommandFrame::decode(&frame.channels);
        }
        if byte & 63 == 0 {
            finder.gap();
        }
    }
    assert!(finder.skipped_bytes() <= bytes.len() as u64);
}

/// One datagram.
pub fn vicon_datagram(bytes: &[u8]) {
    if let Ok(datagram) = vicon::Datagram::decode(bytes) {
        for object in datagram.objects() {
            let _ = object.is_finite();
            let _ = vicon::euler_to_rotation(object.rotation_rad);
        }
    }
}

/// A serial line, in both modes; payloads are read as ours.
pub fn xbee_line(bytes: &[u8]) {
    for mode in [ApiMode::Plain, ApiMode::Escaped] {
        Decoder::new(mode).receive(bytes, |frame| {
            let mut out = [0; 600];
            assert!(frame.encode(mode, &mut out).is_ok());
        });
    }
}

/// One payload of the data link, either way.
pub fn vehicle_link_payload(bytes: &[u8]) {
    let _ = Uplink::decode(bytes);
    let _ = Downlink::decode(bytes);
}
