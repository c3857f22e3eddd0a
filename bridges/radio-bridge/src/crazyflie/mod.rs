//! A Crazyflie: one radio that carries setpoints there, and answers back.
//!
//! ```text
//!   slots ────────▶ setpoints ─┐
//!   supervisor: arm, state ────┤
//!   log: battery ──────────────┼─▶ radio/tx, port command_link(vehicle): a packet each
//!   echo: delay ───────────────┤
//!   stop ──────────────────────┘
//!   radio/rx, port command_link(vehicle) ─▶ state ─▶ vehicle/telemetry
//! ```
//!
//! It is armed by the supervisor when flying is commanded after a command to stay off, and disarmed by such a command:
//! one that has stopped its motors by itself is not started again from wherever its controller believes it to be. Its
//! report is the supervisor's
//! state, with the battery's voltage by the log; without both there is none. It has no clock to be fitted, so the
//! command link's delay is half an echo's round trip.
//!
//! An emergency stop is sent in both the forms that firmware knows. The vehicle is then locked, and says so, until
//! it is restarted by hand; the release of this bridge's own latch does not change that. What was a crash, the
//! release does recover.
//!
//! The vehicle's watchdog stops it, locked, a second after the bridge was last heard. Its setpoints have a timeout of
//! their own, which levels it first; so the watchdog is begun only where `crazyflie_watchdog` says so.
//!
//! Poses are not sent to it: the bridge does not hear motion capture, and rates need none.

mod log;
mod setpoints;

use std::collections::VecDeque;

use device::crtp::{LogReply, PACKET_BYTES_MAX, Packet, Supervisor, SupervisorState};
use device::vehicle_link::Uplink;
use quantity::{Span, Time};
use schemas::{CommandMode, DeviceBytes, FlightMode, Severity, VehicleTelemetry};
use service_core::Outbox;
use settings::Ports;

use crate::Output;
use crate::form::Form;
use crate::helm::Helm;
use crate::slots::{Served, Slot};
use crate::tuning::Tuning;

use log::{LogClient, LogNews};

pub(crate) use setpoints::Setpoints;

/// Time between two requests of the supervisor's state.
const STATE_PERIOD: Span = Span::from_millis(50);
/// Time between two orders to arm or to disarm, while the state says otherwise.
const ARM_PERIOD: Span = Span::from_millis(50);
/// Time between two signs of life for the watchdog.
const WATCHDOG_PERIOD: Span = Span::from_millis(200);
/// Time between two echoes, and while the delay is not known yet.
const ECHO_PERIOD: Span = Span::from_millis(200);
/// Echoes that are still waited for.
const ECHOES_MAX: usize = 32;
/// What the bytes of an echo begin with.
const ECHO_MARK: u8 = 0xA7;
/// A state older than this is not acted on.
const STATE_AGE_MAX: Span = Span::from_millis(500);
/// A voltage older than this is not reported.
const VOLTAGE_AGE_MAX: Span = Span::from_secs(5);

/// One Crazyflie.
#[derive(Clone, Debug)]
pub(crate) struct Crazyflie {
    /// Who commands it, and what.
    pub(crate) helm: Helm,
    log: LogClient,
    echoes: Echoes,
    watchdog: bool,
    watchdog_at: Time,
    state_at: Time,
    arm_at: Time,
    state: Option<(SupervisorState, Time)>,
    voltage: Option<(f64, Time)>,
    /// Whether it is to be armed, by the slot last served; `None` in silence.
    wanted_armed: Option<bool>,
    /// It was told to stay off since it was last armed, and since the last silence.
    rested: bool,
    sent_at: Option<Time>,
    locked: bool,
    lost: bool,
    begun: bool,
}

/// Echoes on their way.
#[derive(Clone, Debug)]
struct Echoes {
    next_at: Time,
    token: u16,
    waiting: VecDeque<(u16, Time)>,
}

/// What came of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Heard {
    /// Nothing for the bus.
    Used,
    /// A report.
    Report(VehicleTelemetry),
    /// It is no packet, or says what stands for nothing.
    Damaged,
}

