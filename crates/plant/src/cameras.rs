//! The motion-capture system: 200 exposures a second, noise, latency, and the vendor's datagrams, Vicon's here
//! and OptiTrack's in `natnet_server`.

use device::vicon::{self, NAME_BYTES, Object};
use quantity::{Body, Rotation, Span, Time, Vector};
use settings::{CameraSettings, FleetVehicle, MotionCapture, MotionCaptureProtocol};

use crate::faults::{Fault, Occlusion, Schedule};
use crate::natnet_server::Server;
use crate::output::{Device, Outputs};
use crate::random::{Purpose, Stream};
use crate::rigid_body::Motion;

/// Objects in one datagram of at most 1024 bytes.
pub const OBJECTS_PER_DATAGRAM: usize = 13;

const DATAGRAM_BYTES: usize = 1024;

/// Position and rotation as Vicon writes them: millimetres, angles.
pub(crate) type Shown = ([f64; 3], [f64; 3]);

/// One vehicle as the cameras see it.
#[derive(Clone, Debug)]
struct Subject {
    vehicle: u8,
    name: Vec<u8>,
    settings: CameraSettings,
    stream: Stream,
    last: Shown,
}

/// The motion-capture system.
#[derive(Clone, Debug)]
pub struct Cameras {
    /// Rate, latency and jitter are the system's: those of the first vehicle's settings.
    settings: CameraSettings,
    subjects: Vec<Subject>,
    /// Of a system that is OptiTrack's.
    server: Option<Server>,
    stream: Stream,
    first_at: Time,
    exposures: u64,
    frame_number: u32,
    told_number: u32,
    last_due: Time,
    visible: Vec<(usize, Shown)>,
}

impl Cameras {
    /// Cameras that first expose within one period after `start`; their frame counter has run for a while.
    #[must_use]
    pub fn new(fleet: &[FleetVehicle], system: &MotionCapture, seed: u64, start: Time) -> Option<Self> {
        let settings = fleet.first()?.vehicle.plant.camera.clone();
        let mut stream = Stream::new(seed, Purpose::Cameras, 0);
        let subject = |member: &FleetVehicle| {
            let name = member.vehicle.subject.as_bytes();
            Subject {
                vehicle: member.vehicle.id,
                name: name[..name.len().min(NAME_BYTES)].to_vec(),
                settings: member.vehicle.plant.camera.clone(),
                stream: Stream::new(seed, Purpose::Pose, member.vehicle.id),
                last: ([0.0; 3], [0.0; 3]),
            }
        };
        let first_at = start + Span::from_secs_f64(stream.uniform() / settings.rate_hz);
        let frame_number = stream.below(1_000_000);
        let subjects: Vec<Subject> = fleet.iter().map(subject).collect();
        let names = || subjects.iter().map(|subject| subject.name.clone()).collect();
        Some(Self {
            server: match system.protocol {
                MotionCaptureProtocol::Vicon => None,
                MotionCaptureProtocol::Natnet => Some(Server::new(&system.natnet, names(), &mut stream)),
            },
            subjects,
            settings,
            stream,
            first_at,
            exposures: 0,
            frame_number,
            told_number: frame_number,
            last_due: start,
            visible: Vec::with_capacity(fleet.len()),
        })
    }

    /// When the cameras expose next.
    #[must_use]
    pub fn next_at(&self) -> Time {
        self.first_at + Span::from_secs_f64(self.exposures as f64 / self.settings.rate_hz)
    }

    /// A datagram for the system.
    pub(crate) fn receive(&mut self, now: Time, bytes: &[u8], outputs: &mut Outputs) {
        if let Some(server) = &mut self.server {
            server.receive(now, bytes, outputs);
        }
    }

    /// Takes the exposure that is due; `motion` gives each vehicle's true motion at that instant, by fleet
    /// index.
    pub(crate) fn expose(
        &mut self,
        motion: impl Fn(usize) -> Motion,
        faults: &Schedule,
        outputs: &mut Outputs,
    ) {
        let at = self.next_at();
        let index = self.exposures;
        self.exposures += 1;
        let (mut silent, mut frozen, mut late, mut offset) = (false, false, Span::ZERO, 0);
        for fault in faults.at(at) {
            match fault {
                Fault::CamerasSilent => silent = true,
                Fault::FrozenFrameNumber => frozen = true,
                Fault::LateFrames { delay } => late = delay,
                Fault::RenumberedFrames { offset: by } => offset = by,
                Fault::SlowFrames { one_of } if !index.is_multiple_of(u64::from(one_of.max(1))) => return,
                _ => {}
            }
        }
        self.frame_number = self.frame_number.wrapping_add(1);
        if !frozen {
            self.told_number = self.frame_number.wrapping_add(offset);
        }
        let mut visible = core::mem::take(&mut self.visible);
        visible.clear();
        for (index, subject) in self.subjects.iter_mut().enumerate() {
            let shown = subject.see(&motion(index), at, faults);
            visible.extend(shown.map(|shown| (index, shown)));
        }
        let delay_s = self.settings.latency_s + self.stream.exponential(self.settings.jitter_s);
        if !silent {
            // Datagrams keep their order on the cable, but what a fault holds back holds back nothing else.
            let mut due = at + Span::from_secs_f64(delay_s);
            if late == Span::ZERO {
                due = due.max(self.last_due);
                self.last_due = due;
            }
            match self.server.take() {
                None => self.send(due + late, at, &visible, faults, outputs),
                Some(mut server) => {
                    let shown = self.bodies(at, &visible, faults);
                    server.stream(self.told_number, at, due + late, shown, outputs);
                    self.server = Some(server);
                }
            }
        }
        self.visible = visible;
    }

