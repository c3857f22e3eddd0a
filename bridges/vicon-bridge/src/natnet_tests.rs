//! The core before an OptiTrack server, stepped directly.

use std::path::Path;

use device::natnet::{
    FLAG_MODELS_CHANGED, FrameHead, PARAM_TRACKED, Request, RigidBody, RigidBodyName, ServerInfo, Timing,
    UpAxis, Version, encode_frame, encode_model_definition,
};
use quantity::{Rotation, Vector, World};
use service_core::Seed;

use super::*;

const CLOCK_HZ: u64 = 10_000_000;

fn ms(milliseconds: i64) -> Time {
    Time::ZERO + Span::from_millis(milliseconds)
}

/// A bridge of two vehicles, and the server's side of the cable.
struct Bench {
    bridge: ViconBridge,
    out: Outbox<Output>,
    version: Version,
    asked: Vec<(Time, Request)>,
    frames: Vec<MocapFrame>,
}

impl Bench {
    fn new() -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let mut arena = Arena::load(&folder, "fleet").expect("the repository's own settings load");
        arena.network.devices.motion_capture.protocol = MotionCaptureProtocol::Natnet;
        let start = Start { at: ms(0), seed: Seed(1), incarnation: 1 };
        let bridge = ViconBridge::new(&arena, Tuning::default(), start).expect("default tuning");
        let (out, version) = (Outbox::default(), Version::V4_1);
        Self { bridge, out, version, asked: Vec::new(), frames: Vec::new() }
    }

    fn sort(&mut self) {
        for message in self.out.take_messages() {
            match message {
                Output::Frame(frame) => self.frames.push(frame),
                Output::Ask(bytes) => {
                    assert_eq!(bytes.port, Ports::MOTION_CAPTURE);
                    self.asked.push((bytes.at, Request::decode(&bytes.bytes).expect("a request")));
                }
            }
        }
    }

    fn wait(&mut self, until: Time) {
        while let Some(deadline) = self.bridge.deadline().filter(|deadline| *deadline <= until) {
            self.bridge.step(deadline, Event::Deadline, &mut self.out);
            self.sort();
        }
    }

    fn bytes(&mut self, at: Time, bytes: &[u8]) {
        self.wait(at - Span::from_nanos(1));
        let datagram =
            DeviceBytes { port: Ports::MOTION_CAPTURE, at, bytes: bytes.try_into().expect("fits") };
        self.bridge.step(at, Event::Input(Input::Received(datagram)), &mut self.out);
        self.sort();
    }

    fn info(&mut self, at: Time, natnet_version: [u8; 4]) {
        let info = ServerInfo {
            name: b"Motive",
            program_version: [3, 1, 0, 0],
            natnet_version,
            clock_hz: CLOCK_HZ,
            data_port: 1511,
            multicast: false,
            group: [0; 4],
        };
        let mut bytes = [0; 512];
        let length = info.encode(&mut bytes).expect("fits");
        self.bytes(at, &bytes[..length]);
    }

    fn models(&mut self, at: Time, names: &[(i32, &str)]) {
        let bodies: Vec<_> =
            names.iter().map(|(id, name)| RigidBodyName { id: *id, name: name.as_bytes() }).collect();
        let mut bytes = [0; 1024];
        let length = encode_model_definition(self.version, &bodies, &mut bytes).expect("fits");
        self.bytes(at, &bytes[..length]);
    }

    /// A frame that left the server `latency` after its exposure.
    fn frame(&mut self, at: Time, number: u32, flags: u16, latency: Span, bodies: &[RigidBody]) {
        let ticks = |at: Time| 77_000_000 + (at.as_nanos() / 100).cast_unsigned();
        let timing = Timing {
            exposed_ticks: ticks(at - latency),
            received_ticks: ticks(at - latency) + 10,
            transmitted_ticks: ticks(at),
            ..Timing::default()
        };
        let mut bytes = [0; 1024];
        let head = FrameHead { number, timing, flags };
        let length = encode_frame(self.version, &head, bodies, &mut bytes).expect("fits");
        self.bytes(at, &bytes[..length]);
    }

    fn known() -> Self {
        let mut bench = Self::new();
        bench.wait(ms(0));
        bench.info(ms(1), [4, 1, 0, 0]);
        bench.models(ms(2), &[(31, "quad2"), (32, "quad1"), (33, "a wand")]);
        bench
    }

    fn events(&self) -> Vec<&str> {
        self.out.events().iter().map(|event| event.name.as_str()).collect()
    }
}

fn body(id: i32, number: u32, tracked: bool) -> RigidBody {
    let position_m = UpAxis::Y.streamed_position(Vector::new(1.0, -2.0, 3.0 + 0.001 * f64::from(number)));
    let orientation_xyzw = UpAxis::Y.streamed_orientation(Rotation::from_yaw_pitch_roll(0.5, 0.1, -0.2));
    let params = if tracked { PARAM_TRACKED } else { 0 };
    RigidBody { id, position_m, orientation_xyzw, marker_error_m: 0.0003, params }
}

