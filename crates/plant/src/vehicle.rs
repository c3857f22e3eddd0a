//! One simulated vehicle: its physics, its sensors, its clock, and the very firmware that a real one would
//! run.

use device::vehicle_link::{FlightMode, ManeuverPhase, PAYLOAD_BYTES_MAX};
use onboard::{Firmware, ImuSample, SettingsError};
use quantity::{Body, GRAVITY_M_S2, Time, Vector};
use settings::{FleetVehicle, Hall, Radio};

use crate::airframe::Airframe;
use crate::clock::VehicleClock;
use crate::command_link::{CommandLink, LinkCounts};
use crate::crazyflie::Crazyflie;
use crate::data_link::DataLink;
use crate::faults::{Fault, Schedule};
use crate::firmware_settings::firmware_settings;
use crate::floor::{Contact, Touchdown};
use crate::imu::{Accelerometer, Gyro};
use crate::output::Outputs;
use crate::random::{Purpose, Stream};
use crate::rigid_body::Motion;
use crate::rotor::ROTORS;
use crate::truth::{Extremes, ManeuverTruth, Recorder, Trajectory, Truth, Watch};

/// What a vehicle shares with the rest of the arena while time passes.
pub(crate) struct Surroundings<'a> {
    pub hall: &'a Hall,
    pub faults: &'a Schedule,
    pub data_link: &'a mut DataLink,
    pub outputs: &'a mut Outputs,
    pub maneuvers: &'a mut Vec<ManeuverTruth>,
    pub trajectories: &'a mut Vec<Trajectory>,
}

/// One simulated vehicle.
#[derive(Clone, Debug)]
pub(crate) struct SimulatedVehicle {
    id: u8,
    /// Its place in the fleet, and among the data link's radios.
    index: usize,
    clock: VehicleClock,
    airframe: Airframe,
    gyro: Gyro,
    accelerometer: Accelerometer,
    brain: Brain,
    motor_commands: [u8; ROTORS],
    hover_thrust_n: f64,
    touchdown: Option<Touchdown>,
    extremes: Extremes,
    watch: Option<Watch>,
    recorder: Option<Recorder>,
    /// A fault has left its mark on the airframe.
    marked: bool,
}

/// What flies it.
#[derive(Clone, Debug)]
enum Brain {
    /// The arena's own firmware, commanded over the command link.
    Onboard(Box<(Firmware, CommandLink)>),
    /// A Crazyflie.
    Crazyflie(Box<Crazyflie>),
}

impl Brain {
    fn new(member: &FleetVehicle, encoder: &settings::CommandLink, seed: u64) -> Result<Self, SettingsError> {
        let vehicle = &member.vehicle;
        Ok(match vehicle.links.radio {
            Radio::Pair => Self::Onboard(Box::new((
                Firmware::new(firmware_settings(vehicle, encoder.channel_bits))?,
                CommandLink::new(vehicle.id, encoder, &vehicle.plant.command_link, seed),
            ))),
            Radio::Crazyradio => Self::Crazyflie(Box::new(Crazyflie::new(vehicle, seed)?)),
        })
    }

    fn firmware(&self) -> &Firmware {
        match self {
            Self::Onboard(onboard) => &onboard.0,
            Self::Crazyflie(crazyflie) => crazyflie.rate_loops(),
        }
    }
}

