//! Uncertainty of a measured quantity, its rate, and a disturbance of its acceleration.

/// How a chain's uncertainty grows between measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Growth {
    /// The rate's error decays with this gain (a closed rate loop, drag), 1/s.
    pub damping_1_s: f64,
    /// The disturbance decays with this gain, 1/s.
    pub decay_1_s: f64,
    /// Spectral density of a random walk of the rate: (rate in one second)².
    pub walk: f64,
    /// One sigma of the disturbance, were it never measured, squared.
    pub disturbance_variance: f64,
}

/// Longest step of [`Chain::grow`]: its transition is a series in the step.
const STEP_S_MAX: f64 = 0.005;

/// Covariance of (quantity, rate, disturbance of the acceleration), the same for every axis it is used for:
/// each axis has the same dynamics, noise and measurements, hence the same gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Chain {
    p00: f64,
    p01: f64,
    p02: f64,
    p11: f64,
    p12: f64,
    p22: f64,
}

/// What a measurement of the quantity tells of all three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gain {
    /// Of the quantity.
    pub quantity: f64,
    /// Of its rate, 1/s.
    pub rate: f64,
    /// Of the disturbance, 1/s².
    pub disturbance: f64,
}

impl Chain {
    /// Independent uncertainties, one sigma each.
    pub fn new(quantity: f64, rate: f64, disturbance: f64) -> Self {
        Self {
            p00: quantity * quantity,
            p01: 0.0,
            p02: 0.0,
            p11: rate * rate,
            p12: 0.0,
            p22: disturbance * disturbance,
        }
    }

    /// One sigma of the quantity, squared.
    pub fn quantity_variance(&self) -> f64 {
        self.p00
    }

    /// One sigma of the rate, squared.
    #[cfg(test)]
    pub fn rate_variance(&self) -> f64 {
        self.p11
    }

    /// Forgets what was known of the disturbance, and adds to the other uncertainties; one sigma each.
    pub fn widen(&mut self, quantity: f64, rate: f64, disturbance: f64) {
        self.p00 += quantity * quantity;
        self.p11 += rate * rate;
        (self.p02, self.p12, self.p22) = (0.0, 0.0, disturbance * disturbance);
    }

    /// Time passes without a measurement.
    pub fn grow(&mut self, growth: &Growth, span_s: f64) {
        let mut left_s = span_s;
        while left_s > 0.0 {
            let step_s = left_s.min(STEP_S_MAX);
            self.grow_step(growth, step_s);
            left_s -= step_s;
        }
    }

    fn grow_step(&mut self, growth: &Growth, h: f64) {
        let (c, l) = (growth.damping_1_s, growth.decay_1_s);
        let f11 = (1.0 - 0.5 * c * h) / (1.0 + 0.5 * c * h);
        let f22 = (1.0 - 0.5 * l * h) / (1.0 + 0.5 * l * h);
        let f01 = 0.5 * h * (1.0 + f11);
        let f12 = 0.25 * h * (1.0 + f11) * (1.0 + f22);
        let f02 = 0.5 * h * f12;
        // F P, then (F P) F': F is upper triangular with ones and f11, f22 on its diagonal.
        let a00 = self.p00 + f01 * self.p01 + f02 * self.p02;
        let a01 = self.p01 + f01 * self.p11 + f02 * self.p12;
        let a02 = self.p02 + f01 * self.p12 + f02 * self.p22;
        let a11 = f11 * self.p11 + f12 * self.p12;
        let a12 = f11 * self.p12 + f12 * self.p22;
        let a22 = f22 * self.p22;
        let jerk = 2.0 * l * growth.disturbance_variance;
        let walk = growth.walk;
        let (h2, h3) = (h * h, h * h * h);
        self.p00 = a00 + a01 * f01 + a02 * f02 + walk * h3 / 3.0 + jerk * h3 * h2 / 20.0;
        self.p01 = a01 * f11 + a02 * f12 + walk * h2 / 2.0 + jerk * h2 * h2 / 8.0;
        self.p02 = a02 * f22 + jerk * h3 / 6.0;
        self.p11 = a11 * f11 + a12 * f12 + walk * h + jerk * h3 / 3.0;
        self.p12 = a12 * f22 + jerk * h2 / 2.0;
        self.p22 = a22 * f22 + jerk * h;
    }

    /// A measurement of the quantity, with this variance; the gains to correct the state with.
    pub fn measure(&mut self, variance: f64) -> Gain {
        let scale = 1.0 / (self.p00 + variance);
        let gain = Gain { quantity: self.p00 * scale, rate: self.p01 * scale, disturbance: self.p02 * scale };
        self.p22 -= gain.disturbance * self.p02;
        self.p12 -= gain.rate * self.p02;
        self.p11 -= gain.rate * self.p01;
        // What remains of the first row is exactly the measurement's part; so written it cannot turn
        // negative.
        let keep = variance * scale;
        self.p00 *= keep;
        self.p01 *= keep;
        self.p02 *= keep;
        gain
    }

    /// Whether every entry is a finite number and no variance negative.
    pub fn is_sound(&self) -> bool {
        [self.p00, self.p11, self.p22].iter().all(|variance| variance.is_finite() && *variance >= 0.0)
            && [self.p01, self.p02, self.p12].iter().all(|covariance| covariance.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Growth = Growth { damping_1_s: 0.0, decay_1_s: 1.0, walk: 0.0, disturbance_variance: 0.01 };

    #[test]
    fn settles_where_the_textbook_says() {
        // A triple integrator with jerk density q and measurement density r has the gains 2w, 2w², w³ with
        // w = (q/r)^(1/6); sampled fast enough, the discrete gains are those times the period.
        let mut chain = Chain::new(1.0, 1.0, 1.0);
        let (period, sigma) = (0.0005, 0.0005);
        let growth = Growth { decay_1_s: 1e-3, disturbance_variance: 10.0, ..QUIET };
        let mut gain = chain.measure(sigma * sigma);
        for _ in 0..20_000 {
            chain.grow(&growth, period);
            gain = chain.measure(sigma * sigma);
        }
        let ratio = 2.0 * 1e-3 * 10.0 / (sigma * sigma * period);
        let w = quantity::math::exp(quantity::math::ln(ratio) / 6.0);
        assert!(
            (gain.quantity / (2.0 * w * period) - 1.0).abs() < 0.02,
            "{} {}",
            gain.quantity,
            2.0 * w * period
        );
        assert!((gain.rate / (2.0 * w * w * period) - 1.0).abs() < 0.03);
        assert!((gain.disturbance / (w * w * w * period) - 1.0).abs() < 0.04);
    }

    #[test]
    fn long_gaps_equal_many_short_ones() {
        let mut at_once = Chain::new(0.001, 0.01, 0.1);
        let mut in_steps = at_once;
        at_once.grow(&QUIET, 0.1);
        for _ in 0..20 {
            in_steps.grow(&QUIET, 0.005);
        }
        assert!((at_once.p00 / in_steps.p00 - 1.0).abs() < 1e-9);
        assert!(at_once.is_sound());
    }

    #[test]
    fn stays_sound_whatever_the_spacing() {
        let mut chain = Chain::new(1.0, 10.0, 300.0);
        let growth = Growth { damping_1_s: 20.0, decay_1_s: 10.0, walk: 1.0, disturbance_variance: 9e4 };
        for k in 0..10_000u32 {
            chain.grow(&growth, 0.0001 * f64::from(1 + k * 7919 % 977));
            chain.measure(9e-6);
            assert!(chain.is_sound());
        }
    }
}
