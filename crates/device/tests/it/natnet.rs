//! NatNet's frames against the `natnet` crate, which decodes and encodes all of them.

use device::natnet::{
    Frame, FrameHead, RigidBody, SERVER_INFO_BYTES, ServerInfo, Timing, Version, encode_frame, frame_bytes,
};
use natnet as oracle;
use oracle::{
    Asset, ConnectionInfo, Decoder, Device, ForcePlate, FrameOfData, FrameTiming, LabeledMarker, MarkerSet,
    Message, PlannedBody, RawSection, Skeleton, SyntheticServer,
};
use proptest::prelude::*;

use crate::random::Random;

pub fn their_version(version: Version) -> oracle::Version {
    oracle::Version::from_bytes(version.to_bytes())
}

fn encoded(version: Version, head: &FrameHead, bodies: &[RigidBody]) -> Vec<u8> {
    let mut out = vec![0; frame_bytes(version, bodies.len())];
    let length = encode_frame(version, head, bodies, &mut out).unwrap();
    assert_eq!(length, out.len());
    out
}

fn theirs(version: Version, bytes: &[u8]) -> Option<FrameOfData> {
    match Decoder::new(their_version(version)).unwrap().parse(bytes).ok()?.into_message() {
        Message::FrameOfData(frame) => Some(*frame),
        _ => None,
    }
}

/// Ours and theirs in one form; floats as their bits, since some are no numbers.
type Plain = (u32, [u64; 8], u16, Vec<(i32, [u32; 8], u16)>);

fn plain(frame: &Frame<'_>) -> Plain {
    let (head, timing) = (frame.head, frame.head.timing);
    let times = [
        u64::from(timing.timecode),
        u64::from(timing.timecode_subframe),
        timing.timestamp_s.to_bits(),
        timing.exposed_ticks,
        timing.received_ticks,
        timing.transmitted_ticks,
        u64::from(timing.precision_s),
        u64::from(timing.precision_fraction),
    ];
    let body = |body: RigidBody| {
        let ([x, y, z], [a, b, c, d]) = (body.position_m, body.orientation_xyzw);
        (body.id, [x, y, z, a, b, c, d, body.marker_error_m].map(f32::to_bits), body.params)
    };
    (head.number, times, head.flags, frame.rigid_bodies().map(body).collect())
}

fn their_plain(frame: &FrameOfData) -> Plain {
    let timing = frame.timing;
    let times = [
        u64::from(timing.timecode),
        u64::from(timing.timecode_subframe),
        timing.timestamp.to_bits(),
        timing.camera_mid_exposure,
        timing.camera_data_received,
        timing.transmit,
        u64::from(timing.precision_timestamp_secs),
        u64::from(timing.precision_timestamp_fractional_secs),
    ];
    let body = |body: &oracle::RigidBody| {
        let ([x, y, z], [a, b, c, d]) = (body.position, body.orientation);
        (body.id, [x, y, z, a, b, c, d, body.mean_marker_error].map(f32::to_bits), body.params)
    };
    (frame.frame_number as u32, times, frame.params, frame.rigid_bodies.iter().map(body).collect())
}