impl SimulatedVehicle {
    /// A vehicle standing at its start, switched on some time ago.
    ///
    /// # Errors
    /// What the firmware refuses to fly with.
    pub(crate) fn new(
        member: &FleetVehicle,
        encoder: &settings::CommandLink,
        index: usize,
        seed: u64,
        start: Time,
    ) -> Result<Self, SettingsError> {
        let (vehicle, truth) = (&member.vehicle, &member.vehicle.plant);
        let mut build = Stream::new(seed, Purpose::Build, vehicle.id);
        let clock = VehicleClock::new(&truth.clock, start, &mut build);
        let true_weight_n = vehicle.airframe.mass_kg * truth.body.mass_ratio * GRAVITY_M_S2;
        Ok(Self {
            id: vehicle.id,
            index,
            airframe: Airframe::new(member, seed, clock.tick_s(), &mut build),
            gyro: Gyro::new(&truth.gyro, seed, vehicle.id, &mut build),
            accelerometer: Accelerometer::new(&truth.accelerometer, seed, vehicle.id, &mut build),
            brain: Brain::new(member, encoder, seed)?,
            motor_commands: [0; ROTORS],
            hover_thrust_n: true_weight_n / ROTORS as f64,
            touchdown: None,
            extremes: Extremes::default(),
            watch: None,
            recorder: None,
            marked: false,
            clock,
        })
    }

    pub(crate) fn id(&self) -> u8 {
        self.id
    }

    pub(crate) fn firmware(&self) -> &Firmware {
        self.brain.firmware()
    }

    /// Bytes for the encoder of its command link, or for its own radio.
    pub(crate) fn feed(&mut self, now: Time, bytes: &[u8], faults: &Schedule, outputs: &mut Outputs) {
        match &mut self.brain {
            Brain::Onboard(onboard) => onboard.1.feed(now, bytes, faults, outputs),
            Brain::Crazyflie(crazyflie) => crazyflie.feed(now, bytes, faults),
        }
    }

    pub(crate) fn command_link_counts(&self) -> LinkCounts {
        match &self.brain {
            Brain::Onboard(onboard) => onboard.1.counts(),
            Brain::Crazyflie(crazyflie) => crazyflie.counts(),
        }
    }

    pub(crate) fn unused_packets(&self) -> Option<u64> {
        match &self.brain {
            Brain::Onboard(_) => None,
            Brain::Crazyflie(crazyflie) => Some(crazyflie.unused()),
        }
    }

    pub(crate) fn extremes(&self) -> Extremes {
        self.extremes
    }

    pub(crate) fn next_tick_at(&self) -> Time {
        self.clock.next_at()
    }

    pub(crate) fn record_trajectories(&mut self, on: bool) {
        self.recorder = on.then(Recorder::default);
    }

    pub(crate) fn set_battery_ratio(&mut self, charge_ratio: f64) {
        self.airframe.battery_mut().set_charge_ratio(charge_ratio);
    }

    /// Puts the vehicle somewhere, its rotors hovering where it is in the air.
    pub(crate) fn place(&mut self, motion: Motion) {
        let flying = motion.position_m.z > self.airframe.gear_height_m();
        let thrust_n = if flying { self.hover_thrust_n } else { 0.0 };
        self.airframe.place(motion, [thrust_n; ROTORS]);
    }

    /// The motion at an instant between the last tick and the next.
    pub(crate) fn motion_at(&self, now: Time) -> Motion {
        self.airframe.ahead((now - self.clock.tick_at()).as_secs_f64())
    }

    pub(crate) fn truth(&self, now: Time) -> Truth {
        Truth {
            vehicle: self.id,
            at: now,
            motion: self.motion_at(now),
            thrust_n: self.airframe.thrust_n(),
            motor_commands: self.motor_commands,
            battery_ratio: self.airframe.battery().charge_ratio(),
            battery_v: self.airframe.voltage_v(),
            contact: self.airframe.contact(),
            touchdown: self.touchdown,
        }
    }

    /// Lets time pass until `now`: ticks, and what the radios receive between them, in the order of time.
    pub(crate) fn advance(&mut self, now: Time, around: &mut Surroundings<'_>) {
        loop {
            let tick_at = self.clock.next_at();
            self.receive(tick_at.min(now), around);
            if tick_at > now {
                return;
            }
            self.tick(around);
        }
    }

