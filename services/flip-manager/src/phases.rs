//! The course of a vehicle's work: approach, gate, upload, start, flip, measure, recover, and again; then land.

use quantity::{Span, Time};
use schemas::{
    FlightMode, FlipError, FlipOutcome, FlipParameters, FlipPhase, LearnerVerdict, ManeuverAbort, ManeuverPhase,
    ManeuverResult, ManeuverStart, Severity,
};
use settings::Hall;

use crate::Out;
use crate::end_state::flip_error;
use crate::gate::age_s;
use crate::order::Wanted;
use crate::tuning::Tuning;
use crate::upload::upload;
use crate::vehicle::{Attempt, Vehicle};

/// Where the work stands, with what only that stage needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Phase {
    /// On the ground, no order.
    Idle,
    /// On its way to its place, or steadying there.
    Approach,
    /// Steady; something of the gate is not met.
    Gate,
    /// The set is on its way.
    Upload {
        /// When it was last sent.
        sent_at: Time,
        /// How often.
        attempts: u32,
    },
    /// The start is on its way.
    Start {
        /// When it was first sent.
        first_at: Time,
        /// When it was last sent.
        sent_at: Time,
        /// Whether it is still repeated.
        repeats: bool,
    },
    /// The vehicle flies the maneuver.
    Flip {
        /// When its end was last ordered.
        abort_sent_at: Option<Time>,
    },
    /// The maneuver is over.
    Measure,
    /// The hover controller catches the vehicle.
    Recover,
    /// On its way down, to rest there.
    Landing {
        /// Where it will rest.
        then: Rest,
    },
    /// Down, and not to rise on the order that stood then.
    Done {
        /// When that order was given.
        order_given_at: Time,
    },
}

/// What a vehicle does once it is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    /// It waits for the next order.
    Idle,
    /// Its work is done, or was stopped: only a new order makes it rise.
    Done,
}

impl Phase {
    /// As it is told to others.
    pub(crate) fn name(self) -> FlipPhase {
        match self {
            Self::Idle => FlipPhase::Idle,
            Self::Approach => FlipPhase::Approach,
            Self::Gate => FlipPhase::Gate,
            Self::Upload { .. } => FlipPhase::Upload,
            Self::Start { .. } => FlipPhase::Start,
            Self::Flip { .. } => FlipPhase::Flip,
            Self::Measure => FlipPhase::Measure,
            Self::Recover => FlipPhase::Recover,
            Self::Landing { .. } => FlipPhase::Landing,
            Self::Done { .. } => FlipPhase::Done,
        }
    }
}

/// What a step of the work sees besides the vehicle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Context<'a> {
    /// Now.
    pub(crate) now: Time,
    /// What people want.
    pub(crate) wanted: Wanted,
    /// When the service started.
    pub(crate) started_at: Time,
    /// The hall.
    pub(crate) hall: &'a Hall,
    /// The section of the settings.
    pub(crate) tuning: &'a Tuning,
}

fn seconds(seconds: f64) -> Span {
    Span::from_secs_f64(seconds)
}

impl Vehicle {
    /// One step of the work.
    pub(crate) fn advance(&mut self, context: &Context, out: &mut Out) {
        self.notice_flight(context, out);
        self.consider_landing(context, out);
        match self.phase {
            Phase::Idle => self.idle(context, out),
            Phase::Approach | Phase::Gate => self.approach(context, out),
            Phase::Upload { sent_at, attempts } => self.await_echo(context, sent_at, attempts, out),
            Phase::Start { first_at, sent_at, repeats } => {
                self.await_begin(context, first_at, sent_at, repeats, out);
            }
            Phase::Flip { abort_sent_at } => self.watch(context, abort_sent_at, out),
            Phase::Measure => self.measure(context, out),
            Phase::Recover => self.recover(context),
            Phase::Landing { then } => self.land(context, then),
            Phase::Done { order_given_at } => self.rest(context, order_given_at),
        }
        self.repeat_result(context, out);
    }

    fn report(&self, context: &Context, severity: Severity, name: &str, detail: &str, out: &mut Out) {
        out.event(context.now, severity, self.id, name, detail);
    }

