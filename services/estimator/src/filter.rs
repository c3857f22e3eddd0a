//! One vehicle's filter: its state at the newest exposure, and how certain that is.

use quantity::{Body, GRAVITY_M_S2, Span, Time, Vector, World};
use schemas::Kinematics;

use crate::attitude::AttitudeFilter;
use crate::commands::Commands;
use crate::gate::{Expectation, Pose};
use crate::model::{Decay, Model, Motion, Regime};
use crate::predict::Path;
use crate::translation::TranslationFilter;
use crate::tuning::{ModelTuning, Tuning};

/// A vehicle's state, how it moves on, and how certain it is.
#[derive(Clone, Debug)]
pub(crate) struct Filter {
    at: Time,
    motion: Motion,
    regime: Regime,
    entered_at: Time,
    translation: TranslationFilter,
    attitude: AttitudeFilter,
    /// Disturbance last estimated while commands were flown: during a maneuver there is none.
    settled_disturbance_m_s2: Vector<World>,
}

/// Learning waits so long after a change of regime, until the disturbance has settled.
const SETTLING: Span = Span::from_millis(500);
/// A disturbance beyond this is a collision or a wrong regime, nothing to learn from.
const LEARNABLE_M_S2: f64 = 3.0;
/// Speed from which on a disturbance along the motion counts as drag.
const DRAG_SPEED_M_S: f64 = 1.0;
/// Bounds of what is learned.
const THRUST_RATIO_RANGE: (f64, f64) = (0.5, 1.5);
const DRAG_RANGE_1_S: (f64, f64) = (0.0, 1.5);

impl Filter {
    /// Starts from the last two poses of a run.
    pub fn start(tuning: &Tuning, model: &Model, regime: Regime, previous: &Pose, last: &Pose) -> Self {
        let span_s = (last.at - previous.at).as_secs_f64().max(0.001);
        let turn = (previous.orientation.inverse() * last.orientation).rotation_vector();
        let kinematics = Kinematics {
            position_m: last.position_m,
            velocity_m_s: (last.position_m - previous.position_m) * (1.0 / span_s),
            orientation: last.orientation,
            rate_rad_s: turn * (1.0 / span_s),
        };
        let mut motion = Motion::new(kinematics);
        if regime == Regime::Commanded {
            model.explain(&mut motion, Vector::ZERO, Vector::ZERO);
        }
        Self {
            at: last.at,
            motion,
            regime,
            entered_at: last.at,
            translation: TranslationFilter::new(&tuning.noise, span_s),
            attitude: AttitudeFilter::new(&tuning.noise, model, span_s),
            settled_disturbance_m_s2: Vector::ZERO,
        }
    }

    /// The instant of the state.
    pub fn at(&self) -> Time {
        self.at
    }

    /// The state.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// How the vehicle moves on.
    pub fn regime(&self) -> Regime {
        self.regime
    }

    /// Acceleration the model does not explain: thrust error, drag, draughts.
    pub fn disturbance_m_s2(&self, model: &Model) -> Vector<World> {
        if self.regime != Regime::Commanded || self.motion.resting {
            return self.settled_disturbance_m_s2;
        }
        let k = &self.motion.kinematics;
        let collective = model.collective_m_s2(&self.motion);
        let thrust_error = collective * (1.0 - 1.0 / model.thrust_ratio);
        self.motion.disturbance_m_s2 + k.orientation.z_axis() * thrust_error - k.velocity_m_s * model.drag_1_s
    }

    /// The vehicle moves on otherwise than before, perhaps since as long as `late`.
    pub fn enter(&mut self, regime: Regime, model: &Model, late: Span) {
        if regime == self.regime {
            return;
        }
        self.settled_disturbance_m_s2 = self.disturbance_m_s2(model);
        let motion = &mut self.motion;
        if regime == Regime::Commanded {
            if motion.resting {
                motion.thrust_n = [0.0; 4];
            } else {
                model.explain(motion, motion.acceleration_m_s2, motion.angular_acceleration_rad_s2);
            }
            motion.disturbance_m_s2 = Vector::ZERO;
            motion.angular_disturbance_rad_s2 = Vector::ZERO;
        } else {
            motion.disturbance_m_s2 = motion.acceleration_m_s2;
            motion.angular_disturbance_rad_s2 = motion.angular_acceleration_rad_s2;
        }
        let late_s = late.as_secs_f64().max(0.0);
        self.translation.enter(regime, late_s);
        self.attitude.enter(regime, late_s);
        self.regime = regime;
        self.entered_at = self.at;
    }

