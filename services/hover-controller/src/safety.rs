//! How long a state may be trusted, and what is flown when it may not.
//!
//! | Since the last valid state | Command |
//! | --- | --- |
//! | up to 60 ms, and while it is valid | fly |
//! | then | level, thrust held |
//! | 300 ms, or 200 ms after it ceased to be valid | descend, on the vehicle's own sensors |
//!
//! In and right after a maneuver the descent comes at once: nobody on the ground knows the attitude then.
//! Once lost, a state is trusted again only when it rests on ten consecutive frames.

use quantity::{Body, Frame, Rotation, Span, Time, Vector, World};
use schemas::{Tracking, VehicleState};

use crate::tuning::SafetyTuning;

/// What may be flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trust {
    /// The state.
    State,
    /// Only level, on the last attitude known.
    Level,
    /// Nothing: the vehicle must descend by itself.
    Descend,
}

/// Watches the age of one vehicle's states.
#[derive(Clone, Debug)]
pub(crate) struct Watch {
    state_max: Span,
    descend_after: Span,
    descend_after_invalid: Span,
    resume_frames: u16,
    settle: Span,
    maneuver_at: Option<Time>,
    /// Nothing before the first valid state.
    level_at: Option<Time>,
    descend_at: Time,
    /// Trust was lost, and too few frames have come since.
    resuming: bool,
}

impl Watch {
    /// No state yet.
    pub fn new(tuning: &SafetyTuning) -> Self {
        Self {
            state_max: Span::from_secs_f64(tuning.state_s_max),
            descend_after: Span::from_secs_f64(tuning.descend_after_s),
            descend_after_invalid: Span::from_secs_f64(tuning.descend_after_invalid_s),
            resume_frames: tuning.resume_frames,
            settle: Span::from_secs_f64(tuning.settle_s),
            maneuver_at: None,
            level_at: None,
            descend_at: Time::ZERO,
            resuming: true,
        }
    }

    /// Takes a state; whether it may be flown now.
    pub fn take(&mut self, now: Time, state: &VehicleState) -> bool {
        if state.tracking == Tracking::Ballistic {
            self.maneuver_at = Some(now);
        }
        let after_maneuver = self.maneuver_at.is_some_and(|at| now - at <= self.settle);
        if state.valid_until < now || !self.rests_on_frames(state, after_maneuver) || !is_usable(state) {
            self.level_at = self.level_at.map(|at| at.min(now - Span::from_nanos(1)));
            return false;
        }
        // Whoever was lost must show a history, not one lucky frame.
        self.resuming |= self.trust(now) != Trust::State;
        if state.accepted_frames >= self.resume_frames {
            self.resuming = false;
        }
        if !self.resuming {
            self.level_at = Some(state.valid_until.min(now + self.state_max));
            let after_invalid = state.valid_until.saturating_add(self.descend_after_invalid);
            // Lost in or right after a maneuver, the attitude is anybody's guess: the vehicle's own gyros
            // know it better, and hints of ours would spoil what they know.
            self.descend_at =
                if after_maneuver { Time::ZERO } else { after_invalid.min(now + self.descend_after) };
        }
        !self.resuming
    }

    /// Whether the cameras stand behind the state: in and right after a maneuver, where the model is least
    /// sure, a state may be called valid that rests on no recent frame.
    fn rests_on_frames(&self, state: &VehicleState, after_maneuver: bool) -> bool {
        match state.tracking {
            Tracking::Invalid => false,
            Tracking::Ballistic => state.accepted_frames >= self.resume_frames,
            Tracking::Coasting => !after_maneuver,
            Tracking::Tracking => true,
        }
    }

    /// What may be flown now.
    pub fn trust(&self, now: Time) -> Trust {
        match self.level_at {
            Some(level_at) if !self.resuming && now <= level_at => Trust::State,
            Some(_) if now < self.descend_at => Trust::Level,
            _ => Trust::Descend,
        }
    }

