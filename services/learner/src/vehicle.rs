//! One vehicle's learning: from the result of a flip to the parameters of the next.

use maneuver::{FinalError, Parameters};
use quantity::Time;
use schemas::{FlipOutcome, FlipParameters, LearnerVerdict, ManeuverParameters, ManeuverResult, Severity};

use crate::Out;
use crate::check::{Forecast, Refusal, Room, check};
use crate::plan::Plan;
use crate::streaks::{Streaks, Verdict};
use crate::tuning::Tuning;

/// One vehicle's learning.
#[derive(Clone, Debug)]
pub(crate) struct VehicleLearning {
    id: u8,
    plan: Plan,
    room: Room,
    iterations: u32,
    /// The flip ordered next, counted from zero.
    iteration: u32,
    /// Its parameters.
    parameters: Parameters,
    /// What is expected of them.
    forecast: Forecast,
    streaks: Streaks,
    /// Why the learning has stopped.
    stopped: Option<String>,
}

/// How far parameters reported as flown may be from those ordered: the link carries single precision.
const SAME_RATIO: f64 = 1e-5;

impl VehicleLearning {
    pub(crate) fn new(id: u8, plan: Plan, room: Room, iterations: u32, tuning: &Tuning) -> Self {
        let mut learning = Self {
            id,
            parameters: plan.first,
            plan,
            room,
            iterations,
            iteration: 0,
            forecast: Forecast::default(),
            streaks: Streaks::default(),
            stopped: None,
        };
        match learning.check(&learning.parameters, tuning) {
            Ok(forecast) => learning.forecast = forecast,
            Err(refusal) => {
                learning.stopped = Some(format!("the first parameters may not be flown: {refusal}"))
            }
        }
        learning
    }

    /// The vehicle's number.
    pub(crate) fn id(&self) -> u8 {
        self.id
    }

    fn check(&self, parameters: &Parameters, tuning: &Tuning) -> Result<Forecast, Refusal> {
        let Plan { model, flown, .. } = &self.plan;
        check(model, flown, parameters, &self.room, &tuning.bounds, &tuning.check)
    }

    /// What the flip manager shall do next.
    pub(crate) fn word(&self) -> ManeuverParameters {
        let verdict = if self.stopped.is_some() {
            LearnerVerdict::Stopped
        } else if self.iteration >= self.iterations {
            LearnerVerdict::Finished
        } else {
            LearnerVerdict::Fly
        };
        let reason = self.stopped.as_deref().map(|reason| cut(reason, 120)).unwrap_or_default();
        let design = &self.plan.flown;
        ManeuverParameters {
            vehicle: self.id,
            verdict,
            iteration: self.iteration,
            flips: design.flips,
            parameters: to_message(&self.parameters),
            rate_rad_s_max: design.rate_rad_s_max,
            envelope_low_m_s2: design.envelope.low_m_s2,
            envelope_high_m_s2: design.envelope.high_m_s2,
            lever_m: self.plan.model.alpha_l_m(),
            duration_s: self.forecast.duration_s,
            height_loss_m: self.forecast.height_loss_m,
            reason: reason.try_into().unwrap_or_default(),
        }
    }

    /// Takes a result; whether it was news. One of an earlier flip is a repetition.
    pub(crate) fn hear(
        &mut self,
        now: Time,
        result: &ManeuverResult,
        tuning: &Tuning,
        out: &mut Out,
    ) -> bool {
        if self.stopped.is_some() || result.iteration < self.iteration {
            return false;
        }
        self.adopt(now, result, tuning, out);
        self.iteration = result.iteration.saturating_add(1);
        let error = from_message(result);
        let measured = result.outcome == FlipOutcome::Completed && error.norm().is_finite();
        let verdict = match result.outcome {
            FlipOutcome::Aborted => self.streaks.bad(&tuning.stop, "ended early"),
            FlipOutcome::Completed if measured => self.streaks.measured(&tuning.stop, error.norm()),
            FlipOutcome::Completed | FlipOutcome::Unmeasured => self.streaks.unmeasured(&tuning.stop),
        };
        if let Verdict::Stop(reason) = verdict {
            self.stop(now, reason, out);
        } else if measured {
            self.learn(now, &error, tuning, out);
        }
        true
    }

