//! The supervisor of a simulated Crazyflie: whether its motors may turn.
//!
//! It arms when told to, and disarms when told to, when it crashes, and when its setpoints have been silent for two
//! seconds. Stopped, or with its watchdog silent, it is locked until it is restarted.

use device::crtp::SupervisorState;
use quantity::{Span, Time};

/// A watchdog that was begun and then heard no more for so long stops the vehicle.
const WATCHDOG_MAX: Span = Span::from_secs(1);
/// It counts as flying until so long after its motors last turned.
const FLYING_LASTS: Span = Span::from_secs(2);

/// The supervisor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Supervisor {
    armed: bool,
    locked: bool,
    crashed: bool,
    tumbled: bool,
    watchdog_at: Option<Time>,
    turned_at: Option<Time>,
}

impl Supervisor {
    /// Whether the motors may turn.
    pub(super) const fn allows_motors(&self) -> bool {
        self.armed && !self.locked && !self.crashed
    }

    /// Arms or disarms; answers whether that was done.
    pub(super) fn arm(&mut self, arm: bool) -> bool {
        let possible = !arm || self.can_be_armed();
        if possible {
            self.armed = arm;
        }
        possible
    }

    const fn can_be_armed(&self) -> bool {
        !self.locked && !self.crashed && !self.tumbled
    }

    /// Whether it is armed.
    pub(super) const fn armed(&self) -> bool {
        self.armed
    }

    /// Recovers from a crash; answers whether it has.
    pub(super) fn recover(&mut self) -> bool {
        if !self.tumbled {
            self.crashed = false;
        }
        !self.crashed
    }

    /// Emergency stop.
    pub(super) fn stop(&mut self) {
        self.locked = true;
        self.armed = false;
    }

    /// The watchdog's sign of life.
    pub(super) fn watch(&mut self, now: Time) {
        self.watchdog_at = Some(now);
    }

    /// A tick: whether it lies on its back or is broken, and whether its motors turn.
    pub(super) fn tick(&mut self, now: Time, tumbled: bool, broken: bool, turning: bool) {
        if turning {
            self.turned_at = Some(now);
        }
        self.tumbled = tumbled;
        if broken || tumbled && self.allows_motors() && turning {
            self.crashed = true;
            self.armed = false;
        }
        if self.watchdog_at.is_some_and(|at| now - at > WATCHDOG_MAX) {
            self.watchdog_at = None;
            self.stop();
        }
    }

    /// As it is told.
    pub(super) fn state(&self, now: Time) -> SupervisorState {
        let flying = self.turned_at.is_some_and(|at| now - at < FLYING_LASTS);
        let bits = [
            (self.can_be_armed() && !self.armed, SupervisorState::CAN_BE_ARMED),
            (self.armed, SupervisorState::ARMED),
            (self.allows_motors(), SupervisorState::CAN_FLY),
            (flying, SupervisorState::FLYING),
            (self.tumbled, SupervisorState::TUMBLED),
            (self.locked, SupervisorState::LOCKED),
            (self.crashed, SupervisorState::CRASHED),
        ];
        SupervisorState(bits.iter().filter(|(set, _)| *set).fold(0, |all, (_, bit)| all | bit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    #[test]
    fn it_arms_when_told_and_a_stop_locks_it() {
        let mut supervisor = Supervisor::default();
        assert!(supervisor.state(ms(0)).has(SupervisorState::CAN_BE_ARMED) && !supervisor.allows_motors());
        assert!(supervisor.arm(true) && supervisor.allows_motors());
        supervisor.tick(ms(10), false, false, true);
        let flies = SupervisorState::ARMED | SupervisorState::CAN_FLY | SupervisorState::FLYING;
        assert_eq!(supervisor.state(ms(10)), SupervisorState(flies));
        supervisor.stop();
        assert!(!supervisor.arm(true) && !supervisor.allows_motors());
        assert_eq!(supervisor.state(ms(9000)), SupervisorState(SupervisorState::LOCKED));
        assert!(supervisor.recover() && supervisor.state(ms(9000)).has(SupervisorState::LOCKED));
    }

    #[test]
    fn a_watchdog_once_begun_must_go_on() {
        let mut supervisor = Supervisor::default();
        supervisor.arm(true);
        supervisor.tick(ms(60_000), false, false, true);
        assert!(supervisor.allows_motors(), "never begun");
        supervisor.watch(ms(60_000));
        supervisor.tick(ms(61_000), false, false, true);
        assert!(supervisor.allows_motors());
        supervisor.tick(ms(61_001), false, false, true);
        assert!(!supervisor.allows_motors() && supervisor.state(ms(61_001)).has(SupervisorState::LOCKED));
    }

    #[test]
    fn on_its_back_it_has_crashed_until_it_is_recovered_upright() {
        let mut supervisor = Supervisor::default();
        supervisor.arm(true);
        supervisor.tick(ms(0), true, false, true);
        assert!(!supervisor.allows_motors() && !supervisor.recover());
        supervisor.tick(ms(10), false, false, false);
        assert!(!supervisor.arm(true) && supervisor.recover() && supervisor.arm(true));
    }
}