    /// When [`Watch::trust`] turns to [`Trust::Level`]; nothing before the first state.
    pub fn level_at(&self) -> Option<Time> {
        self.level_at
    }
}

/// Finite, and such as a vehicle in a hall can have: arithmetic on anything else ends in numbers that are
/// none.
fn is_usable(state: &VehicleState) -> bool {
    let k = &state.prediction;
    is_within(k.position_m, POSITION_M_MAX)
        && is_within(k.velocity_m_s, SPEED_M_S_MAX)
        && is_within(k.rate_rad_s, RATE_RAD_S_MAX)
        && is_within(state.disturbance_m_s2, DISTURBANCE_M_S2_MAX)
        && k.orientation.is_finite()
}

const POSITION_M_MAX: f64 = 1e3;
const SPEED_M_S_MAX: f64 = 100.0;
const RATE_RAD_S_MAX: f64 = 200.0;
const DISTURBANCE_M_S2_MAX: f64 = 1e3;

/// Whether every component is a number of at most this magnitude.
pub(crate) fn is_within<F: Frame>(vector: Vector<F>, magnitude_max: f64) -> bool {
    [vector.x, vector.y, vector.z].iter().all(|component| component.abs() <= magnitude_max)
}

/// The vehicle carried on without states, as if it did what it was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DeadReckoning {
    at: Time,
    /// Attitude.
    pub orientation: Rotation<Body, World>,
    /// Height above the floor.
    pub height_m: f64,
    /// Up positive.
    pub vertical_speed_m_s: f64,
    rate_rad_s: Vector<Body>,
}

/// Nothing is carried further than this.
const RECKONING_S_MAX: f64 = 0.5;

impl DeadReckoning {
    /// From the last state.
    pub fn from_state(state: &VehicleState) -> Self {
        let k = &state.prediction;
        Self {
            at: state.predicted_for,
            orientation: k.orientation,
            height_m: k.position_m.z,
            vertical_speed_m_s: k.velocity_m_s.z,
            rate_rad_s: k.rate_rad_s,
        }
    }

    /// The vehicle is told to turn so from now on.
    pub fn told(&mut self, rate_rad_s: Vector<Body>) {
        self.rate_rad_s = rate_rad_s;
    }

