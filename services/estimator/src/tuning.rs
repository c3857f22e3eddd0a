//! The estimator's section of `services.toml`.

use serde::Deserialize;
use settings::ConfigError;

/// Settings of the estimator; every one has a default.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Whether `prediction` is carried to the execution of the next command. Off, it repeats the estimate:
    /// for showing what prediction is worth, never for flying.
    pub prediction: bool,
    /// How long data lasts, and how often the estimator speaks.
    pub timing: TimingTuning,
    /// What the filters believe of the cameras and of their own models.
    pub noise: NoiseTuning,
    /// What a pose must satisfy to be believed.
    pub gate: GateTuning,
    /// What the model of the vehicle learns in flight.
    pub model: ModelTuning,
}

/// How long data lasts, and how often the estimator speaks. Times are in seconds.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TimingTuning {
    /// A state stays valid so long after the last accepted pose should have arrived.
    pub coast_s: f64,
    /// A state stays valid so long after the end of a maneuver ...
    pub flip_coast_s: f64,
    /// ... if the cameras lost sight of the vehicle no longer than this before that end. Within a maneuver
    /// nothing but the cameras tells how the vehicle turns: of one unseen for longer, the attitude is not
    /// known.
    pub flip_blind_s_max: f64,
    /// Without an accepted pose for so long, a state is called coasting.
    pub degraded_after_s: f64,
    /// Without a pose for so long, states are published from the model alone.
    pub silence_s: f64,
    /// Period of states published from the model alone.
    pub coast_period_s: f64,
    /// Period of the announcement that there is no valid state.
    pub invalid_period_s: f64,
    /// A maneuver whose end nobody reported is over after so long.
    pub maneuver_s_max: f64,
    /// The vehicle flies a command no longer than this; then it levels by itself.
    pub command_s_max: f64,
    /// A report of the vehicle's mode counts for so long.
    pub telemetry_s_max: f64,
    /// Without an accepted pose for so long, the filter is dropped and the vehicle must be acquired anew.
    pub forget_s: f64,
    /// After so long without an accepted pose, the vehicle may stand any way.
    pub anywhere_s: f64,
    /// A command computed from a state needs so long to reach the radio: nearer slots are taken as missed.
    pub slot_lead_s: f64,
    /// No prediction reaches further than this.
    pub horizon_s_max: f64,
    /// Frames are on their way as long as the latency setting says, give or take this; others are late or
    /// wrongly stamped.
    pub stamp_tolerance_s: f64,
    /// Greatest step of the model's integration.
    pub step_s: f64,
}

/// What the filters believe of the cameras and of their own models; one sigma each.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseTuning {
    /// Position measured, per axis.
    pub position_m: f64,
    /// Attitude measured, per axis.
    pub attitude_rad: f64,
    /// Unexplained acceleration, per axis: draughts, and what the model still has to learn.
    pub disturbance_m_s2: f64,
    /// Time over which that changes.
    pub disturbance_time_s: f64,
    /// Unexplained change of velocity in one second, as a random walk.
    pub velocity_walk_m_s: f64,
    /// Unexplained angular acceleration.
    pub angular_disturbance_rad_s2: f64,
    /// Time over which that changes.
    pub angular_disturbance_time_s: f64,
    /// Unexplained change of body rate in one second, as a random walk.
    pub rate_walk_rad_s: f64,
    /// Scale of the vehicle's gyros: true rate by rate held, less one.
    pub rate_scale_ratio: f64,
    /// Acceleration in a maneuver.
    pub ballistic_acceleration_m_s2: f64,
    /// Angular acceleration in a maneuver.
    pub ballistic_angular_rad_s2: f64,
    /// Time over which accelerations change in a maneuver.
    pub ballistic_time_s: f64,
    /// Acceleration while the vehicle flies by itself or commands are unknown.
    pub unknown_acceleration_m_s2: f64,
    /// Angular acceleration likewise.
    pub unknown_angular_rad_s2: f64,
    /// Time over which those change.
    pub unknown_time_s: f64,
}

