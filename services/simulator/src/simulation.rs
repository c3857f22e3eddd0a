//! The plant with what reaches it and what it says, in order of time.

use std::collections::VecDeque;

use plant::{DeviceOutput, ManeuverTruth, Plant, PlantError, Truth};
use quantity::{Span, Time};
use schemas::{FlipError, Kinematics, PlantManeuver, PlantTruth};
use settings::Arena;

/// How often the truth is told.
pub(crate) const TRUTH_PERIOD: Span = Span::from_millis(20);

/// Bytes that have reached a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// When.
    pub at: Time,
    /// Which device (`settings::Ports`).
    pub port: u16,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// What a simulation says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Said<'a> {
    /// Bytes from a device.
    Device(DeviceOutput<'a>),
    /// A vehicle's true state, every 20 ms.
    Truth(PlantTruth),
    /// How a maneuver truly ended.
    Maneuver(PlantManeuver),
}

/// The plant with what reaches it and what it says, in order of time. It has no clock: time passes by
/// [`Simulation::advance`].
#[derive(Debug)]
pub struct Simulation {
    plant: Plant,
    inbox: VecDeque<Arrival>,
    truth_at: Time,
}

impl Simulation {
    /// The scenario's arena at `start`.
    ///
    /// # Errors
    /// Settings the plant cannot work with.
    pub fn new(arena: &Arena, seed: u64, start: Time) -> Result<Self, PlantError> {
        Ok(Self { plant: Plant::new(arena, seed, start)?, inbox: VecDeque::new(), truth_at: start })
    }

    /// The instant up to which time has passed.
    #[must_use]
    pub fn now(&self) -> Time {
        self.plant.now()
    }

    /// The earliest instant at which it could have something to say, if nothing arrives before.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let arrival = self.inbox.front().map_or(Time::FAR_FUTURE, |arrival| arrival.at);
        self.plant.next_event().min(self.truth_at).min(arrival)
    }

    /// Takes bytes for a device, to be delivered at the time of their arrival, or at once should that have
    /// passed.
    pub fn receive(&mut self, arrival: Arrival) {
        // Sockets are read one after the other, so what they bring is nearly in order, and short.
        let place =
            self.inbox.iter().rposition(|earlier| earlier.at <= arrival.at).map_or(0, |place| place + 1);
        self.inbox.insert(place, arrival);
    }

    /// Lets time pass until `until`: delivers what has arrived by then, each at its time, and says what there
    /// is to say, in order.
    pub fn advance(&mut self, until: Time, say: &mut dyn FnMut(Said<'_>)) {
        loop {
            let arrival_at = self.inbox.front().map_or(Time::FAR_FUTURE, |arrival| arrival.at);
            let next = arrival_at.min(self.truth_at);
            if next > until {
                break;
            }
            self.plant.advance(next, &mut |output| say(Said::Device(output)));
            if arrival_at <= self.truth_at {
                if let Some(arrival) = self.inbox.pop_front() {
                    self.plant.receive(self.plant.now(), arrival.port, &arrival.bytes);
                }
            } else {
                self.truth_at += TRUTH_PERIOD;
                self.tell_truth(say);
            }
        }
        self.plant.advance(until, &mut |output| say(Said::Device(output)));
    }

    fn tell_truth(&mut self, say: &mut dyn FnMut(Said<'_>)) {
        for vehicle in self.plant.vehicles() {
            if let Some(truth) = self.plant.truth(vehicle) {
                say(Said::Truth(truth_message(&truth)));
            }
        }
        for maneuver in self.plant.maneuver_truths() {
            say(Said::Maneuver(maneuver_message(&maneuver)));
        }
    }
}

fn truth_message(truth: &Truth) -> PlantTruth {
    let motion = truth.motion;
    PlantTruth {
        vehicle: truth.vehicle,
        at: truth.at,
        truth: Kinematics {
            position_m: motion.position_m,
            velocity_m_s: motion.velocity_m_s,
            orientation: motion.orientation,
            rate_rad_s: motion.rate_rad_s,
        },
        battery_ratio: truth.battery_ratio,
    }
}

fn maneuver_message(maneuver: &ManeuverTruth) -> PlantManeuver {
    let error = maneuver.error;
    PlantManeuver {
        vehicle: maneuver.vehicle,
        maneuver_id: maneuver.maneuver_id,
        began_at: maneuver.began_at,
        ended_at: maneuver.ended_at,
        error: FlipError {
            x_m: error.x_m,
            z_m: error.z_m,
            vx_m_s: error.vx_m_s,
            vz_m_s: error.vz_m_s,
            theta_rad: error.theta_rad,
        },
    }
}

#[cfg(test)]
mod tests;