    /// Goes on from the parameters flown where they are not the ones ordered: this service was restarted, and
    /// its predecessor ordered them.
    fn adopt(&mut self, now: Time, result: &ManeuverResult, tuning: &Tuning, out: &mut Out) {
        let flown = from_flown(&result.parameters);
        let same = self.parameters.to_array().iter().zip(flown.to_array()).all(|(own, flown)| {
            // Not `>`: what is not a number is not the same.
            (own - flown).abs() <= SAME_RATIO * own.abs()
        });
        if same {
            return;
        }
        let detail = match self.check(&flown, tuning) {
            Ok(forecast) => {
                self.parameters = flown;
                self.forecast = forecast;
                self.streaks = Streaks::default();
                format!("goes on from flip {}, flown with parameters of another start", result.iteration)
            }
            Err(refusal) => {
                format!("flip {} was flown with parameters that may not be: {refusal}", result.iteration)
            }
        };
        out.event(now, Severity::Warning, self.id, "parameters-adopted", &detail);
    }

    /// Corrects the parameters. // Lupashin 2010, eq. (26).
    fn learn(&mut self, now: Time, error: &FinalError, tuning: &Tuning, out: &mut Out) {
        let correction = self.plan.correction(error);
        let (mut step, shortened) = tuning.step.shorten(correction);
        if shortened {
            let detail = format!("flip {}: the step was too long and has been shortened", self.iteration);
            out.event(now, Severity::Info, self.id, "step-shortened", &detail);
        }
        let mut refused = None;
        for _ in 0..=tuning.check.halvings_max {
            let (moved, cut) = tuning.bounds.cut(&self.plan.model, stepped(&self.parameters, &step));
            match self.check(&moved, tuning) {
                Ok(forecast) => {
                    self.parameters = moved;
                    self.forecast = forecast;
                    self.streaks.step_taken();
                    self.report_limits(now, cut, refused, out);
                    return;
                }
                Err(refusal) => refused = Some(refusal),
            }
            step = step.map(|part| 0.5 * part);
        }
        let Some(refusal) = refused else { return };
        let detail = format!("flip {}: no part of the step may be flown: {refusal}", self.iteration);
        out.event(now, Severity::Warning, self.id, "step-refused", &detail);
        if let Verdict::Stop(reason) = self.streaks.step_refused(&tuning.stop, &refusal) {
            self.stop(now, reason, out);
        }
    }

    fn report_limits(&self, now: Time, cut: bool, refused: Option<Refusal>, out: &mut Out) {
        if let Some(refusal) = refused {
            let detail = format!("flip {}: only part of the step may be flown: {refusal}", self.iteration);
            out.event(now, Severity::Info, self.id, "step-halved", &detail);
        }
        if cut {
            let detail = format!("flip {}: a parameter is at its bound", self.iteration);
            out.event(now, Severity::Info, self.id, "parameters-cut", &detail);
        }
    }

    fn stop(&mut self, now: Time, reason: String, out: &mut Out) {
        out.event(now, Severity::Fault, self.id, "learning-stopped", &reason);
        self.stopped = Some(reason);
    }

    /// Reports a learning that was stopped before it began; told once, with the first word.
    pub(crate) fn report_initial_stop(&self, now: Time, out: &mut Out) {
        if let Some(reason) = &self.stopped {
            out.event(now, Severity::Fault, self.id, "learning-stopped", reason);
        }
    }
}

fn stepped(parameters: &Parameters, step: &[f64; 5]) -> Parameters {
    let mut moved = parameters.to_array();
    moved.iter_mut().zip(step).for_each(|(parameter, part)| *parameter += part);
    Parameters::from_array(moved)
}

/// At most that many bytes, cut between characters.
fn cut(text: &str, bytes_max: usize) -> &str {
    let mut end = text.len().min(bytes_max);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

fn to_message(parameters: &Parameters) -> FlipParameters {
    let Parameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s } = *parameters;
    FlipParameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s }
}

fn from_flown(parameters: &FlipParameters) -> Parameters {
    let FlipParameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s } = *parameters;
    Parameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s }
}

fn from_message(result: &ManeuverResult) -> FinalError {
    let error = &result.error;
    FinalError {
        x_m: error.x_m,
        z_m: error.z_m,
        vx_m_s: error.vx_m_s,
        vz_m_s: error.vz_m_s,
        theta_rad: error.theta_rad,
    }
    .wrapped()
}