#[test]
fn the_vectors_are_theirs_too() {
    let body = PlannedBody::tracked(7, [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    for (version, length) in Version::ALL.into_iter().zip([120, 120, 120, 164]) {
        let server = SyntheticServer::new(their_version(version), 1_000_000);
        let bytes = server.datagram(42, 0.0, &[body]).unwrap();
        assert_eq!(bytes.len(), length);
        let (position_m, orientation_xyzw) = ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
        let body = RigidBody { id: 7, position_m, orientation_xyzw, marker_error_m: 0.0, params: 1 };
        let head = FrameHead { number: 42, ..FrameHead::default() };
        assert_eq!(encoded(version, &head, &[body]), bytes);
    }
}

pub fn any_version() -> impl Strategy<Value = Version> {
    prop::sample::select(Version::ALL.to_vec())
}

fn any_body() -> impl Strategy<Value = RigidBody> {
    (any::<i32>(), any::<[u32; 8]>(), any::<u16>()).prop_map(|(id, bits, params)| {
        let [x, y, z, a, b, c, d, marker_error_m] = bits.map(f32::from_bits);
        let (position_m, orientation_xyzw) = ([x, y, z], [a, b, c, d]);
        RigidBody { id, position_m, orientation_xyzw, marker_error_m, params }
    })
}

fn any_head(version: Version) -> impl Strategy<Value = FrameHead> {
    any::<(u32, u16, u64, [u64; 3], [u32; 4])>().prop_map(move |(number, flags, seconds, ticks, words)| {
        let ([exposed_ticks, received_ticks, transmitted_ticks], [timecode, timecode_subframe, p, q]) =
            (ticks, words);
        let (precision_s, precision_fraction) = if version == Version::V4_1 { (p, q) } else { (0, 0) };
        let timestamp_s = f64::from_bits(seconds);
        let timing = Timing {
            timecode,
            timecode_subframe,
            timestamp_s,
            exposed_ticks,
            received_ticks,
            transmitted_ticks,
            precision_s,
            precision_fraction,
        };
        FrameHead { number, timing, flags }
    })
}

fn any_frame() -> impl Strategy<Value = (Version, FrameHead, Vec<RigidBody>)> {
    any_version()
        .prop_flat_map(|version| (Just(version), any_head(version), prop::collection::vec(any_body(), 0..12)))
}

/// A frame with something in every section, as the oracle writes it.
fn full_frame(version: Version, random: &mut Random) -> Vec<u8> {
    fn some<T>(random: &mut Random, mut make: impl FnMut(&mut Random) -> T) -> Vec<T> {
        (0..random.below(4)).map(|_| make(random)).collect()
    }
    fn number(random: &mut Random) -> f32 {
        random.next() as i32 as f32 / 1e6
    }
    fn vector(random: &mut Random) -> [f32; 3] {
        [number(random), number(random), number(random)]
    }
    fn body(random: &mut Random) -> oracle::RigidBody {
        oracle::RigidBody {
            id: random.next() as i32,
            position: vector(random),
            orientation: [number(random), number(random), number(random), number(random)],
            mean_marker_error: number(random),
            params: random.next() as u16,
        }
    }
    fn marker(random: &mut Random) -> LabeledMarker {
        let (id, position) = (random.next() as i32, vector(random));
        LabeledMarker { id, position, size: number(random), params: 1, residual: number(random) }
    }
    fn channels(random: &mut Random) -> Vec<Vec<f32>> {
        some(random, |random| some(random, number))
    }
    let marker_sets = some(random, |random| MarkerSet {
        name: "set".repeat(random.below(5)),
        markers: some(random, vector),
    });
    let skeletons =
        some(random, |random| Skeleton { id: random.next() as i32, rigid_bodies: some(random, body) });
    let assets = some(random, |random| Asset {
        id: random.next() as i32,
        rigid_bodies: some(random, body),
        markers: some(random, marker),
    });
    let assets = if version == Version::V4_1 { assets } else { Vec::new() };
    let force_plates =
        some(random, |random| ForcePlate { id: random.next() as i32, channels: channels(random) });
    let devices = some(random, |random| Device { id: random.next() as i32, channels: channels(random) });
    let timing = FrameTiming {
        timecode: random.next() as u32,
        timecode_subframe: random.next() as u32,
        timestamp: f64::from(number(random)),
        camera_mid_exposure: random.next(),
        camera_data_received: random.next(),
        transmit: random.next(),
        precision_timestamp_secs: 0,
        precision_timestamp_fractional_secs: 0,
    };
    let frame = FrameOfData {
        frame_number: random.next() as i32,
        marker_sets,
        other_markers: some(random, vector),
        rigid_bodies: some(random, body),
        skeletons: RawSection::from_skeletons(&skeletons).unwrap(),
        assets: RawSection::from_assets(&assets).unwrap(),
        labeled_markers: some(random, marker),
        force_plates: RawSection::from_force_plates(&force_plates).unwrap(),
        devices: RawSection::from_devices(&devices).unwrap(),
        timing,
        params: random.next() as u16,
    };
    frame.to_datagram(their_version(version)).unwrap()
}

proptest! {
    #[test]
    fn what_we_write_they_read_and_write_again((version, head, bodies) in any_frame()) {
        let bytes = encoded(version, &head, &bodies);
        let frame = theirs(version, &bytes).expect("they read it");
        prop_assert_eq!(their_plain(&frame), plain(&Frame::decode(version, &bytes).unwrap()));
        prop_assert_eq!(frame.to_datagram(their_version(version)).unwrap(), bytes);
    }
}

#[test]
fn what_they_write_in_all_sections_we_read() {
    let (mut random, mut bodies) = (Random::new(5), 0);
    for round in 0..4_000 {
        let version = Version::ALL[round % 4];
        let bytes = full_frame(version, &mut random);
        let ours = Frame::decode(version, &bytes).unwrap();
        assert_eq!(plain(&ours), their_plain(&theirs(version, &bytes).unwrap()), "round {round}");
        bodies += ours.rigid_bodies().len();
    }
    assert!(bodies > 4_000);
}

/// Before 4.1 both walk every byte, so both refuse the same frames. In 4.1 we step over by sizes what they
/// look into, so what they accept we accept.
#[test]
fn we_agree_on_which_damaged_frames_are_none() {
    let (mut random, mut accepted) = (Random::new(6), 0);
    for round in 0..40_000 {
        let version = Version::ALL[round % 4];
        let mut bytes = full_frame(version, &mut random);
        for _ in 0..=random.below(2) {
            let at = 4 + random.below(bytes.len() - 4);
            bytes[at] = [0, 1, 2, 4, 0xFF, random.next() as u8][random.below(6)];
        }
        let (ours, theirs) = (Frame::decode(version, &bytes).ok(), theirs(version, &bytes));
        if version == Version::V4_1 && theirs.is_none() {
            continue;
        }
        assert_eq!(ours.as_ref().map(plain), theirs.as_ref().map(their_plain), "{version}: {bytes:02x?}");
        accepted += u32::from(ours.is_some());
    }
    assert!((5_000..38_000).contains(&accepted), "{accepted}");
}

proptest! {
    #[test]
    fn server_info_both_ways(
        name in "[ -~]{0,255}", versions: [[u8; 4]; 2], clock_hz: u64, data_port: u16, multicast: bool,
        group: [u8; 4],
    ) {
        let [program_version, natnet_version] = versions;
        let ours = ServerInfo {
            name: name.as_bytes(), program_version, natnet_version, clock_hz, data_port, multicast, group,
        };
        let theirs = oracle::ServerInfo {
            application_name: name.clone(),
            server_version: oracle::Version::from_bytes(program_version),
            protocol_version: oracle::Version::from_bytes(natnet_version),
            high_res_clock_frequency: clock_hz,
            connection: ConnectionInfo { data_port, multicast, multicast_group: group },
        };
        let mut out = [0; SERVER_INFO_BYTES];
        ours.encode(&mut out).unwrap();
        let bytes = theirs.to_datagram().unwrap();
        prop_assert_eq!(&out[..], &bytes[..]);
        prop_assert_eq!(ServerInfo::decode(&bytes), Ok(ours));
        prop_assert_eq!(oracle::ServerInfo::parse(&out), Ok(theirs));
    }
}
