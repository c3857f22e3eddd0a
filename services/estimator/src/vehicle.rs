//! Everything the estimator knows of one vehicle.

use quantity::{Rotation, Span, Time};
use schemas::{CommandSent, MocapBody, MocapFrame, Severity, Tracking, VehicleState, VehicleTelemetry};
use service_core::Outbox;
use settings::{Arena, Vehicle};

use crate::Output;
use crate::commands::{Commands, Drive};
use crate::filter::Filter;
use crate::gate::{Belief, Gate, Neighbour, Pose, Refusal, Verdict};
use crate::maneuver::Reports;
use crate::model::{Model, Regime};
use crate::tuning::Tuning;

/// Refused poses are reported at most this often.
const REPORT_PERIOD: Span = Span::from_secs(1);
/// A vehicle tilted further than this (the cosine of 0.6 rad) may, after a gap, stand any way.
const TURNING_COS: f64 = 0.825;
/// Lateness of a report that the filter makes up for; beyond, nothing more is learned from its lateness.
const LATENESS_MAX: Span = Span::from_millis(100);

/// The tuning's times as spans.
#[derive(Clone, Copy, Debug)]
struct Times {
    coast: Span,
    flip_coast: Span,
    flip_blind_max: Span,
    degraded_after: Span,
    silence: Span,
    coast_period: Span,
    invalid_period: Span,
    forget: Span,
    slot_lead: Span,
    horizon_max: Span,
    step: Span,
}

/// The last pose believed.
#[derive(Clone, Copy, Debug)]
struct Believed {
    pose: Pose,
    turning: bool,
}

/// One vehicle's estimator.
#[derive(Clone, Debug)]
pub(crate) struct VehicleEstimator {
    id: u8,
    tuning: Tuning,
    times: Times,
    mocap_latency: Span,
    command_delay: Span,
    model: Model,
    commands: Commands,
    reports: Reports,
    gate: Gate,
    filter: Option<Filter>,
    believed: Option<Believed>,
    seen_at: Option<Time>,
    accepted_frames: u16,
    lost: bool,
    state: VehicleState,
    publish_at: Time,
    refused_count: u32,
    report_at: Time,
}

impl VehicleEstimator {
    /// Knows nothing of the vehicle but its settings.
    pub fn new(arena: &Arena, vehicle: &Vehicle, tuning: &Tuning, start: Time) -> Self {
        let timing = &tuning.timing;
        let span = Span::from_secs_f64;
        Self {
            id: vehicle.id,
            times: Times {
                coast: span(timing.coast_s),
                flip_coast: span(timing.flip_coast_s),
                flip_blind_max: span(timing.flip_blind_s_max),
                degraded_after: span(timing.degraded_after_s),
                silence: span(timing.silence_s),
                coast_period: span(timing.coast_period_s),
                invalid_period: span(timing.invalid_period_s),
                forget: span(timing.forget_s),
                slot_lead: span(timing.slot_lead_s),
                horizon_max: span(timing.horizon_s_max),
                step: span(timing.step_s),
            },
            mocap_latency: span(vehicle.links.mocap_latency_s),
            command_delay: span(vehicle.links.command_delay_s),
            model: Model::new(vehicle, &tuning.model),
            commands: Commands::new(span(timing.command_s_max)),
            reports: Reports::new(span(timing.maneuver_s_max), span(timing.telemetry_s_max)),
            gate: Gate::new(&tuning.gate, &arena.hall, tuning.model.floor_height_m, span(timing.anywhere_s)),
            filter: None,
            believed: None,
            seen_at: None,
            accepted_frames: 0,
            lost: true,
            state: VehicleState { vehicle: vehicle.id, ..VehicleState::default() },
            publish_at: start + span(timing.invalid_period_s),
            refused_count: 0,
            report_at: start,
            tuning: tuning.clone(),
        }
    }

    /// When this vehicle must be spoken of at the latest.
    pub fn publish_at(&self) -> Time {
        self.publish_at
    }

    /// Takes note of a command that left the radio.
    pub fn command_sent(&mut self, sent: &CommandSent) {
        self.commands.sent(sent);
    }

    /// Takes note of the vehicle's report.
    pub fn telemetry(&mut self, now: Time, telemetry: &VehicleTelemetry) {
        self.reports.take(now, telemetry);
    }

    /// Where others must not be seen at that instant; nothing for a vehicle never seen.
    pub fn as_neighbour(&self, now: Time, at: Time) -> Option<Neighbour> {
        let believed = self.believed.as_ref()?;
        let tracked = self.tracking(now) != Tracking::Invalid;
        let position_m = match &self.filter {
            Some(filter) if tracked => {
                let k = &filter.motion().kinematics;
                k.position_m + k.velocity_m_s * (at - filter.at()).as_secs_f64()
            }
            _ => believed.pose.position_m,
        };
        Some(Neighbour { position_m, tracked })
    }

