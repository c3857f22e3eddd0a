//! The learner's section of `services.toml`.

use serde::Deserialize;
use settings::{Arena, ConfigError};

/// `[learner]`: all of it has defaults. The step size gamma is the scenario's.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// How often the next parameters are repeated.
    pub repeat_s: f64,
    /// What parameters may be at all.
    pub bounds: BoundsTuning,
    /// How far parameters may move from one flip to the next.
    pub step: StepTuning,
    /// What parameters are tried on before they are flown.
    pub check: CheckTuning,
    /// When to stop and ask a person.
    pub stop: StopTuning,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            repeat_s: 0.5,
            bounds: BoundsTuning::default(),
            step: StepTuning::default(),
            check: CheckTuning::default(),
            stop: StopTuning::default(),
        }
    }
}

/// `[learner.bounds]`: what parameters may be at all (hazard H14 of the safety notes). The vehicle refuses
/// what lies outside.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundsTuning {
    /// Least collective acceleration of any step.
    pub collective_m_s2_min: f64,
    /// Greatest collective acceleration of any step; the vehicle's greatest thrust by its mass bounds it too.
    pub collective_m_s2_max: f64,
    /// Least duration of any step.
    pub duration_s_min: f64,
    /// Greatest duration of the whole.
    pub total_s_max: f64,
    /// Greatest commanded rate, either way.
    pub rate_rad_s_max: f64,
}

impl Default for BoundsTuning {
    fn default() -> Self {
        Self {
            collective_m_s2_min: 0.68,
            collective_m_s2_max: 23.9,
            duration_s_min: 0.005,
            total_s_max: 4.0,
            rate_rad_s_max: 31.415_926,
        }
    }
}

/// `[learner.step]`: how far parameters may move from one flip to the next. A longer step is shortened, its
/// direction kept.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StepTuning {
    /// Greatest change of U1 and U5.
    pub collective_m_s2_max: f64,
    /// Greatest change of T1, T3 and T5.
    pub duration_s_max: f64,
}

impl Default for StepTuning {
    fn default() -> Self {
        Self { collective_m_s2_max: 2.0, duration_s_max: 0.1 }
    }
}

/// `[learner.check]`: what parameters are tried on before they are flown.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CheckTuning {
    /// The model's thrust, mass, inertia and rotor gain are each taken this much lower and higher.
    pub spread_ratio: f64,
    /// Height that must remain where the worst of these models sinks to.
    pub floor_reserve_m_min: f64,
    /// Height that must remain to the net above where the weakest of these models climbs to.
    pub ceiling_reserve_m_min: f64,
    /// How far below its place a flip may begin.
    pub place_m_max: f64,
    /// A step that fails is halved so often before it is given up.
    pub halvings_max: u32,
}

impl Default for CheckTuning {
    fn default() -> Self {
        Self {
            spread_ratio: 0.2,
            floor_reserve_m_min: 1.5,
            ceiling_reserve_m_min: 0.5,
            place_m_max: 0.1,
            halvings_max: 6,
        }
    }
}

/// `[learner.stop]`: when to stop and ask a person.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StopTuning {
    /// So many bad flips in a row stop the learning.
    pub bad_flips_max: u32,
    /// So many flips in a row whose end was not measured stop the learning.
    pub unmeasured_flips_max: u32,
    /// So many steps in a row that fail the check stop the learning.
    pub refused_steps_max: u32,
    /// A flip is bad when the norm of its error (m, m/s and rad one to one) is above this and grows.
    pub error_norm_max: f64,
    /// A flip is bad when the norm of its error is above this, growing or not.
    pub error_norm_wild: f64,
}

impl Default for StopTuning {
    fn default() -> Self {
        Self {
            bad_flips_max: 5,
            unmeasured_flips_max: 5,
            refused_steps_max: 5,
            error_norm_max: 12.0,
            error_norm_wild: 20.0,
        }
    }
}

impl Tuning {
    /// Refuses what cannot be learned with.
    ///
    /// # Errors
    /// The first number outside its range, the scenario's flown rate among them.
    pub(crate) fn check(&self, arena: &Arena) -> Result<(), ConfigError> {
        let Self { repeat_s, bounds, step, check, stop } = self;
        for (key, value, min, max) in [
            ("repeat_s", *repeat_s, 0.05, 10.0),
            ("bounds.collective_m_s2_min", bounds.collective_m_s2_min, 0.0, 9.0),
            ("bounds.collective_m_s2_max", bounds.collective_m_s2_max, 10.0, 200.0),
            ("bounds.duration_s_min", bounds.duration_s_min, 1e-4, 0.1),
            ("bounds.total_s_max", bounds.total_s_max, 0.1, 10.0),
            ("bounds.rate_rad_s_max", bounds.rate_rad_s_max, 1.0, 200.0),
            ("step.collective_m_s2_max", step.collective_m_s2_max, 1e-3, 10.0),
            ("step.duration_s_max", step.duration_s_max, 1e-4, 1.0),
            ("check.spread_ratio", check.spread_ratio, 0.0, 0.5),
            ("check.floor_reserve_m_min", check.floor_reserve_m_min, 0.0, 100.0),
            ("check.ceiling_reserve_m_min", check.ceiling_reserve_m_min, 0.0, 100.0),
            ("check.place_m_max", check.place_m_max, 0.0, 2.0),
            ("check.halvings_max", f64::from(check.halvings_max), 0.0, 30.0),
            ("stop.bad_flips_max", f64::from(stop.bad_flips_max), 1.0, 1000.0),
            ("stop.unmeasured_flips_max", f64::from(stop.unmeasured_flips_max), 1.0, 1000.0),
            ("stop.refused_steps_max", f64::from(stop.refused_steps_max), 1.0, 1000.0),
            ("stop.error_norm_max", stop.error_norm_max, 0.1, 1e3),
            ("stop.error_norm_wild", stop.error_norm_wild, stop.error_norm_max, 1e6),
        ] {
            in_range("services.toml", &format!("[learner] {key}"), value, min, max)?;
        }
        let Some(flip) = &arena.scenario.flip else { return Ok(()) };
        let file = format!("scenarios/{}.toml", arena.name);
        in_range(&file, "flip.flown_rate_rad_s", flip.flown_rate_rad_s, 0.0, bounds.rate_rad_s_max)
    }
}

/// Refuses a number outside its range; one that is not a number is outside every range.
///
/// # Errors
/// File, key, value and range.
fn in_range(file: &str, key: &str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(ConfigError::OutOfRange { file: file.to_owned(), key: key.to_owned(), value, min, max })
}
