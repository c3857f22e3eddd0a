//! The command link: at each slot the newest valid command of each vehicle, or silence.
//!
//! Slots follow an absolute schedule, so that a late wake-up shifts no other slot. A slot that cannot begin within its
//! first half is left out: frames are never sent in a burst, and the vehicle can tell a pause from a stutter.
//!
//! An old command is never repeated. The vehicle watches the age of its newest frame and holds level, then lands, by
//! itself; a bridge that repeats a dead controller's last word takes that away from it.

use device::sbus;
use device::vehicle_link::{CommandFrame, CommandMode as LinkMode, roll_pitch_rad};
use quantity::{Span, Time};
use schemas::{CommandMode, CommandSent, DeviceBytes, VehicleCommand};
use settings::Ports;

/// Values of a frame's counter.
const COUNTERS: usize = 32;

/// The absolute schedule of slots.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    start: Time,
    length: Span,
    next: u64,
    missed: u64,
}

/// A slot that begins now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Slot {
    /// Counted from the bridge's start.
    pub(crate) number: u64,
    /// When the one after it begins.
    pub(crate) next_at: Time,
}

impl Schedule {
    /// Slot k begins at `start` + k·`length`.
    pub(crate) const fn new(start: Time, length: Span) -> Self {
        Self { start, length, next: 0, missed: 0 }
    }

    /// When the next slot begins.
    pub(crate) fn next_at(&self) -> Time {
        self.begin(self.next)
    }

    /// Slots left out since the start, because the driver came too late.
    pub(crate) const fn missed(&self) -> u64 {
        self.missed
    }

    /// The slot to serve now, once each.
    pub(crate) fn due(&mut self, now: Time) -> Option<Slot> {
        if now < self.next_at() {
            return None;
        }
        let current = ((now - self.start).as_nanos() / self.length.as_nanos()) as u64;
        let late = now - self.begin(current);
        let number = if late <= self.length / 2 { current } else { current + 1 };
        self.missed += number - self.next;
        if number > current {
            self.next = number;
            return None;
        }
        self.next = number + 1;
        Some(Slot { number, next_at: self.next_at() })
    }

    fn begin(&self, slot: u64) -> Time {
        self.start.saturating_add(Span::from_nanos(self.length.as_nanos().saturating_mul(slot as i64)))
    }
}

/// The command link of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct CommandLink {
    vehicle: u8,
    age_max: Span,
    newest: Option<(VehicleCommand, Time)>,
    counter: u8,
    sent_at: [Option<Time>; COUNTERS],
    talking: bool,
}

/// What became of a vehicle's slot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Served {
    /// A frame is sent, as these bytes and this report.
    Sent {
        /// For the encoder.
        bytes: DeviceBytes,
        /// For the estimator.
        report: CommandSent,
        /// Whether the slot before was silent, after others that were not.
        resumed: bool,
    },
    /// Silence, and the slot before was not silent: why.
    FellSilent(&'static str),
    /// Silence again.
    Silent,
}

impl CommandLink {
    /// A link that has sent nothing; commands over `age_max` old are not sent.
    pub(crate) const fn new(vehicle: u8, age_max: Span) -> Self {
        Self { vehicle, age_max, newest: None, counter: 0, sent_at: [None; COUNTERS], talking: false }
    }

    /// A command its lease allows.
    pub(crate) fn command(&mut self, now: Time, command: VehicleCommand) {
        self.newest = Some((command, now));
    }

    /// When the newest frame with that counter was sent.
    pub(crate) fn sent_at(&self, counter: u8) -> Option<Time> {
        self.sent_at.get(usize::from(counter)).copied().flatten()
    }

    /// Serves a slot; `link_delay_s` is for the report.
    pub(crate) fn serve(&mut self, now: Time, slot: Slot, link_delay_s: f64) -> Served {
        let usable = match &self.newest {
            None => Err("no command"),
            Some((command, _)) if command.valid_until < now => Err("the newest command's validity is over"),
            Some((_, at)) if now - *at > self.age_max => Err("the newest command is too old"),
            Some((command, _)) => frame(command, self.counter).ok_or("the newest command is not finite"),
        };
        let ((frame, channels), command) = match (usable, &self.newest) {
            (Ok(encoded), Some((command, _))) => (encoded, command),
            (Err(reason), _) => return self.fall_silent(reason),
            (Ok(_), None) => return self.fall_silent("no command"),
        };
        let report = CommandSent {
            vehicle: self.vehicle,
            mode: command.mode,
            lease_epoch: command.lease_epoch,
            slot: slot.number,
            sent_at: now,
            next_slot_at: slot.next_at,
            link_delay_s,
            collective_m_s2: frame.collective_m_s2,
            rate_rad_s: frame.rate_rad_s,
        };
        let bytes = sbus::Frame::new(channels).encode();
        let bytes = DeviceBytes {
            port: Ports::command_link(self.vehicle),
            at: now,
            bytes: bytes.as_slice().try_into().expect("25 bytes are within the bound of device bytes"),
        };
        self.sent_at[usize::from(self.counter)] = Some(now);
        self.counter = CommandFrame::next_counter(self.counter);
        let resumed = !std::mem::replace(&mut self.talking, true);
        Served::Sent { bytes, report, resumed }
    }

    fn fall_silent(&mut self, reason: &'static str) -> Served {
        // What is too old now will not get younger.
        self.newest = None;
        if std::mem::replace(&mut self.talking, false) { Served::FellSilent(reason) } else { Served::Silent }
    }
}
