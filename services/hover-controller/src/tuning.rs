//! The hover controller's section of `services.toml`.

use serde::Deserialize;
use settings::ConfigError;

/// Settings of the hover controller; every one has a default.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Position to acceleration.
    pub position: PositionTuning,
    /// Thrust direction and heading to body rates.
    pub attitude: AttitudeTuning,
    /// Take-off and landing.
    pub phases: PhaseTuning,
    /// Age limits.
    pub safety: SafetyTuning,
}

/// Position to acceleration.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionTuning {
    /// Velocity asked for by distance from the goal.
    pub position_gain_1_s: f64,
    /// Horizontal acceleration asked for by error of velocity.
    pub velocity_gain_1_s: f64,
    /// Vertical acceleration asked for by error of velocity.
    pub vertical_gain_1_s: f64,
    /// Acceleration asked for by the integral of the distance from the goal.
    pub integral_gain_1_s3: f64,
    /// Greatest acceleration the integral may ask for.
    pub integral_m_s2_max: f64,
    /// The integral runs only this close to the goal.
    pub integral_reach_m: f64,
    /// Time constant with which the estimator's disturbance is compensated.
    pub disturbance_time_s: f64,
    /// Greatest disturbance compensated.
    pub disturbance_m_s2_max: f64,
    /// Greatest horizontal speed toward the goal.
    pub speed_m_s_max: f64,
    /// Greatest upward speed toward the goal.
    pub climb_m_s_max: f64,
    /// Greatest downward speed toward the goal.
    pub descent_m_s_max: f64,
    /// Greatest tilt asked for in normal flight.
    pub tilt_rad_max: f64,
    /// Greatest tilt asked for while recovering.
    pub recovery_tilt_rad_max: f64,
    /// Least collective acceleration asked for in flight: below, the rotors cannot turn the vehicle.
    pub collective_m_s2_min: f64,
    /// Greatest collective acceleration asked for: above, the rotors cannot turn the vehicle either.
    pub collective_m_s2_max: f64,
    /// Goals are carried on with their velocity for at most so long.
    pub goal_horizon_s: f64,
}

/// Thrust direction and heading to body rates.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AttitudeTuning {
    /// Rate asked for by angle of the thrust axis.
    pub tilt_gain_1_s: f64,
    /// Rate asked for by error of heading.
    pub yaw_gain_1_s: f64,
    /// The vehicle goes on turning for so long when told to stop: errors are taken at the attitude it will
    /// have.
    pub lead_s: f64,
    /// Angular acceleration it can be relied on to stop with.
    pub stopping_rad_s2: f64,
    /// Greatest pitch and roll rate.
    pub rate_rad_s_max: f64,
    /// Greatest yaw rate.
    pub yaw_rate_rad_s_max: f64,
    /// Tilted further than this, only the thrust axis counts and heading waits.
    pub yaw_tilt_rad_max: f64,
}

/// Take-off and landing.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhaseTuning {
    /// Motors are commanded off for so long before a take-off.
    pub ground_s_min: f64,
    /// Collective acceleration at the start of a take-off.
    pub spin_up_m_s2: f64,
    /// How fast the collective rises until the vehicle leaves the floor.
    pub spin_up_m_s3: f64,
    /// A vehicle that has not left the floor by then does not fly.
    pub spin_up_s_max: f64,
    /// After a take-off that failed, the next waits so long.
    pub retry_s: f64,
    /// Risen so far, the vehicle is in the air.
    pub lift_off_m: f64,
    /// Climbing speed of a take-off.
    pub climb_m_s: f64,
    /// Height at which a take-off ends and the flight to the goal begins.
    pub take_off_height_m: f64,
    /// Speed of descent of a landing.
    pub descent_m_s: f64,
    /// Speed of descent close to the floor.
    pub touchdown_m_s: f64,
    /// Below this height a landing is close to the floor.
    pub flare_height_m: f64,
    /// A landing descends only this close to its spot, seen from above.
    pub spot_m: f64,
    /// Height of the centre of a standing vehicle, at most.
    pub standing_height_m: f64,
    /// A vehicle higher than this is in the air.
    pub airborne_height_m: f64,
    /// Standing still for so long, a landing vehicle has landed.
    pub touchdown_s: f64,
    /// In flight without a goal since the start, for so long it is held where it is.
    pub no_goal_s: f64,
    /// In flight, a goal not repeated for so long is void, and the vehicle lands.
    pub goal_s_max: f64,
    /// Time constant of the voltage's average.
    pub battery_time_s: f64,
    /// Speed relative to the goal's above which the vehicle must be caught rather than flown.
    pub recover_m_s: f64,
    /// Tilt above which likewise.
    pub recover_rad: f64,
    /// Pitch and roll rate above which likewise.
    pub recover_rad_s: f64,
}

