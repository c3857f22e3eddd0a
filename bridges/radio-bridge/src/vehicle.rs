//! All the bridge keeps of one vehicle, and its side of the data link.

use std::collections::VecDeque;

use device::vehicle_link::{Downlink, Status, Uplink, UploadReply};
use quantity::{Span, Time};
use schemas::{ManeuverAbort, ManeuverStart, ManeuverUpload, Severity, VehicleTelemetry};
use service_core::Outbox;

use crate::Output;
use crate::clock::{Plausibility, VehicleClock};
use crate::encoder::{Encoder, EncoderLine};
use crate::form::Form;
use crate::helm::Helm;
use crate::orders::{AbortOrder, StartOrder};
use crate::telemetry;
use crate::tuning::Tuning;
use crate::upload::{Outcome, Upload};

/// Pings whose answers are still waited for.
const PINGS_WAITING_MAX: usize = 32;
/// An accepted command reported later than this may already have been followed by one with the same counter.
const COMMAND_AGE_MAX: Span = Span::from_millis(300);
/// Delay of the data link assumed before it is measured.
const DATA_DELAY: Span = Span::from_millis(10);

/// The intervals of the data link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    upload_retry: Span,
    upload_max: Span,
    start_retry: Span,
    abort_retry: Span,
    abort_repeats: u32,
    ping: Span,
    ping_young: Span,
    ping_young_answers: u32,
}

impl Pace {
    /// As set.
    pub(crate) fn new(tuning: &Tuning) -> Self {
        Self {
            upload_retry: Span::from_secs_f64(tuning.upload_retry_s),
            upload_max: Span::from_secs_f64(tuning.upload_s_max),
            start_retry: Span::from_secs_f64(tuning.start_retry_s),
            abort_retry: Span::from_secs_f64(tuning.abort_retry_s),
            abort_repeats: tuning.abort_repeats,
            ping: Span::from_secs_f64(tuning.ping_s),
            ping_young: Span::from_secs_f64(tuning.ping_young_s),
            ping_young_answers: tuning.ping_young_answers,
        }
    }
}

/// One vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Vehicle {
    /// Who commands it, and what.
    pub(crate) helm: Helm,
    /// The address of its data-link radio.
    pub(crate) address: u16,
    /// What its encoder says.
    pub(crate) encoder_line: EncoderLine,
    clock: VehicleClock,
    pings: Pings,
    upload: Option<Upload>,
    start: Option<StartOrder>,
    abort: Option<AbortOrder>,
    status: Option<(Status, Time)>,
    lost: bool,
    measured_us: u64,
    undelivered: u32,
}

/// What came of a message from the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reaction {
    /// Nothing for the bus.
    Used,
    /// A report for the bus.
    Report(VehicleTelemetry),
    /// Overtaken by a later one, or stamped with a time that cannot be.
    Untimely,
}

/// Pings on their way.
#[derive(Clone, Debug)]
struct Pings {
    next_at: Time,
    token: u16,
    waiting: VecDeque<(u16, Time)>,
}

impl Vehicle {
    /// A vehicle not heard of yet, to be pinged from `first_ping` on.
    pub(crate) fn new(
        member: &settings::Vehicle,
        encoder: Encoder,
        tuning: &Tuning,
        first_ping: Time,
        first_token: u16,
    ) -> Self {
        let clock = VehicleClock::new(
            Span::from_secs_f64(tuning.clock_window_s),
            Span::from_secs_f64(tuning.downlink_extra_s),
        );
        Self {
            helm: Helm::new(member, Form::Channels(encoder), tuning),
            address: member.links.data_address,
            encoder_line: EncoderLine::new(),
            clock,
            pings: Pings { next_at: first_ping, token: first_token, waiting: VecDeque::new() },
            upload: None,
            start: None,
            abort: None,
            status: None,
            lost: false,
            measured_us: 0,
            undelivered: 0,
        }
    }

    /// When the data link is to be served next.
    pub(crate) fn due_at(&self) -> Time {
        let orders = [
            self.upload.as_ref().map(Upload::due_at),
            self.start.as_ref().map(StartOrder::due_at),
            self.abort.as_ref().map(AbortOrder::due_at),
            self.helm.stop.due_at(),
        ];
        orders.into_iter().flatten().fold(self.pings.next_at, Time::min)
    }

