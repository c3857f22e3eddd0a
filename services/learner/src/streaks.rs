//! When to stop and ask a person: what went wrong several times in a row.

use crate::check::Refusal;
use crate::tuning::StopTuning;

/// What has gone wrong lately, and how often in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Streaks {
    bad_flips: u32,
    unmeasured_flips: u32,
    refused_steps: u32,
    last_norm: Option<f64>,
}

/// Whether to go on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// Go on.
    GoOn,
    /// Stop; this is why.
    Stop(String),
}

impl Streaks {
    /// A flip was measured.
    pub(crate) fn measured(&mut self, tuning: &StopTuning, norm: f64) -> Verdict {
        self.unmeasured_flips = 0;
        let grows = self.last_norm.is_some_and(|last| norm > last);
        self.last_norm = Some(norm);
        if norm > tuning.error_norm_wild || (grows && norm > tuning.error_norm_max) {
            return self.bad(tuning, &format!("has an error of norm {norm:.2}"));
        }
        self.bad_flips = 0;
        Verdict::GoOn
    }

    /// A flip was bad, because of what it did.
    pub(crate) fn bad(&mut self, tuning: &StopTuning, what: &str) -> Verdict {
        self.bad_flips += 1;
        if self.bad_flips < tuning.bad_flips_max {
            return Verdict::GoOn;
        }
        Verdict::Stop(format!("{} bad flips in a row; the last {what}", self.bad_flips))
    }

    /// The end of a flip was not measured.
    pub(crate) fn unmeasured(&mut self, tuning: &StopTuning) -> Verdict {
        self.unmeasured_flips += 1;
        if self.unmeasured_flips < tuning.unmeasured_flips_max {
            return Verdict::GoOn;
        }
        Verdict::Stop(format!("{} flips in a row were not measured", self.unmeasured_flips))
    }

    /// A step was taken, whole or in part.
    pub(crate) fn step_taken(&mut self) {
        self.refused_steps = 0;
    }

    /// No part of a step may be flown.
    pub(crate) fn step_refused(&mut self, tuning: &StopTuning, refusal: &Refusal) -> Verdict {
        self.refused_steps += 1;
        if self.refused_steps < tuning.refused_steps_max {
            return Verdict::GoOn;
        }
        Verdict::Stop(format!("{} steps in a row may not be flown; the last {refusal}", self.refused_steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stops_after(norms: impl IntoIterator<Item = f64>) -> Option<usize> {
        let (tuning, mut streaks) = (StopTuning::default(), Streaks::default());
        norms.into_iter().position(|norm| streaks.measured(&tuning, norm) != Verdict::GoOn)
    }

    #[test]
    fn only_large_errors_that_grow_stop_and_only_in_a_row() {
        assert_eq!(stops_after([13.0, 13.1, 13.2, 13.3, 13.4, 13.5, 13.6]), Some(5));
        assert_eq!(
            stops_after([13.0, 13.1, 13.2, 13.3, 13.4, 13.3, 13.4, 13.5, 13.6, 13.7]),
            None,
            "one that shrinks"
        );
        assert_eq!(stops_after((0..100).map(|flip| 0.01 * f64::from(flip))), None, "small errors may grow");
        assert_eq!(
            stops_after((0..100).map(|flip| 18.0 - 0.1 * f64::from(flip))),
            None,
            "large ones may shrink"
        );
        assert_eq!(stops_after([25.0, 24.0, 23.0, 22.0, 21.0]), Some(4), "wild ones may not even shrink");
    }

    #[test]
    fn the_first_triple_flip_of_the_paper_is_not_bad() {
        let (tuning, mut streaks) = (StopTuning::default(), Streaks::default());
        let norm =
            maneuver::FinalError { x_m: -1.0, z_m: -2.0, vx_m_s: -4.0, vz_m_s: -2.0, theta_rad: -1.0 }.norm();
        for _ in 0..20 {
            assert_eq!(streaks.measured(&tuning, norm), Verdict::GoOn);
        }
        assert_eq!(streaks.bad_flips, 0);
    }

    #[test]
    fn early_ends_and_blind_flips_are_counted_apart() {
        let (tuning, mut streaks) = (StopTuning::default(), Streaks::default());
        for _ in 0..4 {
            assert_eq!(streaks.bad(&tuning, "ended early"), Verdict::GoOn);
            assert_eq!(streaks.unmeasured(&tuning), Verdict::GoOn);
        }
        assert_eq!(
            streaks.bad(&tuning, "ended early"),
            Verdict::Stop("5 bad flips in a row; the last ended early".to_owned())
        );
        streaks.measured(&tuning, 0.1);
        assert_eq!(streaks.unmeasured(&tuning), Verdict::GoOn);
    }
}