    /// Ends the work where the vehicle itself has ended its flight.
    fn notice_flight(&mut self, context: &Context, out: &mut Out) {
        let Some(report) = self.fresh_telemetry(context.now, context.tuning) else { return };
        let mode = report.mode;
        match mode {
            FlightMode::Flying | FlightMode::Maneuver | FlightMode::LevelHold | FlightMode::Descend => {
                self.has_flown = true;
            }
            FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped => {
                let latched = mode != FlightMode::Disarmed;
                let at_work =
                    !matches!(self.phase, Phase::Idle | Phase::Landing { .. } | Phase::Done { .. });
                if at_work && (self.has_flown || latched) {
                    let detail = if latched { "motors off and latched" } else { "motors off" };
                    self.report(context, Severity::Fault, "vehicle-down", detail, out);
                    self.finish(context);
                }
            }
        }
    }

    /// Goes down wherever the order or the vehicle's condition says so; a flip is flown to its end first.
    fn consider_landing(&mut self, context: &Context, out: &mut Out) {
        let waits = matches!(self.phase, Phase::Approach | Phase::Gate | Phase::Upload { .. });
        if !waits && self.phase != Phase::Recover {
            return;
        }
        match context.wanted {
            Wanted::Land => return self.phase = Phase::Landing { then: Rest::Idle },
            Wanted::Unknown | Wanted::Lost => {
                self.report(context, Severity::Warning, "order-missing", "nobody repeats the order", out);
                return self.phase = Phase::Landing { then: Rest::Done };
            }
            Wanted::Fly(_) | Wanted::Hover(_) => {}
        }
        if !waits {
            return;
        }
        let Some((severity, name, detail)) = self.reason_to_land(context) else { return };
        self.report(context, severity, name, &detail, out);
        self.phase = Phase::Landing { then: Rest::Done };
    }

    fn reason_to_land(&self, context: &Context) -> Option<(Severity, &'static str, String)> {
        if let Some(end) = self.end_of_work(context) {
            return Some(end);
        }
        let timing = &context.tuning.timing;
        let waited_s = age_s(context.now, self.waiting_since);
        let silent_s = self.telemetry.map_or(waited_s, |report| age_s(context.now, report.received_at));
        if silent_s > timing.silence_s_max {
            let detail = format!("no report for {silent_s:.1} s");
            return Some((Severity::Fault, "telemetry-lost", detail));
        }
        if matches!(context.wanted, Wanted::Fly(_)) && waited_s > timing.patience_s {
            let detail = format!("no flip for {waited_s:.0} s; gate conditions unmet: {}", self.unmet.0);
            return Some((Severity::Fault, "gate-unmet", detail));
        }
        None
    }

    /// Why there is no next flip, nor a hover: the learner's verdict, or the battery.
    fn end_of_work(&self, context: &Context) -> Option<(Severity, &'static str, String)> {
        let flies = matches!(context.wanted, Wanted::Fly(_));
        if let Some(next) = self.next.as_ref().filter(|_| flies) {
            match next.verdict {
                LearnerVerdict::Fly => {}
                LearnerVerdict::Finished => {
                    return Some((Severity::Info, "learning-finished", "all iterations are flown".to_owned()));
                }
                LearnerVerdict::Stopped => {
                    return Some((Severity::Fault, "learning-stopped", next.reason.to_string()));
                }
            }
        }
        let limit_v = if flies { self.battery.flip_v_min } else { self.battery.land_v_min };
        let volts = self.rest.volts().filter(|volts| *volts < limit_v)?;
        let detail = format!("{volts:.2} V at rest, at least {limit_v:.2} V are needed");
        Some((Severity::Warning, "battery-low", detail))
    }

    fn idle(&mut self, context: &Context, out: &mut Out) {
        let (now, tuning) = (context.now, context.tuning);
        if self.is_airborne(now, tuning) {
            // This service was restarted below a flying vehicle.
            let waited = now - context.started_at;
            match context.wanted {
                Wanted::Fly(_) | Wanted::Hover(_) => self.begin_approach(now),
                Wanted::Unknown if waited <= seconds(tuning.timing.order_timeout_s) => {}
                Wanted::Unknown | Wanted::Land | Wanted::Lost => self.phase = Phase::Landing { then: Rest::Idle },
            }
            return;
        }
        let ready = match context.wanted {
            Wanted::Fly(_) => self.next.is_some(),
            Wanted::Hover(_) => true,
            Wanted::Unknown | Wanted::Land | Wanted::Lost => false,
        };
        if !ready || self.fresh_telemetry(now, tuning).is_none() || self.state.is_none() {
            return;
        }
        match self.end_of_work(context) {
            Some((severity, name, detail)) => {
                self.report(context, severity, name, &detail, out);
                self.finish(context);
            }
            None => {
                self.has_flown = false;
                self.begin_approach(now);
            }
        }
    }