/// What a pose must satisfy to be believed.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GateTuning {
    /// A pose may lie so far from the prediction, besides `sigmas`.
    pub position_m: f64,
    /// ... but never further than this.
    pub position_m_max: f64,
    /// An attitude may lie so far from the prediction, besides `sigmas`.
    pub attitude_rad: f64,
    /// ... but never further than this; half a quarter turn, so that of two ways to match the markers only
    /// the nearer can fit.
    pub attitude_rad_max: f64,
    /// A filter less certain of its attitude than this compares with nothing: it must start anew.
    pub attitude_sigma_rad_max: f64,
    /// Multiples of the filter's own uncertainty added to both.
    pub sigmas: f64,
    /// Distance two successive poses may lie apart, besides what `speed_m_s_max` explains.
    pub jump_m: f64,
    /// Greatest speed of a vehicle.
    pub speed_m_s_max: f64,
    /// Angle two successive poses may lie apart, besides what `rate_rad_s_max` explains.
    pub jump_rad: f64,
    /// Greatest body rate of a vehicle; flips reach 31 rad/s, and overshoot.
    pub rate_rad_s_max: f64,
    /// Consecutive poses that agree with each other and force a new start of the filter.
    pub reacquire_frames: u16,
    /// Longest gap within such a run of poses.
    pub reacquire_gap_s: f64,
    /// After a jump, the new attitude may differ so much from the last believed one ...
    pub reacquire_rad: f64,
    /// ... and so much more per second since.
    pub reacquire_rad_s: f64,
    /// No pose of one vehicle lies so close to another tracked vehicle: that is a swap of markers.
    pub neighbour_m: f64,
    /// Poses further than this outside the hall are refused.
    pub hall_margin_m: f64,
    /// The centre of a vehicle is never lower; what millimetres read as metres make of any height in a hall
    /// is.
    pub height_m_min: f64,
}

/// What the model of the vehicle learns in flight.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelTuning {
    /// A vehicle whose centre is lower may stand on the floor.
    pub floor_height_m: f64,
    /// Greatest share of a rotor's thrust that the firmware lends to yaw.
    pub yaw_thrust_n_max: f64,
    /// Nothing is learned below this height, where the ground carries.
    pub learning_height_m: f64,
    /// Time constant with which a lasting disturbance along the thrust becomes part of the thrust's ratio.
    pub thrust_learning_s: f64,
    /// Time constant with which a lasting disturbance against the motion becomes part of the drag.
    pub drag_learning_s: f64,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            prediction: true,
            timing: TimingTuning::default(),
            noise: NoiseTuning::default(),
            gate: GateTuning::default(),
            model: ModelTuning::default(),
        }
    }
}

impl Default for TimingTuning {
    fn default() -> Self {
        Self {
            coast_s: 0.1,
            flip_coast_s: 0.2,
            flip_blind_s_max: 0.08,
            degraded_after_s: 0.025,
            silence_s: 0.0075,
            coast_period_s: 0.005,
            invalid_period_s: 0.1,
            maneuver_s_max: 4.0,
            command_s_max: 0.1,
            telemetry_s_max: 0.5,
            forget_s: 0.5,
            anywhere_s: 10.0,
            slot_lead_s: 0.0003,
            horizon_s_max: 0.25,
            stamp_tolerance_s: 0.005,
            step_s: 0.0025,
        }
    }
}

impl Default for NoiseTuning {
    fn default() -> Self {
        Self {
            position_m: 0.0005,
            attitude_rad: 0.003,
            disturbance_m_s2: 0.1,
            disturbance_time_s: 1.0,
            velocity_walk_m_s: 0.005,
            angular_disturbance_rad_s2: 0.7,
            angular_disturbance_time_s: 0.05,
            rate_walk_rad_s: 0.05,
            rate_scale_ratio: 0.03,
            ballistic_acceleration_m_s2: 30.0,
            ballistic_angular_rad_s2: 200.0,
            ballistic_time_s: 0.1,
            unknown_acceleration_m_s2: 3.0,
            unknown_angular_rad_s2: 20.0,
            unknown_time_s: 0.2,
        }
    }
}

impl Default for GateTuning {
    fn default() -> Self {
        Self {
            position_m: 0.05,
            position_m_max: 0.5,
            attitude_rad: 0.35,
            attitude_rad_max: 0.75,
            attitude_sigma_rad_max: 0.3,
            sigmas: 5.0,
            jump_m: 0.10,
            speed_m_s_max: 10.0,
            jump_rad: 0.15,
            rate_rad_s_max: 36.0,
            reacquire_frames: 10,
            reacquire_gap_s: 0.1,
            reacquire_rad: 0.6,
            reacquire_rad_s: 0.1,
            neighbour_m: 0.25,
            hall_margin_m: 1.0,
            height_m_min: 0.012,
        }
    }
}

impl Default for ModelTuning {
    fn default() -> Self {
        Self {
            floor_height_m: 0.07,
            yaw_thrust_n_max: 0.2,
            learning_height_m: 0.4,
            thrust_learning_s: 4.0,
            drag_learning_s: 4.0,
        }
    }
}

