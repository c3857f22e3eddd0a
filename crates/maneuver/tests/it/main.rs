//! The published figures, the limits, and what must hold for any numbers.

mod figures;
mod infeasible;
mod properties;
mod vehicles;

use maneuver::{Envelope, FlipDesign, Model};

/// A design on the paper's vehicle.
fn design(flips: u8, rate_deg_s: f64, margin: f64) -> FlipDesign {
    let envelope = Envelope::with_margin(&Model::TABLE_I, margin).expect("a margin below one half");
    FlipDesign { flips, rate_rad_s_max: rate_deg_s.to_radians(), envelope }
}

/// Fails unless every number equals its printed figure to half of the last printed digit.
fn assert_prints(what: &str, computed: &[f64], printed: &[f64], digits: i32) {
    let half = (0..digits).fold(0.5, |half, _| half / 10.0);
    assert_eq!(computed.len(), printed.len(), "{what}");
    for (index, (computed, printed)) in computed.iter().zip(printed).enumerate() {
        assert!(
            (computed - printed).abs() <= half * (1.0 + 1e-6),
            "{what} [{index}]: computed {computed}, printed {printed}"
        );
    }
}
