//! What the vehicle knows of its own attitude and height, for the time when nobody tells it.
//!
//! Gyros and accelerometer carry both forward; the ground's hints in each command frame correct them. The
//! heading is not needed and not kept right. The errors of gyros and accelerometer are learned from the hints,
//! so that ten seconds of descent without them stay level and end at about the speed they began with. While
//! hints are missing, the drag felt keeps the tilt from running away ([`crate::drift`]).

use device::vehicle_link::CommandFrame;
use quantity::{Body, GRAVITY_M_S2, Rotation, Vector, World, math};

use crate::drift::Drift;
use crate::settings::AttitudeSettings;

/// The learned vertical error of the accelerometer stays below this: one off by more is broken.
const BIAS_M_S2_MAX: f64 = 0.5;

/// Times over which the accelerometer's vertical error is learned, at first and later,
const BIAS_TIME_S: [f64; 2] = [2.0, 10.0];
/// and how long after a maneuver, with its great forces and its tilt not yet sure, it is not.
const BIAS_WAITS_S: f64 = 1.0;

/// A vertical speed further off than this is no sensor's slow error.
const BIAS_SPEED_ERROR_M_S_MAX: f64 = 0.3;

/// The learned error of a gyro stays below this: one off by more is broken.
const GYRO_BIAS_RAD_S_MAX: f64 = 0.1;

/// Times over which the gyros' error is learned. A maneuver moves it, so that it is learned quickly after one.
const GYRO_BIAS_TIME_S: [f64; 2] = [0.6, 4.0];

/// Above this rate an error of scale would be taken for one of zero.
const GYRO_BIAS_RATE_RAD_S_MAX: f64 = 0.5;

/// A tilt further off than this is no gyro's slow error.
const GYRO_BIAS_TURN_RAD_MAX: f64 = 0.05;

/// Height or speed further from its hint than this is taken whole: the estimate was left alone for too long.
const VERTICAL_SNAP: Vertical = Vertical { height_m: 1.0, speed_m_s: 2.0 };

/// After a maneuver the estimate is sure once hints have come for this long.
const SURE_S: f64 = 0.3;
/// And the gyros' error is well known after this long.
const SETTLED_S: f64 = 5.0;
/// How much faster the drag felt is followed while the tilt is unsure, and once all is known.
const UNSURE_HURRY_RATIO: f64 = 2.0;
const SETTLED_HURRY_RATIO: f64 = 0.6;

/// Time between two hints.
const HINT_INTERVAL_S: f64 = 0.02;

/// Height and vertical speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vertical {
    /// Above the floor.
    pub height_m: f64,
    /// Up positive.
    pub speed_m_s: f64,
}

impl Vertical {
    fn is_near(self, other: Self) -> bool {
        (self.height_m - other.height_m).abs() < VERTICAL_SNAP.height_m
            && (self.speed_m_s - other.speed_m_s).abs() < VERTICAL_SNAP.speed_m_s
    }
}

/// The vehicle's own estimate of itself.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OwnState {
    attitude: Option<Rotation<Body, World>>,
    vertical: Option<Vertical>,
    acceleration_bias_m_s2: f64,
    /// Time the accelerometer's error rests on.
    bias_learned_s: f64,
    /// About roll and pitch.
    gyro_bias_rad_s: Vector<Body>,
    drift: Drift,
    /// For how long hints have come, since the beginning or the last maneuver.
    hinted_s: f64,
    /// Whether a hint came since the maneuver before: the first is taken whole.
    attitude_hinted: bool,
    height_hinted: bool,
}

/// In what way the vehicle moves through a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Going {
    /// Motors off, or a maneuver: no more than gyros and accelerometers can be made use of.
    Otherwise,
    /// In the air, under the ground's commands.
    Led,
    /// In the air, left alone.
    Alone,
}

