//! The core, stepped directly.

use super::*;
use device::vicon::{Object, encode, rotation_to_euler};
use quantity::{Body, Rotation, Vector, World};
use service_core::Seed;
use std::path::Path;

/// From the specification: 4242, "quad1", 100, -200.5, 1500.25 mm, 0.1, -0.2, 0.3 rad.
const GOLDEN: [u8; 80] = [
    0x92, 0x10, 0, 0, 1, 0, 0x48, 0, 0x71, 0x75, 0x61, 0x64, 0x31, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x59, 0x40, 0, 0, 0, 0, 0, 0x10, 0x69, 0xc0, 0, 0, 0, 0, 0, 0x71, 0x97,
    0x40, 0x9a, 0x99, 0x99, 0x99, 0x99, 0x99, 0xb9, 0x3f, 0x9a, 0x99, 0x99, 0x99, 0x99, 0x99, 0xc9, 0xbf,
    0x33, 0x33, 0x33, 0x33, 0x33, 0x33, 0xd3, 0x3f,
];

fn start() -> Start {
    Start { at: ms(0), seed: Seed(1), incarnation: 1 }
}

fn arena(scenario: &str) -> Arena {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    Arena::load(&folder, scenario).expect("the repository's own settings load")
}

fn ms(milliseconds: i64) -> Time {
    Time::ZERO + Span::from_millis(milliseconds)
}

/// The bridge, its stream, and what it said.
struct Bench {
    bridge: ViconBridge,
    out: Outbox<Output>,
}

impl Bench {
    fn new(scenario: &str) -> Self {
        let bridge = ViconBridge::new(&arena(scenario), Tuning::default(), start()).expect("default tuning");
        Self { bridge, out: Outbox::default() }
    }

    /// A datagram's bytes arrive; deadlines before are kept. Answers the frames published.
    fn bytes(&mut self, at: Time, bytes: &[u8]) -> Vec<MocapFrame> {
        self.wait(at - Span::from_nanos(1));
        let bytes = bytes.try_into().expect("fits");
        let datagram = DeviceBytes { port: Ports::MOTION_CAPTURE, at, bytes };
        self.bridge.step(at, Event::Input(Input::Received(datagram)), &mut self.out);
        self.frames()
    }

    fn wait(&mut self, until: Time) {
        while let Some(deadline) = self.bridge.deadline().filter(|deadline| *deadline <= until) {
            self.bridge.step(deadline, Event::Deadline, &mut self.out);
            assert_ne!(self.bridge.deadline(), Some(deadline), "a deadline kept must move");
        }
    }

    fn frames(&mut self) -> Vec<MocapFrame> {
        let frames = self.out.take_messages().map(|message| match message {
            Output::Frame(frame) => frame,
            Output::Ask(question) => panic!("Vicon takes no questions: {question:?}"),
        });
        frames.collect()
    }

    fn objects(&mut self, at: Time, frame: u32, objects: &[Object<'_>]) -> Vec<MocapFrame> {
        let mut bytes = [0; 1472];
        let length = encode(frame, objects, &mut bytes).expect("fits");
        self.bytes(at, &bytes[..length])
    }

    fn events(&self) -> Vec<&str> {
        self.out.events().iter().map(|event| event.name.as_str()).collect()
    }
}

/// A vehicle somewhere that differs from frame to frame.
fn seen(name: &str, frame: u32) -> Object<'_> {
    let x = f64::from(frame) * 0.37;
    Object { name: name.as_bytes(), translation_mm: [x, 2000.0, 3000.0], rotation_rad: [0.01, 0.02, 0.03] }
}

fn vehicles(frame: &MocapFrame) -> Vec<u8> {
    frame.bodies.iter().map(|body| body.vehicle).collect()
}

#[test]
fn the_golden_datagram_becomes_a_frame() {
    let mut bench = Bench::new("double-flip");
    let frames = bench.bytes(ms(100), &GOLDEN);
    assert_eq!(frames.len(), 1);
    assert_eq!((frames[0].frame, frames[0].received_at, frames[0].exposed_at), (4242, ms(100), ms(90)));
    let body = &frames[0].bodies[0];
    assert_eq!((body.vehicle, body.subject.as_str()), (1, "quad1"));
    assert!((body.position_m - Vector::<World>::new(0.1, -0.2005, 1.50025)).norm() < 1e-12);
    let back = rotation_to_euler(body.orientation);
    assert!(back.iter().zip([0.1, -0.2, 0.3]).all(|(a, b)| (a - b).abs() < 1e-12));
    assert_eq!(bench.bridge.counters().frames, 1);
}

