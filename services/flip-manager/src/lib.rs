//! The flip manager: brings each vehicle to its place, makes sure that a flip may begin, uploads the
//! learner's parameters, starts the flip, watches it, measures how it ended, and tells the learner.
//!
//! A vehicle flies its flip by itself, from parameters in its own store. What this service owes it is *when*:
//! the `gate` says whether a flip may begin, `phases` and `flip` are the course of the work, `watch` ends a
//! flip that goes wrong, and `end_state` recovers how far from its start a flip ended (Lupashin 2010, section
//! V-B). A vehicle that flies no flips hovers at its place where the others fly.

mod battery;
mod end_state;
mod flip;
mod gate;
mod goals;
mod order;
mod phases;
mod poses;
mod recording;
mod tuning;
mod upload;
mod vehicle;
mod watch;

#[cfg(test)]
mod tests;

use quantity::{Span, Time};
use schemas::{
    ArenaOrder, FlipStatus, LoggerStatus, ManeuverAbort, ManeuverParameters, ManeuverResult, ManeuverStart,
    ManeuverUpload, MocapFrame, VehicleGoal, VehicleState, VehicleTelemetry, topics,
};
use service_core::{Core, Event, Outbox, Start, inputs, outputs};
use settings::{Arena, ConfigError, Hall};

pub use tuning::{
    BatteryTuning, GateTuning, MeasureTuning, RecordingTuning, TimingTuning, Tuning, WatchTuning,
};

use order::StandingOrder;
use phases::{Context, Phase};
use recording::Recording;
use vehicle::Vehicle;

inputs! {
    /// What the flip manager hears.
    pub enum Input {
        /// Poses: what a flip's end is measured with.
        Mocap(MocapFrame) = topics::MOCAP_FRAME,
        /// Estimates: what the gate looks at.
        State(VehicleState) = topics::VEHICLE_STATE,
        /// The vehicles' reports: active set, begin and end of a maneuver, battery.
        Telemetry(VehicleTelemetry) = topics::VEHICLE_TELEMETRY,
        /// The learner's next parameters.
        Parameters(ManeuverParameters) = topics::MANEUVER_PARAMETERS,
        /// What people want.
        Order(ArenaOrder) = topics::ARENA_ORDER,
        /// How the recording fares, if there is one.
        Logger(LoggerStatus) = topics::LOGGER_STATUS,
    }
}

outputs! {
    /// What the flip manager says.
    pub enum Output {
        /// Where a vehicle shall be.
        Goal(VehicleGoal) = topics::VEHICLE_GOAL,
        /// A parameter set for a vehicle's store.
        Upload(ManeuverUpload) = topics::MANEUVER_UPLOAD,
        /// The order to begin.
        Start(ManeuverStart) = topics::MANEUVER_START,
        /// The order to end early.
        Abort(ManeuverAbort) = topics::MANEUVER_ABORT,
        /// How a flip ended.
        Result(ManeuverResult) = topics::MANEUVER_RESULT,
        /// What is being done.
        Status(FlipStatus) = topics::FLIP_STATUS,
    }
}

pub(crate) type Out = Outbox<Output>;

/// The flip manager's core.
#[derive(Debug)]
pub struct FlipManager {
    tuning: Tuning,
    hall: Hall,
    started_at: Time,
    order: StandingOrder,
    recording: Recording,
    vehicles: Vec<Vehicle>,
    next_tick_at: Time,
}

impl Core for FlipManager {
    const NAME: &'static str = "flip-manager";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check()?;
        let vehicles = arena
            .fleet
            .iter()
            .map(|member| {
                let flips = arena.scenario.flip.is_some() && member.vehicle.flips();
                Vehicle::new(member, flips, &tuning, start.at, start.incarnation)
            })
            .collect();
        Ok(Self {
            tuning,
            hall: arena.hall.clone(),
            started_at: start.at,
            order: StandingOrder::default(),
            recording: Recording::default(),
            vehicles,
            next_tick_at: start.at,
        })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_tick_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Out) {
        match event {
            Event::Input(input) => self.hear(now, input),
            Event::Deadline => self.tick(now, out),
        }
    }
}