impl OwnState {
    /// Carries the estimate over `dt_s` with what the sensors read.
    pub fn predict(
        &mut self,
        rate_rad_s: Vector<Body>,
        acceleration_m_s2: Vector<Body>,
        dt_s: f64,
        going: Going,
        settings: &AttitudeSettings,
    ) {
        let hurry_ratio = self.hurry_ratio();
        let Some(attitude) = &mut self.attitude else {
            return;
        };
        *attitude = attitude.turned((rate_rad_s - self.gyro_bias_rad_s) * dt_s);
        if going == Going::Otherwise {
            self.drift.reset();
        } else {
            let turn = self.drift.predict(*attitude, acceleration_m_s2, dt_s, hurry_ratio, &settings.drift);
            if going == Going::Alone {
                let turn = attitude.inverse() * turn;
                *attitude = attitude.turned(turn * dt_s);
                let across = Vector::new(turn.x, turn.y, 0.0) * (settings.drift.gyro_bias_1_s * dt_s);
                self.gyro_bias_rad_s = (self.gyro_bias_rad_s - across).limited(GYRO_BIAS_RAD_S_MAX);
            } else {
                self.drift.learn_bias(acceleration_m_s2, dt_s, &settings.drift);
            }
        }
        if let Some(vertical) = &mut self.vertical {
            let up = (*attitude * acceleration_m_s2).z - GRAVITY_M_S2 - self.acceleration_bias_m_s2;
            vertical.height_m += (vertical.speed_m_s + 0.5 * up * dt_s) * dt_s;
            vertical.speed_m_s += up * dt_s;
        }
    }

    /// A maneuver is over: whatever the sensors made of it, the next hints are taken whole.
    pub fn maneuver_ended(&mut self) {
        self.hinted_s = 0.0;
        self.attitude_hinted = false;
        self.height_hinted = false;
    }

    /// Takes the hints of an accepted frame.
    pub fn correct(&mut self, frame: &CommandFrame, rate_rad_s: Vector<Body>, settings: &AttitudeSettings) {
        let hinted = frame.attitude_valid || frame.height_valid;
        if !hinted || rate_rad_s.norm() > settings.hint_rate_rad_s_max {
            return;
        }
        self.hinted_s += HINT_INTERVAL_S;
        if frame.attitude_valid {
            let first = !core::mem::replace(&mut self.attitude_hinted, true);
            self.correct_attitude(frame, rate_rad_s, first, settings);
        }
        if frame.height_valid {
            let first = !core::mem::replace(&mut self.height_hinted, true);
            self.correct_height(frame, first, settings);
        }
    }

    fn correct_height(&mut self, frame: &CommandFrame, first: bool, settings: &AttitudeSettings) {
        let told = Vertical { height_m: frame.height_m, speed_m_s: frame.vertical_speed_m_s };
        match &mut self.vertical {
            Some(own) if own.is_near(told) && !first => {
                let speed_error = told.speed_m_s - own.speed_m_s;
                own.height_m += settings.hint_weight_ratio * (told.height_m - own.height_m);
                own.speed_m_s += settings.hint_weight_ratio * speed_error;
                if speed_error.abs() < BIAS_SPEED_ERROR_M_S_MAX && self.hinted_s > BIAS_WAITS_S {
                    self.bias_learned_s += HINT_INTERVAL_S;
                    let [shortest_s, longest_s] = BIAS_TIME_S;
                    let time_s = self.bias_learned_s.clamp(shortest_s, longest_s);
                    let gain_1_s = settings.hint_weight_ratio / time_s;
                    let bias = self.acceleration_bias_m_s2 - gain_1_s * speed_error;
                    self.acceleration_bias_m_s2 = bias.clamp(-BIAS_M_S2_MAX, BIAS_M_S2_MAX);
                }
            }
            _ => self.vertical = Some(told),
        }
    }