    fn begin_approach(&mut self, now: Time) {
        self.phase = Phase::Approach;
        self.waiting_since = now;
    }

    fn approach(&mut self, context: &Context, out: &mut Out) {
        if self.follow_news(context, out) {
            return;
        }
        if !matches!(context.wanted, Wanted::Fly(_)) {
            // Ordered to hover, it waits for nothing.
            self.waiting_since = context.now;
            self.phase = Phase::Approach;
        } else if !self.is_settled(context.now, context.tuning) {
            self.phase = Phase::Approach;
        } else if self.unmet.is_open() {
            self.begin_upload(context, out);
        } else {
            self.phase = Phase::Gate;
        }
    }

    /// Uploads the next set, unless the vehicle has it already.
    fn begin_upload(&mut self, context: &Context, out: &mut Out) {
        let Some(next) = &self.next else { return };
        let known = self.attempt.as_ref().is_some_and(|attempt| attempt.parameters == *next);
        if !known {
            let reported = self.telemetry.map(|report| report.set_id);
            let Some(upload) = upload(next, self.set_ids.next(reported)) else {
                self.next = None;
                let detail = "the learner's parameters are no flip";
                return self.report(context, Severity::Fault, "parameters-refused", detail, out);
            };
            let parameters = next.clone();
            self.attempt = Some(Attempt { parameters, upload, maneuver_id: None, battery_v: 0.0 });
        }
        if self.vehicle_has_set() {
            return self.begin_start(context, out);
        }
        if let Some(attempt) = &self.attempt {
            out.publish(attempt.upload);
            self.phase = Phase::Upload { sent_at: context.now, attempts: 1 };
        }
    }

    fn vehicle_has_set(&self) -> bool {
        self.attempt.as_ref().zip(self.telemetry).is_some_and(|(attempt, report)| {
            (report.set_id, report.set_digest) == (attempt.upload.set_id, attempt.upload.digest)
        })
    }

    fn await_echo(&mut self, context: &Context, sent_at: Time, attempts: u32, out: &mut Out) {
        let timing = &context.tuning.timing;
        let Some(attempt) = &self.attempt else { return self.phase = Phase::Approach };
        let replaced = self.next.as_ref() != Some(&attempt.parameters);
        if replaced || !matches!(context.wanted, Wanted::Fly(_)) {
            self.phase = Phase::Approach;
        } else if self.vehicle_has_set() {
            if self.is_settled(context.now, context.tuning) && self.unmet.is_open() {
                self.begin_start(context, out);
            } else {
                self.phase = Phase::Approach;
            }
        } else if context.now - sent_at < seconds(timing.upload_repeat_s) {
        } else if attempts < timing.upload_attempts_max {
            out.publish(attempt.upload);
            self.phase = Phase::Upload { sent_at: context.now, attempts: attempts + 1 };
        } else {
            let detail = format!("no echo of set {} after {attempts} uploads", attempt.upload.set_id);
            self.report(context, Severity::Fault, "upload-failed", &detail, out);
            self.phase = Phase::Landing { then: Rest::Done };
        }
    }

    fn begin_start(&mut self, context: &Context, out: &mut Out) {
        let reported = self.telemetry.map(|report| report.maneuver_id);
        let battery_v = self.rest.volts().unwrap_or_default();
        let Some(attempt) = &mut self.attempt else { return };
        attempt.maneuver_id = Some(self.maneuver_ids.next(reported));
        attempt.battery_v = battery_v;
        let now = context.now;
        self.send_start(context, out);
        self.phase = Phase::Start { first_at: now, sent_at: now, repeats: true };
    }

