//! Commands and parameters in, radio bytes out; telemetry back.
//!
//! ```text
//!   vehicle/command ─▶ lease ─▶ slots ─┬─ 50 Hz ─▶ radio/tx, port command_link(vehicle): SBUS or CRSF
//!                                      └─▶ vehicle/command-sent, as quantised
//!   maneuver/upload ─▶ upload ─┐
//!   maneuver/start  ─▶ orders ─┼─▶ data_link ─▶ radio/tx, port DATA_LINK: XBee TX16, escaped
//!   maneuver/abort  ─▶ orders ─┤
//!                       pings ─┘
//!   radio/rx, port DATA_LINK ─▶ data_link ─┬─▶ Pong ─▶ clock: vehicle's uptime -> arena time
//!                                          ├─▶ UploadReply ─▶ upload
//!                                          └─▶ Status ─▶ delay, telemetry ─▶ vehicle/telemetry
//! ```
//!
//! The *command link* is one way, a frame per vehicle and slot. In a slot for which there is no valid command
//! the bridge is silent: it never repeats one, since silence is what the vehicle's own failsafe acts on. Of
//! several controllers only the one with the highest lease epoch is heard.
//!
//! A vehicle that is a Crazyflie has one radio for both, which speaks CRTP: `crazyflie` is its side of all this.
//!
//! The *data link* loses frames, so what matters is repeated until it is known to have arrived: see
//! [`Tuning`] for the intervals. Everything sent on either link leaves as [`DeviceBytes`] with the instant it
//! was handed over.

mod clock;
mod crazyflie;
mod data_link;
mod delay;
mod encoder;
mod form;
mod helm;
mod lease;
mod orders;
mod reports;
mod slots;
mod stop;
mod telemetry;
mod tuning;
mod upload;
mod vehicle;

use device::vehicle_link::Downlink;
use device::xbee::TransmitResult;
use quantity::{Span, Time};
use schemas::{
    CommandSent, DeviceBytes, ManeuverAbort, ManeuverStart, ManeuverUpload, Severity, StopKind, StopOrder,
    VehicleCommand, VehicleTelemetry, topics,
};
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError, Ports, Radio};

use crazyflie::Crazyflie;
use data_link::{DataLink, Heard};
use encoder::Encoder;
use helm::Helm;
use lease::Admission;
use reports::Reports;
use slots::{Schedule, Served};
use vehicle::{Pace, Reaction, Vehicle};

pub use reports::Counters;
pub use tuning::Tuning;

service_core::inputs! {
    /// What the bridge hears.
    pub enum Input {
        /// A command to a vehicle.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
        /// A parameter set for a vehicle's store.
        Upload(ManeuverUpload) = topics::MANEUVER_UPLOAD,
        /// An order to begin a maneuver.
        Start(ManeuverStart) = topics::MANEUVER_START,
        /// An order to end one early.
        Abort(ManeuverAbort) = topics::MANEUVER_ABORT,
        /// The emergency stop, or its release.
        Stop(StopOrder) = topics::STOP_ORDER,
        /// Bytes from the data link's radio.
        Received(DeviceBytes) = topics::RADIO_RX,
    }
}

service_core::outputs! {
    /// What the bridge says.
    pub enum Output {
        /// Bytes for a radio.
        Transmit(DeviceBytes) = topics::RADIO_TX,
        /// What a slot carried.
        Sent(CommandSent) = topics::COMMAND_SENT,
        /// What a vehicle reports.
        Telemetry(VehicleTelemetry) = topics::VEHICLE_TELEMETRY,
    }
}

/// Commands of an overtaken controller that may still be on their way; more of them mean that it is still
/// there.
const CONFLICT_COMMANDS_MIN: u64 = 3;
/// Of a command link's packets so many should arrive, in percent; ExpressLRS's own warning level.
const QUALITY_PERCENT_MIN: u8 = 50;
/// Payloads in a row that a vehicle's radio has not acknowledged, before it is reported.
const UNDELIVERED_REPORTED: u32 = 10;

/// The radio bridge.
#[derive(Clone, Debug)]
pub struct RadioBridge {
    schedule: Schedule,
    pace: Pace,
    telemetry_max: Span,
    vehicles: Vec<Vehicle>,
    crazyflies: Vec<Crazyflie>,
    data_link: DataLink,
    reports: Reports,
    counters: Counters,
}

