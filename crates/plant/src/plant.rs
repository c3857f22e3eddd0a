//! The simulated arena as a whole: time goes in, device bytes go both ways.

use core::fmt;

use onboard::{Firmware, SettingsError};
use quantity::Time;
use settings::{Arena, Hall, Ports};

use crate::cameras::Cameras;
use crate::command_link::LinkCounts;
use crate::data_link::DataLink;
use crate::faults::{Fault, Schedule};
use crate::output::{DeviceOutput, Outputs};
use crate::rigid_body::Motion;
use crate::truth::{Extremes, ManeuverTruth, Trajectory, Truth};
use crate::vehicle::{SimulatedVehicle, Surroundings};

/// Why there can be no such arena.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlantError {
    /// The scenario has no vehicle.
    NoVehicles,
    /// A vehicle's firmware refuses its settings.
    Firmware {
        /// The vehicle.
        vehicle: u8,
        /// What it refuses.
        error: SettingsError,
    },
}

impl fmt::Display for PlantError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoVehicles => write!(f, "the scenario has no vehicle to simulate"),
            Self::Firmware { vehicle, error } => write!(f, "vehicle {vehicle}: {error}"),
        }
    }
}

impl core::error::Error for PlantError {}

/// The simulated hall with everything in it.
///
/// It has no clock: [`Plant::advance`] lets time pass until the instant it is given, and
/// [`Plant::next_event`] tells until when nothing will come out by itself. The same settings, seed and calls
/// give the same bytes.
#[derive(Clone, Debug)]
pub struct Plant {
    now: Time,
    hall: Hall,
    vehicles: Vec<SimulatedVehicle>,
    cameras: Cameras,
    data_link: DataLink,
    outputs: Outputs,
    faults: Schedule,
    maneuvers: Vec<ManeuverTruth>,
    trajectories: Vec<Trajectory>,
}

impl Plant {
    /// The arena of these settings at `start`: every vehicle stands at its start, switched on.
    ///
    /// # Errors
    /// [`PlantError`].
    pub fn new(arena: &Arena, seed: u64, start: Time) -> Result<Self, PlantError> {
        let devices = &arena.network.devices;
        let vehicles = arena.fleet.iter().enumerate().map(|(index, member)| {
            let refused = |error| PlantError::Firmware { vehicle: member.vehicle.id, error };
            SimulatedVehicle::new(member, &devices.command_link, index, seed, start).map_err(refused)
        });
        Ok(Self {
            now: start,
            hall: arena.hall.clone(),
            vehicles: vehicles.collect::<Result<_, _>>()?,
            cameras: Cameras::new(&arena.fleet, &devices.motion_capture, seed, start)
                .ok_or(PlantError::NoVehicles)?,
            data_link: DataLink::new(&arena.fleet, seed),
            outputs: Outputs::new(),
            faults: Schedule::default(),
            maneuvers: Vec::new(),
            trajectories: Vec::new(),
        })
    }

