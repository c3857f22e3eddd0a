//! What is computed once per kind of vehicle: the first parameters, and the matrix that corrects them.

use maneuver::{
    Discretisation, Envelope, FinalError, FlipDesign, Integral, Model, Parameters, SolveError, solve,
};
use nalgebra::{SMatrix, SVector};
use settings::{Arena, ConfigError, FlipSettings, Vehicle};

/// Model, design and corrective matrix of one kind of vehicle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    /// The vehicle as its builders believe it to be.
    pub(crate) model: Model,
    /// What is flown; its rate may differ from the one the parameters were computed for.
    pub(crate) flown: FlipDesign,
    /// Optimal on the model: where the learning begins.
    pub(crate) first: Parameters,
    /// Inverse of the sensitivity of the final error to the parameters.
    inverse: SMatrix<f64, 5, 5>,
    /// Step size gamma.
    step_size: f64,
}

impl Plan {
    /// Solves the flip of the scenario on a vehicle's model.
    ///
    /// # Errors
    /// The settings make no flip, or one that the model cannot fly inside the envelope.
    pub(crate) fn new(arena: &Arena, flip: &FlipSettings, vehicle: &Vehicle) -> Result<Self, ConfigError> {
        let model = model(vehicle);
        let margin = flip.envelope_margin_ratio;
        let envelope = Envelope::with_margin(&model, margin)
            .map_err(|error| malformed(arena, &format!("flip.envelope_margin_ratio = {margin}: {error}")))?;
        let designed = FlipDesign { flips: flip.flips, rate_rad_s_max: flip.design_rate_rad_s, envelope };
        let solution = solve(&model, &designed, Discretisation::Continuous)
            .map_err(|error| unsolved(arena, flip, &vehicle.subject, error))?;
        let jacobian = SMatrix::<f64, 5, 5>::from_fn(|row, column| solution.jacobian[row][column]);
        let inverse = jacobian
            .try_inverse()
            .filter(|inverse| inverse.iter().all(|entry| entry.is_finite()))
            .ok_or_else(|| malformed(arena, "the flip's Jacobian has no inverse"))?;
        Ok(Self {
            model,
            flown: FlipDesign { rate_rad_s_max: flip.flown_rate_rad_s, ..designed },
            first: solution.parameters,
            inverse,
            step_size: flip.step_size_ratio,
        })
    }

    /// Whether this is the plan of that vehicle too.
    pub(crate) fn fits(&self, vehicle: &Vehicle) -> bool {
        self.model == model(vehicle)
    }

    /// The change of the parameters after a flip with that error: -gamma J⁻¹ E.
    // Lupashin 2010, eq. (26).
    pub(crate) fn correction(&self, error: &FinalError) -> [f64; 5] {
        (self.inverse * SVector::from(error.wrapped().to_array()) * -self.step_size).into()
    }
}

/// The planar model of a vehicle as its builders believe it to be.
fn model(vehicle: &Vehicle) -> Model {
    let (airframe, rotor, rate_loop) = (&vehicle.airframe, &vehicle.rotor, &vehicle.rate_loop);
    Model {
        mass_kg: airframe.mass_kg,
        arm_m: airframe.arm_m,
        inertia_kg_m2: airframe.inertia_kg_m2[1],
        rotor_gain_up_1_s: rotor.gain_up_1_s,
        rotor_gain_down_1_s: rotor.gain_down_1_s,
        thrust_n_min: rotor.thrust_n_min,
        thrust_n_max: rotor.thrust_n_max,
        rate_gain_p_1_s: rate_loop.maneuver_p_1_s,
        rate_gain_i_1_s2: rate_loop.maneuver_i_1_s2,
        integral: match rate_loop.integral {
            settings::Integral::Literal => Integral::Literal,
            settings::Integral::Conditional => Integral::Conditional,
        },
    }
}

fn scenario_file(arena: &Arena) -> String {
    format!("scenarios/{}.toml", arena.name)
}

fn malformed(arena: &Arena, reason: &str) -> ConfigError {
    ConfigError::Malformed { file: scenario_file(arena), reason: reason.to_owned() }
}

fn unsolved(arena: &Arena, flip: &FlipSettings, subject: &str, error: SolveError) -> ConfigError {
    match error {
        SolveError::Infeasible(infeasible) => ConfigError::Contradiction {
            file: scenario_file(arena),
            key: "flip.flips".to_owned(),
            value: flip.flips.to_string(),
            other_key: "flip.design_rate_rad_s, flip.envelope_margin_ratio".to_owned(),
            other_value: format!("{}, {}", flip.design_rate_rad_s, flip.envelope_margin_ratio),
            reason: format!("{subject}: {infeasible}"),
        },
        other => malformed(arena, &format!("{subject}: {other}")),
    }
}
