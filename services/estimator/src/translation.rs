//! Position and velocity from camera positions: a Kalman filter whose three axes share one covariance.

use quantity::{Vector, World};

use crate::chain::{Chain, Growth};
use crate::model::{Motion, Regime};
use crate::tuning::NoiseTuning;

/// Uncertainty of position, velocity and unexplained acceleration.
#[derive(Clone, Debug)]
pub(crate) struct TranslationFilter {
    chain: Chain,
    commanded: Growth,
    ballistic: Growth,
    unknown: Growth,
    variance: f64,
}

/// After a maneuver, what is left unexplained is so uncertain: the thrust just then is inferred, not known.
const AFTERMATH_M_S2: f64 = 0.7;

impl TranslationFilter {
    /// A filter started from two poses `span_s` apart.
    pub fn new(noise: &NoiseTuning, span_s: f64) -> Self {
        let walk = noise.velocity_walk_m_s * noise.velocity_walk_m_s;
        let growth = |sigma: f64, time_s: f64| Growth {
            damping_1_s: 0.0,
            decay_1_s: 1.0 / time_s,
            walk,
            disturbance_variance: sigma * sigma,
        };
        let acceleration = noise.unknown_acceleration_m_s2;
        let velocity = 1.5 * noise.position_m / span_s + 0.5 * acceleration * span_s;
        Self {
            chain: Chain::new(noise.position_m, velocity, acceleration),
            commanded: growth(noise.disturbance_m_s2, noise.disturbance_time_s),
            ballistic: growth(noise.ballistic_acceleration_m_s2, noise.ballistic_time_s),
            unknown: growth(acceleration, noise.unknown_time_s),
            variance: noise.position_m * noise.position_m,
        }
    }

    fn growth(&self, regime: Regime) -> &Growth {
        match regime {
            Regime::Commanded => &self.commanded,
            Regime::Ballistic => &self.ballistic,
            Regime::Unknown => &self.unknown,
        }
    }

    /// How fast the unexplained acceleration fades, 1/s.
    pub fn decay_1_s(&self, regime: Regime) -> f64 {
        self.growth(regime).decay_1_s
    }

    /// Another regime begins, and perhaps began `late_s` ago, unknown to the filter.
    pub fn enter(&mut self, regime: Regime, late_s: f64) {
        let sigma = match regime {
            Regime::Commanded => AFTERMATH_M_S2,
            Regime::Ballistic | Regime::Unknown => {
                quantity::math::sqrt(self.growth(regime).disturbance_variance)
            }
        };
        self.chain.widen(0.5 * sigma * late_s * late_s, sigma * late_s, sigma);
    }

    /// Time passes.
    pub fn grow(&mut self, regime: Regime, span_s: f64) {
        let growth = *self.growth(regime);
        self.chain.grow(&growth, span_s);
    }

    /// One sigma of the position per axis.
    pub fn position_sigma_m(&self) -> f64 {
        quantity::math::sqrt(self.chain.quantity_variance())
    }

    /// One sigma of the velocity per axis.
    #[cfg(test)]
    pub fn velocity_sigma_m_s(&self) -> f64 {
        quantity::math::sqrt(self.chain.rate_variance())
    }

    /// Fuses a position: `innovation_m` is measured less predicted.
    pub fn correct(&mut self, motion: &mut Motion, innovation_m: Vector<World>) {
        let gain = self.chain.measure(self.variance);
        motion.kinematics.position_m += innovation_m * gain.quantity;
        motion.kinematics.velocity_m_s += innovation_m * gain.rate;
        motion.disturbance_m_s2 += innovation_m * gain.disturbance;
    }

    /// Whether the covariance is one.
    pub fn is_sound(&self) -> bool {
        self.chain.is_sound()
    }
}