    fn send(
        &self,
        due: Time,
        at: Time,
        visible: &[(usize, Shown)],
        faults: &Schedule,
        outputs: &mut Outputs,
    ) {
        let mut bytes = [0; DATAGRAM_BYTES];
        let nothing = Object { name: &[], translation_mm: [0.0; 3], rotation_rad: [0.0; 3] };
        let mut objects = [nothing; OBJECTS_PER_DATAGRAM];
        let mut rest = visible;
        // A frame without objects is sent too.
        loop {
            let (chunk, tail) = rest.split_at(rest.len().min(OBJECTS_PER_DATAGRAM));
            rest = tail;
            for (object, (index, (translation_mm, rotation_rad))) in objects.iter_mut().zip(chunk) {
                let (translation_mm, rotation_rad) = (*translation_mm, *rotation_rad);
                *object = Object { name: self.name_of(*index, at, faults), translation_mm, rotation_rad };
            }
            // Names are cut to their field and the buffer holds a full datagram, so this cannot fail.
            if let Ok(length) = vicon::encode(self.told_number, &objects[..chunk.len()], &mut bytes) {
                outputs.push(Device::MotionCapture, due, &bytes[..length]);
            }
            if rest.is_empty() {
                return;
            }
        }
    }

    /// Every subject as OptiTrack shows it, and whether it was seen: what was not is shown where it was last.
    fn bodies<'a>(
        &'a self,
        at: Time,
        visible: &'a [(usize, Shown)],
        faults: &'a Schedule,
    ) -> impl Iterator<Item = (Shown, bool)> + 'a {
        self.subjects.iter().map(move |subject| {
            let seen = visible.iter().find(|(index, _)| self.name_of(*index, at, faults) == subject.name);
            seen.map_or((subject.last, false), |(_, shown)| (*shown, true))
        })
    }

    /// The name a subject is shown under.
    fn name_of(&self, index: usize, at: Time, faults: &Schedule) -> &[u8] {
        let mut seen_as = self.subjects[index].vehicle;
        for fault in faults.at(at) {
            if let Fault::SwappedMarkers { vehicle, other } = fault {
                if seen_as == vehicle {
                    seen_as = other;
                } else if seen_as == other {
                    seen_as = vehicle;
                }
            }
        }
        let subject = self.subjects.iter().find(|subject| subject.vehicle == seen_as);
        &subject.unwrap_or(&self.subjects[index]).name
    }
}

