//! One flip, from the upload of its parameters to the result for the learner.

use quantity::{Span, Time};
use schemas::{
    FlipError, FlipOutcome, FlipParameters, ManeuverAbort, ManeuverPhase, ManeuverResult, ManeuverStart,
    Severity,
};

use crate::Out;
use crate::end_state::flip_error;
use crate::order::Wanted;
use crate::phases::{Context, Phase, Rest, seconds};
use crate::upload::upload;
use crate::vehicle::{Attempt, Vehicle};

/// A report that left the vehicle before a start was void may arrive this much later.
const LINK_TIME: Span = Span::from_millis(50);

impl Vehicle {
    /// Uploads the next set, unless the vehicle has it already.
    pub(crate) fn begin_upload(&mut self, context: &Context, out: &mut Out) {
        let Some(next) = &self.next else { return };
        let known = self.attempt.as_ref().is_some_and(|attempt| attempt.parameters == *next);
        if !known {
            let reported = self.telemetry.map(|report| report.set_id).filter(|id| *id != 0);
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

    /// Waits for the vehicle to report the set, then starts the flip.
    pub(crate) fn await_echo(&mut self, context: &Context, sent_at: Time, attempts: u32, out: &mut Out) {
        let timing = &context.tuning.timing;
        let Some(attempt) = &self.attempt else {
            return self.phase = Phase::Approach;
        };
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
        let reported = self.telemetry.map(|report| report.maneuver_id).filter(|id| *id != 0);
        let battery_v = self.rest.volts().unwrap_or_default();
        let Some(attempt) = &mut self.attempt else { return };
        attempt.maneuver_id = Some(self.maneuver_ids.next(reported));
        attempt.battery_v = battery_v;
        let now = context.now;
        self.send_start(context, out);
        self.phase = Phase::Start { first_at: now, sent_at: now, repeats: true };
    }

    fn send_start(&self, context: &Context, out: &mut Out) {
        let Some((attempt, maneuver_id)) =
            self.attempt.as_ref().and_then(|a| a.maneuver_id.map(|id| (a, id)))
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

    /// Repeats the start until the vehicle reports on it, while the gate holds and the time lasts.
    pub(crate) fn await_begin(
        &mut self,
        context: &Context,
        first_at: Time,
        sent_at: Time,
        repeats: bool,
        out: &mut Out,
    ) {
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
    pub(crate) fn follow_news(&mut self, context: &Context, out: &mut Out) -> bool {
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

    /// Watches a running flip, and ends it where it breaks its limits.
    pub(crate) fn watch(&mut self, context: &Context, abort_sent_at: Option<Time>, out: &mut Out) {
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
        let Some(breach) = tuning.watch.breach(now, context.hall, self.last_valid.as_ref()) else {
            return;
        };
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

    /// Measures a flip that has ended, once the cameras have seen enough.
    pub(crate) fn measure(&mut self, context: &Context, out: &mut Out) {
        let measure = &context.tuning.measure;
        let Some((report, attempt)) = self.news().zip(self.attempt.as_ref()) else {
            return self.give_up(context, "the vehicle speaks of another maneuver", out);
        };
        let (began_at, ended_at) = (report.began_at, report.ended_at);
        if ended_at > context.now + LINK_TIME || began_at > ended_at {
            return self.give_up(context, "reported to have ended at an impossible time", out);
        }
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
    pub(crate) fn conclude(
        &mut self,
        context: &Context,
        outcome: FlipOutcome,
        error: FlipError,
        out: &mut Out,
    ) {
        self.phase = Phase::Recover;
        self.waiting_since = context.now;
        let news = self.news().copied();
        let Some(attempt) = self.attempt.take() else {
            return;
        };
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

    /// Says the last result again until the learner has answered it.
    pub(crate) fn repeat_result(&mut self, context: &Context, out: &mut Out) {
        let repeat = seconds(context.tuning.timing.result_repeat_s);
        if let Some((result, said_at)) = &mut self.unanswered
            && context.now - *said_at >= repeat
        {
            out.publish(*result);
            *said_at = context.now;
        }
    }
}
