//! Who flies: the ground while its commands are fresh, the vehicle itself when they are not, nobody after a
//! stop.
//!
//! | Age of the last accepted command | Action |
//! | --- | --- |
//! | up to 100 ms (stale over 60 ms: no maneuver starts) | fly it |
//! | over 100 ms | level on the vehicle's own attitude, braking the drift it feels, hover thrust |
//! | over 500 ms | descend so, faster from high up, at 1 m/s close to the floor |
//! | touchdown, land timer or emergency stop | motors off, latched until a person re-arms |
//!
//! A maneuver suspends this clock until a little after its planned end. A descent the ground orders ends
//! without a latch if the ground stayed with it to the end.

use device::vehicle_link::{CommandFrame, CommandMode, FlightMode};
use quantity::{Span, Time};

use crate::attitude::OwnState;
use crate::sensors::elapsed;
use crate::settings::FailsafeSettings;

/// A command and when it came.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Received {
    /// The command.
    pub frame: CommandFrame,
    /// When.
    pub at: Time,
}

/// A descent under way.
#[derive(Clone, Copy, Debug)]
struct Descent {
    /// Motors stop by then, whatever the sensors say.
    deadline: Time,
    /// Nobody ordered it, or whoever did was lost on the way.
    unordered: bool,
    /// Fresh flying commands in a row since.
    resuming: u8,
}

/// The state machine of flight modes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Supervisor {
    mode: FlightMode,
    command: Option<Received>,
    /// A command to stay disarmed, stick at rest, came since the motors went off.
    armable: bool,
    emergency: bool,
    /// The clock of command age starts no earlier than this.
    clock_from: Time,
    /// Levelling after an aborted maneuver until then.
    recovering_until: Option<Time>,
    descent: Option<Descent>,
}

impl Default for Supervisor {
    fn default() -> Self {
        Self {
            mode: FlightMode::Disarmed,
            command: None,
            armable: false,
            emergency: false,
            clock_from: Time::from_nanos(i64::MIN),
            recovering_until: None,
            descent: None,
        }
    }
}

impl Supervisor {
    /// What is being done.
    pub const fn mode(&self) -> FlightMode {
        self.mode
    }

    /// Whether the motors turn.
    pub const fn motors_on(&self) -> bool {
        !matches!(self.mode, FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped)
    }

    /// Whether a person must release the motors.
    pub const fn latched(&self) -> bool {
        matches!(self.mode, FlightMode::Landed | FlightMode::Stopped)
    }

    /// Whether the last latch was an emergency stop's.
    pub const fn emergency(&self) -> bool {
        self.emergency
    }

    /// The newest accepted command.
    pub const fn command(&self) -> Option<&Received> {
        self.command.as_ref()
    }

    /// Age of the newest accepted command.
    pub fn command_age(&self, now: Time) -> Option<Span> {
        self.command.map(|received| elapsed(received.at, now))
    }

    /// Whether there is a command young enough to build on.
    pub fn command_fresh(&self, now: Time, settings: &FailsafeSettings) -> bool {
        self.command_age(now).is_some_and(|age| age <= settings.fresh)
    }

    /// A frame addressed to this vehicle. Answers whether it counts as a new command: a frame with its
    /// predecessor's counter is a transmitter repeating itself, and keeps nobody in the air.
    pub fn accept(
        &mut self,
        now: Time,
        frame: CommandFrame,
        own: &OwnState,
        settings: &FailsafeSettings,
    ) -> bool {
        if frame.mode == CommandMode::Stop {
            self.stop(true);
        } else if self.command.is_some_and(|last| last.frame.counter == frame.counter) {
            return false;
        }
        let in_a_row = self.command_fresh(now, settings);
        self.command = Some(Received { frame, at: now });
        match self.mode {
            FlightMode::Disarmed => match frame.mode {
                CommandMode::Disarmed => {
                    self.armable = frame.collective_m_s2 < settings.rest_collective_m_s2_max;
                }
                CommandMode::Fly if self.armable => self.enter(FlightMode::Flying),
                _ => {}
            },
            FlightMode::Descend => {
                if let Some(descent) = &mut self.descent {
                    let flying = frame.mode == CommandMode::Fly;
                    descent.resuming = match (flying, in_a_row) {
                        (true, true) => descent.resuming.saturating_add(1),
                        (true, false) => 1,
                        (false, _) => 0,
                    };
                    if frame.height_valid && frame.height_m > settings.disarm_height_m_max {
                        descent.deadline = land_deadline(now, own, settings);
                    }
                }
            }
            _ => {}
        }
        true
    }

    /// Motors off now, latched; an emergency where a person or the ground said so.
    pub fn stop(&mut self, emergency: bool) {
        self.enter(FlightMode::Stopped);
        self.emergency = emergency;
    }

    /// A person releases the latch; while motors turn there is nothing to release.
    pub fn rearm(&mut self) {
        if self.latched() {
            self.enter(FlightMode::Disarmed);
            self.emergency = false;
        }
    }

