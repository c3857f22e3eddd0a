//! A scripted arena around the core: a vehicle that obeys or does not, a learner, and people's orders.

use quantity::{Rotation, Span, Time, Vector};
use schemas::{
    ArenaOrder, FlightMode, FlipParameters, FlipPhase, GoalKind, Kinematics, LearnerVerdict,
    ManeuverParameters, ManeuverPhase, ManeuverStart, MocapBody, MocapFrame, OrderKind, Tracking,
    VehicleState, VehicleTelemetry,
};
use service_core::{Core, Event, Outbox, Seed, Start};
use settings::Arena;

use crate::{FlipManager, Input, Output, Tuning};

/// Planned duration of the scripted flip.
pub(crate) const FLIP_S: f64 = 1.0;

/// What the scripted vehicle does wrong.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Faults {
    /// Uploads never arrive.
    pub(crate) deaf_to_uploads: bool,
    /// It takes another set than the one sent.
    pub(crate) wrong_set: bool,
    /// Starts never arrive.
    pub(crate) deaf_to_starts: bool,
    /// It refuses to start.
    pub(crate) refuses: bool,
    /// Its flip never ends.
    pub(crate) endless: bool,
    /// It does not report.
    pub(crate) mute: bool,
    /// The learner answers no result.
    pub(crate) learner_silent: bool,
    /// The front door is gone.
    pub(crate) nobody_orders: bool,
    /// Somebody holds it in the air.
    pub(crate) carried: bool,
    /// The cameras are dark.
    pub(crate) dark: bool,
}

/// The rig.
pub(crate) struct Rig {
    pub(crate) core: FlipManager,
    pub(crate) now: Time,
    pub(crate) faults: Faults,
    pub(crate) order: ArenaOrder,
    pub(crate) kinematics: Kinematics,
    pub(crate) telemetry: VehicleTelemetry,
    pub(crate) parameters: ManeuverParameters,
    /// Everything said, with its time.
    pub(crate) said: Vec<(Time, Output)>,
    /// Names of the events reported.
    pub(crate) events: Vec<String>,
    /// Starts the vehicle would have to obey, with the gate as last told at that time.
    pub(crate) starts: Vec<(Time, ManeuverStart)>,
    upload_due: Option<(Time, u16, u64)>,
    answer_due: bool,
    step: u64,
}

/// The arena of the repository's double-flip scenario.
pub(crate) fn arena(scenario: &str) -> Arena {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
    Arena::load(std::path::Path::new(folder), scenario).expect("the repository's own settings are good")
}