    fn correct_attitude(
        &mut self,
        frame: &CommandFrame,
        rate_rad_s: Vector<Body>,
        first: bool,
        settings: &AttitudeSettings,
    ) {
        let told =
            |yaw_rad| Rotation::<Body, World>::from_yaw_pitch_roll(yaw_rad, frame.pitch_rad, frame.roll_rad);
        let Some(own) = self.attitude else {
            self.attitude = Some(told(0.0));
            return;
        };
        // The shortest turn that brings the vehicle's idea of "up" to the ground's; it has no heading in it.
        let (up_own, up_told) = (up_in_body(own), up_in_body(told(0.0)));
        let turn = shortest_turn(up_told, up_own);
        if first || turn.norm() > settings.hint_snap_rad {
            self.attitude = Some(told(own.yaw_rad()));
            return;
        }
        self.attitude = Some(own.turned(turn * settings.hint_weight_ratio));
        if turn.norm() < GYRO_BIAS_TURN_RAD_MAX && rate_rad_s.norm() < GYRO_BIAS_RATE_RAD_S_MAX {
            let [shortest_s, longest_s] = GYRO_BIAS_TIME_S;
            let gain_1_s = settings.hint_weight_ratio / self.hinted_s.clamp(shortest_s, longest_s);
            let across = Vector::new(turn.x, turn.y, 0.0);
            self.gyro_bias_rad_s = (self.gyro_bias_rad_s - across * gain_1_s).limited(GYRO_BIAS_RAD_S_MAX);
        }
    }

    /// Whether hints have come for long enough since the beginning, or since the last maneuver.
    pub fn is_sure(&self) -> bool {
        self.hinted_s > SURE_S
    }

    /// How fast the drag felt is followed: the less is known of the tilt, the faster.
    fn hurry_ratio(&self) -> f64 {
        if !self.is_sure() {
            UNSURE_HURRY_RATIO
        } else if self.hinted_s < SETTLED_S {
            1.0
        } else {
            SETTLED_HURRY_RATIO
        }
    }

    /// Height and vertical speed, once hinted at.
    pub const fn vertical(&self) -> Option<Vertical> {
        self.vertical
    }

    /// Whether the tilt is known.
    pub const fn attitude_known(&self) -> bool {
        self.attitude.is_some()
    }

    /// Angle between the body's and the world's z axis.
    pub fn tilt_rad(&self) -> Option<f64> {
        self.attitude.map(|attitude| shortest_turn(Vector::Z, up_in_body(attitude)).norm())
    }

    /// Cosine of the tilt; one where it is not known.
    pub fn upright_ratio(&self) -> f64 {
        self.attitude.map_or(1.0, |attitude| up_in_body(attitude).z)
    }

    /// The rate, as the gyros read it, that levels the vehicle or, tilted by at most `brake_rad_max`, brakes
    /// the drift it feels; zero where its tilt is not known.
    pub fn levelling_rate_rad_s(&self, settings: &AttitudeSettings, brake_rad_max: f64) -> Vector<Body> {
        let Some(attitude) = self.attitude else {
            return Vector::ZERO;
        };
        let thrust_tan = self.drift.velocity_m_s() * (-settings.drift.brake_1_s / GRAVITY_M_S2);
        let wanted = Vector::<World>::Z + thrust_tan.horizontal().limited(brake_rad_max);
        let turn = shortest_turn(Vector::Z, attitude.inverse() * (wanted / wanted.norm()));
        (turn * settings.level_gain_1_s).limited(settings.level_rate_rad_s_max) + self.gyro_bias_rad_s
    }
}

fn up_in_body(attitude: Rotation<Body, World>) -> Vector<Body> {
    attitude.inverse() * Vector::<World>::Z
}

