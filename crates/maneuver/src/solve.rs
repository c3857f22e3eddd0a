//! From a design to the parameters that fly it on the model, and the Jacobian there.

use core::array;

use quantity::{GRAVITY_M_S2, math};

use crate::descend::{Descent, Goal, QuasiNewton, SOLVED, descend, matrix};
use crate::limits::{Bounds, Limits};
use crate::model::{Model, ModelError};
use crate::parameters::{FinalError, FlipDesign, Parameters};
use crate::planar::{CONTINUOUS_HZ, Discretisation, FlipError};
use crate::primitive::{Primitive, PrimitiveError};
use crate::problem::{Evaluation, Grid, Problem};

/// The way down from the rough guess, on a grid that errs by a few hundredths at most and costs a thirtieth.
const ROUGH: Goal = Goal { grid: Grid::Steps(400.0), tolerance: 1e-3, stall: 2e-4, width: 1.0 };

/// Grid of the Jacobian the last steps start with.
const FINE_GRID: Grid = Grid::Steps(1_600.0);

/// Norm of the final error at which that grid has no more to tell.
const FINE_TOLERANCE: f64 = 1e-4;

/// Starts tried when the rough guess leads nowhere, and how many of the best are followed to the end.
const STARTS: u32 = 48;
const FOLLOWED: usize = 3;

/// A flip that ends where it began, on the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Where the search began, eqs. (23), (24).
    pub rough_guess: Parameters,
    /// F at the rough guess, or at the nearest flyable parameters if the guess is none (negative T3).
    pub rough_error: FinalError,
    /// P0: inside the reduced envelope, durations above zero.
    pub parameters: Parameters,
    /// F(P0), of norm below 1e-9.
    pub final_error: FinalError,
    /// J at P0: rows x, z, vx, vz, theta, columns U1, T1, T3, U5, T5. Central differences of ±0.002 m/s² and
    /// ±50 µs.
    // Lupashin 2010, eq. (25).
    pub jacobian: [[f64; 5]; 5],
    /// Ratio of the Jacobian's greatest to its least singular value.
    pub condition: f64,
    /// T1 to T5, s.
    pub durations_s: [f64; 5],
    /// Greatest height above the start, m.
    pub apex_m: f64,
}

impl Solution {
    /// T1 + ... + T5, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.durations_s.iter().sum()
    }
}

/// The least final error inside the reduced envelope, where it is not zero.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("no solution inside the reduced envelope: least residual {least_residual:.3}, {limits}")]
pub struct Infeasible {
    /// Least norm of the final error found.
    pub least_residual: f64,
    /// Where it was found. Not a P0.
    pub parameters: Parameters,
    /// Bounds that keep it from getting less.
    pub limits: Limits,
}

