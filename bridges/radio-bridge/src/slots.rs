//! The command link: at each slot the newest valid command of each vehicle, or silence.
//!
//! Slots follow an absolute schedule, so that a late wake-up shifts no other slot. A slot that cannot begin
//! within its first half is left out: frames are never sent in a burst, and the vehicle can tell a pause from
//! a stutter.
//!
//! An old command is never repeated. The vehicle watches the age of its newest frame and holds level, then
//! lands, by itself; a bridge that repeats a dead controller's last word takes that away from it.

use device::vehicle_link::CommandFrame;
use quantity::{Span, Time};
use schemas::{CommandSent, DeviceBytes, VehicleCommand};
use settings::Ports;

use crate::form::{Form, Framed};

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
    /// When it was to begin.
    pub(crate) at: Time,
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
        Some(Slot { number, at: self.begin(number), next_at: self.next_at() })
    }

    fn begin(&self, slot: u64) -> Time {
        self.start.saturating_add(Span::from_nanos(self.length.as_nanos().saturating_mul(slot as i64)))
    }
}

/// The command link of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct CommandLink {
    vehicle: u8,
    form: Form,
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
        /// For the device.
        bytes: DeviceBytes,
        /// For the estimator.
        report: CommandSent,
        /// Whether the slot before was silent, after others that were not.
        resumed: bool,
    },
    /// An emergency stop is sent, as these bytes.
    Stop(DeviceBytes),
    /// Silence, and the slot before was not silent: why.
    FellSilent(&'static str),
    /// Silence again.
    Silent,
}

impl CommandLink {
    /// A link that has sent nothing; commands over `age_max` old are not sent.
    pub(crate) const fn new(vehicle: u8, form: Form, age_max: Span) -> Self {
        Self { vehicle, form, age_max, newest: None, counter: 0, sent_at: [None; COUNTERS], talking: false }
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
        let (command, commanded_at) = match self.usable(now) {
            Ok(usable) => usable,
            Err(reason) => return self.fall_silent(reason),
        };
        let framed = match self.form.frame(now, &command, self.counter) {
            Ok(framed) => framed,
            Err(reason) => return self.fall_silent(reason),
        };
        let Framed { bytes, mode, collective_m_s2, rate_rad_s } = framed;
        let report = CommandSent {
            vehicle: self.vehicle,
            mode,
            lease_epoch: command.lease_epoch,
            slot: slot.number,
            frame_received_at: command.frame_received_at,
            commanded_at,
            slot_at: slot.at,
            sent_at: now,
            next_slot_at: slot.next_at,
            link_delay_s,
            collective_m_s2,
            rate_rad_s,
        };
        let bytes = self.send(now, bytes);
        let resumed = !std::mem::replace(&mut self.talking, true);
        Served::Sent { bytes, report, resumed }
    }

    /// Serves a slot of a stopped vehicle: with the stop, or with silence.
    pub(crate) fn serve_stop(&mut self, now: Time, speaks: bool) -> Served {
        // What was commanded before the stop is not flown after its release.
        self.newest = None;
        self.talking = false;
        match self.form.stop(self.vehicle, self.counter) {
            Some(bytes) if speaks => Served::Stop(self.send(now, bytes)),
            _ => Served::Silent,
        }
    }

    /// Takes note of whether the vehicle says that it flies.
    pub(crate) const fn note_flying(&mut self, flying: bool) {
        if let Form::Setpoints(setpoints) = &mut self.form {
            setpoints.note_flying(flying);
        }
    }

    /// The bytes for the device, counted and remembered.
    fn send(&mut self, now: Time, bytes: Vec<u8>) -> DeviceBytes {
        self.sent_at[usize::from(self.counter)] = Some(now);
        self.counter = CommandFrame::next_counter(self.counter);
        DeviceBytes {
            port: Ports::command_link(self.vehicle),
            at: now,
            bytes: bytes.try_into().expect("a frame is within the bound of device bytes"),
        }
    }

