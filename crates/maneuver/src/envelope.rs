//! The reduced control envelope: the part of the thrust range a flip is designed in, the rest kept for
//! feedback.

use crate::model::Model;

/// Bounds on the collective acceleration each propeller's thrust is designed to correspond to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Envelope {
    /// Lower bound, β̲ in the paper, m/s².
    pub low_m_s2: f64,
    /// Upper bound, β̄ in the paper, m/s².
    pub high_m_s2: f64,
}

/// An envelope nothing can fly in.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EnvelopeError {
    /// The margin is not in [0, 0.5).
    #[error("envelope: the margin kept back at each end must be at least 0 and below 0.5, got {margin}")]
    Margin {
        /// The margin asked for, as a ratio of the whole range.
        margin: f64,
    },
    /// The bounds are not `0 <= low < high`, both finite.
    #[error("envelope: bounds must be finite, not negative and in order, got {low_m_s2} to {high_m_s2} m/s²")]
    Bounds {
        /// Lower bound, m/s².
        low_m_s2: f64,
        /// Upper bound, m/s².
        high_m_s2: f64,
    },
}

impl Envelope {
    /// The margin every double and triple from 1000 to 1800 deg/s solves at with [`Model::TABLE_I`].
    pub const MARGIN: f64 = 0.125;

    /// Keeps back `margin` of the collective range at each end.
    ///
    /// # Errors
    /// If the margin is not in [0, 0.5), or the model's own range is impossible.
    // Lupashin 2010, eq. (14).
    pub fn with_margin(model: &Model, margin: f64) -> Result<Self, EnvelopeError> {
        if !(0.0..0.5).contains(&margin) {
            return Err(EnvelopeError::Margin { margin });
        }
        let kept_back_m_s2 = margin * (model.collective_m_s2_max() - model.collective_m_s2_min());
        Self::new(model.collective_m_s2_min() + kept_back_m_s2, model.collective_m_s2_max() - kept_back_m_s2)
    }

    /// An envelope with these bounds.
    ///
    /// # Errors
    /// Unless `0 <= low < high` and both are finite.
    pub fn new(low_m_s2: f64, high_m_s2: f64) -> Result<Self, EnvelopeError> {
        let envelope = Self { low_m_s2, high_m_s2 };
        envelope.check()?;
        Ok(envelope)
    }

    /// Refuses what [`Envelope::new`] refuses; for envelopes that arrived as numbers.
    ///
    /// # Errors
    /// Unless `0 <= low < high` and both are finite.
    pub fn check(&self) -> Result<(), EnvelopeError> {
        let Self { low_m_s2, high_m_s2 } = *self;
        if low_m_s2 >= 0.0 && low_m_s2 < high_m_s2 && high_m_s2.is_finite() {
            Ok(())
        } else {
            Err(EnvelopeError::Bounds { low_m_s2, high_m_s2 })
        }
    }

    /// Middle of the envelope, m/s²: the collective of both rotation steps, eq. (17).
    #[must_use]
    pub fn middle_m_s2(&self) -> f64 {
        (self.high_m_s2 + self.low_m_s2) / 2.0
    }

    /// Height of the envelope, m/s².
    #[must_use]
    pub fn span_m_s2(&self) -> f64 {
        self.high_m_s2 - self.low_m_s2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_margin_gives_the_published_bounds() {
        let envelope = Envelope::with_margin(&Model::TABLE_I, Envelope::MARGIN).unwrap();
        assert!((envelope.low_m_s2 - 3.589_744).abs() < 5e-7);
        assert!((envelope.high_m_s2 - 21.025_641).abs() < 5e-7);
    }

    #[test]
    fn margins_that_leave_nothing_are_refused() {
        for margin in [-0.01, 0.5, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                Envelope::with_margin(&Model::TABLE_I, margin),
                Err(EnvelopeError::Margin { .. })
            ));
        }
        for (low, high) in [(2.0, 2.0), (-1.0, 2.0), (f64::NAN, 2.0), (1.0, f64::INFINITY)] {
            assert!(matches!(Envelope::new(low, high), Err(EnvelopeError::Bounds { .. })));
        }
    }
}