    /// Carries on to an instant.
    pub fn carry_to(&mut self, at: Time) {
        let span_s = (at - self.at).as_secs_f64();
        if span_s <= 0.0 {
            return;
        }
        if span_s < RECKONING_S_MAX {
            self.orientation = self.orientation.turned(self.rate_rad_s * span_s);
            self.height_m += self.vertical_speed_m_s * span_s;
        }
        self.at = at;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    fn state(valid_until_ms: i64, frames: u16) -> VehicleState {
        VehicleState {
            tracking: Tracking::Tracking,
            accepted_frames: frames,
            valid_until: ms(valid_until_ms),
            ..VehicleState::default()
        }
    }

    fn watch() -> Watch {
        let mut watch = Watch::new(&SafetyTuning::default());
        assert!(watch.take(ms(1000), &state(1100, 10)));
        watch
    }

    #[test]
    fn an_estimator_that_dies() {
        let watch = watch();
        for (at, trust) in [
            (1000, Trust::State),
            (1060, Trust::State),
            (1061, Trust::Level),
            (1299, Trust::Level),
            (1300, Trust::Descend),
            (99_000, Trust::Descend),
        ] {
            assert_eq!(watch.trust(ms(at)), trust, "{at} ms");
        }
    }

    #[test]
    fn cameras_that_fail() {
        // Coasting states follow until 1100; then the estimator says that it has none.
        let mut watch = watch();
        for at in (1005..=1100).step_by(5) {
            assert!(watch.take(ms(at), &state(1100, 10)));
        }
        assert!(!watch.take(ms(1101), &VehicleState { tracking: Tracking::Invalid, ..state(1100, 0) }));
        for (at, trust) in [(1101, Trust::Level), (1299, Trust::Level), (1300, Trust::Descend)] {
            assert_eq!(watch.trust(ms(at)), trust, "{at} ms");
        }
    }

    #[test]
    fn a_vehicle_lost_in_a_maneuver_is_left_to_itself() {
        let mut watch = watch();
        watch.take(ms(1010), &VehicleState { tracking: Tracking::Ballistic, ..state(1210, 10) });
        assert_eq!(watch.trust(ms(1070)), Trust::State);
        assert_eq!(watch.trust(ms(1071)), Trust::Descend);
        watch.take(ms(1080), &VehicleState { tracking: Tracking::Ballistic, ..state(1280, 10) });
        assert_eq!(watch.trust(ms(1081)), Trust::State);
        assert!(!watch.take(ms(1085), &VehicleState { tracking: Tracking::Ballistic, ..state(1285, 0) }));
        assert_eq!(watch.trust(ms(1085)), Trust::Descend);
        // After it, a state coasted on the model alone is none; one with frames is.
        assert!(watch.take(ms(1100), &state(1200, 20)));
        assert!(!watch.take(ms(1130), &VehicleState { tracking: Tracking::Coasting, ..state(1200, 20) }));
        assert_eq!(watch.trust(ms(1130)), Trust::Descend);
        assert!(watch.take(ms(1590), &state(1690, 20)));
        assert!(watch.take(ms(1620), &VehicleState { tracking: Tracking::Coasting, ..state(1690, 20) }));
    }

    #[test]
    fn nothing_is_flown_before_ten_frames() {
        let mut watch = Watch::new(&SafetyTuning::default());
        assert_eq!(watch.trust(ms(0)), Trust::Descend);
        assert!(!watch.take(ms(1000), &state(1100, 1)));
        assert!(!watch.take(ms(1005), &state(1105, 9)));
        assert!(watch.take(ms(1010), &state(1110, 10)));
    }

    #[test]
    fn a_descent_lasts_until_ten_frames() {
        let mut watch = watch();
        assert_eq!(watch.trust(ms(1400)), Trust::Descend);
        assert!(!watch.take(ms(1400), &state(1500, 1)));
        assert_eq!(watch.trust(ms(1401)), Trust::Descend);
        assert!(watch.take(ms(1445), &state(1545, 10)));
        assert_eq!(watch.trust(ms(1446)), Trust::State);
    }

    #[test]
    fn a_short_gap_needs_ten_frames_too() {
        let mut watch = watch();
        assert_eq!(watch.trust(ms(1200)), Trust::Level);
        assert!(!watch.take(ms(1200), &state(1300, 1)));
        assert!(!watch.take(ms(1240), &state(1340, 9)));
        assert_eq!(watch.trust(ms(1241)), Trust::Level);
        assert!(watch.take(ms(1245), &state(1345, 10)));
        // An estimator that only paused has its history.
        let mut paused = self::watch();
        assert!(paused.take(ms(1200), &state(1300, 300)));
    }

    #[test]
    fn old_or_impossible_states_are_no_states() {
        let mut watch = watch();
        assert!(!watch.take(ms(1050), &state(1049, 50)));
        let mut poisoned = state(1200, 50);
        poisoned.prediction.velocity_m_s.y = f64::NAN;
        assert!(!watch.take(ms(1051), &poisoned));
        assert_eq!(watch.trust(ms(1052)), Trust::Level);
    }

    #[test]
    fn reckoning_turns_as_told() {
        let mut reckoning = DeadReckoning::from_state(&state(0, 0));
        reckoning.told(Vector::new(1.0, 0.0, 0.0));
        reckoning.carry_to(ms(100));
        assert!((reckoning.orientation.tilt_rad() - 0.1).abs() < 1e-9);
    }
}
