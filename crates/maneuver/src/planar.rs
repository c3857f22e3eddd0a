//! The vertical-plane simulation: from a design and its parameters to the final error.

use crate::continuous;
use crate::dynamics::{Coefficients, PlanarState, State};
use crate::model::{Model, ModelError};
use crate::parameters::{FinalError, FlipDesign, Parameters};
use crate::primitive::{Primitive, PrimitiveError};
use crate::stress::Deviation;
use crate::ticks::{self, Collective};

/// Ticks of a vehicle's rate loop per second.
pub const LOOP_HZ: f64 = 800.0;

/// Runge-Kutta steps per second of the continuous model.
pub const CONTINUOUS_HZ: f64 = 12_800.0;

/// How time is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Discretisation {
    /// The continuous model (`cont`): step n in ceil(12800 Tn) equal Runge-Kutta steps.
    Continuous,
    /// Rate loop at 800 Hz, collective averaged over each tick (`avg`), so that the error has derivatives.
    Average800,
    /// Rate loop at 800 Hz, collective sampled at each tick (`zoh`): what a vehicle does. The final error
    /// jumps where a step boundary crosses a tick.
    Hold800,
}

/// Why a flip could not be simulated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FlipError {
    /// The model is impossible.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The design or its parameters are impossible.
    #[error(transparent)]
    Primitive(#[from] PrimitiveError),
    /// A ratio of a [`Deviation`] is not finite and above zero.
    #[error("deviation: {field} must be finite and above zero, got {ratio}")]
    Deviation {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        ratio: f64,
    },
}

/// The final error F(P) of the model. // Lupashin 2010, eqs. (10) to (13), (25).
///
/// # Errors
/// If the model, the design or the parameters are impossible.
pub fn final_error(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    discretisation: Discretisation,
) -> Result<FinalError, FlipError> {
    let flight = Flight::new(model, design, parameters, &Deviation::NONE)?;
    Ok(flight.fly(discretisation, |_, _| ()))
}

/// [`final_error`], and the trajectory with it: `observe` is called with the time since the start, s, and the
/// state, first at the start and then after every integration step, last at the end.
///
/// # Errors
/// If the model, the design or the parameters are impossible.
pub fn trajectory(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    discretisation: Discretisation,
    observe: impl FnMut(f64, PlanarState),
) -> Result<FinalError, FlipError> {
    let flight = Flight::new(model, design, parameters, &Deviation::NONE)?;
    Ok(flight.fly(discretisation, observe))
}

/// Greatest height above the start, m.
///
/// # Errors
/// If the model, the design or the parameters are impossible.
pub fn apex_m(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    discretisation: Discretisation,
) -> Result<f64, FlipError> {
    let mut apex_m: f64 = 0.0;
    trajectory(model, design, parameters, discretisation, |_, state| apex_m = apex_m.max(state.z_m))?;
    Ok(apex_m)
}

/// One flip on one vehicle, checked and ready.
pub(crate) struct Flight {
    coefficients: Coefficients,
    primitive: Primitive,
    turn_rad: f64,
}

impl Flight {
    pub fn new(
        model: &Model,
        design: &FlipDesign,
        parameters: &Parameters,
        deviation: &Deviation,
    ) -> Result<Self, FlipError> {
        model.check()?;
        deviation.check()?;
        Ok(Self {
            coefficients: Coefficients::new(model, deviation),
            primitive: Primitive::new(design, model.alpha_l_m(), parameters)?,
            turn_rad: design.turn_rad(),
        })
    }

    pub fn fly(
        &self,
        discretisation: Discretisation,
        mut observe: impl FnMut(f64, PlanarState),
    ) -> FinalError {
        let mut state = State::hovering(&self.coefficients);
        observe(0.0, state.lane(0));
        let observe = |t_s: f64, state: &State<1>| observe(t_s, state.lane(0));
        match discretisation {
            Discretisation::Continuous => self.fly_continuous(&mut state, CONTINUOUS_HZ, observe),
            Discretisation::Average800 => self.fly_ticks(&mut state, Collective::Averaged, observe),
            Discretisation::Hold800 => self.fly_ticks(&mut state, Collective::Sampled, observe),
        }
        error_of(&state, 0, self.turn_rad)
    }

    fn fly_continuous(&self, state: &mut State<1>, steps_hz: f64, mut observe: impl FnMut(f64, &State<1>)) {
        let primitives = [self.primitive];
        for index in 0..5 {
            continuous::fly_step(&self.coefficients, state, &primitives, index, steps_hz, &mut observe);
        }
    }

    fn fly_ticks(&self, state: &mut State<1>, collective: Collective, observe: impl FnMut(f64, &State<1>)) {
        ticks::fly(&self.coefficients, state, &self.primitive, collective, observe);
    }
}

/// The final error of one lane.
pub(crate) fn error_of<const N: usize>(state: &State<N>, lane: usize, turn_rad: f64) -> FinalError {
    FinalError {
        x_m: state.x.0[lane],
        z_m: state.z.0[lane],
        vx_m_s: state.vx.0[lane],
        vz_m_s: state.vz.0[lane],
        theta_rad: state.theta.0[lane] - turn_rad,
    }
}
