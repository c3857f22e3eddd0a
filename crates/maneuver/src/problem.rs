//! The final error as a function of five numbers, and its Jacobian, on a chosen grid of time.

use core::array;

use crate::continuous;
use crate::dynamics::{Coefficients, State};
use crate::model::Model;
use crate::parameters::{FinalError, FlipDesign, Parameters};
use crate::planar::{FlipError, error_of};
use crate::primitive::{Primitive, PrimitiveError};
use crate::stress::Deviation;
use crate::ticks::{self, Collective};

/// Half the width of the central differences in U1 and U5, m/s².
///
/// Part of the definition of J: clipping and the rotors' two lags put kinks into F, so that its smallest
/// entries differ by some percent with the width and with the grid. These widths give the published J to its
/// last digit; other ones, and the exact derivative of the grid's equations, do not.
pub(crate) const DIFFERENCE_M_S2: f64 = 2e-3;

/// Half the width of the central differences in T1, T3 and T5, s. See [`DIFFERENCE_M_S2`].
pub(crate) const DIFFERENCE_S: f64 = 5e-5;

/// How time is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Grid {
    /// Continuous model, so many Runge-Kutta steps per second.
    Steps(f64),
    /// The 800 Hz rate loop with averaged collective.
    Ticks,
}

/// One flip to be solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Problem<'a> {
    pub design: &'a FlipDesign,
    coefficients: Coefficients,
    alpha_l_m: f64,
}

/// F at one set of parameters, and what the Jacobian there can reuse.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Evaluation {
    pub error: FinalError,
    /// Greatest height above the start, m.
    pub apex_m: f64,
    /// States where steps 3 and 4 begin. Steps 1 and 2 depend on neither T3, U5 nor T5, step 3 neither on U5
    /// nor T5.
    coast_begins: State<1>,
    stop_begins: State<1>,
}

impl<'a> Problem<'a> {
    pub fn new(model: &Model, design: &'a FlipDesign) -> Result<Self, FlipError> {
        model.check()?;
        design.envelope.check().map_err(PrimitiveError::from)?;
        Ok(Self {
            design,
            coefficients: Coefficients::new(model, &Deviation::NONE),
            alpha_l_m: model.alpha_l_m(),
        })
    }

    fn primitive(&self, parameters: &[f64; 5]) -> Result<Primitive, PrimitiveError> {
        Primitive::new(self.design, self.alpha_l_m, &Parameters::from_array(*parameters))
    }

    /// Whether these parameters make a flip at all.
    pub fn possible(&self, parameters: &[f64; 5]) -> bool {
        self.primitive(parameters).is_ok()
    }

    /// F of these parameters.
    pub fn evaluate(&self, parameters: &[f64; 5], grid: Grid) -> Result<Evaluation, PrimitiveError> {
        let primitive = self.primitive(parameters)?;
        match grid {
            Grid::Steps(steps_hz) => Ok(self.fly(&[primitive], steps_hz).0),
            Grid::Ticks => {
                let mut state = State::hovering(&self.coefficients);
                let (coast_begins, stop_begins) = (state, state);
                let mut apex_m: f64 = 0.0;
                ticks::fly(&self.coefficients, &mut state, &primitive, Collective::Averaged, |_, state| {
                    apex_m = apex_m.max(state.z.0[0]);
                });
                let error = error_of(&state, 0, self.design.turn_rad());
                Ok(Evaluation { error, apex_m, coast_begins, stop_begins })
            }
        }
    }

    /// [`Problem::evaluate`] of these parameters, and F of others `beside`, in the time of one where the grid
    /// allows.
    pub fn evaluate_beside(
        &self,
        parameters: &[f64; 5],
        beside: &[f64; 5],
        grid: Grid,
    ) -> Result<(Evaluation, FinalError), PrimitiveError> {
        match grid {
            Grid::Ticks => Ok((self.evaluate(parameters, grid)?, self.evaluate(beside, grid)?.error)),
            Grid::Steps(steps_hz) => {
                let pair = [self.primitive(parameters)?, self.primitive(beside)?];
                let (here, [_, error]) = self.fly(&pair, steps_hz);
                Ok((here, error))
            }
        }
    }

    /// Flies flips side by side on a grid of steps: the first one's evaluation, and everyone's error.
    fn fly<const N: usize>(
        &self,
        primitives: &[Primitive; N],
        steps_hz: f64,
    ) -> (Evaluation, [FinalError; N]) {
        let mut state = State::<N>::hovering(&self.coefficients);
        let mut begins = [state.only_first(); 5];
        let mut apex_m: f64 = 0.0;
        for (index, begin) in begins.iter_mut().enumerate() {
            *begin = state.only_first();
            continuous::fly_step(&self.coefficients, &mut state, primitives, index, steps_hz, |_, state| {
                apex_m = apex_m.max(state.z.0[0]);
            });
        }
        let errors = array::from_fn(|lane| error_of(&state, lane, self.design.turn_rad()));
        let [_, _, coast_begins, stop_begins, _] = begins;
        (Evaluation { error: errors[0], apex_m, coast_begins, stop_begins }, errors)
    }

    /// J at these parameters, whose evaluation on the same grid is `here`: rows x, z, vx, vz, theta, columns
    /// U1, T1, T3, U5, T5. Differences are `width` times [`DIFFERENCE_M_S2`] and [`DIFFERENCE_S`] wide.
    pub fn jacobian(
        &self,
        parameters: &[f64; 5],
        here: &Evaluation,
        grid: Grid,
        width: f64,
    ) -> Result<[[f64; 5]; 5], PrimitiveError> {
        let mut jacobian = [[0.0; 5]; 5];
        for column in 0..5 {
            let width = width * if column == 0 || column == 3 { DIFFERENCE_M_S2 } else { DIFFERENCE_S };
            let (mut above, mut below) = (*parameters, *parameters);
            above[column] += width;
            below[column] -= width;
            let [above, below] = match grid {
                Grid::Ticks => [self.evaluate(&above, grid)?.error, self.evaluate(&below, grid)?.error],
                Grid::Steps(steps_hz) => {
                    let pair = [self.primitive(&above)?, self.primitive(&below)?];
                    let (first, state) = match column {
                        0 | 1 => (0, State::hovering(&self.coefficients)),
                        2 => (2, State::like(&here.coast_begins)),
                        _ => (3, State::like(&here.stop_begins)),
                    };
                    self.finish(&pair, first, state, steps_hz)
                }
            };
            let (above, below) = (above.to_array(), below.to_array());
            for row in 0..5 {
                jacobian[row][column] = (above[row] - below[row]) / (2.0 * width);
            }
        }
        Ok(jacobian)
    }

    /// Flies two flips side by side from the start of step `first` (0 to 4).
    fn finish(
        &self,
        pair: &[Primitive; 2],
        first: usize,
        mut state: State<2>,
        steps_hz: f64,
    ) -> [FinalError; 2] {
        for index in first..5 {
            continuous::fly_step(&self.coefficients, &mut state, pair, index, steps_hz, |_, _| ());
        }
        let turn_rad = self.design.turn_rad();
        [error_of(&state, 0, turn_rad), error_of(&state, 1, turn_rad)]
    }
}