    /// Takes the vehicle's pose in a frame, and publishes the state that follows.
    pub fn pose(
        &mut self,
        now: Time,
        frame: &MocapFrame,
        body: &MocapBody,
        neighbours: &[Neighbour],
        out: &mut Outbox<Output>,
    ) {
        let exposed_at = frame.exposed_at;
        // One pose for each exposure, in order: what comes late or twice says nothing new.
        if self.seen_at.is_some_and(|seen_at| exposed_at <= seen_at) {
            return;
        }
        self.seen_at = Some(exposed_at);
        self.state.frame_received_at = frame.received_at;
        let q = body.orientation;
        let Some(orientation) = Rotation::from_components(q.w, q.x, q.y, q.z) else {
            self.refuse(now, Refusal::Absurd, out);
            return;
        };
        let pose = Pose { at: exposed_at, position_m: body.position_m, orientation };
        self.forget_if_old(exposed_at);
        self.advance(now, exposed_at);
        let expectation = self.filter.as_ref().map(Filter::expectation);
        let belief = self.belief(now);
        match self.gate.judge(&pose, expectation.as_ref(), belief.as_ref(), neighbours) {
            Verdict::Accept { position_m, turn_rad } => {
                if let Some(filter) = &mut self.filter {
                    filter.correct(position_m, turn_rad);
                    let span_s =
                        self.believed.map_or(0.0, |believed| (pose.at - believed.pose.at).as_secs_f64());
                    filter.teach(&mut self.model, &self.tuning.model, span_s.min(0.05));
                }
                self.accepted_frames = self.accepted_frames.saturating_add(1);
                self.believe(now, pose, out);
            }
            Verdict::Restart { previous, last } => {
                let regime = self.regime_at(now, last.at);
                self.filter = Some(Filter::start(&self.tuning, &self.model, regime, &previous, &last));
                self.accepted_frames = self.tuning.gate.reacquire_frames;
                let detail = format!(
                    "at {:.2} {:.2} {:.2} m",
                    last.position_m.x, last.position_m.y, last.position_m.z
                );
                out.event(now, Severity::Info, self.id, "reacquired", &detail);
                self.believe(now, pose, out);
            }
            Verdict::Refuse(refusal) => self.refuse(now, refusal, out),
        }
    }

    /// Publishes what can be said without a pose.
    pub fn silence(&mut self, now: Time, out: &mut Outbox<Output>) {
        self.forget_if_old(now);
        let tracking = self.tracking(now);
        let unseen = self.believed.map_or(Span::ZERO, |believed| now - believed.pose.at);
        // In a maneuver the state is not called invalid; but whoever flies on it needs to know that it rests
        // on nothing.
        if tracking == Tracking::Ballistic && unseen > self.times.flip_blind_max {
            self.accepted_frames = 0;
        }
        if tracking == Tracking::Invalid {
            self.accepted_frames = 0;
            if !self.lost {
                self.lost = true;
                out.event(
                    now,
                    Severity::Warning,
                    self.id,
                    "tracking-lost",
                    "no believable pose for too long",
                );
            }
        }
        self.publish(now, true, out);
        let period = match tracking {
            Tracking::Invalid => self.times.invalid_period,
            _ => self.times.coast_period,
        };
        // The moment of becoming invalid is news of its own.
        let next = now + period;
        let expires_at = self.state.valid_until + Span::from_nanos(1);
        self.publish_at = if expires_at > now { next.min(expires_at) } else { next };
    }

    fn believe(&mut self, now: Time, pose: Pose, out: &mut Outbox<Output>) {
        let Some(filter) = &self.filter else { return };
        if !filter.is_sound() {
            self.filter = None;
            out.event(now, Severity::Fault, self.id, "filter-unsound", "the filter was dropped");
            return;
        }
        let turning = filter.regime() == Regime::Ballistic
            || filter.motion().kinematics.orientation.z_axis().z < TURNING_COS;
        self.believed = Some(Believed { pose, turning });
        if self.tracking(now) != Tracking::Invalid {
            self.lost = false;
        }
        self.publish(now, false, out);
        self.publish_at = now + self.times.silence;
    }

    fn refuse(&mut self, now: Time, refusal: Refusal, out: &mut Outbox<Output>) {
        if refusal == Refusal::Acquiring {
            return;
        }
        self.accepted_frames = 0;
        self.refused_count += 1;
        if now >= self.report_at {
            let detail = format!("{}; {} since the last report", refusal.text(), self.refused_count);
            out.event(now, Severity::Warning, self.id, "pose-rejected", &detail);
            self.refused_count = 0;
            self.report_at = now + REPORT_PERIOD;
        }
    }