    fn send_start(&self, context: &Context, out: &mut Out) {
        let Some((attempt, maneuver_id)) = self.attempt.as_ref().and_then(|a| a.maneuver_id.map(|id| (a, id)))
        else {
            return;
        };
        out.publish(ManeuverStart {
            vehicle: self.id,
            maneuver_id,
            set_id: attempt.upload.set_id,
            digest: attempt.upload.digest,
            valid_until: context.now + seconds(context.tuning.timing.start_validity_s),
        });
    }

    fn await_begin(&mut self, context: &Context, first_at: Time, sent_at: Time, repeats: bool, out: &mut Out) {
        if self.follow_news(context, out) {
            return;
        }
        let (now, timing) = (context.now, &context.tuning.timing);
        let repeats = repeats
            && self.unmet.is_open()
            && matches!(context.wanted, Wanted::Fly(_))
            && now - first_at < seconds(timing.start_s_max);
        let void_at = sent_at + seconds(timing.start_validity_s);
        let planned_s = self.attempt.as_ref().map_or(0.0, |attempt| attempt.parameters.duration_s);
        if repeats && now - sent_at >= seconds(timing.start_repeat_s) {
            self.send_start(context, out);
            self.phase = Phase::Start { first_at, sent_at: now, repeats };
        } else if !repeats && self.telemetry.is_some_and(|report| report.received_at > void_at + LINK_TIME) {
            // Heard since, and not of this maneuver: it was not begun and cannot begin any more.
            self.report(context, Severity::Warning, "start-unanswered", "the vehicle did not begin", out);
            self.phase = Phase::Approach;
        } else if now > void_at + seconds(planned_s + timing.end_grace_s) {
            self.give_up(context, "no report after the start", out);
        } else {
            self.phase = Phase::Start { first_at, sent_at, repeats };
        }
    }

    /// Goes on by what the vehicle reports of the flip being attempted; whether it did.
    fn follow_news(&mut self, context: &Context, out: &mut Out) -> bool {
        let Some(report) = self.news() else { return false };
        let reason = report.reason;
        self.phase = match report.maneuver_phase {
            ManeuverPhase::None => return false,
            ManeuverPhase::Running => Phase::Flip { abort_sent_at: None },
            ManeuverPhase::Completed | ManeuverPhase::Aborted => Phase::Measure,
            ManeuverPhase::Refused => {
                let detail = format!("the vehicle refused, reason {reason}");
                self.report(context, Severity::Warning, "flip-refused", &detail, out);
                self.conclude(context, FlipOutcome::Aborted, FlipError::default(), out);
                return true;
            }
        };
        true
    }

    fn watch(&mut self, context: &Context, abort_sent_at: Option<Time>, out: &mut Out) {
        let (now, tuning) = (context.now, context.tuning);
        let Some((report, attempt)) = self.news().zip(self.attempt.as_ref()) else {
            return self.give_up(context, "the vehicle speaks of another maneuver", out);
        };
        if matches!(report.maneuver_phase, ManeuverPhase::Completed | ManeuverPhase::Aborted) {
            self.phase = Phase::Measure;
            return self.measure(context, out);
        }
        let planned_end_at = report.began_at + seconds(attempt.parameters.duration_s);
        if now > planned_end_at + seconds(tuning.timing.end_grace_s) {
            return self.give_up(context, "no report of the flip's end", out);
        }
        let Some(breach) = tuning.watch.breach(now, context.hall, self.last_valid.as_ref()) else { return };
        let maneuver_id = report.maneuver_id;
        if abort_sent_at.is_none() {
            self.report(context, Severity::Warning, "flip-aborted", breach.text(), out);
        }
        if abort_sent_at.is_none_or(|sent| now - sent >= seconds(tuning.timing.start_repeat_s)) {
            out.publish(ManeuverAbort { vehicle: self.id, maneuver_id });
            self.phase = Phase::Flip { abort_sent_at: Some(now) };
        }
    }

    fn give_up(&mut self, context: &Context, detail: &str, out: &mut Out) {
        self.report(context, Severity::Warning, "flip-unmeasured", detail, out);
        self.conclude(context, FlipOutcome::Unmeasured, FlipError::default(), out);
    }

