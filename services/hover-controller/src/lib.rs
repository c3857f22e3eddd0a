//! Take-off, hover, recovery and landing.
//!
//! Each state is answered at once with a command, computed for the state *predicted* for its execution. The
//! position loop (`position`) asks for an acceleration, that becomes a thrust and where it shall point, and
//! the attitude loop (`attitude`) turns the vehicle there by body rates; the vehicle's own rate loops do the
//! rest. The same loops catch a vehicle that comes out of a flip in any attitude.
//!
//! `phases` knows whether the vehicle stands, takes off, flies or lands; `safety` knows how old a state may
//! be, and what is commanded when it is older. A controller that starts anew holds a new lease, says nothing
//! to a vehicle it has not seen, holds one that it finds in the air, and lands it if nobody names a goal.

mod attitude;
mod phases;
mod position;
mod reports;
mod safety;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod tuning;
mod vehicle;

use quantity::Time;
use schemas::{VehicleCommand, VehicleGoal, VehicleState, VehicleTelemetry, topics};
use service_core::{Core, Event, Outbox, Start, inputs, outputs};
use settings::{Arena, ConfigError};

use crate::vehicle::VehicleController;

pub use crate::tuning::{AttitudeTuning, PhaseTuning, PositionTuning, SafetyTuning, Tuning};

inputs! {
    /// What the hover controller hears.
    pub enum Input {
        /// Estimates and predictions.
        State(VehicleState) = topics::VEHICLE_STATE,
        /// Where the vehicles shall be.
        Goal(VehicleGoal) = topics::VEHICLE_GOAL,
        /// What the vehicles say of themselves.
        Telemetry(VehicleTelemetry) = topics::VEHICLE_TELEMETRY,
    }
}

outputs! {
    /// What the hover controller says.
    pub enum Output {
        /// Commands.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
    }
}

/// The service.
#[derive(Debug)]
pub struct HoverController {
    vehicles: Vec<(u8, VehicleController)>,
}

impl Core for HoverController {
    const NAME: &'static str = "hover-controller";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check()?;
        let vehicles = arena
            .fleet
            .iter()
            .map(|member| {
                let controller = VehicleController::new(arena, member, &tuning, start.incarnation, start.at);
                (member.vehicle.id, controller)
            })
            .collect();
        Ok(Self { vehicles })
    }

    fn deadline(&self) -> Option<Time> {
        self.vehicles.iter().filter_map(|(_, vehicle)| vehicle.blind_at()).min()
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match event {
            Event::Deadline => {}
            Event::Input(Input::State(state)) => {
                if let Some(vehicle) = self.vehicle(state.vehicle) {
                    vehicle.state(now, &state, out);
                }
            }
            Event::Input(Input::Goal(goal)) => {
                if let Some(vehicle) = self.vehicle(goal.vehicle) {
                    vehicle.goal(now, &goal);
                }
            }
            Event::Input(Input::Telemetry(telemetry)) => {
                if let Some(vehicle) = self.vehicle(telemetry.vehicle) {
                    vehicle.telemetry(now, &telemetry, out);
                }
            }
        }
        for (_, vehicle) in &mut self.vehicles {
            if vehicle.blind_at().is_some_and(|at| at <= now) {
                vehicle.blind(now, out);
            }
        }
    }
}

impl HoverController {
    fn vehicle(&mut self, id: u8) -> Option<&mut VehicleController> {
        self.vehicles.iter_mut().find(|(known, _)| *known == id).map(|(_, vehicle)| vehicle)
    }
}