    /// A maneuver begins.
    pub fn maneuver_began(&mut self, planned_end: Time, settings: &FailsafeSettings) {
        self.enter(FlightMode::Maneuver);
        self.clock_from = planned_end.saturating_add(settings.maneuver_grace);
    }

    /// A maneuver was flown to its end: the ground's commands count again.
    pub fn maneuver_completed(&mut self) {
        self.enter(FlightMode::Flying);
    }

    /// A maneuver was ended early: the vehicle levels itself first.
    pub fn maneuver_aborted(&mut self, now: Time, settings: &FailsafeSettings) {
        self.enter(FlightMode::LevelHold);
        self.clock_from = now;
        self.recovering_until = Some(now.saturating_add(settings.recovery_max));
    }

    /// The vehicle is level again: the ground's commands count.
    pub fn recovered(&mut self) {
        self.recovering_until = None;
    }

    /// Whether the vehicle is levelling itself after an aborted maneuver.
    pub const fn recovering(&self) -> bool {
        self.recovering_until.is_some()
    }

    /// The ground was touched: ends a descent.
    pub fn touched_down(&mut self) {
        if let Some(descent) = self.descent {
            self.enter(if descent.unordered { FlightMode::Landed } else { FlightMode::Disarmed });
        }
    }

    /// One tick: which mode the age of the commands leaves.
    pub fn tick(&mut self, now: Time, own: &OwnState, settings: &FailsafeSettings) {
        if self.recovering_until.is_some_and(|until| now >= until) {
            self.recovering_until = None;
        }
        match self.mode {
            FlightMode::Landed | FlightMode::Stopped | FlightMode::Maneuver => return,
            FlightMode::Disarmed => {
                // Whoever rested the stick is gone: the next must rest it again.
                self.armable &= self.command_age(now).is_some_and(|age| age <= settings.descend_after);
                return;
            }
            FlightMode::Flying | FlightMode::LevelHold | FlightMode::Descend => {}
        }
        if self.descent.is_some_and(|descent| now >= descent.deadline) {
            self.touched_down();
            return;
        }
        let (wanted, unordered) = self.wanted(now, own, settings);
        if wanted == FlightMode::Descend {
            let deadline = land_deadline(now, own, settings);
            let descent = self.descent.get_or_insert(Descent { deadline, unordered, resuming: 0 });
            descent.unordered |= unordered;
            if unordered {
                descent.resuming = 0;
            }
        }
        if wanted == FlightMode::Disarmed && self.descent.is_some_and(|descent| descent.unordered) {
            self.touched_down();
        } else if wanted != self.mode {
            self.enter(wanted);
        }
    }

    /// The mode that command and age ask for, and whether it is one nobody ordered.
    fn wanted(&self, now: Time, own: &OwnState, settings: &FailsafeSettings) -> (FlightMode, bool) {
        let Some(command) = &self.command else {
            return (FlightMode::Descend, true);
        };
        let suspended_age = elapsed(command.at.max(self.clock_from), now);
        if suspended_age > settings.descend_after {
            return (FlightMode::Descend, true);
        }
        if elapsed(command.at, now) > settings.level_after {
            let mode = if self.descent.is_some() { FlightMode::Descend } else { FlightMode::LevelHold };
            return (mode, false);
        }
        let mode = match command.frame.mode {
            CommandMode::Fly if self.must_keep_descending(settings) => FlightMode::Descend,
            CommandMode::Fly if self.recovering() => FlightMode::LevelHold,
            CommandMode::Fly => FlightMode::Flying,
            CommandMode::Descend => FlightMode::Descend,
            CommandMode::Disarmed if is_high(own, settings) => FlightMode::Descend,
            CommandMode::Disarmed => FlightMode::Disarmed,
            CommandMode::Stop => FlightMode::Stopped,
        };
        (mode, false)
    }

    fn must_keep_descending(&self, settings: &FailsafeSettings) -> bool {
        self.descent.is_some_and(|descent| descent.unordered && descent.resuming < settings.resume_frames)
    }

    fn enter(&mut self, mode: FlightMode) {
        self.mode = mode;
        self.armable = false;
        if mode != FlightMode::Descend {
            self.descent = None;
        }
        if mode != FlightMode::LevelHold {
            self.recovering_until = None;
        }
        if !self.motors_on() {
            self.clock_from = Time::from_nanos(i64::MIN);
        }
    }
}

/// Cutting the motors drops the vehicle: above this height only an emergency stop may.
fn is_high(own: &OwnState, settings: &FailsafeSettings) -> bool {
    own.vertical().is_some_and(|vertical| vertical.height_m > settings.disarm_height_m_max)
}

/// When a descent from here must be over.
fn land_deadline(now: Time, own: &OwnState, settings: &FailsafeSettings) -> Time {
    let timer = own.vertical().map_or(settings.land_timer_max, |vertical| {
        let descent = Span::from_secs_f64(vertical.height_m.clamp(0.0, 1e3) / settings.descent_m_s);
        // Without a hint since a maneuver the height is a guess, and too early a cut is a fall.
        let margins = if own.is_sure() { 1 } else { 2 };
        (descent + settings.land_timer_margin * margins).min(settings.land_timer_max)
    });
    now.saturating_add(timer)
}

