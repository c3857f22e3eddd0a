//! The learner: corrects the parameters of a flip after each flip by how far from its start it ended
//! (Lupashin 2010, section IV).
//!
//! A low-order model of the vehicle in a vertical plane gives the first parameters and the sensitivity of the
//! final error to them (`plan`). After each flip the parameters move against the measured error (`vehicle`),
//! inside `bounds`, and only as far as flights on deliberately wrong models allow (`check`). What goes wrong
//! several times in a row stops the learning until a person has looked (`streaks`).
//!
//! Where a scenario has no flip, and for a vehicle that flies none, there is nothing to learn.
//!
//! Nothing here knows the simulated vehicle's equations: a learner that shared them would prove nothing.

mod bounds;
mod check;
mod plan;
mod streaks;
mod tuning;
mod vehicle;

#[cfg(test)]
mod tests;

use quantity::{Span, Time};
use schemas::{ManeuverParameters, ManeuverResult, topics};
use service_core::{Core, Event, Outbox, Start, inputs, outputs};
use settings::{Arena, ConfigError};

pub use tuning::{BoundsTuning, CheckTuning, StepTuning, StopTuning, Tuning};

use check::Room;
use plan::Plan;
use vehicle::VehicleLearning;

inputs! {
    /// What the learner hears.
    pub enum Input {
        /// How flips ended.
        Result(ManeuverResult) = topics::MANEUVER_RESULT,
    }
}

outputs! {
    /// What the learner says.
    pub enum Output {
        /// The parameters of the next flip.
        Parameters(ManeuverParameters) = topics::MANEUVER_PARAMETERS,
    }
}

pub(crate) type Out = Outbox<Output>;

/// The learner's core.
#[derive(Debug)]
pub struct Learner {
    tuning: Tuning,
    vehicles: Vec<VehicleLearning>,
    has_spoken: bool,
    next_word_at: Time,
}

impl Core for Learner {
    const NAME: &'static str = "learner";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check(arena)?;
        let mut plans: Vec<Plan> = Vec::new();
        let mut vehicles = Vec::with_capacity(arena.fleet.len());
        let flying =
            arena.scenario.flip.as_ref().map(|flip| arena.fleet.iter().map(move |member| (flip, member)));
        for (flip, member) in flying.into_iter().flatten().filter(|(_, member)| member.vehicle.flips()) {
            let vehicle = &member.vehicle;
            let plan = match plans.iter().find(|plan| plan.fits(vehicle)) {
                Some(plan) => plan.clone(),
                None => Plan::new(arena, flip, vehicle)?,
            };
            plans.push(plan.clone());
            let room = Room::new(&arena.hall, member, &tuning.check);
            vehicles.push(VehicleLearning::new(vehicle.id, plan, room, flip.iterations, &tuning));
        }
        Ok(Self { tuning, vehicles, has_spoken: false, next_word_at: start.at })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_word_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Out) {
        match event {
            Event::Input(Input::Result(result)) => {
                let Some(vehicle) = self.vehicles.iter_mut().find(|vehicle| vehicle.id() == result.vehicle)
                else {
                    return;
                };
                if vehicle.hear(now, &result, &self.tuning, out) {
                    out.publish(vehicle.word());
                }
            }
            Event::Deadline => self.repeat(now, out),
        }
    }
}

impl Learner {
    fn repeat(&mut self, now: Time, out: &mut Out) {
        if now < self.next_word_at {
            return;
        }
        let period = Span::from_secs_f64(self.tuning.repeat_s);
        let late = now - self.next_word_at;
        self.next_word_at += period * (1 + late.as_nanos() / period.as_nanos());
        for vehicle in &self.vehicles {
            if !self.has_spoken {
                vehicle.report_initial_stop(now, out);
            }
            out.publish(vehicle.word());
        }
        self.has_spoken = true;
    }
}