impl Core for RadioBridge {
    const NAME: &'static str = "radio-bridge";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        tuning.check()?;
        // Pings to several vehicles take turns, so that they do not meet on the air.
        let share = Span::from_secs_f64(tuning.ping_young_s) / (arena.fleet.len().max(1) as i64);
        let (mut vehicles, mut crazyflies) = (Vec::new(), Vec::new());
        for (member, index) in arena.fleet.iter().zip(0i64..) {
            let (vehicle, token) = (&member.vehicle, start.seed.0 as u16);
            let first_at = start.at.saturating_add(share * index);
            match vehicle.links.radio {
                Radio::Pair => {
                    let encoder = Encoder::new(&arena.network.devices.command_link);
                    vehicles.push(Vehicle::new(vehicle, encoder, &tuning, first_at, token));
                }
                Radio::Crazyradio => crazyflies.push(Crazyflie::new(vehicle, &tuning, first_at, token)),
            }
        }
        Ok(Self {
            schedule: Schedule::new(start.at, Span::from_secs_f64(tuning.slot_s)),
            pace: Pace::new(&tuning),
            telemetry_max: Span::from_secs_f64(tuning.telemetry_s_max),
            vehicles,
            crazyflies,
            data_link: DataLink::new(),
            reports: Reports::new(Span::from_secs_f64(tuning.report_s)),
            counters: Counters::default(),
        })
    }

    fn deadline(&self) -> Option<Time> {
        let vehicles = self.vehicles.iter().map(Vehicle::due_at);
        let due = vehicles.chain(self.crazyflies.iter().map(Crazyflie::due_at));
        Some(due.fold(self.schedule.next_at(), Time::min))
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        let woken = matches!(event, Event::Deadline);
        match event {
            Event::Deadline => {}
            Event::Input(Input::Command(command)) => self.command(now, &command, out),
            Event::Input(Input::Upload(message)) => self.upload(now, &message, out),
            Event::Input(Input::Start(order)) => {
                if let Some(vehicle) = self.vehicle(now, order.vehicle, out) {
                    vehicle.start(now, order);
                }
            }
            Event::Input(Input::Abort(order)) => {
                let pace = self.pace;
                if let Some(vehicle) = self.vehicle(now, order.vehicle, out) {
                    vehicle.abort(now, order, &pace);
                }
            }
            Event::Input(Input::Stop(order)) => self.stop(now, &order, out),
            Event::Input(Input::Received(bytes)) => self.receive(now, &bytes, out),
        }
        // What comes in at the very instant of a slot still belongs to it: the slot waits to be woken for.
        if woken || now > self.schedule.next_at() {
            self.serve_slot(now, out);
        }
        self.serve_data_link(now, out);
        self.serve_crazyflies(now, out);
    }
}