/// The rotation vector of the shortest way from one unit vector to another.
fn shortest_turn(from: Vector<Body>, to: Vector<Body>) -> Vector<Body> {
    let axis = from.cross(to);
    let (sin, cos) = (axis.norm(), from.dot(to));
    if sin > 1e-9 {
        axis * (math::atan2(sin, cos) / sin)
    } else if cos > 0.0 {
        Vector::ZERO
    } else {
        // Exactly upside down: any axis across will do, pitch is the strongest.
        Vector::new(0.0, core::f64::consts::PI, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{FirmwareSettings, LOOP_HZ};

    const DT_S: f64 = 1.0 / LOOP_HZ;

    const SETTINGS: AttitudeSettings = FirmwareSettings::table_i(1).attitude;

    fn frame(roll_rad: f64, pitch_rad: f64, height_m: f64, vertical_speed_m_s: f64) -> CommandFrame {
        CommandFrame {
            attitude_valid: true,
            height_valid: true,
            roll_rad,
            pitch_rad,
            height_m,
            vertical_speed_m_s,
            ..CommandFrame::default()
        }
    }

    fn known(roll_rad: f64, pitch_rad: f64) -> OwnState {
        let mut own = OwnState::default();
        own.correct(&frame(roll_rad, pitch_rad, 4.0, 0.0), Vector::ZERO, &SETTINGS);
        own
    }

    #[test]
    fn nothing_is_known_until_hinted_at() {
        let mut own = OwnState::default();
        own.predict(Vector::new(1.0, 1.0, 1.0), Vector::ZERO, 1.0, Going::Alone, &SETTINGS);
        let unhinted =
            CommandFrame { attitude_valid: false, height_valid: false, ..frame(0.1, 0.1, 1.0, 0.0) };
        own.correct(&unhinted, Vector::ZERO, &SETTINGS);
        assert!(!own.attitude_known() && own.vertical().is_none() && own.tilt_rad().is_none());
        assert_eq!(own.levelling_rate_rad_s(&SETTINGS, 0.0), Vector::ZERO);
        assert_eq!(own.upright_ratio(), 1.0);
    }

    #[test]
    fn levelling_turns_back_what_was_tilted() {
        let rate = known(0.2, 0.0).levelling_rate_rad_s(&SETTINGS, 0.0);
        assert!((rate - Vector::new(-1.2, 0.0, 0.0)).norm() < 1e-9);
        let rate = known(0.0, -0.1).levelling_rate_rad_s(&SETTINGS, 0.0);
        assert!((rate - Vector::new(0.0, 0.6, 0.0)).norm() < 1e-9);
        let over = known(core::f64::consts::PI, 0.0).levelling_rate_rad_s(&SETTINGS, 0.0);
        assert!((over.norm() - SETTINGS.level_rate_rad_s_max).abs() < 1e-6, "upside down turns at full rate");
    }

    #[test]
    fn following_its_own_levelling_ends_level_from_anywhere() {
        for (roll, pitch) in [(3.1, 0.1), (-2.0, 1.0), (0.5, -1.5), (0.0, 0.7)] {
            let mut own = known(roll, pitch);
            for _ in 0..3 * LOOP_HZ as u32 {
                let rate = own.levelling_rate_rad_s(&SETTINGS, 0.0);
                own.predict(rate, Vector::ZERO, DT_S, Going::Otherwise, &SETTINGS);
            }
            assert!(own.tilt_rad().unwrap() < 0.01);
        }
    }

    #[test]
    fn hints_correct_by_their_weight_or_whole_when_far_off() {
        let mut own = known(0.0, 0.0);
        own.correct(&frame(0.1, 0.0, 4.5, 0.0), Vector::ZERO, &SETTINGS);
        assert!((own.tilt_rad().unwrap() - 0.03).abs() < 1e-6);
        assert!((own.vertical().unwrap().height_m - 4.15).abs() < 1e-9);
        own.correct(&frame(0.0, 1.0, 6.0, 0.0), Vector::ZERO, &SETTINGS);
        assert_eq!(own.vertical().unwrap().height_m, 6.0);
        assert!((own.tilt_rad().unwrap() - 1.0).abs() < 1e-9);
        own.correct(&frame(0.0, 0.0, 4.0, 0.0), Vector::new(0.0, 30.0, 0.0), &SETTINGS);
        assert!((own.tilt_rad().unwrap() - 1.0).abs() < 1e-9, "turning too fast for a hint");
    }

    #[test]
    fn a_biased_accelerometer_is_learned_and_dead_reckoning_holds() {
        let mut own = known(0.0, 0.0);
        let biased = Vector::new(0.0, 0.0, GRAVITY_M_S2 + 0.2);
        for tick in 0..20 * LOOP_HZ as u32 {
            own.predict(Vector::ZERO, biased, DT_S, Going::Led, &SETTINGS);
            if tick % 16 == 0 {
                own.correct(&frame(0.0, 0.0, 4.0, 0.0), Vector::ZERO, &SETTINGS);
            }
        }
        for _ in 0..5 * LOOP_HZ as u32 {
            own.predict(Vector::ZERO, biased, DT_S, Going::Led, &SETTINGS);
        }
        assert!(own.vertical().unwrap().speed_m_s.abs() < 0.05, "{own:?}");
    }

    /// Level flight with gyros off by this much, hints every 20 ms, for so long.
    fn hinted_with_gyro_bias(own: &mut OwnState, bias_rad_s: Vector<Body>, seconds: u32) {
        for tick in 0..seconds * LOOP_HZ as u32 {
            own.predict(bias_rad_s, Vector::new(0.0, 0.0, GRAVITY_M_S2), DT_S, Going::Led, &SETTINGS);
            if tick % 16 == 0 {
                own.correct(&frame(0.0, 0.0, 4.0, 0.0), bias_rad_s, &SETTINGS);
            }
        }
    }

    #[test]
    fn a_biased_gyro_is_learned_in_flight_and_anew_after_a_maneuver() {
        let mut own = known(0.0, 0.0);
        for bias_rad_s in [Vector::new(0.005, -0.004, 0.0), Vector::new(-0.03, 0.02, 0.0)] {
            own.maneuver_ended();
            hinted_with_gyro_bias(&mut own, bias_rad_s, 8);
            assert!((own.gyro_bias_rad_s - bias_rad_s).norm() < 0.001, "{own:?}");
            let mut left = own;
            for _ in 0..5 * LOOP_HZ as u32 {
                left.predict(
                    bias_rad_s,
                    Vector::new(0.0, 0.0, GRAVITY_M_S2),
                    DT_S,
                    Going::Otherwise,
                    &SETTINGS,
                );
            }
            assert!(left.tilt_rad().unwrap() < 0.005, "{left:?}");
        }
    }

    #[test]
    fn neither_a_fast_turn_nor_a_far_hint_is_taken_for_a_gyros_bias() {
        let mut own = known(0.0, 0.0);
        own.correct(&frame(0.04, 0.0, 4.0, 0.0), Vector::new(0.0, 3.0, 0.0), &SETTINGS);
        own.correct(&frame(0.2, 0.0, 4.0, 0.0), Vector::ZERO, &SETTINGS);
        assert_eq!(own.gyro_bias_rad_s, Vector::ZERO);
    }

    #[test]
    fn what_a_maneuver_did_to_the_speed_is_not_taken_for_the_accelerometers_error() {
        let mut own = known(0.0, 0.0);
        let level = Vector::new(0.0, 0.0, GRAVITY_M_S2);
        hinted_with_gyro_bias(&mut own, Vector::ZERO, 2);
        own.vertical = Some(Vertical { height_m: 4.0, speed_m_s: -1.5 });
        own.maneuver_ended();
        hinted_with_gyro_bias(&mut own, Vector::ZERO, 1);
        for _ in 0..6 * LOOP_HZ as u32 {
            own.predict(Vector::ZERO, level, DT_S, Going::Alone, &SETTINGS);
        }
        assert!(own.vertical().unwrap().speed_m_s.abs() < 0.01, "{own:?}");
    }
}