    fn receive(&mut self, until: Time, around: &mut Surroundings<'_>) {
        let (firmware, command_link) = match &mut self.brain {
            Brain::Onboard(onboard) => (&mut onboard.0, &mut onboard.1),
            Brain::Crazyflie(crazyflie) => {
                while crazyflie.next_at().is_some_and(|at| at <= until) {
                    crazyflie.receive(until, |at| self.clock.uptime_at(at));
                }
                return;
            }
        };
        loop {
            let command_at = command_link.next_at().unwrap_or(Time::FAR_FUTURE);
            let payload_at = around.data_link.next_up_at(self.index).unwrap_or(Time::FAR_FUTURE);
            if command_at.min(payload_at) > until {
                return;
            }
            let clock = &self.clock;
            if command_at <= payload_at {
                if let Some((at, Some(frame))) = command_link.arrived(until) {
                    firmware.receive_sbus(clock.uptime_at(at), &frame);
                }
            } else {
                around.data_link.arrived_up(self.index, until, |at, payload| {
                    firmware.receive_payload(clock.uptime_at(at), payload);
                });
            }
        }
    }

    fn tick(&mut self, around: &mut Surroundings<'_>) {
        let before = (self.clock.tick_at(), *self.airframe.motion());
        let touchdown = self.airframe.step();
        self.touchdown = touchdown.or(self.touchdown);
        let uptime = self.clock.advance();
        let now = self.clock.tick_at();
        let (gyro_bias_rad_s, gyro_dead) = self.apply_faults(now, around.faults);
        let motion = *self.airframe.motion();
        let mut rate_rad_s = self.gyro.read(motion.rate_rad_s, gyro_bias_rad_s);
        if gyro_dead {
            rate_rad_s = Vector::new(f64::NAN, f64::NAN, f64::NAN);
        }
        let imu = ImuSample {
            rate_rad_s,
            acceleration_m_s2: self.accelerometer.read(self.airframe.specific_force_m_s2()),
            battery_v: self.airframe.voltage_v(),
        };
        self.motor_commands = match &mut self.brain {
            Brain::Onboard(onboard) => onboard.0.tick(uptime, &imu),
            Brain::Crazyflie(crazyflie) => {
                crazyflie.tick(uptime, &imu, self.airframe.contact() == Contact::Broken)
            }
        };
        self.airframe.command(self.motor_commands);
        let inside = self.airframe.inside(around.hall);
        self.extremes.include(&motion, inside, touchdown.as_ref());
        if let Some(trajectory) = self.recorder.as_mut().and_then(|recorder| recorder.tick(now, &motion)) {
            around.trajectories.push(trajectory);
        }
        self.watch_maneuver(now, uptime, before, touchdown, inside, around);
        match &mut self.brain {
            Brain::Crazyflie(crazyflie) => crazyflie.send(now, around.faults, around.outputs),
            Brain::Onboard(onboard) => {
                let mut payload = [0; PAYLOAD_BYTES_MAX];
                while let Some(length) = onboard.0.poll_transmit(uptime, &mut payload) {
                    let payload = &payload[..length];
                    around.data_link.send_down(self.index, now, payload, around.faults, around.outputs);
                }
            }
        }
    }

    fn watch_maneuver(
        &mut self,
        now: Time,
        uptime: Time,
        (before_at, before): (Time, Motion),
        touchdown: Option<Touchdown>,
        inside: bool,
        around: &mut Surroundings<'_>,
    ) {
        let motion = *self.airframe.motion();
        let running = self.firmware().mode() == FlightMode::Maneuver;
        match (&mut self.watch, running) {
            (None, false) => {}
            (Some(watch), true) => watch.follow(&motion, inside, touchdown.as_ref()),
            (None, true) => {
                let maneuver_id = self.firmware().status(uptime).maneuver_id;
                self.gyro.begin_maneuver();
                self.watch = Some(Watch::begin(maneuver_id, now, motion));
                let recorder = self.recorder.as_mut();
                let unfinished =
                    recorder.and_then(|recorder| recorder.begin(self.id, maneuver_id, now, &motion));
                around.trajectories.extend(unfinished);
            }
            (Some(_), false) => {
                let status = self.firmware().status(uptime);
                let completed = status.maneuver_phase == ManeuverPhase::Completed;
                let ended_uptime = Time::from_nanos(i64::try_from(status.ended_us).unwrap_or(0) * 1_000);
                // The firmware notices at the first tick after the planned end, which lies between the two.
                let ended_at = self.clock.arena_at(ended_uptime).max(before_at).min(now);
                let part = (ended_at - before_at).as_secs_f64() / (now - before_at).as_secs_f64();
                let end = between(&before, &motion, part, (now - before_at).as_secs_f64());
                if let Some(watch) = self.watch.take() {
                    around.maneuvers.push(watch.end(self.id, ended_at, end, completed));
                }
                if let Some(recorder) = &mut self.recorder {
                    recorder.end(ended_at);
                }
            }
        }
    }

