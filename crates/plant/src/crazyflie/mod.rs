//! A simulated Crazyflie: its radio, its supervisor, its log, and what it makes of setpoints.
//!
//! It speaks CRTP, one packet in each datagram, and answers the null packet with which clients look for vehicles. Its
//! thrust is linear in the command, as the firmware's battery compensation makes it: 65 535 is four times the settings'
//! `rotor.thrust_n_max`. Motors turn by the very rate loops and mixer of the crate `onboard`, which is given what the
//! setpoint asks at every tick; what a Crazyflie does by itself is here:
//!
//! | Age of the newest setpoint | Action |
//! | --- | --- |
//! | up to 0.5 s | fly it |
//! | up to 2 s | level, with the thrust it had |
//! | more | motors off, disarmed |
//!
//! Not simulated: the planner and the position controller (positions, hovers, poses from motion capture are heard and not
//! flown), parameters, memories. Such packets are counted.

mod attitude;
mod log;
mod supervisor;

use device::crtp::{self, LogRequest, PACKET_BYTES_MAX, Packet, Setpoint};
use device::vehicle_link::{CommandFrame, CommandMode};
use onboard::{Firmware, ImuSample, SettingsError};
use quantity::{Body, Span, Time, Vector};
use settings::{ChannelBits, LinkSettings, Vehicle};

use crate::clock::TICK;
use crate::command_link::LinkCounts;
use crate::faults::{Fault, Schedule};
use crate::firmware_settings::firmware_settings;
use crate::output::{Device, Outputs};
use crate::queue::DelayQueue;
use crate::random::{Purpose, Stream};
use crate::rotor::ROTORS;

use attitude::Attitude;
use log::{Log, Values};
use supervisor::Supervisor;

/// Setpoints older than this are no longer flown.
const LEVEL_AFTER: Span = Span::from_millis(500);
/// And older than this, the motors stop.
const OFF_AFTER: Span = Span::from_secs(2);
/// Packets under way at most, each way.
const UNDER_WAY_MAX: usize = 64;
/// Share of a rotor's greatest thrust that the yaw loop may ask for: the paper's vehicle's.
const YAW_THRUST_RATIO: f64 = 0.07;

/// A Crazyflie.
#[derive(Clone, Debug)]
pub(crate) struct Crazyflie {
    vehicle: u8,
    up: Way,
    down: Way,
    air: DelayQueue<Vec<u8>>,
    /// Collective acceleration of a full command, as its builders believe.
    collective_m_s2_max: f64,
    rate_loops: Firmware,
    attitude: Attitude,
    supervisor: Supervisor,
    log: Log,
    setpoint: Option<(Setpoint, Time)>,
    counter: u8,
    answers: Vec<Vec<u8>>,
    unused: u64,
}

/// One direction of its radio.
#[derive(Clone, Debug)]
struct Way {
    settings: LinkSettings,
    stream: Stream,
    last_due: Time,
    counts: LinkCounts,
}

impl Way {
    fn new(settings: &LinkSettings, stream: Stream) -> Self {
        Self { settings: settings.clone(), stream, last_due: Time::ZERO, counts: LinkCounts::default() }
    }

    /// When a packet sent now arrives, if it does. A damaged one does not: the radio checks. None overtakes another.
    fn arrival(&mut self, now: Time, loss_ratio: f64, extra: Span) -> Option<Time> {
        self.counts.sent += 1;
        let delay_s = self.settings.delay_s + self.stream.exponential(self.settings.jitter_s);
        let lost = self.stream.chance(self.settings.loss_ratio.max(loss_ratio));
        let damaged = self.stream.chance(self.settings.corruption_ratio);
        if lost || damaged {
            self.counts.lost += 1;
            return None;
        }
        self.last_due = self.last_due.max(now + extra + Span::from_secs_f64(delay_s));
        Some(self.last_due)
    }
}