impl Crazyflie {
    /// A vehicle not heard of yet, to be asked from `first_at` on.
    pub(crate) fn new(member: &settings::Vehicle, tuning: &Tuning, first_at: Time, token: u16) -> Self {
        Self {
            helm: Helm::new(member, Form::Setpoints(Setpoints::new(member)), tuning),
            log: LogClient::new(first_at),
            echoes: Echoes { next_at: first_at, token, waiting: VecDeque::new() },
            watchdog: tuning.crazyflie_watchdog,
            watchdog_at: first_at,
            state_at: first_at,
            arm_at: first_at,
            state: None,
            voltage: None,
            wanted_armed: None,
            rested: false,
            sent_at: None,
            locked: false,
            lost: false,
            begun: false,
        }
    }

    /// When it is to be spoken to next, slots apart.
    pub(crate) fn due_at(&self) -> Time {
        let mut due = self.state_at.min(self.log.due_at()).min(self.echoes.next_at);
        if self.watchdog {
            due = due.min(self.watchdog_at);
        }
        if self.arm_order().is_some() {
            due = due.min(self.arm_at);
        }
        self.helm.stop.due_at().map_or(due, |at| due.min(at))
    }

    /// Serves a slot.
    pub(crate) fn serve_slot(&mut self, now: Time, slot: Slot) -> Served {
        let flying = self.fresh_state(now).is_some_and(|state| mode(state) == FlightMode::Flying);
        self.helm.commands.note_flying(flying);
        let served = self.helm.serve(now, slot);
        self.wanted_armed = match &served {
            Served::Sent { report, .. } => Some(report.mode != CommandMode::Disarmed),
            _ => None,
        };
        match self.wanted_armed {
            None => self.rested = false,
            Some(armed) => {
                self.rested |= !armed;
                self.sent_at = Some(now);
            }
        }
        served
    }

    /// Says what is due, slots apart.
    pub(crate) fn serve(&mut self, now: Time, out: &mut Outbox<Output>) -> u64 {
        let (port, mut sent) = (Ports::command_link(self.helm.id), 0);
        let mut send = |packet: &[u8]| {
            sent += 1;
            let bytes = packet.try_into().expect("a packet is within the bound of device bytes");
            out.publish(DeviceBytes { port, at: now, bytes });
        };
        let fallen = self.state.is_some_and(|(state, _)| {
            state.has(SupervisorState::CRASHED) || state.has(SupervisorState::TUMBLED)
        });
        self.helm.stop.send_due(now, |uplink| match uplink {
            Uplink::Stop => {
                send_packet(&Packet::Supervisor(Supervisor::Stop), &mut send);
                send_packet(&Packet::OldEmergencyStop, &mut send);
            }
            _ if fallen => send_packet(&Packet::Supervisor(Supervisor::Recover), &mut send),
            _ => {}
        });
        if let Some(arm) = self.arm_order().filter(|_| now >= self.arm_at) {
            self.arm_at = now.saturating_add(ARM_PERIOD);
            send_packet(&Packet::Supervisor(Supervisor::Arm(arm)), &mut send);
        }
        if now >= self.state_at {
            self.state_at = now.saturating_add(STATE_PERIOD);
            send_packet(&Packet::Supervisor(Supervisor::RequestState), &mut send);
        }
        if self.watchdog && now >= self.watchdog_at {
            self.watchdog_at = now.saturating_add(WATCHDOG_PERIOD);
            send_packet(&Packet::Supervisor(Supervisor::Watchdog), &mut send);
            send_packet(&Packet::OldWatchdog, &mut send);
        }
        self.echoes.send_due(now, &mut send);
        self.log.send_due(now, send);
        sent
    }

    /// The order that brings the vehicle's arming to what is wanted; none to one that arms by itself or is locked.
    fn arm_order(&self) -> Option<bool> {
        let (state, _) = self.state?;
        let wanted = self.wanted_armed?;
        let leave = state.has(SupervisorState::ARMS_ITSELF) || state.has(SupervisorState::LOCKED);
        let possible = !leave && (self.rested || !wanted);
        (possible && state.has(SupervisorState::ARMED) != wanted).then_some(wanted)
    }

    fn fresh_state(&self, now: Time) -> Option<SupervisorState> {
        self.state.filter(|(_, at)| now - *at <= STATE_AGE_MAX).map(|(state, _)| state)
    }