    fn measure(&mut self, context: &Context, out: &mut Out) {
        let measure = &context.tuning.measure;
        let Some((report, attempt)) = self.news().zip(self.attempt.as_ref()) else {
            return self.give_up(context, "the vehicle speaks of another maneuver", out);
        };
        let (began_at, ended_at) = (report.began_at, report.ended_at);
        let outcome = match report.maneuver_phase {
            ManeuverPhase::Completed => FlipOutcome::Completed,
            _ => FlipOutcome::Aborted,
        };
        let flown_s = (ended_at - began_at).as_secs_f64();
        let off_s = (flown_s - attempt.parameters.duration_s).abs();
        if outcome == FlipOutcome::Completed && off_s > measure.duration_error_s_max {
            return self.give_up(context, &format!("reported to have lasted {flown_s:.3} s"), out);
        }
        if report.clock_uncertainty_s > measure.clock_uncertainty_s_max {
            let detail = format!("the vehicle's clock is known to {:.3} s only", report.clock_uncertainty_s);
            return self.give_up(context, &detail, out);
        }
        let seen_until = ended_at + seconds(measure.position_window_s);
        let seen = self.poses.newest().is_some_and(|pose| pose.at >= seen_until);
        if !seen && context.now <= ended_at + seconds(measure.wait_s_max) {
            return;
        }
        match flip_error(&self.poses, began_at, ended_at, measure) {
            Ok(error) => self.conclude(context, outcome, error, out),
            // An early end is one whether or not it was seen.
            Err(_) if outcome == FlipOutcome::Aborted => {
                self.conclude(context, outcome, FlipError::default(), out);
            }
            Err(unmeasured) => self.give_up(context, unmeasured.text(), out),
        }
    }

    /// Hands the result to the learner.
    fn conclude(&mut self, context: &Context, outcome: FlipOutcome, error: FlipError, out: &mut Out) {
        self.phase = Phase::Recover;
        let news = self.news().copied();
        let Some(attempt) = self.attempt.take() else { return };
        let set = &attempt.upload;
        let result = ManeuverResult {
            vehicle: self.id,
            iteration: attempt.parameters.iteration,
            outcome,
            maneuver_id: attempt.maneuver_id.unwrap_or_default(),
            parameters: FlipParameters {
                u1_m_s2: f64::from(set.u1_m_s2),
                t1_s: f64::from(set.t1_s),
                t3_s: f64::from(set.t3_s),
                u5_m_s2: f64::from(set.u5_m_s2),
                t5_s: f64::from(set.t5_s),
            },
            error,
            began_at: news.map_or(context.now, |report| report.began_at),
            ended_at: news.map_or(context.now, |report| report.ended_at),
            battery_v: attempt.battery_v,
        };
        out.publish(result);
        self.unanswered = Some((result, context.now));
        self.iteration_min = result.iteration.saturating_add(1);
        self.next = None;
    }

    fn repeat_result(&mut self, context: &Context, out: &mut Out) {
        let repeat = seconds(context.tuning.timing.result_repeat_s);
        if let Some((result, said_at)) = &mut self.unanswered
            && context.now - *said_at >= repeat
        {
            out.publish(*result);
            *said_at = context.now;
        }
    }

    fn recover(&mut self, context: &Context) {
        let place_m = self.goals.place_m;
        if self.state.is_some_and(|state| context.tuning.watch.is_recovered(&state, place_m)) {
            self.begin_approach(context.now);
        }
    }

    fn land(&mut self, context: &Context, then: Rest) {
        if self.is_down(context.now, context.tuning) {
            match then {
                Rest::Idle => self.phase = Phase::Idle,
                Rest::Done => self.finish(context),
            }
        }
    }

    /// Rests until an order is given that did not stand already.
    fn finish(&mut self, context: &Context) {
        let order_given_at = match context.wanted {
            Wanted::Fly(given_at) | Wanted::Hover(given_at) => given_at,
            Wanted::Unknown | Wanted::Land | Wanted::Lost => context.now,
        };
        self.attempt = None;
        self.phase = Phase::Done { order_given_at };
    }

    fn rest(&mut self, context: &Context, order_given_at: Time) {
        match context.wanted {
            Wanted::Fly(given_at) | Wanted::Hover(given_at) if given_at > order_given_at => {
                self.phase = Phase::Idle;
            }
            _ => {}
        }
    }
}

/// A report that left the vehicle before a start was void may arrive this much later.
const LINK_TIME: Span = Span::from_millis(50);