impl Crazyflie {
    /// A vehicle just switched on.
    ///
    /// # Errors
    /// What its rate loops cannot fly with.
    pub(crate) fn new(vehicle: &Vehicle, seed: u64) -> Result<Self, SettingsError> {
        let mut rate_loops = firmware_settings(vehicle, ChannelBits::Eleven);
        rate_loops.rates.yaw_thrust_n_max = YAW_THRUST_RATIO * vehicle.rotor.thrust_n_max;
        Ok(Self {
            vehicle: vehicle.id,
            up: Way::new(&vehicle.plant.command_link, Stream::new(seed, Purpose::CommandLink, vehicle.id)),
            down: Way::new(&vehicle.plant.data_link, Stream::new(seed, Purpose::Downlink, vehicle.id)),
            air: DelayQueue::new(),
            collective_m_s2_max: vehicle.collective_m_s2_max(),
            rate_loops: Firmware::new(rate_loops)?,
            attitude: Attitude::default(),
            supervisor: Supervisor::default(),
            log: Log::default(),
            setpoint: None,
            counter: 0,
            answers: Vec::new(),
            unused: 0,
        })
    }

    /// Its rate loops.
    pub(crate) fn rate_loops(&self) -> &Firmware {
        &self.rate_loops
    }

    /// What has become of the packets to it.
    pub(crate) fn counts(&self) -> LinkCounts {
        self.up.counts
    }

    /// Packets that said nothing it simulates.
    pub(crate) fn unused(&self) -> u64 {
        self.unused
    }

    /// A datagram for its radio.
    pub(crate) fn feed(&mut self, now: Time, bytes: &[u8], faults: &Schedule) {
        let (loss_ratio, extra) = self.troubles(now, faults, false);
        match self.up.arrival(now, loss_ratio, extra) {
            Some(due) if self.air.len() < UNDER_WAY_MAX => self.air.push(due, bytes.to_vec()),
            _ => {}
        }
    }

    /// What faults do to a packet: one radio carries both ways, so what silences one silences the other.
    fn troubles(&self, now: Time, faults: &Schedule, down: bool) -> (f64, Span) {
        let (mut loss, mut extra) = (0.0_f64, Span::ZERO);
        for fault in faults.at(now) {
            match fault {
                Fault::CommandLoss { vehicle, loss_ratio } if vehicle == self.vehicle => {
                    loss = loss.max(loss_ratio);
                }
                Fault::DataDownlinkLoss { vehicle, loss_ratio } if down && vehicle == self.vehicle => {
                    loss = loss.max(loss_ratio);
                }
                Fault::CommandDelay { vehicle, delay } if vehicle == self.vehicle => extra = delay,
                _ => {}
            }
        }
        (loss, extra)
    }

    /// When the next packet arrives.
    pub(crate) fn next_at(&self) -> Option<Time> {
        self.air.next_at()
    }

    /// Takes the next packet that has arrived by `until`; `uptime_at` is its clock.
    pub(crate) fn receive(&mut self, until: Time, uptime_at: impl FnOnce(Time) -> Time) {
        if let Some((at, packet)) = self.air.pop_due(until) {
            self.up.counts.delivered += 1;
            self.obey(uptime_at(at), &packet);
        }
    }

    fn obey(&mut self, now: Time, bytes: &[u8]) {
        if let Ok(Some(request)) = LogRequest::decode(bytes) {
            return self.answers.push(self.log.answer(now, &request));
        }
        match Packet::decode(bytes) {
            Ok(Packet::Null(_)) => self.answers.push(crtp::NULL_PACKET.to_vec()),
            Ok(Packet::Echo(_)) => self.answers.push(bytes.to_vec()),
            Ok(Packet::OldEmergencyStop) => self.supervisor.stop(),
            Ok(Packet::OldWatchdog) => self.supervisor.watch(now),
            Ok(Packet::Supervisor(message)) => self.supervise(now, message),
            Ok(Packet::Setpoint(
                setpoint @ (Setpoint::Stop | Setpoint::Rates { .. } | Setpoint::Angles { .. }),
            )) => {
                self.setpoint = Some((setpoint, now));
            }
            _ => self.unused += 1,
        }
    }