/// Why there is no [`Solution`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// Model or design are impossible.
    #[error(transparent)]
    Flip(#[from] FlipError),
    /// The final error jumps with the parameters, so that it has no zero to find and no Jacobian.
    #[error("a sampled collective makes the final error jump: solve the averaged or the continuous model")]
    Discontinuous,
    /// The design cannot be flown inside the envelope.
    #[error(transparent)]
    Infeasible(#[from] Infeasible),
}

impl From<PrimitiveError> for SolveError {
    fn from(error: PrimitiveError) -> Self {
        Self::Flip(error.into())
    }
}

impl From<ModelError> for SolveError {
    fn from(error: ModelError) -> Self {
        Self::Flip(error.into())
    }
}

/// The rough guess: instantaneous, symmetric, as the paper prints it. T3 comes out negative where the rate is
/// so high, and the turns so few, that starting and stopping alone turn further than asked.
///
/// # Errors
/// If model or design are impossible.
// Lupashin 2010, eqs. (23), (24).
pub fn rough_guess(model: &Model, design: &FlipDesign) -> Result<Parameters, FlipError> {
    Problem::new(model, design)?;
    let envelope = &design.envelope;
    let u_m_s2 = 0.9 * envelope.high_m_s2;
    let rotate_s = design.rate_rad_s_max * 2.0 * model.alpha_l_m() / envelope.span_m_s2();
    let coast_s = design.turn_rad() / design.rate_rad_s_max - rotate_s;
    let push_s = GRAVITY_M_S2 * (rotate_s + coast_s + rotate_s) / (2.0 * u_m_s2);
    Ok(Parameters { u1_m_s2: u_m_s2, t1_s: push_s, t3_s: coast_s, u5_m_s2: u_m_s2, t5_s: push_s })
}

/// P0 and J of a design: the parameters inside the reduced envelope whose final error vanishes on the model.
///
/// The weights of the paper's norm do not matter where that norm reaches zero; where it does not, the plain
/// norm's least value is reported.
///
/// # Errors
/// If model or design are impossible, or nothing inside the envelope ends where it began.
pub fn solve(
    model: &Model,
    design: &FlipDesign,
    discretisation: Discretisation,
) -> Result<Solution, SolveError> {
    let grid = match discretisation {
        Discretisation::Continuous => Grid::Steps(CONTINUOUS_HZ),
        Discretisation::Average800 => Grid::Ticks,
        Discretisation::Hold800 => return Err(SolveError::Discontinuous),
    };
    let problem = Problem::new(model, design)?;
    let bounds = Bounds::new(design);
    let rough_guess = rough_guess(model, design)?;
    let start = bounds.clamp(rough_guess.to_array());
    let flyable = rough_guess.to_array();
    let flyable = if problem.possible(&flyable) { flyable } else { start };
    let straight = descend(&problem, &bounds, turned_right(&problem, &bounds, start)?, ROUGH)?;
    let near = approach(&problem, &straight)?;
    let nearest = near.as_ref().map_or(straight.parameters, |near| near.parameters);
    let (first, rough_error) = problem.evaluate_beside(&nearest, &flyable, grid)?;
    let solved = match near {
        Some(near) => near.arrive(&problem, &bounds, first, grid)?,
        None => None,
    };
    let solved = match solved {
        Some(solved) => solved,
        None => search(&problem, &bounds, straight, &start, grid)?,
    };
    let jacobian = problem.jacobian(&solved.parameters, &solved.here, grid, 1.0)?;
    let parameters = Parameters::from_array(solved.parameters);
    let primitive = Primitive::new(design, model.alpha_l_m(), &parameters)?;
    Ok(Solution {
        rough_guess,
        rough_error,
        parameters,
        final_error: solved.here.error,
        jacobian,
        condition: condition(&jacobian),
        durations_s: primitive.steps().map(|step| step.duration_s),
        apex_m: solved.here.apex_m,
    })
}

/// The start with T3 changed until about the right number of turns is made. Nearly always that is all it
/// takes to stay clear of the basins where a double flip passes for a triple.
fn turned_right(
    problem: &Problem<'_>,
    bounds: &Bounds,
    mut start: [f64; 5],
) -> Result<[f64; 5], PrimitiveError> {
    for _ in 0..6 {
        let excess_rad = problem.evaluate(&start, ROUGH.grid)?.error.theta_rad;
        if excess_rad.abs() < 0.05 {
            break;
        }
        start[2] -= excess_rad / problem.design.rate_rad_s_max;
        start = bounds.clamp(start);
    }
    Ok(start)
}

/// A point close to a solution, and how to get there.
#[derive(Clone, Copy, Debug)]
struct Near {
    parameters: [f64; 5],
    newton: QuasiNewton,
}

/// From a descent's end on the rough grid close to a solution; `None` if there is none nearby.
fn approach(problem: &Problem<'_>, rough: &Descent) -> Result<Option<Near>, PrimitiveError> {
    if rough.norm() > 30.0 * ROUGH.tolerance {
        return Ok(None);
    }
    let here = problem.evaluate(&rough.parameters, FINE_GRID)?;
    let jacobian = problem.jacobian(&rough.parameters, &here, FINE_GRID, 1.0)?;
    let Some(mut newton) = QuasiNewton::new(&jacobian) else {
        return Ok(None);
    };
    let closer = newton.polish(problem, rough.parameters, here, FINE_GRID, FINE_TOLERANCE);
    let parameters = closer.map_or(rough.parameters, |closer| closer.parameters);
    Ok(Some(Near { parameters, newton }))
}

impl Near {
    /// To the solution on the grid that counts, on which `here` is the evaluation.
    fn arrive(
        mut self,
        problem: &Problem<'_>,
        bounds: &Bounds,
        here: Evaluation,
        grid: Grid,
    ) -> Result<Option<Descent>, PrimitiveError> {
        if let Some(solved) = self.newton.polish(problem, self.parameters, here, grid, SOLVED)
            && bounds.clamp(solved.parameters) == solved.parameters
        {
            return Ok(Some(solved));
        }
        // The error is smooth in pieces only. Wide differences see across the kinks, narrow ones the piece
        // they are in: where the first are stuck at a kink the second get through.
        let mut parameters = self.parameters;
        for width in [1.0, 0.01] {
            let descent = descend(problem, bounds, parameters, Goal { width, ..precise(grid) })?;
            if descent.norm() < SOLVED {
                return Ok(Some(descent));
            }
            parameters = descent.parameters;
        }
        Ok(None)
    }
}

/// Where the straight way ends without a solution: descends from points spread evenly over the box, until one
/// leads to a solution.
fn search(
    problem: &Problem<'_>,
    bounds: &Bounds,
    straight: Descent,
    guess: &[f64; 5],
    grid: Grid,
) -> Result<Descent, SolveError> {
    let mut best = [None; FOLLOWED];
    insert(&mut best, straight);
    for number in 0..STARTS {
        // A start that is no flip is one start less.
        if let Ok(rough) = descend(problem, bounds, spread(bounds, guess, number), ROUGH)
            && insert(&mut best, rough)
            && let Some(near) = approach(problem, &rough)?
            && let Some(solved) =
                near.arrive(problem, bounds, problem.evaluate(&near.parameters, grid)?, grid)?
        {
            return Ok(solved);
        }
    }
    let mut least = descend(problem, bounds, straight.parameters, precise(grid))?;
    for rough in best.into_iter().flatten().filter(|rough| rough.parameters != straight.parameters) {
        let end = descend(problem, bounds, rough.parameters, precise(grid))?;
        if end.norm() < least.norm() {
            least = end;
        }
    }
    if least.norm() < SOLVED {
        return Ok(least);
    }
    Err(SolveError::Infeasible(Infeasible {
        least_residual: least.norm(),
        parameters: Parameters::from_array(least.parameters),
        limits: least.limits,
    }))
}

/// To a solution, or to the least residual there is.
fn precise(grid: Grid) -> Goal {
    Goal { grid, tolerance: SOLVED, stall: 1e-6, width: 1.0 }
}

/// Puts a descent among the best, sorted by norm, and drops what falls off the end. False if it is not among
/// them, or ended where another did.
fn insert(best: &mut [Option<Descent>; FOLLOWED], mut descent: Descent) -> bool {
    let same = |kept: &Descent| {
        let apart = kept.parameters.iter().zip(descent.parameters).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, f64::max) < 0.02
    };
    if best.iter().flatten().any(same) {
        return false;
    }
    let mut kept = false;
    for place in best.iter_mut() {
        match place {
            None => {
                *place = Some(descent);
                return true;
            }
            Some(other) if descent.norm() < other.norm() => {
                core::mem::swap(other, &mut descent);
                kept = true;
            }
            Some(_) => {}
        }
    }
    kept
}

/// Point `number` of an additive recurrence, which covers five dimensions evenly without a random number: U1
/// and U5 over their bounds, durations from 0.4 to 1.9 of the guess.
fn spread(bounds: &Bounds, guess: &[f64; 5], number: u32) -> [f64; 5] {
    /// The real root of x⁶ = x + 1.
    const GENERATOR: f64 = 1.134_724_138_401_519;
    let mut step = 1.0;
    array::from_fn(|index| {
        step /= GENERATOR;
        let position = 0.5 + f64::from(number + 1) * step;
        let ratio = position - math::floor(position);
        match index {
            0 | 3 => bounds.low[index] + ratio * (bounds.high[index] - bounds.low[index]),
            _ => guess[index].max(0.02) * (0.4 + 1.5 * ratio),
        }
    })
}

/// Ratio of the greatest to the least singular value; infinite for a singular Jacobian.
fn condition(jacobian: &[[f64; 5]; 5]) -> f64 {
    let values = matrix(jacobian).singular_values();
    values.max() / values.min()
}
