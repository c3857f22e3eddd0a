//! Where each vehicle is, and where it will be when a command takes effect.
//!
//! Camera poses describe the past, by the latency of motion capture; commands act in the future, by the delay
//! of the command link. Per vehicle a filter lives at the newest exposure, moved from frame to frame by a
//! model of the vehicle (`model`) that flies the very commands the radio sent (`commands`), and corrected
//! by the poses that pass the gate (`gate`). From there the same model predicts, through the commands
//! already sent, the state in which the vehicle will execute the next one (`predict`).
//!
//! In a maneuver the vehicle ignores commands: the filter then follows the cameras alone. Without poses it
//! coasts on the model, says so, and after 100 ms says that nothing may be flown on it.

mod attitude;
mod chain;
mod commands;
mod filter;
mod gate;
mod maneuver;
mod model;
mod predict;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod trail;
mod translation;
mod tuning;
mod vehicle;

use quantity::{Span, Time};
use schemas::{CommandSent, MocapFrame, Severity, VehicleState, VehicleTelemetry, topics};
use service_core::{Core, Event, Outbox, Start, inputs, outputs};
use settings::{Arena, ConfigError};

use crate::gate::Neighbour;
use crate::vehicle::VehicleEstimator;

pub use crate::tuning::{GateTuning, ModelTuning, NoiseTuning, TimingTuning, Tuning};

inputs! {
    /// What the estimator hears.
    pub enum Input {
        /// Poses.
        Mocap(MocapFrame) = topics::MOCAP_FRAME,
        /// What the radio sent.
        Sent(CommandSent) = topics::COMMAND_SENT,
        /// What the vehicles say of themselves.
        Telemetry(VehicleTelemetry) = topics::VEHICLE_TELEMETRY,
    }
}

outputs! {
    /// What the estimator says.
    pub enum Output {
        /// Estimates and predictions.
        State(VehicleState) = topics::VEHICLE_STATE,
    }
}

/// Refused frames are reported at most this often.
const REPORT_PERIOD: Span = Span::from_secs(1);

/// The service.
#[derive(Debug)]
pub struct Estimator {
    vehicles: Vec<(u8, VehicleEstimator)>,
    stamp_tolerance: Span,
    report_at: Time,
    mistimed: u32,
    neighbours: Vec<Option<Neighbour>>,
    others: Vec<Neighbour>,
}

impl Core for Estimator {
    const NAME: &'static str = "estimator";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check()?;
        let vehicles = arena
            .fleet
            .iter()
            .map(|member| {
                let vehicle = &member.vehicle;
                (vehicle.id, VehicleEstimator::new(arena, vehicle, &tuning, start.at))
            })
            .collect();
        Ok(Self {
            vehicles,
            stamp_tolerance: Span::from_secs_f64(tuning.timing.stamp_tolerance_s),
            report_at: start.at,
            mistimed: 0,
            neighbours: Vec::new(),
            others: Vec::new(),
        })
    }

    fn deadline(&self) -> Option<Time> {
        self.vehicles.iter().map(|(_, vehicle)| vehicle.publish_at()).min()
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match event {
            Event::Deadline => {}
            Event::Input(Input::Mocap(frame)) => self.frame(now, &frame, out),
            Event::Input(Input::Sent(sent)) => {
                if let Some(vehicle) = self.vehicle(sent.vehicle) {
                    vehicle.command_sent(&sent);
                }
            }
            Event::Input(Input::Telemetry(telemetry)) => {
                if let Some(vehicle) = self.vehicle(telemetry.vehicle) {
                    vehicle.telemetry(now, &telemetry);
                }
            }
        }
        for (_, vehicle) in &mut self.vehicles {
            if vehicle.publish_at() <= now {
                vehicle.silence(now, out);
            }
        }
    }
}

impl Estimator {
    fn vehicle(&mut self, id: u8) -> Option<&mut VehicleEstimator> {
        self.vehicles.iter_mut().find(|(known, _)| *known == id).map(|(_, vehicle)| vehicle)
    }

    fn frame(&mut self, now: Time, frame: &MocapFrame, out: &mut Outbox<Output>) {
        let age = frame.received_at.min(now) - frame.exposed_at;
        // A frame's stamp comes from its number. Where the numbers slip, stamps are wrong until the bridge
        // has found the new rhythm, and a wrong stamp is a wrong velocity: better none.
        if (age - Span::from_secs_f64(frame.latency_s)).abs() > self.stamp_tolerance {
            self.mistimed += 1;
            if now >= self.report_at {
                let detail = format!("{age} old on arrival; {} such since the last report", self.mistimed);
                out.event(now, Severity::Warning, 0, "frame-mistimed", &detail);
                self.mistimed = 0;
                self.report_at = now + REPORT_PERIOD;
            }
            return;
        }
        // Where everybody is, before this frame moves anybody.
        let alone = self.vehicles.len() == 1;
        if !alone {
            let neighbours =
                self.vehicles.iter().map(|(_, vehicle)| vehicle.as_neighbour(now, frame.exposed_at));
            self.neighbours.clear();
            self.neighbours.extend(neighbours);
        }
        for body in frame.bodies.iter() {
            let Some(index) = self.vehicles.iter().position(|(id, _)| *id == body.vehicle) else {
                continue;
            };
            self.others.clear();
            if !alone {
                let others = self.neighbours.iter().enumerate().filter(|(other, _)| *other != index);
                self.others.extend(others.filter_map(|(_, neighbour)| *neighbour));
            }
            self.vehicles[index].1.pose(now, frame, body, &self.others, out);
        }
    }
}