#[test]
fn datagrams_of_one_frame_are_merged_and_complete_frames_do_not_wait() {
    let mut bench = Bench::new("fleet");
    assert!(bench.objects(ms(100), 7, &[seen("quad2", 7)]).is_empty());
    let frames = bench.objects(ms(101), 7, &[seen("quad1", 7), seen("quad3", 7)]);
    assert_eq!(vehicles(&frames[0]), [2, 1, 3]);
    assert_eq!((frames[0].received_at, frames[0].exposed_at), (ms(101), ms(90)));
    assert!(bench.events().is_empty());
}

#[test]
fn an_incomplete_frame_goes_out_after_two_milliseconds_or_with_the_next() {
    let mut bench = Bench::new("fleet");
    assert!(bench.objects(ms(100), 7, &[seen("quad2", 7)]).is_empty());
    assert_eq!(bench.bridge.deadline(), Some(ms(102)));
    bench.wait(ms(102));
    assert_eq!(vehicles(&bench.frames()[0]), [2]);
    // The rest of it is too late.
    assert!(bench.objects(ms(103), 7, &[seen("quad1", 7)]).is_empty());
    assert_eq!(bench.bridge.counters().late, 1);
    assert!(bench.objects(ms(105), 8, &[seen("quad2", 8)]).is_empty());
    let frames = bench.objects(ms(106), 9, &[seen("quad1", 9), seen("quad2", 9), seen("quad3", 9)]);
    assert_eq!(frames.iter().map(|frame| frame.frame).collect::<Vec<_>>(), [8, 9]);
}

#[test]
fn a_vehicle_long_gone_is_not_waited_for_until_it_shows_up_again() {
    let mut bench = Bench::new("fleet");
    for frame in 0..250 {
        bench.objects(ms(5 * i64::from(frame)), frame, &[seen("quad1", frame), seen("quad2", frame)]);
    }
    let both = |frame| [seen("quad1", frame), seen("quad2", frame)];
    assert_eq!(bench.objects(ms(1250), 250, &both(250)).len(), 1);
    // It comes back in a datagram of its own, behind the first: once too late, then waited for.
    assert!(bench.objects(ms(1251), 250, &[seen("quad3", 250)]).is_empty());
    assert!(bench.objects(ms(1255), 251, &both(251)).is_empty());
    assert_eq!(vehicles(&bench.objects(ms(1256), 251, &[seen("quad3", 251)])[0]), [1, 2, 3]);
}

#[test]
fn a_frame_in_which_nobody_is_seen_is_still_sent() {
    let mut bench = Bench::new("double-flip");
    bench.objects(ms(100), 7, &[]);
    bench.wait(ms(102));
    assert_eq!(vehicles(&bench.frames()[0]), []);
    let zero = Object { name: b"quad1", translation_mm: [0.0; 3], rotation_rad: [0.0; 3] };
    // Reported at zero it is reported: no need to wait for more.
    assert_eq!(vehicles(&bench.objects(ms(105), 8, &[zero])[0]), []);
    assert_eq!(bench.events(), ["pose-zero"]);
}

#[test]
fn a_frozen_pose_is_left_out_at_once_and_reported_once() {
    let mut bench = Bench::new("double-flip");
    assert_eq!(vehicles(&bench.objects(ms(100), 1, &[seen("quad1", 1)])[0]), [1]);
    for frame in 2..60 {
        assert_eq!(vehicles(&bench.objects(ms(95 + 5 * frame), frame as u32, &[seen("quad1", 1)])[0]), []);
        assert_eq!(bench.events().len(), usize::from(frame >= 6), "reported within 50 ms, once");
    }
    assert_eq!(bench.events(), ["pose-frozen"]);
    assert_eq!(vehicles(&bench.objects(ms(400), 60, &[seen("quad1", 60)])[0]), [1]);
}

#[test]
fn poison_leaves_only_its_own_vehicle_out() {
    let mut bench = Bench::new("fleet");
    let bad = Object { translation_mm: [f64::NAN, 0.0, 0.0], ..seen("quad2", 1) };
    for frame in 1..100 {
        let frames = bench.objects(
            ms(5 * i64::from(frame)),
            frame,
            &[seen("quad1", frame), bad, seen("quad3", frame)],
        );
        assert_eq!(vehicles(&frames[0]), [1, 3]);
    }
    assert_eq!(bench.bridge.counters().not_finite, 99);
    assert_eq!(bench.events(), ["pose-not-finite"], "at most once a second");
}