/// Age limits; see the failsafe ladder of the safety notes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SafetyTuning {
    /// Without a state for so long, the vehicle is told to level.
    pub state_s_max: f64,
    /// Without a state for so long, it is told to descend by itself.
    pub descend_after_s: f64,
    /// ... or so long after the last state ceased to be valid.
    pub descend_after_invalid_s: f64,
    /// Consecutive frames the estimate must rest on before the vehicle is flown again.
    pub resume_frames: u16,
    /// For so long after a maneuver, states count only while the cameras see the vehicle.
    pub settle_s: f64,
    /// Validity of a command.
    pub command_s: f64,
    /// Period of commands while no state comes.
    pub blind_period_s: f64,
    /// A report of the vehicle counts for so long.
    pub telemetry_s_max: f64,
    /// A maneuver whose end nobody reported is over after so long.
    pub maneuver_s_max: f64,
}

impl Default for PositionTuning {
    fn default() -> Self {
        Self {
            position_gain_1_s: 2.4,
            velocity_gain_1_s: 6.5,
            vertical_gain_1_s: 6.0,
            integral_gain_1_s3: 2.0,
            integral_m_s2_max: 0.8,
            integral_reach_m: 0.3,
            disturbance_time_s: 0.15,
            disturbance_m_s2_max: 3.0,
            speed_m_s_max: 1.8,
            climb_m_s_max: 1.5,
            descent_m_s_max: 1.0,
            tilt_rad_max: 0.5,
            recovery_tilt_rad_max: 0.85,
            collective_m_s2_min: 3.0,
            collective_m_s2_max: 20.0,
            goal_horizon_s: 0.25,
        }
    }
}

impl Default for AttitudeTuning {
    fn default() -> Self {
        Self {
            tilt_gain_1_s: 12.0,
            yaw_gain_1_s: 2.0,
            lead_s: 0.01,
            stopping_rad_s2: 80.0,
            rate_rad_s_max: 10.0,
            yaw_rate_rad_s_max: 3.0,
            yaw_tilt_rad_max: 1.0,
        }
    }
}

impl Default for PhaseTuning {
    fn default() -> Self {
        Self {
            ground_s_min: 0.3,
            spin_up_m_s2: 3.0,
            spin_up_m_s3: 15.0,
            spin_up_s_max: 1.2,
            retry_s: 3.0,
            lift_off_m: 0.04,
            climb_m_s: 0.7,
            take_off_height_m: 0.8,
            descent_m_s: 0.9,
            touchdown_m_s: 0.4,
            flare_height_m: 0.6,
            spot_m: 0.3,
            standing_height_m: 0.1,
            airborne_height_m: 0.3,
            touchdown_s: 0.15,
            no_goal_s: 2.0,
            goal_s_max: 3.0,
            battery_time_s: 2.0,
            recover_m_s: 2.0,
            recover_rad: 0.6,
            recover_rad_s: 4.0,
        }
    }
}

impl Default for SafetyTuning {
    fn default() -> Self {
        Self {
            state_s_max: 0.06,
            descend_after_s: 0.3,
            descend_after_invalid_s: 0.2,
            resume_frames: 10,
            settle_s: 0.5,
            command_s: 0.06,
            blind_period_s: 0.01,
            telemetry_s_max: 0.5,
            maneuver_s_max: 4.0,
        }
    }
}