impl RadioBridge {
    /// What went out and came in since the start, and what was left out of it.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters {
            slots_missed: self.schedule.missed(),
            bytes_skipped: self.data_link.bytes_skipped(),
            ..self.counters
        }
    }

    /// Every vehicle's helm.
    fn helms(&mut self) -> impl Iterator<Item = &mut Helm> {
        let vehicles = self.vehicles.iter_mut().map(|vehicle| &mut vehicle.helm);
        vehicles.chain(self.crazyflies.iter_mut().map(|crazyflie| &mut crazyflie.helm))
    }

    /// The vehicle with that number that has a store for flips; another number is reported.
    fn vehicle(&mut self, now: Time, id: u8, out: &mut Outbox<Output>) -> Option<&mut Vehicle> {
        if self.crazyflies.iter().any(|crazyflie| crazyflie.helm.id == id) {
            self.counters.foreign += 1;
            let detail = || format!("vehicle {id} is a Crazyflie: it hovers, and has no store for flips");
            self.reports.warn(now, id, "flips-not", detail, out);
            return None;
        }
        if self.vehicles.iter().all(|vehicle| vehicle.helm.id != id) {
            self.unknown(now, id, out);
        }
        self.vehicles.iter_mut().find(|vehicle| vehicle.helm.id == id)
    }

    fn unknown(&mut self, now: Time, id: u8, out: &mut Outbox<Output>) {
        self.counters.foreign += 1;
        let detail = || format!("a message for vehicle {id}, which is not of this arena");
        self.reports.warn(now, id, "vehicle-unknown", detail, out);
    }

    fn command(&mut self, now: Time, command: &VehicleCommand, out: &mut Outbox<Output>) {
        let Some(vehicle) = self.helms().find(|helm| helm.id == command.vehicle) else {
            return self.unknown(now, command.vehicle, out);
        };
        match vehicle.lease.admit(command.lease_epoch) {
            Admission::Held => vehicle.commands.command(now, *command),
            Admission::TakenOver { from } => {
                vehicle.commands.command(now, *command);
                let detail = match from {
                    None => format!("epoch {}, the first", command.lease_epoch),
                    Some(from) => format!("epoch {} after {from}", command.lease_epoch),
                };
                out.event(now, Severity::Info, command.vehicle, "lease-taken", &detail);
            }
            Admission::Refused { holder, refused } => {
                self.counters.commands_refused += 1;
                if refused >= CONFLICT_COMMANDS_MIN {
                    let detail = || {
                        format!("a controller of epoch {} commands on, {holder} holds", command.lease_epoch)
                    };
                    self.reports.warn(now, command.vehicle, "lease-conflict", detail, out);
                }
            }
        }
    }

    /// An emergency order to one vehicle, or to all.
    fn stop(&mut self, now: Time, order: &StopOrder, out: &mut Outbox<Output>) {
        for vehicle in self.helms().filter(|helm| order.vehicle == 0 || helm.id == order.vehicle) {
            if vehicle.stop.order(now, order) {
                let (severity, name) = match order.kind {
                    StopKind::Stop => (Severity::Fault, "emergency-stop"),
                    StopKind::Release => (Severity::Warning, "emergency-released"),
                };
                out.event(now, severity, vehicle.id, name, "ordered by a person");
            }
        }
    }

    fn upload(&mut self, now: Time, message: &ManeuverUpload, out: &mut Outbox<Output>) {
        let pace = self.pace;
        let Some(vehicle) = self.vehicle(now, message.vehicle, out) else {
            return;
        };
        if let Err(computed) = vehicle.upload(now, message, &pace) {
            let (set_id, digest) = (message.set_id, message.digest);
            let detail = || format!("set {set_id} says {digest:016x}, its items come to {computed:016x}");
            self.reports.warn(now, message.vehicle, "upload-digest-mismatch", detail, out);
        }
    }

    fn serve_slot(&mut self, now: Time, out: &mut Outbox<Output>) {
        let Some(slot) = self.schedule.due(now) else {
            return;
        };
        let Self { vehicles, crazyflies, counters, telemetry_max, .. } = self;
        for vehicle in vehicles {
            let served = vehicle.helm.serve(now, slot);
            tell_slot(now, vehicle.helm.id, served, counters, out);
            if vehicle.lose(now, *telemetry_max) {
                tell_lost(now, vehicle.helm.id, *telemetry_max, out);
            }
        }
        for crazyflie in crazyflies {
            let served = crazyflie.serve_slot(now, slot);
            tell_slot(now, crazyflie.helm.id, served, counters, out);
            if crazyflie.lose(now, *telemetry_max) {
                tell_lost(now, crazyflie.helm.id, *telemetry_max, out);
            }
        }
    }

    fn serve_crazyflies(&mut self, now: Time, out: &mut Outbox<Output>) {
        for crazyflie in self.crazyflies.iter_mut().filter(|crazyflie| crazyflie.due_at() <= now) {
            self.counters.payloads_sent += crazyflie.serve(now, out);
        }
    }

    /// A packet from a Crazyflie.
    fn hear_crazyflie(&mut self, now: Time, index: usize, received: &DeviceBytes, out: &mut Outbox<Output>) {
        let Some(crazyflie) = self.crazyflies.get_mut(index) else { return };
        match crazyflie.hear(now, received.at.min(now), &received.bytes, out) {
            crazyflie::Heard::Used => self.counters.payloads_received += 1,
            crazyflie::Heard::Damaged => self.counters.payloads_damaged += 1,
            crazyflie::Heard::Report(telemetry) => {
                self.counters.payloads_received += 1;
                out.publish(telemetry);
            }
        }
    }

    fn serve_data_link(&mut self, now: Time, out: &mut Outbox<Output>) {
        for (vehicle, index) in self.vehicles.iter_mut().zip(0..) {
            if now < vehicle.due_at() {
                continue;
            }
            let (id, address) = (vehicle.helm.id, vehicle.address);
            let mut sent = Vec::new();
            vehicle.serve(now, &self.pace, out, |uplink| {
                sent.extend(self.data_link.transmit(now, &uplink, id, address, index));
            });
            self.counters.payloads_sent += sent.len() as u64;
            sent.into_iter().for_each(|bytes| out.publish(bytes));
        }
    }

    /// What the encoder of a vehicle's command link says of its link.
    fn hear_encoder(&mut self, now: Time, id: u8, bytes: &[u8], out: &mut Outbox<Output>) {
        let Some(vehicle) = self.vehicles.iter_mut().find(|vehicle| vehicle.helm.id == id) else {
            self.counters.foreign += 1;
            return;
        };
        for quality_percent in vehicle.encoder_line.qualities_percent(bytes) {
            if quality_percent < QUALITY_PERCENT_MIN {
                let detail = || format!("{quality_percent} % of its packets arrive at the vehicle");
                self.reports.warn(now, id, "command-link-weak", detail, out);
            }
        }
    }

    fn receive(&mut self, now: Time, received: &DeviceBytes, out: &mut Outbox<Output>) {
        if let Some(id) = Ports::vehicle_of_command_link(received.port) {
            if let Some(index) = self.crazyflies.iter().position(|crazyflie| crazyflie.helm.id == id) {
                return self.hear_crazyflie(now, index, received, out);
            }
            return self.hear_encoder(now, id, &received.bytes, out);
        }
        if received.port != Ports::DATA_LINK {
            self.counters.foreign += 1;
            return;
        }
        let arrived = received.at.min(now);
        let Self { data_link, vehicles, reports, counters, pace, .. } = self;
        data_link.receive(&received.bytes, |heard| match heard {
            Heard::Payload { source, data } => {
                let Some(vehicle) = vehicles.iter_mut().find(|vehicle| vehicle.address == source) else {
                    counters.payloads_misaddressed += 1;
                    let detail = || format!("a payload from address {source:04X}, which is no vehicle's");
                    return reports.warn(now, 0, "radio-unknown", detail, out);
                };
                match Downlink::decode(data) {
                    Err(_) => counters.payloads_damaged += 1,
                    Ok((id, _)) if id != vehicle.helm.id => {
                        counters.payloads_misaddressed += 1;
                        let detail = || format!("the radio at {source:04X} says it is vehicle {id}");
                        reports.warn(now, vehicle.helm.id, "vehicle-address-mismatch", detail, out);
                    }
                    Ok((_, message)) => match vehicle.hear(now, &message, arrived, pace, out) {
                        Reaction::Used => counters.payloads_received += 1,
                        Reaction::Untimely => counters.payloads_untimely += 1,
                        Reaction::Report(telemetry) => {
                            counters.payloads_received += 1;
                            out.publish(telemetry);
                        }
                    },
                }
            }
            Heard::Transmitted { index, result } => {
                let Some(vehicle) = vehicles.get_mut(usize::from(index)) else {
                    return;
                };
                let delivered = result == TransmitResult::Success;
                counters.payloads_undelivered += u64::from(!delivered);
                if vehicle.transmitted(delivered) >= UNDELIVERED_REPORTED {
                    let detail = || format!("payloads are not acknowledged: {result:?}");
                    reports.warn(now, vehicle.helm.id, "data-link-undelivered", detail, out);
                }
            }
            Heard::Modem(status) => {
                let detail = || format!("the data link's radio reports status {status:02X}");
                reports.warn(now, 0, "radio-status", detail, out);
            }
        });
    }
}

/// Says what a slot carried, or why it carried nothing.
fn tell_slot(now: Time, id: u8, served: Served, counters: &mut Counters, out: &mut Outbox<Output>) {
    match served {
        Served::Sent { bytes, report, resumed } => {
            counters.commands_sent += 1;
            out.publish(bytes);
            out.publish(report);
            if resumed {
                out.event(now, Severity::Info, id, "command-sending", "the command link speaks");
            }
        }
        Served::Stop(bytes) => {
            counters.stops_sent += 1;
            out.publish(bytes);
        }
        Served::FellSilent(reason) => out.event(now, Severity::Warning, id, "command-silent", reason),
        Served::Silent => {}
    }
}

fn tell_lost(now: Time, id: u8, longest: Span, out: &mut Outbox<Output>) {
    let detail = format!("no status for {longest}");
    out.event(now, Severity::Warning, id, "telemetry-lost", &detail);
}

#[cfg(test)]
mod tests;