/// Feels the ground in a descent.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TouchdownDetector {
    supported_since: Option<Time>,
    still_since: Option<Time>,
}

/// Specific force beyond the commanded one that only the ground can give; a thrust wrong by a sixth is not
/// enough.
const SUPPORT_M_S2: f64 = 1.5;
const SUPPORT_LASTS: Span = Span::from_millis(150);
/// Specific force of an impact: three times what a descent ever commands.
const IMPACT_M_S2: f64 = 30.0;
/// Above this height an impact is the net or another vehicle.
const IMPACT_HEIGHT_M_MAX: f64 = 1.5;
/// Height and speed of a vehicle the ground sees standing.
const STANDING_HEIGHT_M_MAX: f64 = 0.1;
const STANDING_SPEED_M_S_MAX: f64 = 0.15;
const STANDING_LASTS: Span = Span::from_millis(300);

impl TouchdownDetector {
    /// One tick of a descent: whether the vehicle stands on the ground. `force_m_s2` is the accelerometer's
    /// z, `hinted` whether height and speed are still being corrected by the ground.
    pub fn tick(
        &mut self,
        now: Time,
        force_m_s2: f64,
        commanded_m_s2: f64,
        own: &OwnState,
        hinted: bool,
    ) -> bool {
        let vertical = own.vertical();
        let low = vertical.is_none_or(|vertical| vertical.height_m < IMPACT_HEIGHT_M_MAX);
        let impact = low && force_m_s2.abs() > IMPACT_M_S2;
        let supported = force_m_s2 - commanded_m_s2 > SUPPORT_M_S2;
        let standing = hinted
            && vertical.is_some_and(|vertical| {
                vertical.height_m < STANDING_HEIGHT_M_MAX && vertical.speed_m_s.abs() < STANDING_SPEED_M_S_MAX
            });
        impact
            || lasts(&mut self.supported_since, supported, now, SUPPORT_LASTS)
            || lasts(&mut self.still_since, standing, now, STANDING_LASTS)
    }
}

/// Whether a condition has held for a span without a break.
fn lasts(since: &mut Option<Time>, holds: bool, now: Time, span: Span) -> bool {
    if !holds {
        *since = None;
    }
    holds && elapsed(*since.get_or_insert(now), now) >= span
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::FirmwareSettings;
    use quantity::Vector;

    const SETTINGS: FirmwareSettings = FirmwareSettings::table_i(1);

    fn at(millis: i64) -> Time {
        Time::ZERO + Span::from_millis(millis)
    }

    fn known(height_m: f64, vertical_speed_m_s: f64) -> OwnState {
        let mut own = OwnState::default();
        let (attitude_valid, height_valid) = (true, true);
        let hints = CommandFrame { attitude_valid, height_valid, ..CommandFrame::default() };
        let frame = CommandFrame { height_m, vertical_speed_m_s, ..hints };
        for _ in 0..20 {
            own.correct(&frame, Vector::ZERO, &SETTINGS.attitude);
        }
        own
    }

    #[test]
    fn the_ground_is_felt_by_support_impact_or_sight() {
        let own = known(0.5, -1.0);
        let mut feet = TouchdownDetector::default();
        assert!(!feet.tick(at(0), 9.8, 8.0, &own, false));
        assert!(!feet.tick(at(149), 9.8, 8.0, &own, false));
        assert!(!feet.tick(at(149), 9.0, 8.0, &own, false), "a break starts anew");
        assert!(!feet.tick(at(150), 9.8, 8.0, &own, false));
        assert!(feet.tick(at(300), 9.8, 8.0, &own, false));

        let mut feet = TouchdownDetector::default();
        assert!(feet.tick(at(0), 31.0, 8.0, &own, false));
        assert!(!feet.tick(at(0), 31.0, 30.0, &known(3.0, 0.0), false), "up there it is the net");
        assert!(feet.tick(at(0), 31.0, 30.0, &OwnState::default(), false));

        let mut feet = TouchdownDetector::default();
        let standing = known(0.05, 0.0);
        assert!(!feet.tick(at(0), 9.0, 9.0, &standing, true));
        assert!(feet.tick(at(300), 9.0, 9.0, &standing, true));
        assert!(!feet.tick(at(301), 9.0, 9.0, &standing, false), "dead reckoning is not sight");
    }

    #[test]
    fn the_land_timer_is_height_and_two_seconds_and_never_over_ten() {
        for (height_m, millis) in [(0.0, 2_000), (3.0, 5_000), (7.5, 9_500), (12.0, 10_000)] {
            assert_eq!(land_deadline(at(0), &known(height_m, 0.0), &SETTINGS.failsafe), at(millis));
        }
        assert_eq!(land_deadline(at(0), &OwnState::default(), &SETTINGS.failsafe), at(10_000));
    }
}
