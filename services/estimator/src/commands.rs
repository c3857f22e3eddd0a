//! The commands sent and not yet forgotten: what the vehicle is told to do at each instant, past and to come.

use quantity::{Body, Span, Time, Vector};
use schemas::{CommandMode, CommandSent};

/// What the command link asks of the vehicle at some instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Drive {
    /// Fly this.
    Fly {
        /// Total thrust by mass.
        collective_m_s2: f64,
        /// Body rate to hold.
        rate_rad_s: Vector<Body>,
    },
    /// Motors off.
    Off,
    /// Nothing, or nothing recent, or that it land by itself: what it does is its own affair.
    Silent,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    sent_at: Time,
    effective_at: Time,
    drive: Drive,
}

/// Entries kept: 640 ms of radio slots, more than any gap the filter is carried over.
const CAPACITY: usize = 32;

/// A vehicle's commands by the instant they take effect. Each holds until the next does, or until it is too
/// old.
#[derive(Clone, Debug)]
pub(crate) struct Commands {
    entries: [Entry; CAPACITY],
    /// How many of `entries` are in use, oldest first.
    len: usize,
    hold: Span,
    slot: Option<Slot>,
}

/// The radio's schedule as last announced.
#[derive(Clone, Copy, Debug)]
struct Slot {
    next_at: Time,
    period: Span,
    link_delay: Span,
}

/// Radio slots are never closer than this, whatever a message says.
const SLOT_PERIOD_MIN: Span = Span::from_millis(1);

impl Commands {
    /// No command yet; each will be flown for at most `hold`.
    pub fn new(hold: Span) -> Self {
        let never = Entry { sent_at: Time::ZERO, effective_at: Time::ZERO, drive: Drive::Silent };
        Self { entries: [never; CAPACITY], len: 0, hold, slot: None }
    }

    /// Takes note of a command that left the radio; one older than the newest known is ignored.
    pub fn sent(&mut self, sent: &CommandSent) {
        let usable = sent.link_delay_s.is_finite()
            && sent.collective_m_s2.is_finite()
            && sent.rate_rad_s.is_finite()
            && sent.next_slot_at > sent.sent_at;
        if !usable || self.used().last().is_some_and(|last| sent.sent_at <= last.sent_at) {
            return;
        }
        let link_delay = Span::from_secs_f64(sent.link_delay_s.clamp(0.0, 0.2));
        let period = (sent.next_slot_at - sent.sent_at).max(SLOT_PERIOD_MIN);
        self.slot = Some(Slot { next_at: sent.next_slot_at, period, link_delay });
        let drive = match sent.mode {
            CommandMode::Fly => {
                Drive::Fly { collective_m_s2: sent.collective_m_s2, rate_rad_s: sent.rate_rad_s }
            }
            CommandMode::Disarmed => Drive::Off,
            CommandMode::Descend => Drive::Silent,
        };
        let entry = Entry { sent_at: sent.sent_at, effective_at: sent.sent_at + link_delay, drive };
        // A newly measured, shorter delay: what is sent later still takes effect later.
        while self.used().last().is_some_and(|last| last.effective_at >= entry.effective_at) {
            self.len -= 1;
        }
        if self.len == CAPACITY {
            self.entries.copy_within(1.., 0);
            self.len -= 1;
        }
        self.entries[self.len] = entry;
        self.len += 1;
    }

    fn used(&self) -> &[Entry] {
        &self.entries[..self.len]
    }

    /// What holds at `at`, and until when it surely does.
    pub fn at(&self, at: Time) -> (Drive, Time) {
        // From the newest back: the wanted entry is among the last few.
        let following =
            self.used().iter().rposition(|entry| entry.effective_at <= at).map_or(0, |index| index + 1);
        let until = self.used().get(following).map_or(Time::FAR_FUTURE, |entry| entry.effective_at);
        let Some(entry) = following.checked_sub(1).map(|index| self.entries[index]) else {
            return (Drive::Silent, until);
        };
        let expires_at = entry.effective_at.saturating_add(self.hold);
        match entry.drive {
            // A vehicle on the floor stays off when the link falls silent.
            Drive::Off => (Drive::Off, until),
            drive if at < expires_at => (drive, until.min(expires_at)),
            _ => (Drive::Silent, until),
        }
    }

