//! The hall: the box the vehicles must stay in.

use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::read::in_range;

/// The hall. Its floor is z = 0, its middle x = y = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hall {
    /// Extent along world x, wall to wall.
    pub width_m: f64,
    /// Extent along world y, wall to wall.
    pub depth_m: f64,
    /// Extent along world z, floor to net.
    pub height_m: f64,
    /// How far from walls and net a vehicle's place must be.
    pub margin_m: f64,
}

impl Hall {
    /// Whether a point lies inside the hall.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64, z_m: f64) -> bool {
        x_m.abs() <= 0.5 * self.width_m
            && y_m.abs() <= 0.5 * self.depth_m
            && (0.0..=self.height_m).contains(&z_m)
    }

    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        in_range(file, "width_m", self.width_m, 2.0, 200.0)?;
        in_range(file, "depth_m", self.depth_m, 2.0, 200.0)?;
        in_range(file, "height_m", self.height_m, 2.0, 100.0)?;
        in_range(
            file,
            "margin_m",
            self.margin_m,
            0.1,
            0.4 * self.width_m.min(self.depth_m).min(self.height_m),
        )
    }
}