    /// Brings the airframe into the state the faults want; answers what they do to the gyros.
    fn apply_faults(&mut self, now: Time, faults: &Schedule) -> (Vector<Body>, bool) {
        let (mut bias_rad_s, mut dead) = (Vector::ZERO, false);
        if faults.is_empty() && !self.marked {
            return (bias_rad_s, dead);
        }
        let mut health_ratio = [1.0; ROTORS];
        for fault in faults.at(now) {
            match fault {
                Fault::WeakRotor { vehicle, rotor, thrust_ratio } if vehicle == self.id => {
                    if let Some(health) = health_ratio.get_mut(usize::from(rotor)) {
                        *health = thrust_ratio;
                    }
                }
                Fault::GyroBias { vehicle, bias_rad_s: bias } if vehicle == self.id => bias_rad_s += bias,
                Fault::GyroNotANumber { vehicle } if vehicle == self.id => dead = true,
                _ => {}
            }
        }
        self.marked = health_ratio != [1.0; ROTORS];
        self.airframe.set_health_ratio(health_ratio);
        (bias_rad_s, dead)
    }
}

/// The motion a part of the way from one tick's to the next's.
fn between(before: &Motion, after: &Motion, part: f64, span_s: f64) -> Motion {
    // Position by the cubic that has both positions and velocities, the rest linearly: exact to 1e-4 within a
    // tick.
    let rest = 1.0 - part;
    let (p0, p1) = (before.position_m, after.position_m);
    let (v0, v1) = (before.velocity_m_s * span_s, after.velocity_m_s * span_s);
    let position_m = p0 * (rest * rest * (1.0 + 2.0 * part))
        + p1 * (part * part * (1.0 + 2.0 * rest))
        + v0 * (part * rest * rest)
        - v1 * (part * part * rest);
    let turn_rad: Vector<Body> = (before.orientation.inverse() * after.orientation).rotation_vector();
    Motion {
        position_m,
        velocity_m_s: before.velocity_m_s * rest + after.velocity_m_s * part,
        orientation: before.orientation.turned(turn_rad * part),
        rate_rad_s: before.rate_rad_s * rest + after.rate_rad_s * part,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quantity::Rotation;

    #[test]
    fn between_two_ticks_lies_what_the_physics_would_give() {
        let span_s = 1.25e-3;
        let at = |t: f64| Motion {
            position_m: Vector::new(3.0 * t + 6.0 * t * t, -t, 0.5 - 4.9 * t * t),
            velocity_m_s: Vector::new(3.0 + 12.0 * t, -1.0, -9.8 * t),
            orientation: Rotation::from_yaw_pitch_roll(0.0, 28.0 * t, 0.0),
            rate_rad_s: Vector::new(0.0, 28.0, 0.0),
        };
        let middle = between(&at(0.0), &at(span_s), 0.3, span_s);
        let truth = at(0.3 * span_s);
        assert!((middle.position_m - truth.position_m).norm() < 1e-12);
        assert!((middle.velocity_m_s - truth.velocity_m_s).norm() < 1e-12);
        assert!(middle.orientation.angle_to(truth.orientation) < 1e-9);
    }
}