    /// Sends what is due and drops what is over.
    pub(crate) fn serve(
        &mut self,
        now: Time,
        pace: &Pace,
        out: &mut Outbox<Output>,
        mut send: impl FnMut(Uplink),
    ) {
        self.helm.stop.send_due(now, &mut send);
        if let Some(abort) = &mut self.abort {
            abort.send_due(now, pace.abort_retry, &mut send);
        }
        self.abort.take_if(|abort| abort.is_over());
        let delay = self.clock.least_delay().unwrap_or(DATA_DELAY);
        if let Some(expired) = self.start.take_if(|start| start.is_over(now, delay)) {
            let detail = format!("maneuver {} was not answered while it was valid", expired.maneuver_id());
            out.event(now, Severity::Warning, self.helm.id, "start-unanswered", &detail);
        }
        if let Some(start) = &mut self.start {
            start.send_due(now, pace.start_retry, &mut send);
        }
        if let Some(failed) = self.upload.take_if(|upload| upload.is_over(now)) {
            let detail = format!("set {} unconfirmed after {} rounds", failed.set_id(), failed.rounds());
            out.event(now, Severity::Warning, self.helm.id, "upload-failed", &detail);
        }
        if let Some(upload) = &mut self.upload {
            upload.send_due(now, &mut send);
        }
        let young = self.heard_lately(now) && self.clock.answers() < pace.ping_young_answers;
        let interval = if young { pace.ping_young } else { pace.ping };
        self.pings.send_due(now, interval, send);
    }

    /// A set for the vehicle's store; one already active or on its way changes nothing.
    ///
    /// # Errors
    /// The digest its items come to, where it is not the message's.
    pub(crate) fn upload(&mut self, now: Time, message: &ManeuverUpload, pace: &Pace) -> Result<(), u64> {
        let upload =
            Upload::new(now, message, pace.upload_retry, pace.upload_max).map_err(|wrong| wrong.computed)?;
        let (set_id, digest) = (message.set_id, message.digest);
        let active =
            self.status.is_some_and(|(status, _)| (status.set_id, status.set_digest) == (set_id, digest));
        let on_its_way = self.upload.as_ref().is_some_and(|upload| upload.is_of(set_id, digest));
        if active {
            self.upload = None;
        } else if !on_its_way {
            self.upload = Some(upload);
        }
        Ok(())
    }

    /// An order to begin; one the vehicle has answered changes nothing.
    pub(crate) fn start(&mut self, now: Time, order: ManeuverStart) {
        let answered = self.status.is_some_and(|(status, _)| status.maneuver_id == order.maneuver_id);
        let aborted = self.abort.is_some_and(|abort| abort.maneuver_id() == order.maneuver_id);
        if answered || aborted {
            return;
        }
        match &mut self.start {
            Some(start) if start.maneuver_id() == order.maneuver_id => start.renew(order),
            _ => self.start = Some(StartOrder::new(now, order)),
        }
    }

    /// An order to end, which also takes back the order to begin.
    pub(crate) fn abort(&mut self, now: Time, order: ManeuverAbort, pace: &Pace) {
        self.start.take_if(|start| start.maneuver_id() == order.maneuver_id);
        match &mut self.abort {
            Some(abort) if abort.maneuver_id() == order.maneuver_id => abort.renew(pace.abort_repeats),
            _ => self.abort = Some(AbortOrder::new(now, order, pace.abort_repeats)),
        }
    }

    /// A message from the vehicle.
    pub(crate) fn hear(
        &mut self,
        now: Time,
        message: &Downlink,
        arrived: Time,
        pace: &Pace,
        out: &mut Outbox<Output>,
    ) -> Reaction {
        match message {
            Downlink::Pong { token, received_us, turnaround_us } => {
                let left_us = received_us.saturating_add(u64::from(*turnaround_us));
                let Some(sent) = self.pings.answered(*token) else {
                    return Reaction::Untimely;
                };
                if !self.passes(now, left_us, arrived, out) {
                    return Reaction::Untimely;
                }
                self.clock.answer(sent, *received_us, *turnaround_us, arrived);
                if self.clock.answers() < pace.ping_young_answers {
                    self.pings.next_at =
                        self.pings.next_at.min(sent.saturating_add(pace.ping_young)).max(now);
                }
                Reaction::Used
            }
            Downlink::Status(status) => self.hear_status(now, status, arrived, out),
            Downlink::UploadReply(reply) => {
                self.hear_reply(now, reply, out);
                Reaction::Used
            }
        }
    }

    /// Whether the vehicle's telemetry has just been lost: no status for `longest`.
    pub(crate) fn lose(&mut self, now: Time, longest: Span) -> bool {
        let silent = self.status.is_some_and(|(_, heard_at)| now - heard_at > longest);
        silent && !std::mem::replace(&mut self.lost, true)
    }

