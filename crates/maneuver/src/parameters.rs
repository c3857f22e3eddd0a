//! What is chosen (the design), what is learned (the parameters) and what is measured (the final error).

use core::f64::consts::TAU;

use quantity::math;

use crate::envelope::Envelope;

/// What a flip is meant to be; stays fixed while its [`Parameters`] are learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlipDesign {
    /// Number of full turns N.
    pub flips: u8,
    /// Pitch rate of the coast step, rad/s.
    pub rate_rad_s_max: f64,
    /// The part of the thrust range the design uses.
    pub envelope: Envelope,
}

impl FlipDesign {
    /// The angle to be turned, 2πN, rad.
    #[must_use]
    pub fn turn_rad(&self) -> f64 {
        TAU * f64::from(self.flips)
    }
}

/// The five parameters P of a flip. // Lupashin 2010, section III-C.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parameters {
    /// Collective acceleration U1 of the first step, m/s².
    pub u1_m_s2: f64,
    /// Duration T1 of the first step, s.
    pub t1_s: f64,
    /// Duration T3 of the coast step, s.
    pub t3_s: f64,
    /// Collective acceleration U5 of the last step, m/s².
    pub u5_m_s2: f64,
    /// Duration T5 of the last step, s.
    pub t5_s: f64,
}

impl Parameters {
    /// In the order U1, T1, T3, U5, T5: the columns of the Jacobian.
    #[must_use]
    pub const fn to_array(self) -> [f64; 5] {
        [self.u1_m_s2, self.t1_s, self.t3_s, self.u5_m_s2, self.t5_s]
    }

    /// From the order U1, T1, T3, U5, T5.
    #[must_use]
    pub const fn from_array([u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s]: [f64; 5]) -> Self {
        Self { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s }
    }
}

impl From<[f64; 5]> for Parameters {
    fn from(array: [f64; 5]) -> Self {
        Self::from_array(array)
    }
}

impl From<Parameters> for [f64; 5] {
    fn from(parameters: Parameters) -> Self {
        parameters.to_array()
    }
}

/// How far a flip ends from where it began, turned by 2πN: F(P) of a model, E of a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FinalError {
    /// Lateral, in the direction positive pitch tips the thrust, m.
    pub x_m: f64,
    /// Up, m.
    pub z_m: f64,
    /// Lateral velocity, m/s.
    pub vx_m_s: f64,
    /// Velocity up, m/s.
    pub vz_m_s: f64,
    /// Pitch turned in excess of 2πN, rad.
    pub theta_rad: f64,
}

impl FinalError {
    /// In the order x, z, vx, vz, theta: the rows of the Jacobian.
    #[must_use]
    pub const fn to_array(self) -> [f64; 5] {
        [self.x_m, self.z_m, self.vx_m_s, self.vz_m_s, self.theta_rad]
    }

    /// From the order x, z, vx, vz, theta.
    #[must_use]
    pub const fn from_array([x_m, z_m, vx_m_s, vz_m_s, theta_rad]: [f64; 5]) -> Self {
        Self { x_m, z_m, vx_m_s, vz_m_s, theta_rad }
    }

    /// The plain 2-norm, mixing m, m/s and rad one to one.
    #[must_use]
    pub fn norm(&self) -> f64 {
        math::sqrt(self.to_array().iter().map(|component| component * component).sum())
    }

    /// The same with theta brought into (-π, π]. For errors of a real vehicle, whose attitude does not count
    /// turns; never for the solver, which must not mistake a double flip for a triple.
    #[must_use]
    pub fn wrapped(self) -> Self {
        Self { theta_rad: math::wrap_pi(self.theta_rad), ..self }
    }
}

impl From<[f64; 5]> for FinalError {
    fn from(array: [f64; 5]) -> Self {
        Self::from_array(array)
    }
}

impl From<FinalError> for [f64; 5] {
    fn from(error: FinalError) -> Self {
        error.to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_keep_the_order() {
        let numbers = [1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(Parameters::from(numbers).t3_s, 3.0);
        assert_eq!(<[f64; 5]>::from(Parameters::from(numbers)), numbers);
        assert_eq!(FinalError::from(numbers).vz_m_s, 4.0);
        assert_eq!(<[f64; 5]>::from(FinalError::from(numbers)), numbers);
    }

    #[test]
    fn only_wrapping_forgets_whole_turns() {
        let error = FinalError { x_m: 3.0, vz_m_s: 4.0, theta_rad: -TAU, ..FinalError::default() };
        assert!((error.norm() - math::sqrt(25.0 + TAU * TAU)).abs() < 1e-12);
        assert!((error.wrapped().norm() - 5.0).abs() < 1e-12);
    }
}