    /// How the vehicle moves at an instant, by what is known now.
    fn regime_at(&self, now: Time, at: Time) -> Regime {
        if self.reports.running_since(at).is_some() {
            return Regime::Ballistic;
        }
        if self.reports.deaf(now) {
            return Regime::Unknown;
        }
        match self.commands.at(at).0 {
            Drive::Fly { .. } => Regime::Commanded,
            Drive::Off | Drive::Silent => Regime::Unknown,
        }
    }

    /// Brings the filter to an instant not before its own, through the regime of that instant.
    fn advance(&mut self, now: Time, at: Time) {
        let regime = self.regime_at(now, at);
        let Some(filter) = &mut self.filter else { return };
        let late = match self.reports.running_since(at) {
            Some(began_at) => (filter.at() - began_at).min(LATENESS_MAX),
            None => Span::ZERO,
        };
        filter.enter(regime, &self.model, late);
        filter.advance_to(at, &self.model, &self.commands, self.times.step);
    }

    fn belief(&self, now: Time) -> Option<Belief> {
        let believed = self.believed.as_ref()?;
        let valid = self.filter.is_some() && now <= believed.pose.at + self.mocap_latency + self.times.coast;
        Some(Belief { pose: believed.pose, valid, turning: believed.turning })
    }

    /// Until when the state may be acted on.
    fn valid_until(&self, now: Time) -> Time {
        let (Some(_), Some(believed)) = (&self.filter, &self.believed) else {
            return Time::ZERO;
        };
        let arrived_at = believed.pose.at + self.mocap_latency;
        let mut until = arrived_at + self.times.coast;
        if self.reports.running_since(now).is_some() {
            until = until.max(now + self.times.flip_coast);
        } else if let Some(ended_at) = self.reports.ended_at()
            && ended_at - believed.pose.at <= self.times.flip_blind_max
        {
            until = until.max(ended_at + self.times.flip_coast);
        }
        until
    }

    fn tracking(&self, now: Time) -> Tracking {
        let Some(believed) = &self.believed else {
            return Tracking::Invalid;
        };
        if self.filter.is_none() || now > self.valid_until(now) {
            Tracking::Invalid
        } else if self.reports.running_since(now).is_some() {
            Tracking::Ballistic
        } else if now - believed.pose.at > self.mocap_latency + self.times.degraded_after {
            Tracking::Coasting
        } else {
            Tracking::Tracking
        }
    }

    fn forget_if_old(&mut self, now: Time) {
        let Some(believed) = &self.believed else { return };
        let unseen = now - believed.pose.at;
        if unseen > self.times.forget && now > self.valid_until(now) {
            self.filter = None;
        }
    }

    /// Publishes the state of the newest exposure, or, `onward`, the one the model makes of it by now.
    fn publish(&mut self, now: Time, onward: bool, out: &mut Outbox<Output>) {
        let tracking = self.tracking(now);
        self.state.tracking = tracking;
        self.state.accepted_frames = self.accepted_frames;
        if let (Some(filter), false) = (&self.filter, tracking == Tracking::Invalid) {
            let regime = self.regime_at(now, now);
            let mut filter_now;
            let filter = if onward && regime != filter.regime() {
                // The vehicle has meanwhile begun or ended a maneuver: what moves on is a copy, so that the
                // next pose still meets the filter at its own instant.
                filter_now = filter.clone();
                filter_now.enter(regime, &self.model, Span::ZERO);
                &filter_now
            } else {
                filter
            };
            let path = filter.path(&self.model, &self.commands, self.times.step);
            let mut motion = *filter.motion();
            let mut at = filter.at();
            if onward && now > at {
                path.carry(&mut motion, at, now);
                at = now;
            }
            self.state.estimated_for = at;
            self.state.estimate = motion.kinematics;
            let effect_at = self.commands.next_effect(now, self.times.slot_lead, self.command_delay);
            self.state.predicted_for = effect_at.min(now + self.times.horizon_max).max(at);
            if self.tuning.prediction {
                path.carry(&mut motion, at, self.state.predicted_for);
            }
            self.state.prediction = motion.kinematics;
            self.state.disturbance_m_s2 = filter.disturbance_m_s2(&self.model);
            self.state.valid_until = self.valid_until(now);
        }
        if !self.is_speakable() {
            // Never seen to happen; a number gone wrong must still not reach the bus.
            self.filter = None;
            self.state = VehicleState { vehicle: self.id, ..VehicleState::default() };
        }
        out.publish(self.state);
    }

    fn is_speakable(&self) -> bool {
        let state = &self.state;
        [&state.estimate, &state.prediction].iter().all(|k| {
            k.position_m.is_finite()
                && k.velocity_m_s.is_finite()
                && k.orientation.is_finite()
                && k.rate_rad_s.is_finite()
        }) && state.disturbance_m_s2.is_finite()
    }

    /// One sigma per axis of position, velocity, attitude and body rate.
    #[cfg(test)]
    pub fn sigmas(&self) -> Option<[f64; 4]> {
        self.filter.as_ref().map(Filter::sigmas)
    }
}
