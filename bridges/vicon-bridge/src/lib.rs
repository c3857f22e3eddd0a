//! Motion-capture bytes in, frames of poses out.
//!
//! ```text
//!   cable      UDP datagrams: Vicon Tracker's object stream, or OptiTrack's NatNet (the bridge asks, natnet)
//!     │  vicon/rx (DeviceBytes, stamped with the kernel's arrival time)         ▲  vicon/tx
//!     ▼                                                                         │
//!   decode     device::vicon or device::natnet; anything else is counted and dropped
//!   number     frames:   u32 -> u64 that never falls; late numbers dropped, a vendor's restart found
//!   clock      clock:    frame number -> exposure, by the fastest arrivals less the latency: that which the
//!                        server stamps, else links.mocap_latency_s
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
mod natnet;
mod poses;
mod reports;
mod sighting;
mod subjects;
mod tuning;

use device::vicon;
use quantity::{Span, Time};
use schemas::{DeviceBytes, MocapBody, MocapFrame, Severity, topics};
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError, MotionCaptureProtocol, Ports};

use clock::{FrameClock, Rhythm};
use frames::{FrameCounter, Numbering, OpenFrame};
use natnet::{Client, Heard};
use poses::{PoseGuard, PoseLimits, Refusal};
use reports::Reports;
use sighting::{Exposure, Shown, Sighting};
use subjects::{Subjects, Whose};

pub use reports::Counters;
pub use tuning::Tuning;

service_core::inputs! {
    /// What the bridge hears.
    pub enum Input {
        /// A datagram of the motion-capture system's.
        Received(DeviceBytes) = topics::VICON_RX,
    }
}

service_core::outputs! {
    /// What the bridge says.
    pub enum Output {
        /// The vehicles seen at one exposure.
        Frame(MocapFrame) = topics::MOCAP_FRAME,
        /// A question to the motion-capture system.
        Ask(DeviceBytes) = topics::VICON_TX,
    }
}

/// A stream that was never heard is reported no sooner than this after the start.
const START_GRACE: Span = Span::from_secs(1);
/// Bytes of the longest request to a motion-capture system.
const REQUEST_BYTES_MAX: usize = 512;

/// The vicon bridge.
#[derive(Clone, Debug)]
pub struct ViconBridge {
    /// Of a system that must be asked for its stream.
    client: Option<Client>,
    latency: Span,
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

/// When the first datagram of a frame came.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    at: Time,
    /// From the exposure until then: as the server stamped it, or as it is set.
    latency: Span,
    /// Had the frame taken as long as is set. The clock fits these, and takes the setting off again.
    fitted_at: Time,
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
        let capture = &arena.network.devices.motion_capture;
        Ok(Self {
            client: match capture.protocol {
                MotionCaptureProtocol::Vicon => None,
                MotionCaptureProtocol::Natnet => Some(Client::new(&capture.natnet, start.at)),
            },
            latency,
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
        let ask_at = self.client.as_ref().map(Client::due_at);
        [silent_at, close_at, ask_at].into_iter().flatten().min()
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
        self.ask(now, out);
    }
}

impl ViconBridge {
    /// What came in since the start, and what was left out of it.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters { unknown_objects: self.subjects.unknown_objects(), ..self.counters }
    }

    /// Says to the motion-capture system what is due.
    fn ask(&mut self, now: Time, out: &mut Outbox<Output>) {
        let Some(request) = self.client.as_mut().and_then(|client| client.ask(now)) else {
            return;
        };
        let mut bytes = [0; REQUEST_BYTES_MAX];
        let length = request.encode(&mut bytes).expect("the buffer holds the longest request");
        let bytes = bytes[..length].try_into().expect("a request is within the bound of device bytes");
        out.publish(DeviceBytes { port: Ports::MOTION_CAPTURE, at: now, bytes });
    }

    fn receive(&mut self, now: Time, datagram: &DeviceBytes, out: &mut Outbox<Output>) {
        if !matches!(datagram.port, Ports::MOTION_CAPTURE | Ports::MOTION_CAPTURE_GROUP) {
            self.counters.foreign += 1;
            return;
        }
        self.counters.datagrams += 1;
        let exposure = match self.decode(now, &datagram.bytes, out) {
            Ok(Some(exposure)) => exposure,
            Ok(None) => return,
            Err(reason) => {
                self.counters.undecodable += 1;
                self.reports.warn(now, 0, "datagram-undecodable", || reason, out);
                return;
            }
        };
        self.expose(now, datagram.at.min(now), &exposure, out);
    }

