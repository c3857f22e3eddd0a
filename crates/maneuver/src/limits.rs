//! The box the solver searches in, and which of its sides stopped it.

use core::fmt;

use crate::parameters::FlipDesign;

/// Shortest T1, T3, T5, s: above zero by more than the Jacobian's differences are wide.
const DURATION_S_MIN: f64 = 1e-3;

/// Longest T1, T3, T5, s.
const DURATION_S_MAX: f64 = 3.0;

const NAMES: [&str; 5] = ["U1", "T1", "T3", "U5", "T5"];

/// Bounds of U1, T1, T3, U5, T5.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub low: [f64; 5],
    pub high: [f64; 5],
}

impl Bounds {
    /// (high + low) / 2 <= U1, U5 <= high, and durations above zero.
    pub fn new(design: &FlipDesign) -> Self {
        let (middle, high) = (design.envelope.middle_m_s2(), design.envelope.high_m_s2);
        Self {
            low: [middle, DURATION_S_MIN, DURATION_S_MIN, middle, DURATION_S_MIN],
            high: [high, DURATION_S_MAX, DURATION_S_MAX, high, DURATION_S_MAX],
        }
    }

    /// The point of the box nearest to these parameters, one by one.
    pub fn clamp(&self, mut parameters: [f64; 5]) -> [f64; 5] {
        for (index, value) in parameters.iter_mut().enumerate() {
            *value = value.max(self.low[index]).min(self.high[index]);
        }
        parameters
    }

    /// The sides these parameters stand at.
    pub fn touched(&self, parameters: &[f64; 5]) -> Limits {
        let mut limits = Limits::NONE;
        for (index, value) in parameters.iter().enumerate() {
            limits.0 |= u16::from(*value <= self.low[index]) << (2 * index);
            limits.0 |= u16::from(*value >= self.high[index]) << (2 * index + 1);
        }
        limits
    }

    /// The sides these parameters stand at and would leave the box by, following -gradient.
    pub fn pressed(&self, parameters: &[f64; 5], gradient: &[f64; 5]) -> Limits {
        let mut limits = self.touched(parameters);
        for (index, slope) in gradient.iter().enumerate() {
            if *slope <= 0.0 {
                limits.0 &= !(1 << (2 * index));
            }
            if *slope >= 0.0 {
                limits.0 &= !(1 << (2 * index + 1));
            }
        }
        limits
    }
}

/// A set of sides of the solver's box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits(u16);

impl Limits {
    /// No side.
    pub const NONE: Self = Self(0);

    /// Whether the parameter of this index (U1, T1, T3, U5, T5) stands at its lower bound.
    #[must_use]
    pub fn low(self, parameter: usize) -> bool {
        parameter < 5 && self.0 & (1 << (2 * parameter)) != 0
    }

    /// Whether the parameter of this index (U1, T1, T3, U5, T5) stands at its upper bound.
    #[must_use]
    pub fn high(self, parameter: usize) -> bool {
        parameter < 5 && self.0 & (1 << (2 * parameter + 1)) != 0
    }

    /// Whether the set is empty.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return formatter.write_str("no bound active");
        }
        let mut separator = "";
        for (index, name) in NAMES.iter().enumerate() {
            for (active, side) in [(self.low(index), "lower"), (self.high(index), "upper")] {
                if active {
                    write!(formatter, "{separator}{name} at its {side} bound")?;
                    separator = ", ";
                }
            }
        }
        Ok(())
    }
}