impl FlipManager {
    fn hear(&mut self, now: Time, input: Input) {
        match input {
            Input::Mocap(frame) => {
                for body in frame.bodies.iter() {
                    if let Some(vehicle) = self.vehicle(body.vehicle) {
                        vehicle.hear_pose(frame.exposed_at, body);
                    }
                }
            }
            Input::State(state) => {
                if let Some(vehicle) = self.vehicle(state.vehicle) {
                    vehicle.hear_state(now, state);
                }
            }
            Input::Telemetry(report) => {
                if let Some(vehicle) = self.vehicles.iter_mut().find(|vehicle| vehicle.id == report.vehicle) {
                    vehicle.hear_telemetry(now, report, &self.tuning);
                }
            }
            Input::Parameters(parameters) => {
                if let Some(vehicle) = self.vehicle(parameters.vehicle) {
                    vehicle.hear_parameters(parameters);
                }
            }
            Input::Order(order) => self.order.take(now, order),
            Input::Logger(status) => self.recording.hear(now, &status),
        }
    }

    fn vehicle(&mut self, id: u8) -> Option<&mut Vehicle> {
        self.vehicles.iter_mut().find(|vehicle| vehicle.id == id)
    }

    /// Works every vehicle's phase. A tick that comes late is one tick, not several.
    fn tick(&mut self, now: Time, out: &mut Out) {
        if now < self.next_tick_at {
            return;
        }
        let period = Span::from_secs_f64(self.tuning.timing.tick_s);
        let late = now - self.next_tick_at;
        self.next_tick_at += period * (1 + late.as_nanos() / period.as_nanos());
        let context = Context {
            now,
            wanted: self.order.wanted(now, Span::from_secs_f64(self.tuning.timing.order_timeout_s)),
            started_at: self.started_at,
            recording: &self.recording,
            hall: &self.hall,
            tuning: &self.tuning,
        };
        for index in 0..self.vehicles.len() {
            let nearest_m = nearest_m(&self.vehicles, index, &context);
            let vehicle = &mut self.vehicles[index];
            vehicle.assess(now, &self.hall, nearest_m, &self.tuning);
            let context = Context { wanted: context.wanted.for_vehicle(vehicle.flips), ..context };
            vehicle.advance(&context, out);
            vehicle.speak(&context, out);
        }
    }
}

/// Horizontal distance from a vehicle to the nearest other; zero where one flies unseen.
fn nearest_m(vehicles: &[Vehicle], index: usize, context: &Context) -> f64 {
    let Some(own) = vehicles[index].last_valid else {
        return f64::INFINITY;
    };
    let others = vehicles.iter().enumerate().filter(|(other, _)| *other != index);
    others.fold(f64::INFINITY, |nearest_m, (_, other)| match other.whereabouts(context.now, context.tuning) {
        Ok(None) => nearest_m,
        Ok(Some(position_m)) => nearest_m.min((position_m - own.estimate.position_m).horizontal().norm()),
        Err(vehicle::Unseen) => 0.0,
    })
}

impl Vehicle {
    /// Says goal and status, at their rate and whenever the phase has changed.
    fn speak(&mut self, context: &Context, out: &mut Out) {
        let phase = self.phase.name();
        let due = self.spoke.is_none_or(|(at, said)| {
            said != phase || context.now - at >= Span::from_secs_f64(context.tuning.timing.speak_s)
        });
        if !due {
            return;
        }
        self.spoke = Some((context.now, phase));
        // A vehicle found in the air after a restart keeps what it is doing until the order is known.
        if !(self.phase == Phase::Idle && self.is_high() && !self.is_down(context.now, context.tuning)) {
            out.publish(self.goals.of(phase));
        }
        let at_work = self.attempt.as_ref().map(|attempt| attempt.parameters.iteration);
        let next = self.next.as_ref().map(|next| next.iteration);
        out.publish(FlipStatus {
            vehicle: self.id,
            phase,
            iteration: at_work.or(next).unwrap_or(self.iteration_min),
            gate: self.unmet.0,
            battery_v: self.rest.volts().unwrap_or_default(),
        });
    }
}