    /// A packet from the vehicle.
    pub(crate) fn hear(
        &mut self,
        now: Time,
        arrived: Time,
        packet: &[u8],
        out: &mut Outbox<Output>,
    ) -> Heard {
        match LogReply::decode(packet) {
            Ok(None) => {}
            Ok(Some(reply)) => {
                match self.log.hear(now, &reply) {
                    LogNews::None => {}
                    LogNews::Voltage(volts) => self.voltage = Some((volts, arrived)),
                    LogNews::Absent => {
                        let detail = "its log has no pm.vbat: no reports of it";
                        out.event(now, Severity::Warning, self.helm.id, "battery-unknown", detail);
                    }
                }
                return Heard::Used;
            }
            Err(_) => return Heard::Damaged,
        }
        match Packet::decode(packet) {
            Ok(Packet::Supervisor(Supervisor::State(state))) => self.hear_state(now, arrived, state, out),
            Ok(Packet::Echo(&[ECHO_MARK, low, high])) => {
                if let Some(sent) = self.echoes.answered(u16::from_le_bytes([low, high])) {
                    self.helm.delay.measure((arrived - sent) / 2);
                }
                Heard::Used
            }
            Ok(_) => Heard::Used,
            Err(_) => Heard::Damaged,
        }
    }

    fn hear_state(
        &mut self,
        now: Time,
        arrived: Time,
        state: SupervisorState,
        out: &mut Outbox<Output>,
    ) -> Heard {
        self.state = Some((state, arrived));
        if state.has(SupervisorState::ARMED) && self.wanted_armed != Some(false) {
            self.rested = false;
        }
        let locked = state.has(SupervisorState::LOCKED);
        if locked && !self.locked {
            let detail = "its supervisor is locked: it must be restarted by hand";
            out.event(now, Severity::Fault, self.helm.id, "crazyflie-locked", detail);
        }
        self.locked = locked;
        if std::mem::replace(&mut self.lost, false) {
            out.event(now, Severity::Info, self.helm.id, "telemetry-back", "the vehicle reports again");
        }
        let voltage = self.voltage.filter(|(_, at)| arrived - *at <= VOLTAGE_AGE_MAX);
        let Some((battery_v, _)) = voltage else { return Heard::Used };
        self.begun = true;
        Heard::Report(VehicleTelemetry {
            vehicle: self.helm.id,
            mode: mode(state),
            received_at: arrived,
            battery_v,
            command_age_s: self.sent_at.map_or(0.0, |at| (arrived - at).as_secs_f64().max(0.0)),
            link_delay_s: self.helm.delay.delay_s(),
            ..VehicleTelemetry::default()
        })
    }

    /// Whether the vehicle's reports have just been lost: no state for `longest`.
    pub(crate) fn lose(&mut self, now: Time, longest: Span) -> bool {
        let silent = self.begun && self.state.is_some_and(|(_, heard_at)| now - heard_at > longest);
        silent && !std::mem::replace(&mut self.lost, true)
    }
}

/// What a supervisor's state is to the arena. Its motors may turn only while it is armed; one that arms by itself is
/// armed on the floor too.
fn mode(state: SupervisorState) -> FlightMode {
    if state.has(SupervisorState::LOCKED) {
        FlightMode::Stopped
    } else if state.has(SupervisorState::CRASHED) || state.has(SupervisorState::TUMBLED) {
        FlightMode::Landed
    } else if !state.has(SupervisorState::ARMED)
        || state.has(SupervisorState::ARMS_ITSELF) && !state.has(SupervisorState::FLYING)
    {
        FlightMode::Disarmed
    } else {
        FlightMode::Flying
    }
}

fn send_packet(packet: &Packet<'_>, send: &mut impl FnMut(&[u8])) {
    let mut out = [0; PACKET_BYTES_MAX];
    if let Ok(length) = packet.encode(&mut out) {
        send(&out[..length]);
    }
}

impl Echoes {
    fn send_due(&mut self, now: Time, send: &mut impl FnMut(&[u8])) {
        if now < self.next_at {
            return;
        }
        self.next_at = now.saturating_add(ECHO_PERIOD);
        self.token = self.token.wrapping_add(1);
        if self.waiting.len() == ECHOES_MAX {
            self.waiting.pop_front();
        }
        self.waiting.push_back((self.token, now));
        let [low, high] = self.token.to_le_bytes();
        send_packet(&Packet::Echo(&[ECHO_MARK, low, high]), send);
    }

    /// When the echo with that token was sent; each is answered once.
    fn answered(&mut self, token: u16) -> Option<Time> {
        let place = self.waiting.iter().position(|(waiting, _)| *waiting == token)?;
        self.waiting.remove(place).map(|(_, sent)| sent)
    }
}

#[cfg(test)]
mod tests;