#[test]
fn strangers_are_reported_once_each_and_counted() {
    let mut bench = Bench::new("double-flip");
    for frame in 0..20 {
        let objects = [seen("wand", frame), seen("quad1", frame), seen("table", frame)];
        assert_eq!(vehicles(&bench.objects(ms(5 * i64::from(frame)), frame, &objects)[0]), [1]);
    }
    assert_eq!(bench.events(), ["subject-unknown", "subject-unknown"]);
    assert_eq!(bench.bridge.counters().unknown_objects, 40);
    // A thousand names do not fill memory or the bus.
    for frame in 20..1020 {
        let name = format!("ghost{frame}");
        bench.objects(ms(5 * i64::from(frame)), frame, &[seen(&name, frame), seen("quad1", frame)]);
    }
    assert_eq!(bench.events().len(), 32);
}

#[test]
fn a_vehicle_reported_twice_counts_once() {
    let mut bench = Bench::new("fleet");
    let objects = [seen("quad1", 1), seen("quad1", 2), seen("quad2", 1), seen("quad3", 1)];
    assert_eq!(vehicles(&bench.objects(ms(100), 1, &objects)[0]), [1, 2, 3]);
    assert_eq!(bench.bridge.counters().duplicate_objects, 1);
}

#[test]
fn late_frames_are_dropped_and_counted() {
    let mut bench = Bench::new("double-flip");
    bench.objects(ms(100), 10, &[seen("quad1", 10)]);
    bench.objects(ms(110), 12, &[seen("quad1", 12)]);
    assert!(bench.objects(ms(111), 11, &[seen("quad1", 11)]).is_empty());
    assert_eq!(bench.bridge.counters().late, 1);
    assert_eq!(bench.objects(ms(115), 13, &[seen("quad1", 13)]).len(), 1);
}

#[test]
fn a_frozen_frame_number_is_a_dropout_reported_within_50_ms() {
    let mut bench = Bench::new("double-flip");
    bench.objects(ms(100), 10, &[seen("quad1", 10)]);
    for step in 1..40 {
        assert!(bench.objects(ms(100 + 5 * i64::from(step)), 10, &[seen("quad1", 10 + step)]).is_empty());
        assert_eq!(bench.events().len(), usize::from(step >= 6));
    }
    assert_eq!(bench.events(), ["frame-number-frozen"]);
    bench.objects(ms(300), 11, &[seen("quad1", 90)]);
    assert_eq!(bench.events(), ["frame-number-frozen", "frame-number-advances"]);
}

#[test]
fn a_restart_of_the_vendors_system_goes_on_above_the_old_numbers() {
    let mut bench = Bench::new("double-flip");
    for frame in 0..1000u32 {
        bench.objects(ms(5 * i64::from(frame)), 50_000 + frame, &[seen("quad1", frame)]);
    }
    let mut published = Vec::new();
    for frame in 0..200u32 {
        published.extend(bench.objects(ms(20_000 + 5 * i64::from(frame)), frame, &[seen("quad1", frame)]));
    }
    assert_eq!(bench.events(), ["vicon-silent", "vicon-heard", "vicon-restarted"]);
    assert!(published.len() > 185);
    assert!(published.is_sorted_by(|a, b| a.frame < b.frame && a.exposed_at < b.exposed_at));
    assert_eq!(published[0].frame, 51_000);
    let newest = published.last().expect("some");
    assert!((newest.received_at - newest.exposed_at - Span::from_millis(10)).abs() < Span::from_micros(50));
}

#[test]
fn the_wrap_of_the_count_goes_unnoticed() {
    let mut bench = Bench::new("double-flip");
    let mut published = Vec::new();
    for step in 0..2000u32 {
        let frame = (u32::MAX - 1000).wrapping_add(step);
        published.extend(bench.objects(ms(5 * i64::from(step)), frame, &[seen("quad1", step)]));
    }
    assert_eq!(published.len(), 2000);
    assert!(published.windows(2).all(|pair| pair[1].frame == pair[0].frame + 1));
    assert!(published[100..].windows(2).all(|pair| {
        (pair[1].exposed_at - pair[0].exposed_at - Span::from_millis(5)).abs() < Span::from_micros(2)
    }));
    assert!(bench.events().is_empty());
}