    /// The newest command and when it came, if it may be sent.
    fn usable(&self, now: Time) -> Result<(VehicleCommand, Time), &'static str> {
        match &self.newest {
            None => Err("no command"),
            Some((command, _)) if command.valid_until < now => Err("the newest command's validity is over"),
            Some((_, at)) if now - *at > self.age_max => Err("the newest command is too old"),
            Some((command, at)) => Ok((*command, *at)),
        }
    }

    fn fall_silent(&mut self, reason: &'static str) -> Served {
        // What is too old now will not get younger.
        self.newest = None;
        if std::mem::replace(&mut self.talking, false) { Served::FellSilent(reason) } else { Served::Silent }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::Encoder;
    use device::sbus;
    use device::vehicle_link::CommandMode as LinkMode;
    use quantity::{Rotation, Vector};
    use schemas::CommandMode;
    use settings::{ChannelBits, CommandProtocol};

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn command(valid_until: Time) -> VehicleCommand {
        VehicleCommand {
            vehicle: 3,
            mode: CommandMode::Fly,
            lease_epoch: 0x107,
            valid_until,
            frame_received_at: ms(85),
            collective_m_s2: 9.81,
            rate_rad_s: Vector::new(1.0, -2.1, 0.5),
            orientation: Rotation::from_yaw_pitch_roll(2.0, -0.2, 0.1),
            height_m: 4.0,
            vertical_speed_m_s: -0.3,
        }
    }

    fn link() -> CommandLink {
        link_of(CommandProtocol::Sbus, ChannelBits::Eleven)
    }

    fn link_of(protocol: CommandProtocol, channel_bits: ChannelBits) -> CommandLink {
        let url = "udp://127.0.0.1:52100".parse().expect("a URL");
        let encoder = Encoder::new(&settings::CommandLink { protocol, url, channel_bits });
        CommandLink::new(3, Form::Channels(encoder), Span::from_millis(60))
    }

    const GOLDEN: [u8; 25] = [
        0x0F, 0x55, 0x6C, 0x5A, 0xD1, 0x56, 0x88, 0xB3, 0x10, 0xFA, 0x0D, 0x50, 0xDA, 0x1B, 0xC0, 0x01, 0x06,
        0x00, 0x00, 0x00, 0x08, 0xC0, 0xE7, 0x00, 0x00,
    ];
    const GOLDEN_CRSF: [u8; 26] = [
        0xEE, 0x18, 0x16, 0x57, 0x7C, 0x5A, 0xD1, 0x56, 0x08, 0xF0, 0x40, 0x6D, 0xEF, 0x67, 0xC3, 0x07, 0x1F,
        0xF8, 0xC0, 0x07, 0x3E, 0xF0, 0x81, 0x0F, 0x7C, 0x22,
    ];
    const SLOT: Slot =
        Slot { number: 5, at: Time::from_nanos(100_000_000), next_at: Time::from_nanos(120_000_000) };

    #[test]
    fn slots_follow_the_absolute_schedule_once_each() {
        let mut schedule = Schedule::new(ms(1000), Span::from_millis(20));
        assert_eq!((schedule.next_at(), schedule.due(ms(999))), (ms(1000), None));
        for number in 0..100 {
            let late = Span::from_micros(number * 37 % 900);
            let at = ms(1000 + 20 * number) + late;
            let slot = schedule.due(at).expect("due");
            assert_eq!((slot.number, slot.next_at), (number as u64, ms(1020 + 20 * number)));
            assert_eq!(schedule.due(at), None);
        }
        assert_eq!(schedule.missed(), 0);
    }

    #[test]
    fn a_late_driver_gets_no_burst() {
        let mut schedule = Schedule::new(ms(0), Span::from_millis(20));
        assert_eq!(schedule.due(ms(0)).map(|slot| slot.number), Some(0));
        // Early in slot 7: that one, and none of those missed.
        assert_eq!(schedule.due(ms(149)), Some(Slot { number: 7, at: ms(140), next_at: ms(160) }));
        assert_eq!((schedule.missed(), schedule.due(ms(150))), (6, None));
        // Late in slot 9: left out, the next is 10.
        assert_eq!((schedule.due(ms(195)), schedule.next_at(), schedule.missed()), (None, ms(200), 8));
        let mut sent = vec![];
        for at in (195..1000).step_by(3).filter(|at| at % 70 < 50) {
            sent.extend(schedule.due(ms(at)).map(|_| at));
        }
        assert!(sent.windows(2).all(|pair| pair[1] - pair[0] >= 10), "{sent:?}");
    }

    #[test]
    fn a_frame_is_the_golden_one_of_the_channel_map() {
        let mut link = link();
        link.counter = 19;
        link.command(ms(90), command(ms(150)));
        let Served::Sent { bytes, report, resumed } = link.serve(ms(100), SLOT, 0.018) else {
            panic!("silent")
        };
        assert!(resumed);
        assert_eq!((bytes.port, bytes.at, bytes.bytes.len()), (0x103, ms(100), 25));
        // Packed and sealed by a separate program from the channels 1109 845 837 1067 824 1057 894 640 986 3
        // 7 3 0 0 2 that the map's table gives for this command.
        assert_eq!(bytes.bytes[..], GOLDEN);
        assert_eq!((report.vehicle, report.slot, report.lease_epoch), (3, 5, 0x107));
        assert_eq!((report.sent_at, report.next_slot_at, report.link_delay_s), (ms(100), ms(120), 0.018));
        // From the cameras' datagram to the command, and from the schedule to the slot: what the wait is not.
        let way = (report.frame_received_at, report.commanded_at, report.slot_at);
        assert_eq!(way, (ms(85), ms(90), ms(100)));
    }

    #[test]
    fn over_crsf_and_ten_bits_a_frame_is_the_golden_one_of_the_compact_map() {
        let mut link = link_of(CommandProtocol::Crsf, ChannelBits::Ten);
        link.counter = 19;
        link.command(ms(90), command(ms(150)));
        let Served::Sent { bytes, report, .. } = link.serve(ms(100), SLOT, 0.018) else { panic!("silent") };
        // Likewise, from the compact map's table: height and vertical speed have their turn.
        assert_eq!(bytes.bytes[..], GOLDEN_CRSF);
        // Ten bits are coarser than eleven, and the report says so.
        assert!((report.collective_m_s2 - 418.0 * 24.0 / 1023.0).abs() < 1e-12);
    }

    #[test]
    fn the_report_is_what_the_vehicle_reads() {
        let mut link = link();
        link.command(ms(90), command(ms(150)));
        let Served::Sent { bytes, report, .. } = link.serve(ms(100), SLOT, 0.018) else { panic!("silent") };
        let channels =
            sbus::Frame::decode(bytes.bytes[..].try_into().expect("25")).expect("a frame").channels;
        let (vehicle, frame) = CommandFrame::decode(&channels).expect("sealed");
        assert_eq!((vehicle, frame.mode, frame.attitude_valid), (3, LinkMode::Fly, true));
        assert_eq!((report.collective_m_s2, report.rate_rad_s), (frame.collective_m_s2, frame.rate_rad_s));
        assert_ne!(report.collective_m_s2, 9.81);
        assert!((frame.pitch_rad + 0.2).abs() < 1e-3 && (frame.roll_rad - 0.1).abs() < 2e-3);
    }

    #[test]
    fn what_is_stale_or_expired_is_never_sent_and_never_repeated() {
        for (valid_until, at) in [(ms(99), ms(100)), (ms(1000), ms(161))] {
            let mut link = link();
            link.command(ms(100).min(at), command(valid_until));
            assert_eq!(link.serve(at, SLOT, 0.018), Served::Silent);
        }
        let mut link = link();
        assert_eq!(link.serve(ms(0), SLOT, 0.018), Served::Silent, "never commanded, never heard");
        link.command(ms(100), command(ms(130)));
        assert!(matches!(link.serve(ms(100), SLOT, 0.018), Served::Sent { .. }));
        assert!(matches!(link.serve(ms(120), SLOT, 0.018), Served::Sent { resumed: false, .. }));
        assert!(matches!(link.serve(ms(140), SLOT, 0.018), Served::FellSilent(_)));
        assert_eq!(link.serve(ms(160), SLOT, 0.018), Served::Silent);
        link.command(ms(170), command(ms(230)));
        assert!(matches!(link.serve(ms(180), SLOT, 0.018), Served::Sent { resumed: true, .. }));
    }

    #[test]
    fn frames_count_round_and_remember_when_they_went() {
        let mut link = link();
        for slot in 0..70 {
            let at = ms(20 * slot);
            link.command(at, command(at));
            assert!(matches!(link.serve(at, SLOT, 0.018), Served::Sent { .. }));
        }
        assert_eq!(link.sent_at((69 % 32) as u8), Some(ms(69 * 20)));
        assert_eq!(link.sent_at((38 % 32) as u8), Some(ms(38 * 20)));
        assert_eq!(link.sent_at(32), None);
    }

    #[test]
    fn no_number_no_frame() {
        let mut link = link();
        link.command(ms(100), VehicleCommand { collective_m_s2: f64::NAN, ..command(ms(150)) });
        assert_eq!(link.serve(ms(100), SLOT, 0.018), Served::Silent);
    }

    #[test]
    fn a_descent_is_ordered_without_hints() {
        let mut link = link();
        link.command(ms(100), VehicleCommand { mode: CommandMode::Descend, ..command(ms(150)) });
        let Served::Sent { bytes, .. } = link.serve(ms(100), SLOT, 0.018) else { panic!("silent") };
        let channels =
            sbus::Frame::decode(bytes.bytes[..].try_into().expect("25")).expect("a frame").channels;
        let (_, frame) = CommandFrame::decode(&channels).expect("sealed");
        assert_eq!((frame.mode, frame.attitude_valid), (LinkMode::Descend, false));
    }
}