    /// When a command that leaves here now takes effect: after the next slot it can still reach.
    pub fn next_effect(&self, now: Time, lead: Span, link_delay_setting: Span) -> Time {
        let Some(slot) = self.slot else {
            return now + link_delay_setting;
        };
        let reachable = now + lead;
        let mut slot_at = slot.next_at;
        if slot_at < reachable {
            let behind = (reachable - slot_at).as_nanos();
            let period = slot.period.as_nanos();
            slot_at += slot.period * ((behind + period - 1) / period);
        }
        slot_at + slot.link_delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DELAY: Span = Span::from_millis(18);

    fn ms(ms: i64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    fn sent(at_ms: i64, collective_m_s2: f64) -> CommandSent {
        CommandSent {
            mode: CommandMode::Fly,
            sent_at: ms(at_ms),
            next_slot_at: ms(at_ms + 20),
            link_delay_s: 0.018,
            collective_m_s2,
            ..CommandSent::default()
        }
    }

    fn collective(commands: &Commands, at_ms: i64) -> Option<f64> {
        match commands.at(ms(at_ms)).0 {
            Drive::Fly { collective_m_s2, .. } => Some(collective_m_s2),
            _ => None,
        }
    }

    #[test]
    fn each_holds_from_its_effect_to_the_next() {
        let mut commands = Commands::new(Span::from_millis(100));
        assert_eq!(commands.at(ms(5)), (Drive::Silent, Time::FAR_FUTURE));
        commands.sent(&sent(100, 1.0));
        commands.sent(&sent(120, 2.0));
        assert_eq!(commands.at(ms(117)), (Drive::Silent, ms(118)));
        assert_eq!(collective(&commands, 118), Some(1.0));
        assert_eq!(commands.at(ms(118)).1, ms(138));
        assert_eq!(collective(&commands, 138), Some(2.0));
        assert_eq!(collective(&commands, 237), Some(2.0));
        assert_eq!(collective(&commands, 238), None, "too old to be flown");
    }

    #[test]
    fn off_lasts_and_descend_is_the_vehicles_affair() {
        let mut commands = Commands::new(Span::from_millis(100));
        commands.sent(&CommandSent { mode: CommandMode::Disarmed, ..sent(0, 0.0) });
        assert_eq!(commands.at(ms(5000)).0, Drive::Off);
        commands.sent(&CommandSent { mode: CommandMode::Descend, ..sent(20, 9.0) });
        assert_eq!(commands.at(ms(40)).0, Drive::Silent);
    }

    #[test]
    fn disordered_and_poisoned_messages_change_nothing() {
        let mut commands = Commands::new(Span::from_millis(100));
        commands.sent(&sent(100, 1.0));
        commands.sent(&sent(80, 9.0));
        commands.sent(&sent(120, f64::NAN));
        commands.sent(&CommandSent { link_delay_s: f64::INFINITY, ..sent(120, 9.0) });
        commands.sent(&CommandSent { next_slot_at: ms(110), ..sent(120, 9.0) });
        assert_eq!(collective(&commands, 150), Some(1.0));
    }

    #[test]
    fn a_shorter_delay_puts_the_newer_command_first() {
        let mut commands = Commands::new(Span::from_millis(100));
        commands.sent(&CommandSent { link_delay_s: 0.05, ..sent(100, 1.0) });
        commands.sent(&sent(120, 2.0));
        assert_eq!(collective(&commands, 138), Some(2.0));
        assert_eq!(collective(&commands, 151), Some(2.0));
    }

    #[test]
    fn the_oldest_make_room() {
        let mut commands = Commands::new(Span::from_millis(100));
        for k in 0..100 {
            commands.sent(&sent(20 * k, k as f64));
        }
        assert_eq!(collective(&commands, 99 * 20 + 18), Some(99.0));
        assert_eq!(collective(&commands, 70 * 20 + 18), Some(70.0));
        assert_eq!(collective(&commands, 10 * 20 + 18), None);
    }

    #[test]
    fn effects_follow_the_radios_schedule() {
        let mut commands = Commands::new(Span::from_millis(100));
        let lead = Span::from_micros(300);
        assert_eq!(commands.next_effect(ms(3), lead, DELAY), ms(21));
        commands.sent(&sent(100, 1.0));
        assert_eq!(commands.next_effect(ms(105), lead, DELAY), ms(138));
        assert_eq!(commands.next_effect(ms(119), lead, DELAY), ms(138));
        assert_eq!(commands.next_effect(ms(120) - Span::from_micros(200), lead, DELAY), ms(158));
        assert_eq!(commands.next_effect(ms(1001), lead, DELAY), ms(1038), "the schedule is absolute");
    }
}
