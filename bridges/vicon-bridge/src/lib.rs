//! Motion-capture bytes in, frames of poses out.
//!
//! ```text
//!   cable      UDP datagrams of the Tracker object stream: u32 frame number, objects in mm and Euler angles
//!     │  vicon/rx (DeviceBytes, stamped with the kernel's arrival time)
//!     ▼
//!   decode     device::vicon; anything else is counted and dropped
//!   number     frames:   u32 -> u64 that never falls; late numbers dropped, a vendor's restart found
//!   clock      clock:    frame number -> exposure, by the fastest arrivals less links.mocap_latency_s
//!   names      subjects: subject name -> vehicle; strangers reported once each
//!   judge      poses:    not finite, zero, repeated, absurd -> not seen; the rest in metres and quaternions
//!   merge      frames:   datagrams of one number -> one frame
//!     │  mocap/frame (MocapFrame)
//!     ▼
//!   estimator, flip-manager
//! ```
//!
//! A frame goes out as soon as it has spoken of every vehicle that was reported lately; else with the first
//! datagram of the next frame, or two milliseconds after its own first. A vehicle the cameras do not see is
//! left out of the frame; a frame without any is still sent, since it says that the cameras work.

mod clock;
mod frames;
mod poses;
mod reports;
mod subjects;
mod tuning;

use device::vicon::{Datagram, Object};
use quantity::{Span, Time};
use schemas::{DeviceBytes, MocapBody, MocapFrame, Severity, topics};
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError, Ports};

use clock::{FrameClock, Rhythm};
use frames::{FrameCounter, OpenFrame, Sighting};
use poses::{PoseGuard, PoseLimits, Refusal};
use reports::Reports;
use subjects::{Subjects, Whose};

pub use reports::Counters;
pub use tuning::Tuning;

service_core::inputs! {
    /// What the bridge hears.
    pub enum Input {
        /// A datagram of the object stream.
        Received(DeviceBytes) = topics::VICON_RX,
    }
}

service_core::outputs! {
    /// What the bridge says.
    pub enum Output {
        /// The vehicles seen at one exposure.
        Frame(MocapFrame) = topics::MOCAP_FRAME,
    }
}

/// A stream that was never heard is reported no sooner than this after the start.
const START_GRACE: Span = Span::from_secs(1);

/// The vicon bridge.
#[derive(Clone, Debug)]
pub struct ViconBridge {
    merge: Span,
    expect: Span,
    frozen: Span,
    silent: Span,
    identical_reported: u32,
    limits: PoseLimits,
    subjects: Subjects,
    tracks: Vec<Track>,
    counter: FrameCounter,
    clock: FrameClock,
    open: Option<OpenFrame>,
    stream: Stream,
    reports: Reports,
    counters: Counters,
}

/// What the cameras said of one vehicle so far.
#[derive(Clone, Debug)]
struct Track {
    guard: PoseGuard,
    reported_at: Time,
}

/// How the stream fares as a whole.
#[derive(Clone, Copy, Debug)]
struct Stream {
    heard_at: Time,
    advanced_at: Time,
    silent: bool,
    frozen: bool,
}

impl Core for ViconBridge {
    const NAME: &'static str = "vicon-bridge";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check()?;
        let subjects = Subjects::new(arena)?;
        let latency = common_latency(arena)?;
        let track = Track { guard: PoseGuard::default(), reported_at: start.at };
        let stream = Stream {
            heard_at: start.at.saturating_add(START_GRACE),
            advanced_at: start.at,
            silent: false,
            frozen: false,
        };
        Ok(Self {
            merge: Span::from_secs_f64(tuning.merge_s),
            expect: Span::from_secs_f64(tuning.expect_s),
            frozen: Span::from_secs_f64(tuning.frozen_s),
            silent: Span::from_secs_f64(tuning.silent_s),
            identical_reported: tuning.identical_poses_reported,
            limits: PoseLimits::new(&arena.hall, tuning.outside_hall_m_max, tuning.identical_poses_accepted),
            tracks: vec![track; subjects.known().len()],
            subjects,
            counter: FrameCounter::new(Span::from_secs_f64(tuning.restart_s)),
            clock: FrameClock::new(
                latency,
                Span::from_secs_f64(tuning.clock_jitter_s),
                Span::from_secs_f64(tuning.clock_break_s),
            ),
            open: None,
            stream,
            reports: Reports::new(Span::from_secs_f64(tuning.report_s)),
            counters: Counters::default(),
        })
    }

    fn deadline(&self) -> Option<Time> {
        let silent_at = (!self.stream.silent).then(|| self.stream.heard_at.saturating_add(self.silent));
        let close_at = self.open.as_ref().map(|open| open.close_at);
        [silent_at, close_at].into_iter().flatten().min()
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match event {
            Event::Input(Input::Received(datagram)) => self.receive(now, &datagram, out),
            Event::Deadline => {
                if self.open.as_ref().is_some_and(|open| now >= open.close_at) {
                    self.close(out);
                }
                self.watch_silence(now, out);
            }
        }
    }
}