#[test]
fn another_frame_rate_is_followed() {
    let mut bench = Bench::new("double-flip");
    let mut published = Vec::new();
    for frame in 0..400i64 {
        published.extend(bench.objects(ms(5 * frame), frame as u32, &[seen("quad1", frame as u32)]));
    }
    for frame in 400..800i64 {
        let at = ms(2000 + 10 * (frame - 400));
        published.extend(bench.objects(at, frame as u32, &[seen("quad1", frame as u32)]));
    }
    assert_eq!(published.len(), 800);
    assert_eq!(bench.events(), ["frame-rhythm-changed"]);
    let newest = published.last().expect("some");
    assert!((newest.received_at - newest.exposed_at - Span::from_millis(10)).abs() < Span::from_micros(50));
}

#[test]
fn silence_is_reported_once_and_so_is_its_end() {
    let mut bench = Bench::new("double-flip");
    bench.wait(ms(1050));
    assert!(bench.events().is_empty(), "nothing is missed in the first second");
    bench.wait(ms(10_000));
    assert_eq!(bench.events(), ["vicon-silent"]);
    bench.objects(ms(10_001), 1, &[seen("quad1", 1)]);
    bench.wait(ms(10_100));
    assert_eq!(bench.events(), ["vicon-silent", "vicon-heard"]);
    bench.wait(ms(20_000));
    assert_eq!(bench.events(), ["vicon-silent", "vicon-heard", "vicon-silent"]);
}

#[test]
fn any_bytes_are_decoded_or_dropped() {
    let mut bench = Bench::new("double-flip");
    let mut state = 1u64;
    for step in 0..20_000i64 {
        let mut bytes = GOLDEN;
        for _ in 0..3 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            bytes[(state >> 33) as usize % 80] ^= (state >> 20) as u8;
        }
        let length = if step % 5 == 0 { (state >> 40) as usize % 81 } else { 80 };
        for frame in bench.bytes(ms(step), &bytes[..length]) {
            assert!(frame.exposed_at <= frame.received_at);
            assert!(
                frame.bodies.iter().all(|body| body.position_m.is_finite() && body.orientation.is_finite())
            );
        }
    }
    assert!(bench.bridge.counters().undecodable > 1000);
    assert!(bench.bridge.counters().frames > 100);
}

#[test]
fn another_device_endpoint_is_not_the_stream() {
    let mut bench = Bench::new("double-flip");
    let bytes = GOLDEN.as_slice().try_into().expect("fits");
    let foreign = DeviceBytes { port: 9, at: ms(100), bytes };
    bench.bridge.step(ms(100), Event::Input(Input::Received(foreign)), &mut bench.out);
    assert!(bench.out.is_empty());
    assert_eq!(bench.bridge.counters().foreign, 1);
}

#[test]
fn impossible_settings_are_refused() {
    let tuning = Tuning { merge_s: f64::NAN, ..Tuning::default() };
    assert!(matches!(
        ViconBridge::new(&arena("fleet"), tuning, start()),
        Err(ConfigError::OutOfRange { .. })
    ));
    let mut two_latencies = arena("fleet");
    two_latencies.fleet[1].vehicle.links.mocap_latency_s = 0.02;
    let refused = ViconBridge::new(&two_latencies, Tuning::default(), start());
    assert!(matches!(refused, Err(ConfigError::Contradiction { .. })));
    let mut long_name = arena("fleet");
    long_name.fleet[0].vehicle.subject = "a name of more than 24 bytes".to_owned();
    let refused = ViconBridge::new(&long_name, Tuning::default(), start());
    assert!(matches!(refused, Err(ConfigError::Malformed { .. })));
}

#[test]
fn rotations_are_of_unit_length() {
    let mut bench = Bench::new("double-flip");
    for frame in 1..220 {
        let angle = f64::from(frame) * 0.1 - 10.0;
        let object = Object { rotation_rad: [angle, 0.5 * angle, -0.7 * angle], ..seen("quad1", frame) };
        let frames = bench.objects(ms(5 * i64::from(frame)), frame, &[object]);
        let Rotation::<Body, World> { w, x, y, z, .. } = frames[0].bodies[0].orientation;
        assert!((w * w + x * x + y * y + z * z - 1.0).abs() < 1e-12);
    }
}