type Range = (&'static str, f64, f64, f64);

impl Tuning {
    /// Refuses what no controller can work with.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for (key, value, min, max) in self.flight_ranges().into_iter().chain(self.phase_ranges()) {
            // Not `<` and `>`: what is not a number lies in no range.
            if !(min..=max).contains(&value) {
                return Err(ConfigError::OutOfRange {
                    file: "services.toml".to_owned(),
                    key: format!("[hover-controller] {key}"),
                    value,
                    min,
                    max,
                });
            }
        }
        Ok(())
    }

    fn flight_ranges(&self) -> [Range; 23] {
        let (p, a) = (&self.position, &self.attitude);
        [
            ("position.position_gain_1_s", p.position_gain_1_s, 0.1, 20.0),
            ("position.velocity_gain_1_s", p.velocity_gain_1_s, 0.1, 40.0),
            ("position.vertical_gain_1_s", p.vertical_gain_1_s, 0.1, 40.0),
            ("position.integral_gain_1_s3", p.integral_gain_1_s3, 0.0, 100.0),
            ("position.integral_m_s2_max", p.integral_m_s2_max, 0.0, 10.0),
            ("position.integral_reach_m", p.integral_reach_m, 0.0, 10.0),
            ("position.disturbance_time_s", p.disturbance_time_s, 0.01, 100.0),
            ("position.disturbance_m_s2_max", p.disturbance_m_s2_max, 0.0, 10.0),
            ("position.speed_m_s_max", p.speed_m_s_max, 0.1, 10.0),
            ("position.climb_m_s_max", p.climb_m_s_max, 0.1, 10.0),
            ("position.descent_m_s_max", p.descent_m_s_max, 0.1, 10.0),
            ("position.tilt_rad_max", p.tilt_rad_max, 0.05, 1.2),
            ("position.recovery_tilt_rad_max", p.recovery_tilt_rad_max, p.tilt_rad_max, 1.3),
            ("position.collective_m_s2_min", p.collective_m_s2_min, 0.1, 9.0),
            ("position.collective_m_s2_max", p.collective_m_s2_max, 11.0, 24.0),
            ("position.goal_horizon_s", p.goal_horizon_s, 0.0, 2.0),
            ("attitude.tilt_gain_1_s", a.tilt_gain_1_s, 0.1, 40.0),
            ("attitude.yaw_gain_1_s", a.yaw_gain_1_s, 0.0, 20.0),
            ("attitude.lead_s", a.lead_s, 0.0, 0.2),
            ("attitude.stopping_rad_s2", a.stopping_rad_s2, 1.0, 1000.0),
            ("attitude.rate_rad_s_max", a.rate_rad_s_max, 0.5, 12.0),
            ("attitude.yaw_rate_rad_s_max", a.yaw_rate_rad_s_max, 0.1, 12.0),
            ("attitude.yaw_tilt_rad_max", a.yaw_tilt_rad_max, 0.1, 1.5),
        ]
    }

    fn phase_ranges(&self) -> [Range; 30] {
        let (p, s) = (&self.phases, &self.safety);
        [
            ("phases.ground_s_min", p.ground_s_min, 0.02, 60.0),
            ("phases.spin_up_m_s2", p.spin_up_m_s2, 0.0, 9.0),
            ("phases.spin_up_m_s3", p.spin_up_m_s3, 0.1, 200.0),
            ("phases.spin_up_s_max", p.spin_up_s_max, 0.1, 10.0),
            ("phases.retry_s", p.retry_s, 0.0, 600.0),
            ("phases.lift_off_m", p.lift_off_m, 0.01, 0.5),
            ("phases.climb_m_s", p.climb_m_s, 0.05, 5.0),
            ("phases.take_off_height_m", p.take_off_height_m, 0.1, 5.0),
            ("phases.descent_m_s", p.descent_m_s, 0.1, 3.0),
            ("phases.touchdown_m_s", p.touchdown_m_s, 0.05, 1.5),
            ("phases.flare_height_m", p.flare_height_m, 0.0, 5.0),
            ("phases.spot_m", p.spot_m, 0.01, 10.0),
            ("phases.standing_height_m", p.standing_height_m, 0.0, 1.0),
            ("phases.airborne_height_m", p.airborne_height_m, p.standing_height_m, 2.0),
            ("phases.touchdown_s", p.touchdown_s, 0.01, 5.0),
            ("phases.no_goal_s", p.no_goal_s, 0.0, 60.0),
            ("phases.goal_s_max", p.goal_s_max, 0.2, 60.0),
            ("phases.battery_time_s", p.battery_time_s, 0.01, 100.0),
            ("phases.recover_m_s", p.recover_m_s, 0.1, 20.0),
            ("phases.recover_rad", p.recover_rad, 0.05, 3.2),
            ("phases.recover_rad_s", p.recover_rad_s, 0.1, 100.0),
            ("safety.state_s_max", s.state_s_max, 0.005, 1.0),
            ("safety.descend_after_s", s.descend_after_s, s.state_s_max, 5.0),
            ("safety.descend_after_invalid_s", s.descend_after_invalid_s, 0.0, 5.0),
            ("safety.resume_frames", f64::from(s.resume_frames), 1.0, 1000.0),
            ("safety.settle_s", s.settle_s, 0.0, 10.0),
            ("safety.command_s", s.command_s, 0.005, 0.2),
            ("safety.blind_period_s", s.blind_period_s, 0.001, 0.06),
            ("safety.telemetry_s_max", s.telemetry_s_max, 0.05, 10.0),
            ("safety.maneuver_s_max", s.maneuver_s_max, 0.1, 60.0),
        ]
    }
}