impl ViconBridge {
    /// What came in since the start, and what was left out of it.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters { unknown_objects: self.subjects.unknown_objects(), ..self.counters }
    }

    fn receive(&mut self, now: Time, datagram: &DeviceBytes, out: &mut Outbox<Output>) {
        if datagram.port != Ports::VICON {
            self.counters.foreign += 1;
            return;
        }
        self.counters.datagrams += 1;
        let arrived = datagram.at.min(now);
        let decoded = match Datagram::decode(&datagram.bytes) {
            Ok(decoded) => decoded,
            Err(error) => {
                self.counters.undecodable += 1;
                self.reports.warn(now, 0, "datagram-undecodable", || error.to_string(), out);
                return;
            }
        };
        self.hear(now, out);
        match self.counter.sight(decoded.frame_number, arrived) {
            Sighting::New(frame) => self.begin(now, frame, arrived, out),
            Sighting::Restarted(frame) => {
                self.clock.restart();
                let detail = format!("frame numbers run on from {}", decoded.frame_number);
                out.event(now, Severity::Warning, 0, "vicon-restarted", &detail);
                self.begin(now, frame, arrived, out);
            }
            Sighting::Same => self.watch_freeze(now, decoded.frame_number, out),
            Sighting::Late => {
                self.counters.late += 1;
                return;
            }
        }
        let Some(mut open) = self.open.take() else {
            self.counters.late += 1;
            self.expect_next_time(now, &decoded);
            return;
        };
        open.message.received_at = open.message.received_at.max(arrived);
        for object in decoded.objects() {
            self.add(now, &mut open, &object, out);
        }
        let complete =
            self.tracks.iter().enumerate().all(|(index, track)| {
                open.reported & (1 << index) != 0 || now - track.reported_at > self.expect
            });
        self.open = Some(open);
        if complete {
            self.close(out);
        }
    }

    /// Of a datagram whose frame went out without it: the next frame shall wait for these.
    fn expect_next_time(&mut self, now: Time, datagram: &Datagram<'_>) {
        for object in datagram.objects() {
            if let Whose::Vehicle(index) = self.subjects.whose(object.name) {
                self.tracks[index].reported_at = now;
            }
        }
    }

    /// Begins a frame; the one before has had its time.
    fn begin(&mut self, now: Time, frame: u64, arrived: Time, out: &mut Outbox<Output>) {
        self.close(out);
        if self.clock.observe(frame, arrived) == Rhythm::Broken {
            self.counters.clock_breaks += 1;
            let detail = || format!("arrivals from frame {frame} on do not fit those before");
            self.reports.warn(now, 0, "frame-rhythm-changed", detail, out);
        }
        self.stream.advanced_at = now;
        if self.stream.frozen {
            self.stream.frozen = false;
            out.event(now, Severity::Info, 0, "frame-number-advances", &format!("again, with frame {frame}"));
        }
        let message = MocapFrame { frame, received_at: arrived, ..MocapFrame::default() };
        let close_at = now.saturating_add(self.merge);
        self.open = Some(OpenFrame { message, first_at: arrived, close_at, reported: 0 });
    }

    /// Publishes the open frame, if there is one.
    fn close(&mut self, out: &mut Outbox<Output>) {
        let Some(OpenFrame { mut message, first_at, .. }) = self.open.take() else {
            return;
        };
        message.exposed_at = self.clock.exposed_at(message.frame, first_at);
        self.counters.frames += 1;
        out.publish(message);
    }

    /// Adds an object to the open frame, if it is a vehicle and its pose may be believed.
    fn add(&mut self, now: Time, open: &mut OpenFrame, object: &Object<'_>, out: &mut Outbox<Output>) {
        let index = match self.subjects.whose(object.name) {
            Whose::Vehicle(index) => index,
            Whose::Stranger => return,
            Whose::NewStranger => {
                let detail =
                    format!("{:?} is no vehicle of this arena", String::from_utf8_lossy(object.name));
                out.event(now, Severity::Warning, 0, "subject-unknown", &detail);
                return;
            }
        };
        if open.reported & (1 << index) != 0 {
            self.counters.duplicate_objects += 1;
            return;
        }
        open.reported |= 1 << index;
        let (subject, track) = (&self.subjects.known()[index], &mut self.tracks[index]);
        track.reported_at = now;
        match track.guard.judge(object, open.first_at, &self.limits) {
            Ok(pose) => {
                let (position_m, orientation) = (pose.position_m, pose.orientation);
                let body = MocapBody { position_m, orientation, ..subject.body.clone() };
                // A fleet has at most as many vehicles as a frame has places.
                let _ = open.message.bodies.push(body);
            }
            Err(refusal) => {
                let vehicle = subject.body.vehicle;
                self.refuse(now, vehicle, refusal, object, out);
            }
        }
    }

    fn refuse(
        &mut self,
        now: Time,
        vehicle: u8,
        refusal: Refusal,
        object: &Object<'_>,
        out: &mut Outbox<Output>,
    ) {
        let (name, count) = match refusal {
            Refusal::NotFinite => ("pose-not-finite", &mut self.counters.not_finite),
            Refusal::Zero => ("pose-zero", &mut self.counters.zero),
            Refusal::Repeated(_) => ("pose-frozen", &mut self.counters.repeated),
            Refusal::OutsideHall => ("pose-outside-hall", &mut self.counters.absurd),
            Refusal::UnitSlip => ("pose-unit-slip", &mut self.counters.absurd),
            Refusal::Angles => ("pose-angles-absurd", &mut self.counters.absurd),
        };
        *count += 1;
        // A single repeat is an everyday occlusion; a run of them is something stuck.
        if matches!(refusal, Refusal::Repeated(repeats) if repeats != self.identical_reported) {
            return;
        }
        let detail = || {
            let ([x, y, z], [a, b, c]) = (object.translation_mm, object.rotation_rad);
            format!("{x:.1} {y:.1} {z:.1} mm, {a:.4} {b:.4} {c:.4} rad")
        };
        self.reports.warn(now, vehicle, name, detail, out);
    }

    fn hear(&mut self, now: Time, out: &mut Outbox<Output>) {
        self.stream.heard_at = now.max(self.stream.heard_at);
        if self.stream.silent {
            self.stream.silent = false;
            self.stream.heard_at = now;
            out.event(now, Severity::Info, 0, "vicon-heard", "the object stream is back");
        }
    }

    fn watch_silence(&mut self, now: Time, out: &mut Outbox<Output>) {
        if !self.stream.silent && now >= self.stream.heard_at.saturating_add(self.silent) {
            self.stream.silent = true;
            let detail = format!("no datagram of the object stream for {}", self.silent);
            out.event(now, Severity::Warning, 0, "vicon-silent", &detail);
        }
    }

    fn watch_freeze(&mut self, now: Time, number: u32, out: &mut Outbox<Output>) {
        if !self.stream.frozen && now - self.stream.advanced_at >= self.frozen {
            self.stream.frozen = true;
            let detail = format!("datagrams keep coming, all of frame {number}");
            out.event(now, Severity::Warning, 0, "frame-number-frozen", &detail);
        }
    }
}

/// The cameras' latency, which is one for all vehicles.
fn common_latency(arena: &Arena) -> Result<Span, ConfigError> {
    let mut members = arena.fleet.iter();
    let Some(first) = members.next() else {
        return Ok(Span::ZERO);
    };
    let latency_s = first.vehicle.links.mocap_latency_s;
    match members.find(|member| member.vehicle.links.mocap_latency_s != latency_s) {
        None => Ok(Span::from_secs_f64(latency_s)),
        Some(other) => Err(ConfigError::Contradiction {
            file: "vehicles".to_owned(),
            key: format!("{}.links.mocap_latency_s", other.part.file),
            value: other.vehicle.links.mocap_latency_s.to_string(),
            other_key: format!("{}.links.mocap_latency_s", first.part.file),
            other_value: latency_s.to_string(),
            reason: "one set of cameras sees all vehicles".to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests;