    fn supervise(&mut self, now: Time, message: crtp::Supervisor) {
        let answer = |command, done, holds| crtp::Supervisor::Answer { command, done, holds };
        let answer = match message {
            crtp::Supervisor::RequestState => crtp::Supervisor::State(self.supervisor.state(now)),
            crtp::Supervisor::Arm(arm) => {
                let done = self.supervisor.arm(arm);
                answer(1, done, self.supervisor.armed())
            }
            crtp::Supervisor::Recover => {
                let recovered = self.supervisor.recover();
                answer(2, recovered, recovered)
            }
            crtp::Supervisor::Stop => return self.supervisor.stop(),
            crtp::Supervisor::Watchdog => return self.supervisor.watch(now),
            _ => return self.unused += 1,
        };
        let mut out = [0; PACKET_BYTES_MAX];
        if let Ok(length) = Packet::Supervisor(answer).encode(&mut out) {
            self.answers.push(out[..length].to_vec());
        }
    }

    /// One tick: the motors' commands. `broken` where the floor has broken it.
    pub(crate) fn tick(&mut self, now: Time, imu: &ImuSample, broken: bool) -> [u8; ROTORS] {
        let off = !self.supervisor.allows_motors();
        self.attitude.feel(imu, TICK.as_secs_f64(), off);
        let frame = match self.wanted(now) {
            Some((collective_m_s2, rate_rad_s)) if self.supervisor.allows_motors() => CommandFrame {
                mode: CommandMode::Fly,
                collective_m_s2,
                rate_rad_s,
                ..CommandFrame::default()
            },
            _ => CommandFrame { mode: CommandMode::Disarmed, ..CommandFrame::default() },
        };
        self.counter = CommandFrame::next_counter(self.counter);
        self.rate_loops.receive_frame(now, CommandFrame { counter: self.counter, ..frame });
        let commands = self.rate_loops.tick(now, imu);
        let turning = commands != [0; ROTORS];
        self.supervisor.tick(now, self.attitude.tumbled(), broken, turning);
        self.report(now, imu);
        commands
    }

    /// Collective acceleration and rate to fly; `None` with motors off.
    fn wanted(&mut self, now: Time) -> Option<(f64, Vector<Body>)> {
        let (setpoint, heard_at) = self.setpoint?;
        let age = now - heard_at;
        let thrust = thrust_of(&setpoint)?;
        if age > OFF_AFTER {
            self.setpoint = None;
            self.supervisor.arm(false);
            return None;
        }
        let rate_rad_s = match setpoint {
            _ if age > LEVEL_AFTER => self.attitude.rate_towards_rad_s(0.0, 0.0),
            Setpoint::Angles { roll_deg, pitch_deg, yaw_deg_s, .. } => {
                let [roll, pitch, yaw] =
                    [roll_deg, pitch_deg, yaw_deg_s].map(|degrees| f64::from(degrees).to_radians());
                self.attitude.rate_towards_rad_s(roll, pitch) + Vector::Z * yaw
            }
            other => other.rate_rad_s()?,
        };
        Some((self.collective_m_s2_max * f64::from(thrust) / f64::from(u16::MAX), rate_rad_s))
    }

    fn report(&mut self, now: Time, imu: &ImuSample) {
        let (roll, pitch) = self.attitude.roll_pitch_rad();
        let values = Values {
            roll_deg: roll.to_degrees() as f32,
            pitch_deg: pitch.to_degrees() as f32,
            thrust: self.setpoint.and_then(|(setpoint, _)| thrust_of(&setpoint)).map_or(0.0, f32::from),
            yaw_rate_deg_s: imu.rate_rad_s.z.to_degrees() as f32,
            battery_v: imu.battery_v as f32,
            supervisor: self.supervisor.state(now).0,
        };
        let answers = &mut self.answers;
        self.log.reports(now, &values, |packet| answers.push(packet));
    }

    /// Sends what it has to say.
    pub(crate) fn send(&mut self, now: Time, faults: &Schedule, outputs: &mut Outputs) {
        for packet in core::mem::take(&mut self.answers) {
            let (loss_ratio, extra) = self.troubles(now, faults, true);
            if let Some(due) = self.down.arrival(now, loss_ratio, extra) {
                outputs.push(Device::CommandLink(self.vehicle), due, &packet);
            }
        }
    }
}

/// The thrust of a setpoint that is flown; `None` for a stop.
const fn thrust_of(setpoint: &Setpoint) -> Option<u16> {
    match setpoint {
        Setpoint::Rates { thrust, .. } | Setpoint::Angles { thrust, .. } => Some(*thrust),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
