//! Many seeds of one experiment, and what their distribution is.

use serde::Serialize;

use crate::experiment::{Extremes, Flown};
use crate::report::Outcome;

/// What one learning experiment came to, in the terms the paper's figures are judged by. Norms are plain 2-norms over
/// mixed units of the true final error; medians over several flips, because a single one is as noisy as the air.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The seed.
    pub seed: u64,
    /// Flips flown to their end.
    pub flips: usize,
    /// Flips ended early or not measured.
    pub failed: usize,
    /// The first flip's true error: x, z, vx, vz, theta.
    pub first_error: [f64; 5],
    /// Norm of the first flip's true error.
    pub first_norm: f64,
    /// Least median norm over any ten flips in a row.
    pub floor_norm: f64,
    /// The first flip from which the median norm over ten flips stays below 20 % of the first flip's, at least until half
    /// of all flips are flown.
    pub settled_at: Option<usize>,
    /// Median norm over the flips from a half to four fifths of all: settled, the battery still good.
    pub steady_norm: f64,
    /// Median norm of the last five flips.
    pub last_norm: f64,
    /// Median distance of the measured from the true final error: place.
    pub measured_m: f64,
    /// The same: speed.
    pub measured_m_s: f64,
    /// The same: angle.
    pub measured_rad: f64,
    /// How far the flips and what followed reached.
    pub extremes: Extremes,
    /// Whole turns of the last flip.
    pub turns: f64,
    /// Why learning stopped early, if it did.
    pub stopped: Option<String>,
}

const SETTLED_RATIO: f64 = 0.2;
const MEDIAN_OF: usize = 10;

impl Summary {
    /// Sums up the first vehicle's flips.
    #[must_use]
    pub fn of(flown: &Flown) -> Self {
        let vehicle = &flown.report.vehicles[0];
        let completed: Vec<_> =
            vehicle.iterations.iter().filter(|flip| flip.outcome == Outcome::Completed).collect();
        let norms: Vec<f64> = completed.iter().map(|flip| flip.true_error.norm()).collect();
        let medians: Vec<f64> = norms.windows(MEDIAN_OF).map(median).collect();
        let first_norm = norms.first().copied().unwrap_or(0.0);
        let distance = |of: fn(&[f64; 5], &[f64; 5]) -> f64| {
            let distances: Vec<f64> = completed
                .iter()
                .map(|flip| of(&flip.error.to_array(), &flip.true_error.to_array()))
                .collect();
            median(&distances)
        };
        Self {
            seed: flown.report.seed,
            flips: completed.len(),
            failed: vehicle.iterations.len() - completed.len(),
            first_error: completed.first().map_or([0.0; 5], |flip| flip.true_error.to_array()),
            first_norm,
            floor_norm: medians.iter().copied().fold(f64::INFINITY, f64::min),
            settled_at: settled_at(&medians, SETTLED_RATIO * first_norm),
            steady_norm: median(&norms[norms.len() / 2..norms.len() * 4 / 5]),
            last_norm: median(&norms[norms.len().saturating_sub(5)..]),
            measured_m: distance(|m, t| planar(m[0] - t[0], m[1] - t[1])),
            measured_m_s: distance(|m, t| planar(m[2] - t[2], m[3] - t[3])),
            measured_rad: distance(|m, t| quantity::math::wrap_pi(m[4] - t[4]).abs()),
            extremes: flown.extremes,
            turns: flown.turns.last().copied().unwrap_or(0.0),
            stopped: vehicle.stopped.clone(),
        }
    }
}

fn planar(x: f64, z: f64) -> f64 {
    quantity::math::sqrt(x * x + z * z)
}

fn settled_at(medians: &[f64], threshold: f64) -> Option<usize> {
    let until = medians.len().div_ceil(2);
    let last_bad = medians[..until].iter().rposition(|norm| *norm > threshold);
    match last_bad {
        None => Some(0),
        Some(index) if index + 1 < until => Some(index + 1),
        Some(_) => None,
    }
}

/// The middle of some values; of none, zero.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Least, middle and greatest of some values.
#[must_use]
pub fn spread(values: &[f64]) -> [f64; 3] {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    [least, median(values), greatest]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settling_is_the_first_flip_after_the_last_bad_one() {
        let medians = [1.0, 0.5, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1, 0.9, 0.9];
        assert_eq!(settled_at(&medians, 0.2), Some(4));
        assert_eq!(settled_at(&[1.0; 10], 0.2), None);
    }

    #[test]
    fn the_median_of_none_is_zero() {
        assert_eq!(median(&[]), 0.0);
        assert_eq!(spread(&[3.0, 1.0, 2.0]), [1.0, 2.0, 3.0]);
    }
}
