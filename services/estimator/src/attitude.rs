//! Attitude and body rate from camera attitudes: a Kalman filter on the rotation that takes the predicted
//! body to the measured one. Roll and pitch share one covariance; yaw, whose loop is slower, has its own.

use quantity::{Body, Vector};

use crate::chain::{Chain, Growth};
use crate::model::{Model, Motion, Regime};
use crate::tuning::NoiseTuning;

/// Uncertainty of attitude, body rate and unexplained angular acceleration.
#[derive(Clone, Debug)]
pub(crate) struct AttitudeFilter {
    tilt: Chain,
    yaw: Chain,
    tilt_commanded: Growth,
    yaw_commanded: Growth,
    ballistic: Growth,
    unknown: Growth,
    rate_scale_ratio: f64,
    variance: f64,
}

/// After a maneuver, what is left unexplained is so uncertain.
const AFTERMATH_RAD_S2: f64 = 40.0;

impl AttitudeFilter {
    /// A filter started from two poses `span_s` apart.
    pub fn new(noise: &NoiseTuning, model: &Model, span_s: f64) -> Self {
        let walk = noise.rate_walk_rad_s * noise.rate_walk_rad_s;
        let growth = |damping_1_s: f64, sigma: f64, time_s: f64| Growth {
            damping_1_s,
            decay_1_s: 1.0 / time_s,
            walk,
            disturbance_variance: sigma * sigma,
        };
        let (tilt_damping, yaw_damping) = model.rate_damping_1_s();
        let commanded =
            |damping| growth(damping, noise.angular_disturbance_rad_s2, noise.angular_disturbance_time_s);
        let angular = noise.unknown_angular_rad_s2;
        let rate = 1.5 * noise.attitude_rad / span_s + 0.5 * angular * span_s;
        let chain = Chain::new(noise.attitude_rad, rate, angular);
        Self {
            tilt: chain,
            yaw: chain,
            tilt_commanded: commanded(tilt_damping),
            yaw_commanded: commanded(yaw_damping),
            ballistic: growth(0.0, noise.ballistic_angular_rad_s2, noise.ballistic_time_s),
            unknown: growth(0.0, angular, noise.unknown_time_s),
            rate_scale_ratio: noise.rate_scale_ratio,
            variance: noise.attitude_rad * noise.attitude_rad,
        }
    }

    fn growths(&self, regime: Regime) -> (Growth, Growth) {
        match regime {
            Regime::Commanded => (self.tilt_commanded, self.yaw_commanded),
            Regime::Ballistic => (self.ballistic, self.ballistic),
            Regime::Unknown => (self.unknown, self.unknown),
        }
    }

    /// How fast the unexplained angular acceleration fades, 1/s.
    pub fn decay_1_s(&self, regime: Regime) -> f64 {
        self.growths(regime).0.decay_1_s
    }

    /// Another regime begins, and perhaps began `late_s` ago, unknown to the filter.
    pub fn enter(&mut self, regime: Regime, late_s: f64) {
        let sigma = match regime {
            Regime::Commanded => AFTERMATH_RAD_S2,
            Regime::Ballistic | Regime::Unknown => {
                quantity::math::sqrt(self.growths(regime).0.disturbance_variance)
            }
        };
        for chain in [&mut self.tilt, &mut self.yaw] {
            chain.widen(0.5 * sigma * late_s * late_s, sigma * late_s, sigma);
        }
    }

    /// Time passes, at this body rate.
    pub fn grow(&mut self, regime: Regime, rate_rad_s: Vector<Body>, span_s: f64) {
        let (mut tilt, mut yaw) = self.growths(regime);
        if regime == Regime::Commanded {
            // The vehicle holds the rate its gyros report, whose scale is uncertain.
            let uncertain = self.rate_scale_ratio * self.rate_scale_ratio * rate_rad_s.dot(rate_rad_s);
            for growth in [&mut tilt, &mut yaw] {
                growth.disturbance_variance += uncertain * growth.damping_1_s * growth.damping_1_s;
            }
        }
        self.tilt.grow(&tilt, span_s);
        self.yaw.grow(&yaw, span_s);
    }

    /// One sigma of the attitude, per axis, of the less certain axis.
    pub fn attitude_sigma_rad(&self) -> f64 {
        quantity::math::sqrt(self.tilt.quantity_variance().max(self.yaw.quantity_variance()))
    }

    /// One sigma of the body rate about x and y.
    #[cfg(test)]
    pub fn rate_sigma_rad_s(&self) -> f64 {
        quantity::math::sqrt(self.tilt.rate_variance())
    }

    /// Fuses an attitude: `innovation_rad` is the rotation vector from the predicted body to the measured
    /// one.
    pub fn correct(&mut self, motion: &mut Motion, innovation_rad: Vector<Body>) {
        let (tilt, yaw) = (self.tilt.measure(self.variance), self.yaw.measure(self.variance));
        let e = innovation_rad;
        let scaled = |xy: f64, z: f64| Vector::new(e.x * xy, e.y * xy, e.z * z);
        let k = &mut motion.kinematics;
        k.orientation = k.orientation.turned(scaled(tilt.quantity, yaw.quantity));
        k.rate_rad_s += scaled(tilt.rate, yaw.rate);
        motion.angular_disturbance_rad_s2 += scaled(tilt.disturbance, yaw.disturbance);
    }

    /// Whether the covariances are ones.
    pub fn is_sound(&self) -> bool {
        self.tilt.is_sound() && self.yaw.is_sound()
    }
}