    /// The earliest instant at which a device could send something, if nothing is received before.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let least_delay = self.data_link.least_down_delay();
        let telemetry = self.vehicles.iter().map(|vehicle| vehicle.next_tick_at() + least_delay).min();
        let exposure = self.cameras.next_at();
        let output = self.outputs.next_at().unwrap_or(Time::FAR_FUTURE);
        exposure.min(output).min(telemetry.unwrap_or(Time::FAR_FUTURE))
    }

    /// Lets time pass until `now` and hands out what the devices send until then, in the order of its time. A
    /// `now` before the last changes nothing.
    pub fn advance(&mut self, now: Time, out: &mut impl FnMut(DeviceOutput<'_>)) {
        while self.cameras.next_at() <= now {
            let exposure = self.cameras.next_at();
            self.advance_vehicles(exposure);
            let Self { cameras, vehicles, faults, outputs, .. } = self;
            cameras.expose(|index| vehicles[index].motion_at(exposure), faults, outputs);
        }
        self.advance_vehicles(now);
        self.now = self.now.max(now);
        self.faults.prune(now);
        self.outputs.send(now, out);
    }

    fn advance_vehicles(&mut self, now: Time) {
        let Self { hall, vehicles, data_link, outputs, faults, maneuvers, trajectories, .. } = self;
        let mut around = Surroundings { hall, faults, data_link, outputs, maneuvers, trajectories };
        for vehicle in vehicles {
            vehicle.advance(now, &mut around);
        }
    }

    /// Bytes that a bridge hands to a device at `now`: to a vehicle's command-link encoder or a Crazyflie
    /// ([`Ports::command_link`]), to the data link's coordinator ([`Ports::DATA_LINK`]) or to the motion-capture
    /// system ([`Ports::MOTION_CAPTURE`]). Other ports lead nowhere.
    pub fn receive(&mut self, now: Time, port: u16, bytes: &[u8]) {
        if port == Ports::MOTION_CAPTURE {
            self.cameras.receive(now, bytes, &mut self.outputs);
        } else if port == Ports::DATA_LINK {
            self.data_link.feed(now, bytes, &self.faults, &mut self.outputs);
        } else if let Some(id) = Ports::vehicle_of_command_link(port) {
            let vehicle = self.vehicles.iter_mut().find(|vehicle| vehicle.id() == id);
            if let Some(vehicle) = vehicle {
                vehicle.feed(now, bytes, &self.faults, &mut self.outputs);
            }
        }
    }

    /// Makes something go wrong from `begins` until just before `ends`.
    pub fn fault(&mut self, fault: Fault, begins: Time, ends: Time) {
        self.faults.add(fault, begins, ends);
    }

    /// Ends all faults.
    pub fn clear_faults(&mut self) {
        self.faults.clear(self.now);
    }

    /// The instant up to which time has passed.
    #[must_use]
    pub fn now(&self) -> Time {
        self.now
    }

    /// The vehicles' ids, in the scenario's order.
    pub fn vehicles(&self) -> impl Iterator<Item = u8> + '_ {
        self.vehicles.iter().map(SimulatedVehicle::id)
    }

    /// A vehicle's true state now.
    #[must_use]
    pub fn truth(&self, vehicle: u8) -> Option<Truth> {
        self.find(vehicle).map(|found| found.truth(self.now))
    }

    /// A vehicle's bounds since the start.
    #[must_use]
    pub fn extremes(&self, vehicle: u8) -> Option<Extremes> {
        self.find(vehicle).map(SimulatedVehicle::extremes)
    }

    /// A vehicle's firmware, to look at; of a Crazyflie, its rate loops.
    #[must_use]
    pub fn firmware(&self, vehicle: u8) -> Option<&Firmware> {
        self.find(vehicle).map(SimulatedVehicle::firmware)
    }

    /// Packets to a Crazyflie that said nothing it simulates; `None` for another vehicle.
    #[must_use]
    pub fn unused_packets(&self, vehicle: u8) -> Option<u64> {
        self.find(vehicle).and_then(SimulatedVehicle::unused_packets)
    }

    /// What has become of the frames of a vehicle's command link, or of the packets to a Crazyflie.
    #[must_use]
    pub fn command_link_counts(&self, vehicle: u8) -> Option<LinkCounts> {
        self.find(vehicle).map(SimulatedVehicle::command_link_counts)
    }

    /// What has become of a vehicle's payloads on the data link: to it, from it.
    #[must_use]
    pub fn data_link_counts(&self, vehicle: u8) -> Option<(LinkCounts, LinkCounts)> {
        self.data_link.counts(vehicle)
    }

    /// The maneuvers that have ended since this was last asked.
    pub fn maneuver_truths(&mut self) -> Vec<ManeuverTruth> {
        core::mem::take(&mut self.maneuvers)
    }

    /// Switches the recording of trajectories on or off.
    pub fn record_trajectories(&mut self, on: bool) {
        for vehicle in &mut self.vehicles {
            vehicle.record_trajectories(on);
        }
    }

    /// The trajectories finished since this was last asked.
    pub fn trajectories(&mut self) -> Vec<Trajectory> {
        core::mem::take(&mut self.trajectories)
    }

    /// Puts a vehicle somewhere, its rotors hovering where that is in the air: for tests that do not want to
    /// take off.
    pub fn place(&mut self, vehicle: u8, motion: Motion) {
        if let Some(found) = self.find_mut(vehicle) {
            found.place(motion);
        }
    }

    /// Sets a vehicle's charge.
    pub fn set_battery_ratio(&mut self, vehicle: u8, charge_ratio: f64) {
        if let Some(found) = self.find_mut(vehicle) {
            found.set_battery_ratio(charge_ratio);
        }
    }

    fn find(&self, id: u8) -> Option<&SimulatedVehicle> {
        self.vehicles.iter().find(|vehicle| vehicle.id() == id)
    }

    fn find_mut(&mut self, id: u8) -> Option<&mut SimulatedVehicle> {
        self.vehicles.iter_mut().find(|vehicle| vehicle.id() == id)
    }
}