impl Tuning {
    /// Refuses what no estimator can work with.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        let (timing, noise, gate, model) = (&self.timing, &self.noise, &self.gate, &self.model);
        for (key, value, min, max) in [
            ("timing.coast_s", timing.coast_s, 0.01, 1.0),
            ("timing.flip_coast_s", timing.flip_coast_s, 0.0, 1.0),
            ("timing.flip_blind_s_max", timing.flip_blind_s_max, 0.0, 5.0),
            ("timing.degraded_after_s", timing.degraded_after_s, 0.001, 1.0),
            ("timing.silence_s", timing.silence_s, 0.001, 1.0),
            ("timing.coast_period_s", timing.coast_period_s, 0.001, 1.0),
            ("timing.invalid_period_s", timing.invalid_period_s, 0.001, 10.0),
            ("timing.maneuver_s_max", timing.maneuver_s_max, 0.1, 60.0),
            ("timing.command_s_max", timing.command_s_max, 0.02, 1.0),
            ("timing.telemetry_s_max", timing.telemetry_s_max, 0.05, 10.0),
            ("timing.forget_s", timing.forget_s, timing.coast_s, 5.0),
            ("timing.anywhere_s", timing.anywhere_s, 1.0, 1e6),
            ("timing.slot_lead_s", timing.slot_lead_s, 0.0, 0.02),
            ("timing.horizon_s_max", timing.horizon_s_max, 0.0, 1.0),
            ("timing.stamp_tolerance_s", timing.stamp_tolerance_s, 0.0005, 1.0),
            ("timing.step_s", timing.step_s, 0.0002, 0.01),
            ("noise.position_m", noise.position_m, 1e-6, 1.0),
            ("noise.attitude_rad", noise.attitude_rad, 1e-6, 1.0),
            ("noise.disturbance_m_s2", noise.disturbance_m_s2, 1e-6, 100.0),
            ("noise.disturbance_time_s", noise.disturbance_time_s, 0.01, 100.0),
            ("noise.velocity_walk_m_s", noise.velocity_walk_m_s, 0.0, 10.0),
            ("noise.angular_disturbance_rad_s2", noise.angular_disturbance_rad_s2, 1e-6, 1000.0),
            ("noise.angular_disturbance_time_s", noise.angular_disturbance_time_s, 0.01, 100.0),
            ("noise.rate_walk_rad_s", noise.rate_walk_rad_s, 0.0, 100.0),
            ("noise.rate_scale_ratio", noise.rate_scale_ratio, 0.0, 1.0),
            ("noise.ballistic_acceleration_m_s2", noise.ballistic_acceleration_m_s2, 1e-3, 1000.0),
            ("noise.ballistic_angular_rad_s2", noise.ballistic_angular_rad_s2, 1e-3, 10_000.0),
            ("noise.ballistic_time_s", noise.ballistic_time_s, 0.01, 10.0),
            ("noise.unknown_acceleration_m_s2", noise.unknown_acceleration_m_s2, 1e-3, 1000.0),
            ("noise.unknown_angular_rad_s2", noise.unknown_angular_rad_s2, 1e-3, 10_000.0),
            ("noise.unknown_time_s", noise.unknown_time_s, 0.01, 10.0),
            ("gate.position_m", gate.position_m, 0.001, gate.position_m_max),
            ("gate.position_m_max", gate.position_m_max, 0.001, 10.0),
            ("gate.attitude_rad", gate.attitude_rad, 0.01, gate.attitude_rad_max),
            ("gate.attitude_rad_max", gate.attitude_rad_max, 0.01, 1.5),
            ("gate.attitude_sigma_rad_max", gate.attitude_sigma_rad_max, 0.01, 1.0),
            ("gate.sigmas", gate.sigmas, 0.0, 100.0),
            ("gate.jump_m", gate.jump_m, 0.001, 10.0),
            ("gate.speed_m_s_max", gate.speed_m_s_max, 0.1, 100.0),
            ("gate.jump_rad", gate.jump_rad, 0.01, 1.5),
            ("gate.rate_rad_s_max", gate.rate_rad_s_max, 0.1, 200.0),
            ("gate.reacquire_frames", f64::from(gate.reacquire_frames), 2.0, 1000.0),
            ("gate.reacquire_gap_s", gate.reacquire_gap_s, 0.005, 1.0),
            ("gate.reacquire_rad", gate.reacquire_rad, 0.0, 3.2),
            ("gate.reacquire_rad_s", gate.reacquire_rad_s, 0.0, 100.0),
            ("gate.neighbour_m", gate.neighbour_m, 0.0, 10.0),
            ("gate.hall_margin_m", gate.hall_margin_m, 0.0, 100.0),
            ("gate.height_m_min", gate.height_m_min, -1.0, 1.0),
            ("model.floor_height_m", model.floor_height_m, 0.0, 1.0),
            ("model.yaw_thrust_n_max", model.yaw_thrust_n_max, 0.0, 100.0),
            ("model.learning_height_m", model.learning_height_m, 0.0, 10.0),
            ("model.thrust_learning_s", model.thrust_learning_s, 0.1, 1e6),
            ("model.drag_learning_s", model.drag_learning_s, 0.1, 1e6),
        ] {
            // Not `<` and `>`: what is not a number lies in no range.
            if !(min..=max).contains(&value) {
                return Err(ConfigError::OutOfRange {
                    file: "services.toml".to_owned(),
                    key: format!("[estimator] {key}"),
                    value,
                    min,
                    max,
                });
            }
        }
        Ok(())
    }
}