    /// What became of a payload; answers how many in a row were not delivered.
    pub(crate) const fn transmitted(&mut self, delivered: bool) -> u32 {
        self.undelivered = if delivered { 0 } else { self.undelivered.saturating_add(1) };
        self.undelivered
    }

    fn heard_lately(&self, now: Time) -> bool {
        self.status.is_some_and(|(_, heard_at)| now - heard_at < Span::from_secs(1))
    }

    /// Shows a time stamp to the clock; false where the message is to be dropped.
    fn passes(&mut self, now: Time, vehicle_us: u64, arrived: Time, out: &mut Outbox<Output>) -> bool {
        let plausibility = self.clock.hear(vehicle_us, arrived);
        if plausibility == Plausibility::Restarted {
            let detail = "its clock has started over; what it knew is gone";
            out.event(now, Severity::Warning, self.helm.id, "vehicle-restarted", detail);
            self.status = None;
            self.measured_us = 0;
            self.pings.waiting.clear();
            self.pings.next_at = now;
        }
        plausibility != Plausibility::Implausible
    }

    fn hear_status(
        &mut self,
        now: Time,
        status: &Status,
        arrived: Time,
        out: &mut Outbox<Output>,
    ) -> Reaction {
        if !self.passes(now, status.uptime_us, arrived, out) {
            return Reaction::Untimely;
        }
        if self.status.is_some_and(|(newest, _)| newest.uptime_us >= status.uptime_us) {
            return Reaction::Untimely;
        }
        if std::mem::replace(&mut self.lost, false) {
            out.event(now, Severity::Info, self.helm.id, "telemetry-back", "the vehicle reports again");
        }
        self.status = Some((*status, arrived));
        self.start.take_if(|start| start.maneuver_id() == status.maneuver_id);
        if let Some(done) = self.upload.take_if(|upload| upload.is_of(status.set_id, status.set_digest)) {
            self.say_committed(now, &done, out);
        }
        self.measure_delay(status);
        let link_delay_s = self.helm.delay.delay_s();
        Reaction::Report(telemetry::report(self.helm.id, status, arrived, &self.clock, link_delay_s))
    }

    fn hear_reply(&mut self, now: Time, reply: &UploadReply, out: &mut Outbox<Output>) {
        let Some(upload) = &mut self.upload else { return };
        match upload.reply(reply) {
            Outcome::Going => {}
            Outcome::Committed => {
                if let Some(done) = self.upload.take() {
                    self.say_committed(now, &done, out);
                }
            }
            Outcome::Refused(reason) => {
                let detail = format!("set {}: {reason:?}", reply.set_id);
                out.event(now, Severity::Warning, self.helm.id, "upload-refused", &detail);
                self.upload = None;
            }
        }
    }

    fn say_committed(&self, now: Time, upload: &Upload, out: &mut Outbox<Output>) {
        let detail = format!("set {} after {} rounds", upload.set_id(), upload.rounds());
        out.event(now, Severity::Info, self.helm.id, "upload-committed", &detail);
    }

    /// Each newly accepted command shows the command link's delay once.
    fn measure_delay(&mut self, status: &Status) {
        let received_us = status.command_received_us;
        if received_us == self.measured_us || received_us == 0 || self.clock.answers() == 0 {
            return;
        }
        self.measured_us = received_us;
        let age = Span::from_micros(status.uptime_us.saturating_sub(received_us).min(1_000_000) as i64);
        let (received, sent) =
            (self.clock.at(received_us), self.helm.commands.sent_at(status.command_counter));
        if let (Some(received), Some(sent)) = (received, sent)
            && age <= COMMAND_AGE_MAX
        {
            self.helm.delay.measure(received - sent);
        }
    }
}

impl Pings {
    fn send_due(&mut self, now: Time, interval: Span, mut send: impl FnMut(Uplink)) {
        if now < self.next_at {
            return;
        }
        self.next_at = now.saturating_add(interval);
        self.token = self.token.wrapping_add(1);
        if self.waiting.len() == PINGS_WAITING_MAX {
            self.waiting.pop_front();
        }
        self.waiting.push_back((self.token, now));
        send(Uplink::Ping { token: self.token });
    }

    /// When the ping with that token was sent; each is answered once.
    fn answered(&mut self, token: u16) -> Option<Time> {
        let place = self.waiting.iter().position(|(waiting, _)| *waiting == token)?;
        self.waiting.remove(place).map(|(_, sent)| sent)
    }
}
