//! What goes to the ground, and when: answers first, then the status, at once when it changes.

use device::vehicle_link::{Downlink, FlightMode, ManeuverPhase, Reason, Status, StatusFlags, UploadReply};
use quantity::{Span, Time};

use crate::sensors::elapsed;

/// Status interval ordinarily,
const INTERVAL: Span = Span::from_millis(50);
/// and for a while after something changed, so that a lost frame costs little.
const INTERVAL_AFTER_CHANGE: Span = Span::from_millis(20);
const CHANGE_LASTS: Span = Span::from_millis(200);

/// Pings that may wait for their answer; more in one go are not answered.
const PINGS_WAITING_MAX: usize = 4;

/// The conditions whose change is worth a report of its own.
const FLAGS_WATCHED: u8 = StatusFlags::LATCHED.bits()
    | StatusFlags::EMERGENCY_STOP.bits()
    | StatusFlags::SENSOR_FAULT.bits()
    | StatusFlags::BATTERY_LOW.bits();

/// The part of a status whose change is reported at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Gist {
    mode: FlightMode,
    maneuver: (u16, ManeuverPhase, Reason),
    set: (u16, u64),
    flags: u8,
}

impl Gist {
    const fn of(status: &Status) -> Self {
        Self {
            mode: status.mode,
            maneuver: (status.maneuver_id, status.maneuver_phase, status.reason),
            set: (status.set_id, status.set_digest),
            flags: status.flags.bits() & FLAGS_WATCHED,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Ping {
    token: u16,
    received: Time,
}

/// The queue to the ground. Its length is bounded: answers of one kind replace each other.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Telemetry {
    pings: [Option<Ping>; PINGS_WAITING_MAX],
    reply: Option<UploadReply>,
    sent: Option<(Time, Gist)>,
    changed: Option<Time>,
}

impl Telemetry {
    /// A ping arrived.
    pub fn ping(&mut self, now: Time, token: u16) {
        if let Some(free) = self.pings.iter_mut().find(|place| place.is_none()) {
            *free = Some(Ping { token, received: now });
        }
    }

    /// The state of an upload is to be told; it stands for all earlier ones.
    pub fn upload_reply(&mut self, reply: UploadReply) {
        self.reply = Some(reply);
    }

    /// The next message, if one is due now. `status` is the vehicle's state at this moment.
    pub fn poll(&mut self, now: Time, status: Status) -> Option<Downlink> {
        if let Some(ping) = self.pings.iter_mut().find_map(Option::take) {
            let turnaround_us = elapsed(ping.received, now).as_nanos().max(0) / 1_000;
            return Some(Downlink::Pong {
                token: ping.token,
                received_us: micros(ping.received),
                turnaround_us: u32::try_from(turnaround_us).unwrap_or(u32::MAX),
            });
        }
        if let Some(reply) = self.reply.take() {
            return Some(Downlink::UploadReply(reply));
        }
        let gist = Gist::of(&status);
        if let Some((sent_at, sent)) = self.sent {
            if sent != gist {
                self.changed = Some(now);
            } else {
                let lively = self.changed.is_some_and(|at| elapsed(at, now) < CHANGE_LASTS);
                let interval = if lively { INTERVAL_AFTER_CHANGE } else { INTERVAL };
                if elapsed(sent_at, now) < interval {
                    return None;
                }
            }
        }
        self.sent = Some((now, gist));
        Some(Downlink::Status(status))
    }
}

/// A time on the vehicle's clock as the link carries it.
pub(crate) fn micros(time: Time) -> u64 {
    u64::try_from(time.as_nanos() / 1_000).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn at(millis: i64) -> Time {
        Time::ZERO + Span::from_millis(millis)
    }

    /// Milliseconds at which a status is sent, polled every millisecond.
    fn sent_at(telemetry: &mut Telemetry, from: i64, until: i64, status: Status) -> Vec<i64> {
        (from..until).filter(|millis| telemetry.poll(at(*millis), status).is_some()).collect()
    }

    #[test]
    fn a_change_is_sent_at_once_then_often_then_at_leisure() {
        let mut telemetry = Telemetry::default();
        let calm = Status::default();
        assert_eq!(sent_at(&mut telemetry, 0, 130, calm), [0, 50, 100]);
        let flying = Status { mode: FlightMode::Flying, ..calm };
        let after: Vec<i64> = sent_at(&mut telemetry, 130, 500, flying);
        assert_eq!(after, [130, 150, 170, 190, 210, 230, 250, 270, 290, 310, 360, 410, 460]);
        let stale = Status { flags: StatusFlags::COMMAND_STALE, battery_mv: 5, ..flying };
        assert_eq!(
            sent_at(&mut telemetry, 500, 520, stale),
            [510],
            "what changes all the time does not hurry"
        );
    }

    #[test]
    fn answers_come_first_and_are_bounded() {
        let mut telemetry = Telemetry::default();
        for token in 0..9 {
            telemetry.ping(at(10), token);
        }
        telemetry.upload_reply(UploadReply { set_id: 1, ..UploadReply::default() });
        telemetry.upload_reply(UploadReply { set_id: 2, ..UploadReply::default() });
        let mut polled = Vec::new();
        while let Some(message) = telemetry.poll(at(12), Status::default()) {
            polled.push(message);
        }
        assert_eq!(polled.len(), 6);
        assert_eq!(polled[3], Downlink::Pong { token: 3, received_us: 10_000, turnaround_us: 2_000 });
        assert_eq!(polled[4], Downlink::UploadReply(UploadReply { set_id: 2, ..UploadReply::default() }));
        assert_eq!(polled[5], Downlink::Status(Status::default()));
    }
}
