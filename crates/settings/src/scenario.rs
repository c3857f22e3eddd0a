//! A scenario: which vehicles learn what, or hover, and where.

use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::read::{at_most, in_range};

/// A Jacobian computed for one rate says nothing of a flip at more than twice or less than half of it.
const RATE_RATIO_MAX: f64 = 2.0;

/// One experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// One line for lists and logs.
    pub description: String,
    /// What is learned; without it, the vehicles hover at their places.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<FlipSettings>,
    /// The vehicles and their places.
    #[serde(rename = "vehicle")]
    pub vehicles: Vec<ScenarioVehicle>,
}

/// The flip and how it is learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlipSettings {
    /// Whole turns the first parameters are computed for.
    pub flips: u8,
    /// Coast rate the first parameters and the Jacobian are computed for.
    pub design_rate_rad_s: f64,
    /// Coast rate flown; differs from the design's only where the mismatch is the experiment.
    pub flown_rate_rad_s: f64,
    /// Part of the thrust range kept back at each end.
    pub envelope_margin_ratio: f64,
    /// Step size gamma of the update.
    pub step_size_ratio: f64,
    /// Flips to fly.
    pub iterations: u32,
}

/// A vehicle's part in a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioVehicle {
    /// File name, without ending, in `vehicles/`.
    pub file: String,
    /// Where it takes off, world x.
    pub start_x_m: f64,
    /// Where it takes off, world y.
    pub start_y_m: f64,
    /// Where its flips begin, or it hovers, world x.
    pub place_x_m: f64,
    /// Where its flips begin, or it hovers, world y.
    pub place_y_m: f64,
    /// Where its flips begin, or it hovers, world z.
    pub place_z_m: f64,
    /// Heading of its body x axis: the flip lies in the vertical plane of this heading.
    pub heading_rad: f64,
}

impl Scenario {
    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        in_range(file, "vehicle (how many)", self.vehicles.len() as f64, 1.0, 16.0)?;
        self.flip.as_ref().map_or(Ok(()), |flip| flip.check(file))
    }
}

impl FlipSettings {
    fn check(&self, file: &str) -> Result<(), ConfigError> {
        let flip = self;
        in_range(file, "flip.flips", f64::from(flip.flips), 1.0, 10.0)?;
        in_range(file, "flip.design_rate_rad_s", flip.design_rate_rad_s, 5.0, 60.0)?;
        in_range(file, "flip.flown_rate_rad_s", flip.flown_rate_rad_s, 5.0, 60.0)?;
        at_most(
            file,
            ("flip.flown_rate_rad_s", flip.flown_rate_rad_s),
            RATE_RATIO_MAX,
            ("flip.design_rate_rad_s", flip.design_rate_rad_s),
        )?;
        at_most(
            file,
            ("flip.design_rate_rad_s", flip.design_rate_rad_s),
            RATE_RATIO_MAX,
            ("flip.flown_rate_rad_s", flip.flown_rate_rad_s),
        )?;
        in_range(file, "flip.envelope_margin_ratio", flip.envelope_margin_ratio, 0.0, 0.4)?;
        in_range(file, "flip.step_size_ratio", flip.step_size_ratio, 1e-3, 1.0)?;
        in_range(file, "flip.iterations", f64::from(flip.iterations), 1.0, 100_000.0)
    }
}