#[test]
fn questions_are_asked_until_they_are_answered() {
    let mut bench = Bench::new();
    bench.wait(ms(1200));
    let connect = Request::Connect { natnet_version: None };
    assert_eq!(bench.asked, [(ms(0), connect), (ms(500), connect), (ms(1000), connect)]);
    bench.asked.clear();
    bench.info(ms(1300), [4, 1, 0, 0]);
    bench.wait(ms(1900));
    let models = Request::ModelDefinition;
    assert_eq!(bench.asked, [(ms(1300), models), (ms(1800), models)]);
    bench.asked.clear();
    bench.models(ms(2000), &[(1, "quad1")]);
    for number in 0..600 {
        bench.frame(
            ms(2005 + 5 * i64::from(number)),
            number,
            0,
            Span::from_millis(7),
            &[body(1, number, true)],
        );
    }
    let keep_alive = Request::KeepAlive;
    assert_eq!(bench.asked, [(ms(3000), keep_alive), (ms(4000), keep_alive), (ms(5000), keep_alive)]);
    assert!(bench.events().contains(&"motion-capture-server"));
}

#[test]
fn a_server_that_falls_silent_is_asked_anew() {
    let mut bench = Bench::known();
    bench.frame(ms(10), 1, 0, Span::from_millis(7), &[body(31, 1, true)]);
    bench.asked.clear();
    bench.wait(ms(4000));
    let last = bench.asked.last().expect("it asks").1;
    assert_eq!(last, Request::Connect { natnet_version: None });
    // The server is back: what it tracks is asked for even where it says the same of itself as before.
    bench.asked.clear();
    bench.info(ms(4001), [4, 1, 0, 0]);
    assert_eq!(bench.asked, [(ms(4001), Request::ModelDefinition)]);
}

#[test]
fn bodies_become_vehicles_by_their_names_and_in_the_halls_axes() {
    let mut bench = Bench::known();
    bench.frame(
        ms(10),
        7,
        0,
        Span::from_millis(7),
        &[body(32, 7, true), body(31, 7, false), body(33, 7, true), body(99, 7, true)],
    );
    bench.wait(ms(20));
    let frame = &bench.frames[0];
    assert_eq!(frame.bodies.len(), 1, "the other vehicle is not tracked, the rest are none");
    let seen = &frame.bodies[0];
    assert_eq!((seen.vehicle, frame.frame), (1, 7));
    assert!((seen.position_m - Vector::<World>::new(1.0, -2.0, 3.007)).norm() < 1e-6);
    assert!(seen.orientation.angle_to(Rotation::from_yaw_pitch_roll(0.5, 0.1, -0.2)) < 1e-6);
    assert_eq!(bench.bridge.counters().untracked, 1);
    assert_eq!(bench.events().iter().filter(|name| **name == "subject-unknown").count(), 1);
}

#[test]
fn the_exposure_is_the_servers_stamp_however_long_it_worked() {
    let mut bench = Bench::known();
    // Exposed every 5 ms on the dot; the server takes 4 to 24 ms.
    for number in 0..400 {
        let exposed = ms(100 + 5 * i64::from(number));
        let latency = Span::from_micros(4_000 + 37 * i64::from(number % 11) * 49);
        bench.frame(exposed + latency, number, 0, latency, &[body(31, number, true), body(32, number, true)]);
    }
    let late = bench.frames.iter().skip(100);
    for frame in late {
        let exposed = ms(100 + 5 * frame.frame as i64);
        let off = frame.exposed_at - exposed;
        assert!(off.as_nanos().abs() < 1_000, "frame {} is off by {off}", frame.frame);
    }
    assert!(bench.frames.len() > 250, "{}", bench.frames.len());
}

#[test]
fn frames_before_the_servers_word_are_counted_and_not_guessed_at() {
    let mut bench = Bench::new();
    bench.frame(ms(50), 1, 0, Span::from_millis(7), &[body(31, 1, true)]);
    assert_eq!((bench.bridge.counters().too_early, bench.frames.len()), (1, 0));
    bench.bytes(ms(51), b"\x07");
    bench.bytes(ms(52), b"");
    assert_eq!(bench.bridge.counters().undecodable, 2);
}

#[test]
fn changed_models_are_asked_for_and_the_old_names_hold_meanwhile() {
    let mut bench = Bench::known();
    bench.asked.clear();
    bench.frame(ms(10), 1, FLAG_MODELS_CHANGED, Span::from_millis(7), &[body(32, 1, true)]);
    assert_eq!(bench.asked, [(ms(10), Request::ModelDefinition)]);
    bench.wait(ms(14));
    assert_eq!(bench.frames[0].bodies.len(), 1);
    bench.models(ms(15), &[(32, "quad3")]);
    bench.frame(ms(20), 2, 0, Span::from_millis(7), &[body(32, 2, true)]);
    bench.wait(ms(30));
    assert_eq!(bench.frames[1].bodies[0].vehicle, 3);
}

#[test]
fn a_server_of_a_later_version_is_asked_for_the_last_one_known() {
    let mut bench = Bench::new();
    bench.wait(ms(0));
    bench.info(ms(1), [4, 3, 0, 0]);
    let wanted = Request::connect(Version::V4_1);
    assert_eq!(bench.asked.last(), Some(&(ms(1), wanted)));
    bench.info(ms(2), [4, 3, 0, 0]);
    assert_eq!(bench.asked.last(), Some(&(ms(2), Request::ModelDefinition)));
    bench.models(ms(3), &[(32, "quad1")]);
    bench.frame(ms(10), 1, 0, Span::from_millis(7), &[body(32, 1, true)]);
    bench.wait(ms(20));
    assert_eq!(bench.frames.len(), 1);
}