    /// The poses in a datagram, if it has any.
    fn decode(
        &mut self,
        now: Time,
        bytes: &[u8],
        out: &mut Outbox<Output>,
    ) -> Result<Option<Exposure>, String> {
        let Some(client) = &mut self.client else {
            let datagram = vicon::Datagram::decode(bytes).map_err(|error| error.to_string())?;
            let sightings = datagram.objects().map(|object| Sighting::from(&object)).collect();
            return Ok(Some(Exposure { number: datagram.frame_number, latency: None, sightings }));
        };
        let said = |out: &mut Outbox<Output>, name, detail: &str| {
            out.event(now, Severity::Info, 0, name, detail);
        };
        match client.hear(now, bytes).map_err(|error| error.to_string())? {
            Heard::Exposure(exposure) => return Ok(Some(exposure)),
            Heard::Server(server) => {
                // Another server counts otherwise.
                self.clock.restart();
                said(out, "motion-capture-server", &server);
            }
            Heard::Models(count) => said(out, "motion-capture-models", &format!("{count} rigid bodies")),
            Heard::Nothing => {}
            Heard::TooEarly => self.counters.too_early += 1,
        }
        Ok(None)
    }

    /// Takes in what a datagram that arrived at `arrived` shows.
    fn expose(&mut self, now: Time, arrived: Time, exposure: &Exposure, out: &mut Outbox<Output>) {
        self.hear(now, out);
        let latency = exposure.latency.unwrap_or(self.latency);
        let arrival =
            Arrival { at: arrived, latency, fitted_at: (arrived - latency).saturating_add(self.latency) };
        match self.counter.sight(exposure.number, arrived) {
            Numbering::New(frame) => self.begin(now, frame, arrival, out),
            Numbering::Restarted(frame) => {
                self.clock.restart();
                let detail = format!("frame numbers run on from {}", exposure.number);
                out.event(now, Severity::Warning, 0, "vicon-restarted", &detail);
                self.begin(now, frame, arrival, out);
            }
            Numbering::Same => self.watch_freeze(now, exposure.number, out),
            Numbering::Late => {
                self.counters.late += 1;
                return;
            }
        }
        let Some(mut open) = self.open.take() else {
            self.counters.late += 1;
            self.expect_next_time(now, exposure);
            return;
        };
        open.message.received_at = open.message.received_at.max(arrived);
        for sighting in &exposure.sightings {
            self.add(now, &mut open, sighting, out);
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
    fn expect_next_time(&mut self, now: Time, exposure: &Exposure) {
        for sighting in &exposure.sightings {
            if let Whose::Vehicle(index) = self.subjects.whose(&sighting.name) {
                self.tracks[index].reported_at = now;
            }
        }
    }

    /// Begins a frame; the one before has had its time.
    fn begin(&mut self, now: Time, frame: u64, arrival: Arrival, out: &mut Outbox<Output>) {
        self.close(out);
        if self.clock.observe(frame, arrival.fitted_at) == Rhythm::Broken {
            self.counters.clock_breaks += 1;
            let detail = || format!("arrivals from frame {frame} on do not fit those before");
            self.reports.warn(now, 0, "frame-rhythm-changed", detail, out);
        }
        self.stream.advanced_at = now;
        if self.stream.frozen {
            self.stream.frozen = false;
            out.event(now, Severity::Info, 0, "frame-number-advances", &format!("again, with frame {frame}"));
        }
        let (received_at, latency_s) = (arrival.at, arrival.latency.as_secs_f64());
        let message = MocapFrame { frame, received_at, latency_s, ..MocapFrame::default() };
        let close_at = now.saturating_add(self.merge);
        self.open = Some(OpenFrame { message, first_at: arrival.fitted_at, close_at, reported: 0 });
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
    fn add(&mut self, now: Time, open: &mut OpenFrame, sighting: &Sighting, out: &mut Outbox<Output>) {
        let index = match self.subjects.whose(&sighting.name) {
            Whose::Vehicle(index) => index,
            Whose::Stranger => return,
            Whose::NewStranger => {
                let detail =
                    format!("{:?} is no vehicle of this arena", String::from_utf8_lossy(&sighting.name));
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
        let Some(shown) = &sighting.shown else {
            self.counters.untracked += 1;
            return;
        };
        match track.guard.judge(shown, open.first_at, &self.limits) {
            Ok(pose) => {
                let (position_m, orientation) = (pose.position_m, pose.orientation);
                let body = MocapBody { position_m, orientation, ..subject.body.clone() };
                // A fleet has at most as many vehicles as a frame has places.
                let _ = open.message.bodies.push(body);
            }
            Err(refusal) => {
                let vehicle = subject.body.vehicle;
                self.refuse(now, vehicle, refusal, shown, out);
            }
        }
    }

    fn refuse(&mut self, now: Time, vehicle: u8, refusal: Refusal, shown: &Shown, out: &mut Outbox<Output>) {
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
        self.reports.warn(now, vehicle, name, || shown.to_string(), out);
    }

    fn hear(&mut self, now: Time, out: &mut Outbox<Output>) {
        self.stream.heard_at = now.max(self.stream.heard_at);
        if self.stream.silent {
            self.stream.silent = false;
            self.stream.heard_at = now;
            out.event(now, Severity::Info, 0, "vicon-heard", "the stream of poses is back");
        }
    }

    fn watch_silence(&mut self, now: Time, out: &mut Outbox<Output>) {
        if !self.stream.silent && now >= self.stream.heard_at.saturating_add(self.silent) {
            self.stream.silent = true;
            let detail = format!("no poses for {}", self.silent);
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
mod natnet_tests;
#[cfg(test)]
mod tests;
