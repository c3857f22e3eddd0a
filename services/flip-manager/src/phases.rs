//! The course of a vehicle's work: approach, gate, upload, start, flip, measure, recover, and again; then
//! land.

use quantity::{Span, Time};
use schemas::{FlightMode, FlipError, FlipOutcome, FlipPhase, LearnerVerdict, Severity};
use settings::Hall;

use crate::Out;
use crate::gate::age_s;
use crate::order::Wanted;
use crate::recording::Recording;
use crate::tuning::Tuning;
use crate::vehicle::Vehicle;

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

/// So long after the start of this service nobody is told that a vehicle has yet to be tracked.
const TRACKING_GRACE: Span = Span::from_secs(5);
/// A refusal to take off is repeated this often while its reason stands.
const REFUSAL_PERIOD: Span = Span::from_secs(10);

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
    /// The recording.
    pub(crate) recording: &'a Recording,
    /// The hall.
    pub(crate) hall: &'a Hall,
    /// The section of the settings.
    pub(crate) tuning: &'a Tuning,
}

pub(crate) fn seconds(seconds: f64) -> Span {
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

    /// Reports an event of this vehicle.
    pub(crate) fn report(
        &self,
        context: &Context,
        severity: Severity,
        name: &str,
        detail: &str,
        out: &mut Out,
    ) {
        out.event(context.now, severity, self.id, name, detail);
    }

    /// Ends the work where the vehicle itself has ended its flight.
    fn notice_flight(&mut self, context: &Context, out: &mut Out) {
        let Some(report) = self.fresh_telemetry(context.now, context.tuning) else {
            return;
        };
        let mode = report.mode;
        match mode {
            FlightMode::Flying | FlightMode::Maneuver | FlightMode::LevelHold | FlightMode::Descend => {
                self.has_flown = true;
            }
            FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped => {
                let latched = mode != FlightMode::Disarmed;
                let at_work = !matches!(self.phase, Phase::Idle | Phase::Landing { .. } | Phase::Done { .. });
                if at_work && (self.has_flown || latched) {
                    let detail = if latched { "motors off and latched" } else { "motors off" };
                    self.report(context, Severity::Fault, "vehicle-down", detail, out);
                    if matches!(self.phase, Phase::Flip { .. } | Phase::Measure) {
                        self.conclude(context, FlipOutcome::Aborted, FlipError::default(), out);
                    }
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
        // Where the work ends anyway, the vehicle is caught first.
        let end = if waits { self.end_of_work(context) } else { None };
        let Some((severity, name, detail)) = end.or_else(|| self.trouble(context)) else {
            return;
        };
        self.report(context, severity, name, &detail, out);
        self.phase = Phase::Landing { then: Rest::Done };
    }

    /// Why it is no use to go on hovering: a silent vehicle, or one that does not get to its next flip.
    fn trouble(&self, context: &Context) -> Option<(Severity, &'static str, String)> {
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
                    return Some((
                        Severity::Info,
                        "learning-finished",
                        "all iterations are flown".to_owned(),
                    ));
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
        if self.fresh_telemetry(now, tuning).is_none() || self.state.is_none() {
            return;
        }
        if self.is_high() {
            if self.is_down(now, tuning) {
                // Motors off, and not on the floor: somebody carries it.
                return;
            }
            // This service was restarted below a flying vehicle.
            let waited = now - context.started_at;
            match context.wanted {
                Wanted::Fly(_) | Wanted::Hover(_) => self.begin_approach(now),
                Wanted::Unknown if waited <= seconds(tuning.timing.order_timeout_s) => {}
                Wanted::Unknown | Wanted::Land | Wanted::Lost => {
                    self.phase = Phase::Landing { then: Rest::Idle }
                }
            }
            return;
        }
        let ready = match context.wanted {
            Wanted::Fly(_) => self.next.is_some(),
            Wanted::Hover(_) => true,
            Wanted::Unknown | Wanted::Land | Wanted::Lost => false,
        };
        if !ready {
            return;
        }
        if !self.is_well_tracked(now, tuning) {
            let detail = format!("not tracked for {:.1} s without a break", tuning.timing.tracked_s_min);
            // A moment of it is every start's.
            if now - context.started_at > TRACKING_GRACE {
                self.refuse_take_off(context, &detail, out);
            }
            return;
        }
        if let Some(detail) = context.recording.refusal(now, &tuning.recording) {
            self.refuse_take_off(context, &detail, out);
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

    /// Says why it stays where it is, now and then.
    fn refuse_take_off(&mut self, context: &Context, detail: &str, out: &mut Out) {
        if self.refused_at.is_none_or(|at| context.now - at >= REFUSAL_PERIOD) {
            self.refused_at = Some(context.now);
            self.report(context, Severity::Warning, "take-off-refused", detail, out);
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