    /// How states move on from here.
    pub fn path<'a>(&self, model: &'a Model, commands: &'a Commands, step: Span) -> Path<'a> {
        let decay = Decay {
            acceleration_1_s: self.translation.decay_1_s(self.regime),
            angular_1_s: self.attitude.decay_1_s(self.regime),
        };
        Path { model, commands, regime: self.regime, decay, step }
    }

    /// Moves state and uncertainty on to a later instant.
    pub fn advance_to(&mut self, at: Time, model: &Model, commands: &Commands, step: Span) {
        let span_s = (at - self.at).as_secs_f64();
        if span_s <= 0.0 {
            return;
        }
        let path = self.path(model, commands, step);
        path.carry(&mut self.motion, self.at, at);
        self.translation.grow(self.regime, span_s);
        self.attitude.grow(self.regime, self.motion.kinematics.rate_rad_s, span_s);
        self.at = at;
    }

    /// What the cameras should see at the state's instant.
    pub fn expectation(&self) -> Expectation {
        Expectation {
            position_m: self.motion.kinematics.position_m,
            orientation: self.motion.kinematics.orientation,
            position_sigma_m: self.translation.position_sigma_m(),
            attitude_sigma_rad: self.attitude.attitude_sigma_rad(),
        }
    }

    /// Fuses a pose exposed at the state's instant, given as measured less predicted.
    pub fn correct(&mut self, position_m: Vector<World>, turn_rad: Vector<Body>) {
        self.translation.correct(&mut self.motion, position_m);
        self.attitude.correct(&mut self.motion, turn_rad);
        if self.regime != Regime::Commanded {
            self.motion.acceleration_m_s2 = self.motion.disturbance_m_s2;
            self.motion.angular_acceleration_rad_s2 = self.motion.angular_disturbance_rad_s2;
        }
    }

    /// Moves part of the lasting disturbance over to the model: along the thrust to the thrust's ratio,
    /// against the motion to the drag. The sum of all accelerations stays what it was.
    pub fn teach(&mut self, model: &mut Model, tuning: &ModelTuning, span_s: f64) {
        let motion = &mut self.motion;
        let k = &motion.kinematics;
        let steady = self.regime == Regime::Commanded
            && !motion.resting
            && self.at - self.entered_at >= SETTLING
            && k.position_m.z >= tuning.learning_height_m
            && motion.disturbance_m_s2.norm() < LEARNABLE_M_S2;
        if !steady {
            return;
        }
        let collective = model.collective_m_s2(motion);
        if collective > 0.3 * GRAVITY_M_S2 {
            let axis = k.orientation.z_axis();
            let share = span_s / tuning.thrust_learning_s * motion.disturbance_m_s2.dot(axis) / collective;
            let ratio = model.thrust_ratio * (1.0 + share);
            let ratio = ratio.clamp(THRUST_RATIO_RANGE.0, THRUST_RATIO_RANGE.1);
            motion.disturbance_m_s2 += axis * (collective * (1.0 - ratio / model.thrust_ratio));
            model.thrust_ratio = ratio;
        }
        let velocity = k.velocity_m_s;
        let square = velocity.dot(velocity) + DRAG_SPEED_M_S * DRAG_SPEED_M_S;
        let share = -span_s / tuning.drag_learning_s * motion.disturbance_m_s2.dot(velocity) / square;
        let drag = (model.drag_1_s + share).clamp(DRAG_RANGE_1_S.0, DRAG_RANGE_1_S.1);
        motion.disturbance_m_s2 += velocity * (drag - model.drag_1_s);
        model.drag_1_s = drag;
    }

    /// Whether state and uncertainty are usable numbers.
    pub fn is_sound(&self) -> bool {
        self.motion.is_finite() && self.translation.is_sound() && self.attitude.is_sound()
    }

    /// One sigma per axis of position, velocity, attitude and body rate.
    #[cfg(test)]
    pub fn sigmas(&self) -> [f64; 4] {
        let (translation, attitude) = (&self.translation, &self.attitude);
        [
            translation.position_sigma_m(),
            translation.velocity_sigma_m_s(),
            attitude.attitude_sigma_rad(),
            attitude.rate_sigma_rad_s(),
        ]
    }
}