impl Subject {
    /// The object as it is shown; `None` where it is not.
    fn see(&mut self, motion: &Motion, at: Time, faults: &Schedule) -> Option<Shown> {
        let settings = &self.settings;
        let mut draw = || [self.stream.gaussian(), self.stream.gaussian(), self.stream.gaussian()];
        let ([x, y, z], [rx, ry, rz]) = (draw(), draw());
        let position_m = motion.position_m + Vector::new(x, y, z) * settings.position_noise_m;
        let turn_rad: Vector<Body> = Vector::new(rx, ry, rz) * settings.attitude_noise_rad;
        let mut orientation = motion.orientation.turned(turn_rad);
        let mut absent = self.stream.chance(settings.dropout_ratio);
        let mut occlusion = None;
        let (mut scale, mut poison) = (1_000.0, None);
        for fault in faults.at(at) {
            match fault {
                Fault::Occluded { vehicle, shown } if vehicle == self.vehicle => occlusion = Some(shown),
                Fault::FlippedPose { vehicle, turn_rad } if vehicle == self.vehicle => {
                    orientation = orientation * Rotation::<Body, Body>::from_rotation_vector(turn_rad);
                }
                Fault::PoseNotANumber { vehicle } if vehicle == self.vehicle => poison = Some(f64::NAN),
                Fault::PoseInfinite { vehicle } if vehicle == self.vehicle => poison = Some(f64::INFINITY),
                Fault::PoseInMetres { vehicle } if vehicle == self.vehicle => scale = 1.0,
                _ => {}
            }
        }
        match occlusion {
            Some(Occlusion::Absent) => absent = true,
            Some(Occlusion::ZeroPose) => return Some(([0.0; 3], [0.0; 3])),
            Some(Occlusion::FrozenPose) => return Some(self.last),
            None => {}
        }
        if absent {
            return None;
        }
        let translation_mm = [position_m.x * scale, position_m.y * scale, position_m.z * scale];
        self.last = (translation_mm, vicon::rotation_to_euler(orientation));
        match poison {
            Some(poison) => Some(([poison, translation_mm[1], translation_mm[2]], self.last.1)),
            None => Some(self.last),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::fleet;
    use device::vicon::{Datagram, euler_to_rotation};
    use quantity::{World, math};

    type Seen = (Vec<u8>, Vector<World>, Option<Rotation<Body, World>>, Shown);

    struct Bench {
        cameras: Cameras,
        outputs: Outputs,
        faults: Schedule,
    }

    struct Datagrams {
        at: Time,
        frame_number: u32,
        objects: Vec<Seen>,
    }

    fn motion(index: usize) -> Motion {
        Motion {
            position_m: Vector::new(1.0 + index as f64, -2.0, 3.5),
            orientation: Rotation::from_yaw_pitch_roll(0.4, 1.2, -0.3),
            ..Motion::default()
        }
    }

    impl Bench {
        fn new(vehicles: usize) -> Self {
            let mut members = fleet().fleet;
            while members.len() < vehicles {
                let mut next = members[0].clone();
                next.vehicle.id = members.len() as u8 + 1;
                next.vehicle.subject = format!("quad{}", next.vehicle.id);
                members.push(next);
            }
            members.truncate(vehicles);
            for member in &mut members {
                member.vehicle.plant.camera.dropout_ratio = 0.0;
            }
            let cameras =
                Cameras::new(&members, &fleet().network.devices.motion_capture, 4, Time::ZERO).unwrap();
            Self { cameras, outputs: Outputs::new(), faults: Schedule::default() }
        }

        fn frames(&mut self, count: usize) -> Vec<Datagrams> {
            for _ in 0..count {
                self.cameras.expose(motion, &self.faults, &mut self.outputs);
            }
            let mut sent = Vec::new();
            self.outputs.send(Time::FAR_FUTURE, &mut |output| {
                let datagram = Datagram::decode(output.bytes).unwrap();
                let objects = datagram.objects().map(|object| {
                    let [x, y, z] = object.translation_mm;
                    let position = Vector::new(x, y, z) * 1e-3;
                    let shown = (object.translation_mm, object.rotation_rad);
                    (object.name.to_vec(), position, euler_to_rotation(object.rotation_rad), shown)
                });
                let objects = objects.collect();
                sent.push(Datagrams { at: output.at, frame_number: datagram.frame_number, objects });
            });
            sent
        }
    }

    #[test]
    fn poses_come_back_out_of_the_bytes_within_their_noise() {
        let mut bench = Bench::new(3);
        let frames = bench.frames(4_000);
        assert_eq!(frames.len(), 4_000);
        let (mut position, mut attitude) = (0.0, 0.0);
        for frame in &frames {
            for (index, (name, place, rotation, _)) in frame.objects.iter().enumerate() {
                assert_eq!(*name, format!("quad{}", index + 1).into_bytes());
                let truth = motion(index);
                let off = *place - truth.position_m;
                position += off.dot(off) / 3.0;
                let angle = rotation.unwrap().angle_to(truth.orientation);
                attitude += angle * angle / 3.0;
            }
        }
        assert!((math::sqrt(position / 12_000.0) / 0.0005 - 1.0).abs() < 0.03);
        assert!((math::sqrt(attitude / 12_000.0) / 0.003 - 1.0).abs() < 0.03);
    }

    #[test]
    fn frames_are_numbered_and_leave_in_order_after_the_latency() {
        let mut bench = Bench::new(1);
        let first = bench.cameras.next_at();
        let frames = bench.frames(2_000);
        for (k, frame) in frames.iter().enumerate() {
            let exposed = first + Span::from_micros(5_000) * k as i64;
            let delay = frame.at - exposed;
            assert!(delay >= Span::from_millis(10) && delay < Span::from_millis(13));
            assert_eq!(frame.frame_number, frames[0].frame_number + k as u32);
        }
        assert!(frames.is_sorted_by_key(|frame| frame.at));
        let delays =
            frames.iter().enumerate().map(|(k, frame)| frame.at - first - Span::from_millis(5) * k as i64);
        let mean = delays.map(Span::as_secs_f64).sum::<f64>() / 2_000.0;
        assert!((mean - 0.0102).abs() < 0.000_03);
    }

    #[test]
    fn more_than_thirteen_objects_take_several_datagrams_of_one_number() {
        let mut bench = Bench::new(14);
        let frames = bench.frames(2);
        let sizes: Vec<usize> = frames.iter().map(|frame| frame.objects.len()).collect();
        assert_eq!(sizes, [13, 1, 13, 1]);
        assert_eq!(frames[0].frame_number, frames[1].frame_number);
        assert_ne!(frames[1].frame_number, frames[2].frame_number);
    }

    #[test]
    fn dropouts_have_their_rate() {
        let mut bench = Bench::new(1);
        bench.cameras.subjects[0].settings.dropout_ratio = 0.1;
        let frames = bench.frames(10_000);
        let missing = frames.iter().filter(|frame| frame.objects.is_empty()).count();
        assert!(missing.abs_diff(1_000) < 120, "{missing}");
    }

    #[test]
    fn each_fault_shows_as_it_says_and_passes() {
        let mut bench = Bench::new(2);
        let mut during = |fault: Fault| {
            let begin = bench.cameras.next_at();
            bench.faults.add(fault, begin, begin + Span::from_millis(15));
            let frames = bench.frames(4);
            (frames, bench.frames(1))
        };
        let (frames, after) = during(Fault::Occluded { vehicle: 1, shown: Occlusion::Absent });
        assert!(frames[..3].iter().all(|frame| frame.objects.len() == 1 && frame.objects[0].0 == b"quad2"));
        assert_eq!(after[0].objects.len(), 2);
        let (frames, _) = during(Fault::Occluded { vehicle: 1, shown: Occlusion::ZeroPose });
        assert_eq!(frames[2].objects[0].3, ([0.0; 3], [0.0; 3]));
        let (frames, _) = during(Fault::Occluded { vehicle: 2, shown: Occlusion::FrozenPose });
        assert_eq!(frames[0].objects[1].3, frames[2].objects[1].3);
        assert_ne!(frames[2].objects[1].3, frames[3].objects[1].3);
        let (frames, _) = during(Fault::SwappedMarkers { vehicle: 1, other: 2 });
        assert_eq!(frames[0].objects[0].0, b"quad2");
        assert!((frames[0].objects[0].1.x - 1.0).abs() < 0.01);
        assert_eq!(frames[3].objects[0].0, b"quad1");
        let turn_rad = Vector::new(0.0, 0.0, core::f64::consts::PI);
        let (frames, _) = during(Fault::FlippedPose { vehicle: 1, turn_rad });
        assert!(frames[0].objects[0].2.unwrap().angle_to(motion(0).orientation) > 3.1);
        let (frames, _) = during(Fault::PoseNotANumber { vehicle: 1 });
        assert!(frames[0].objects[0].1.x.is_nan() && frames[3].objects[0].1.x.is_finite());
        let (frames, _) = during(Fault::PoseInfinite { vehicle: 1 });
        assert!(frames[0].objects[0].1.x.is_infinite());
        let (frames, _) = during(Fault::PoseInMetres { vehicle: 1 });
        assert!((frames[0].objects[0].1.z - 0.0035).abs() < 1e-4);
    }

    #[test]
    fn faults_of_the_whole_system_show_as_they_say() {
        let mut bench = Bench::new(1);
        let mut during = |fault: Fault, frames: usize| {
            let begin = bench.cameras.next_at();
            bench.faults.add(fault, begin, begin + Span::from_millis(50));
            bench.frames(frames)
        };
        let before = during(Fault::CamerasSilent, 12);
        assert_eq!(before.len(), 2);
        let frames = during(Fault::FrozenFrameNumber, 12);
        assert!(frames[..10].iter().all(|frame| frame.frame_number == before[1].frame_number));
        assert_eq!(frames[10].frame_number, before[1].frame_number + 11);
        let offset = 1_000u32.wrapping_neg();
        let frames = during(Fault::RenumberedFrames { offset }, 12);
        assert_eq!(frames[9].frame_number, before[1].frame_number + 22 - 1_000);
        assert_eq!(frames[10].frame_number, before[1].frame_number + 23);
        let frames = during(Fault::SlowFrames { one_of: 5 }, 12);
        assert_eq!(frames.len(), 4);
        assert_eq!(frames[1].frame_number, frames[0].frame_number + 1);
        let frames = during(Fault::LateFrames { delay: Span::from_millis(100) }, 12);
        // What was on time again came first.
        assert!(frames[0].frame_number > frames[2].frame_number);
        assert_eq!(frames.len(), 12);
    }
}
