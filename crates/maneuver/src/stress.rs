//! What becomes of a flip on a vehicle that is not the model: to know before the first flight how low it may
//! sink.

use crate::model::Model;
use crate::parameters::{FinalError, FlipDesign, Parameters};
use crate::planar::{Discretisation, Flight, FlipError};

/// How a vehicle differs from the model it was designed with, as ratios: 1 is no difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Thrust delivered over thrust commanded.
    pub thrust: f64,
    /// Mass over the model's.
    pub mass: f64,
    /// Moment of inertia over the model's.
    pub inertia: f64,
    /// Speed of the rotors' lag over the model's, rising and falling alike.
    pub rotor_gain: f64,
    /// What the gyro reads over the true rate.
    pub gyro: f64,
}

impl Deviation {
    /// The vehicle is the model.
    pub const NONE: Self = Self { thrust: 1.0, mass: 1.0, inertia: 1.0, rotor_gain: 1.0, gyro: 1.0 };

    /// Refuses ratios that are not finite and above zero.
    pub(crate) fn check(&self) -> Result<(), FlipError> {
        let ratios = [
            ("thrust", self.thrust),
            ("mass", self.mass),
            ("inertia", self.inertia),
            ("rotor_gain", self.rotor_gain),
            ("gyro", self.gyro),
        ];
        for (field, ratio) in ratios {
            if !(ratio.is_finite() && ratio > 0.0) {
                return Err(FlipError::Deviation { field, ratio });
            }
        }
        Ok(())
    }
}

/// One flip on one deviating vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StressCase {
    /// How the vehicle differs.
    pub deviation: Deviation,
    /// Where it ended.
    pub error: FinalError,
    /// Greatest depth below the start during the flip, m; zero if it never sank.
    pub height_loss_m: f64,
    /// Greatest height above the start, m.
    pub apex_m: f64,
    /// Greatest magnitude of the true pitch rate, rad/s.
    pub rate_rad_s_max: f64,
}

/// Flips on the model and on vehicles that differ from it in one respect each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StressReport {
    /// The model itself, then thrust, mass, inertia and rotor gain, each low and high.
    pub cases: [StressCase; 9],
}

impl StressReport {
    /// The case that sinks deepest below its start.
    #[must_use]
    pub fn deepest(&self) -> &StressCase {
        self.worst(|case| case.height_loss_m)
    }

    /// The case that turns fastest.
    #[must_use]
    pub fn fastest(&self) -> &StressCase {
        self.worst(|case| case.rate_rad_s_max)
    }

    /// The case whose theta error is greatest in magnitude. Learning runs away beyond about π/2.
    #[must_use]
    pub fn most_turned(&self) -> &StressCase {
        self.worst(|case| case.error.theta_rad.abs())
    }

    /// The case with the greatest norm of the final error.
    #[must_use]
    pub fn farthest(&self) -> &StressCase {
        self.worst(|case| case.error.norm())
    }

    fn worst(&self, badness: impl Fn(&StressCase) -> f64) -> &StressCase {
        let mut worst = &self.cases[0];
        for case in &self.cases {
            if badness(case) > badness(worst) {
                worst = case;
            }
        }
        worst
    }
}

/// Flies a flip on a vehicle that differs from the model, hovering at the start as its own weight demands.
///
/// # Errors
/// If the model, the design, the parameters or the deviation are impossible.
pub fn deviate(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    discretisation: Discretisation,
    deviation: &Deviation,
) -> Result<StressCase, FlipError> {
    let flight = Flight::new(model, design, parameters, deviation)?;
    let mut case = StressCase {
        deviation: *deviation,
        error: FinalError::default(),
        height_loss_m: 0.0,
        apex_m: 0.0,
        rate_rad_s_max: 0.0,
    };
    case.error = flight.fly(discretisation, |_, state| {
        case.height_loss_m = case.height_loss_m.max(-state.z_m);
        case.apex_m = case.apex_m.max(state.z_m);
        case.rate_rad_s_max = case.rate_rad_s_max.max(state.rate_rad_s.abs());
    });
    Ok(case)
}

/// Flies a flip on the model and on vehicles whose thrust, mass, inertia or rotor gain is lower or higher by
/// `spread` (0.2 for 20 %).
///
/// # Errors
/// If the model, the design or the parameters are impossible, or the spread is not in [0, 1).
pub fn stress(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    discretisation: Discretisation,
    spread: f64,
) -> Result<StressReport, FlipError> {
    let none = Deviation::NONE;
    let nominal = deviate(model, design, parameters, discretisation, &none)?;
    let (low, high) = (1.0 - spread, 1.0 + spread);
    let deviations = [
        Deviation { thrust: low, ..none },
        Deviation { thrust: high, ..none },
        Deviation { mass: low, ..none },
        Deviation { mass: high, ..none },
        Deviation { inertia: low, ..none },
        Deviation { inertia: high, ..none },
        Deviation { rotor_gain: low, ..none },
        Deviation { rotor_gain: high, ..none },
    ];
    let mut cases = [nominal; 9];
    for (case, deviation) in cases[1..].iter_mut().zip(&deviations) {
        *case = deviate(model, design, parameters, discretisation, deviation)?;
    }
    Ok(StressReport { cases })
}