fn parameters() -> ManeuverParameters {
    ManeuverParameters {
        vehicle: 1,
        verdict: LearnerVerdict::Fly,
        flips: 2,
        parameters: FlipParameters { u1_m_s2: 20.4, t1_s: 0.16, t3_s: 0.28, u5_m_s2: 20.3, t5_s: 0.18 },
        rate_rad_s_max: 27.9,
        envelope_low_m_s2: 3.6,
        envelope_high_m_s2: 21.0,
        lever_m: 0.0578,
        duration_s: FLIP_S,
        height_loss_m: 1.0,
        ..ManeuverParameters::default()
    }
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self::with(arena("double-flip"), 3)
    }

    pub(crate) fn with(arena: Arena, incarnation: u32) -> Self {
        let now = Time::ZERO + Span::from_secs(50);
        let start = Start { at: now, seed: Seed(1), incarnation };
        let core = FlipManager::new(&arena, Tuning::default(), start).expect("defaults are good");
        Self {
            core,
            now,
            faults: Faults::default(),
            order: ArenaOrder { kind: OrderKind::Fly, given_at: now },
            kinematics: Kinematics::default(),
            telemetry: VehicleTelemetry { vehicle: 1, battery_v: 12.0, ..VehicleTelemetry::default() },
            parameters: parameters(),
            said: Vec::new(),
            events: Vec::new(),
            starts: Vec::new(),
            upload_due: None,
            answer_due: false,
            step: 0,
        }
    }

    pub(crate) fn hear(&mut self, input: impl Into<Input>) {
        self.drive(Event::Input(input.into()));
    }

    fn drive(&mut self, event: Event<Input>) {
        let mut out = Outbox::default();
        self.core.step(self.now, event, &mut out);
        let messages: Vec<Output> = out.take_messages().collect();
        self.events.extend(out.take_events().map(|event| event.name.to_string()));
        for message in messages {
            self.obey(&message);
            self.said.push((self.now, message));
        }
    }

    /// What the vehicle and the learner make of a message.
    fn obey(&mut self, message: &Output) {
        match message {
            Output::Upload(upload) if !self.faults.deaf_to_uploads => {
                let set_id = upload.set_id.wrapping_add(u16::from(self.faults.wrong_set));
                self.upload_due = Some((self.now + Span::from_millis(60), set_id, upload.digest));
            }
            Output::Start(start) => {
                self.starts.push((self.now, *start));
                let fits = (start.set_id, start.digest) == (self.telemetry.set_id, self.telemetry.set_digest);
                if !self.faults.deaf_to_starts && fits && self.telemetry.maneuver_id != start.maneuver_id {
                    self.telemetry.maneuver_id = start.maneuver_id;
                    self.telemetry.began_at = self.now;
                    self.telemetry.maneuver_phase =
                        if self.faults.refuses { ManeuverPhase::Refused } else { ManeuverPhase::Running };
                    if !self.faults.refuses {
                        self.telemetry.mode = FlightMode::Maneuver;
                    }
                }
            }
            Output::Abort(abort) if abort.maneuver_id == self.telemetry.maneuver_id => {
                self.end_flip(ManeuverPhase::Aborted);
            }
            Output::Result(result) if !self.faults.learner_silent => {
                self.parameters.iteration = result.iteration + 1;
                self.parameters.parameters.t3_s += 0.001;
                self.answer_due = true;
            }
            Output::Goal(goal) if goal.vehicle == 1 && self.telemetry.mode != FlightMode::Maneuver => {
                match goal.kind {
                    GoalKind::Hover => {
                        self.telemetry.mode = FlightMode::Flying;
                        self.kinematics.position_m = goal.position_m;
                    }
                    GoalKind::Ground | GoalKind::Land if self.faults.carried => {}
                    GoalKind::Ground | GoalKind::Land => {
                        self.telemetry.mode = FlightMode::Disarmed;
                        self.kinematics.position_m = Vector::ZERO;
                    }
                }
            }
            _ => {}
        }
    }

    fn end_flip(&mut self, phase: ManeuverPhase) {
        self.telemetry.maneuver_phase = phase;
        self.telemetry.ended_at = self.now;
        self.telemetry.mode = FlightMode::Flying;
    }

    /// The estimator's word on the scripted vehicle.
    pub(crate) fn state(&self) -> VehicleState {
        VehicleState {
            vehicle: 1,
            tracking: Tracking::Tracking,
            accepted_frames: 100,
            estimated_for: self.now - Span::from_millis(10),
            estimate: self.kinematics,
            predicted_for: self.now + Span::from_millis(30),
            prediction: self.kinematics,
            valid_until: self.now + Span::from_millis(90),
            ..VehicleState::default()
        }
    }

    /// Five milliseconds: one camera frame.
    pub(crate) fn frame(&mut self) {
        self.now += Span::from_millis(5);
        self.step += 1;
        if let Some((due, set_id, digest)) = self.upload_due
            && self.now >= due
        {
            (self.telemetry.set_id, self.telemetry.set_digest) = (set_id, digest);
            self.upload_due = None;
        }
        let flown = self.now - self.telemetry.began_at;
        if self.telemetry.maneuver_phase == ManeuverPhase::Running
            && flown >= Span::from_secs_f64(FLIP_S)
            && !self.faults.endless
        {
            self.end_flip(ManeuverPhase::Completed);
        }
        if !self.faults.dark {
            let body = MocapBody {
                vehicle: 1,
                position_m: self.kinematics.position_m,
                orientation: Rotation::IDENTITY,
                ..MocapBody::default()
            };
            let exposed_at = self.now - Span::from_millis(10);
            let bodies = vec![body].try_into().expect("one body fits");
            let (frame, received_at) = (self.step, self.now);
            self.hear(MocapFrame { frame, exposed_at, received_at, latency_s: 0.01, bodies });
            self.hear(self.state());
        }
        if self.step.is_multiple_of(4) && !self.faults.mute {
            let received_at = self.now;
            self.hear(VehicleTelemetry { received_at, ..self.telemetry });
        }
        if self.step % 100 == 1 {
            if !self.faults.nobody_orders {
                self.hear(self.order);
            }
            self.answer_due = true;
        }
        if core::mem::take(&mut self.answer_due) {
            self.hear(self.parameters.clone());
        }
        while self.core.deadline().is_some_and(|deadline| deadline <= self.now) {
            self.drive(Event::Deadline);
        }
    }

    /// That many seconds.
    pub(crate) fn run(&mut self, seconds: f64) {
        let until = self.now + Span::from_secs_f64(seconds);
        while self.now < until {
            self.frame();
        }
    }

    /// Runs until that phase, at most that many seconds; panics where it does not come.
    pub(crate) fn run_until(&mut self, phase: FlipPhase, seconds: f64) {
        let until = self.now + Span::from_secs_f64(seconds);
        while self.phase() != phase {
            assert!(
                self.now < until,
                "still {:?}, waiting for {phase:?}; events {:?}",
                self.phase(),
                self.events
            );
            self.frame();
        }
    }

    /// The phase of the vehicle.
    pub(crate) fn phase(&self) -> FlipPhase {
        self.core.vehicles[0].phase.name()
    }

    /// The phases told, each once in a row.
    pub(crate) fn phases(&self) -> Vec<FlipPhase> {
        let mut phases: Vec<_> = self
            .said
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Status(status) if status.vehicle == 1 => Some(status.phase),
                _ => None,
            })
            .collect();
        phases.dedup();
        phases
    }

    /// Everything of one kind that was said, with its time.
    pub(crate) fn all<T>(&self, pick: impl Fn(&Output) -> Option<T>) -> Vec<(Time, T)> {
        self.said.iter().filter_map(|(at, output)| pick(output).map(|found| (*at, found))).collect()
    }
}
