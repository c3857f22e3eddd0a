//! Two ways down: damped least squares inside the box, from anywhere; and quasi-Newton, from close by.

use core::array;

use nalgebra::{Matrix5, Vector5};

use crate::limits::{Bounds, Limits};
use crate::primitive::PrimitiveError;
use crate::problem::{Evaluation, Grid, Problem};

/// Norm of the final error below which a flip counts as solved.
pub(crate) const SOLVED: f64 = 1e-9;

/// Iterations of one descent, and retries with more damping within one.
const ITERATIONS_MAX: usize = 60;
const RETRIES_MAX: usize = 16;

/// Quasi-Newton steps before giving up.
const POLISH_STEPS_MAX: usize = 12;

/// Longest step in U1 and U5, m/s², and in a duration, as a ratio and at least in s. Longer ones jump over
/// whole turns into basins where theta is wrong by 2π.
const STEP_M_S2_MAX: f64 = 1.5;
const STEP_RATIO_MAX: f64 = 0.3;
const STEP_S_MIN: f64 = 0.02;

/// What a descent computes with, and when it is done.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    pub grid: Grid,
    /// Norm of the final error that is good enough.
    pub tolerance: f64,
    /// Relative improvement of one iteration that is not worth another.
    pub stall: f64,
    /// Width of the Jacobian's differences, relative to the usual one.
    pub width: f64,
}

/// Where a descent ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Descent {
    pub parameters: [f64; 5],
    pub here: Evaluation,
    /// Sides of the box the error would decrease beyond.
    pub limits: Limits,
}

impl Descent {
    pub fn norm(&self) -> f64 {
        self.here.error.norm()
    }
}

/// Levenberg and Marquardt's damped least squares on |F|, inside the box, until the goal is reached or
/// nothing helps any more.
pub(crate) fn descend(
    problem: &Problem<'_>,
    bounds: &Bounds,
    start: [f64; 5],
    goal: Goal,
) -> Result<Descent, PrimitiveError> {
    let parameters = bounds.clamp(start);
    let here = problem.evaluate(&parameters, goal.grid)?;
    let mut at = Descent { parameters, here, limits: Limits::NONE };
    let mut damping = 1e-3;
    for _ in 0..ITERATIONS_MAX {
        if at.norm() < goal.tolerance {
            break;
        }
        let jacobian = matrix(&problem.jacobian(&at.parameters, &at.here, goal.grid, goal.width)?);
        let gradient = jacobian.transpose() * vector(&at.here);
        at.limits = bounds.pressed(&at.parameters, &gradient.into());
        let normal = jacobian.transpose() * jacobian;
        let before = at.norm();
        let mut improved = false;
        for _ in 0..RETRIES_MAX {
            let step = damped_step(&normal, &gradient, damping, at.limits);
            if let Some(step) = step.map(|step| shortened(step, &at.parameters)) {
                let trial = bounds.clamp(array::from_fn(|index| at.parameters[index] + step[index]));
                // A trial that is no flip at all is refused like one that is worse.
                if let Ok(there) = problem.evaluate(&trial, goal.grid)
                    && there.error.norm() < before
                {
                    (at.parameters, at.here) = (trial, there);
                    damping = f64::max(damping * 0.1, 1e-12);
                    improved = true;
                    break;
                }
            }
            damping *= 10.0;
        }
        if !improved || at.norm() > before * (1.0 - goal.stall) {
            break;
        }
    }
    Ok(at)
}

/// Solution of (JᵀJ + damping diag(JᵀJ)) step = -gradient over the parameters no side of the box holds.
fn damped_step(
    normal: &Matrix5<f64>,
    gradient: &Vector5<f64>,
    damping: f64,
    held: Limits,
) -> Option<Vector5<f64>> {
    let mut matrix = *normal;
    let mut downhill = -gradient;
    for index in 0..5 {
        matrix[(index, index)] += damping * normal[(index, index)];
        if held.low(index) || held.high(index) {
            matrix.row_mut(index).fill(0.0);
            matrix.column_mut(index).fill(0.0);
            matrix[(index, index)] = 1.0;
            downhill[index] = 0.0;
        }
    }
    matrix.lu().solve(&downhill).filter(|step| step.iter().all(|component| component.is_finite()))
}

/// The same direction, no component longer than its limit.
fn shortened(step: Vector5<f64>, parameters: &[f64; 5]) -> Vector5<f64> {
    let mut scale: f64 = 1.0;
    for (index, component) in step.iter().enumerate() {
        let longest = match index {
            0 | 3 => STEP_M_S2_MAX,
            _ => (STEP_RATIO_MAX * parameters[index]).max(STEP_S_MIN),
        };
        if component.abs() * scale > longest {
            scale = longest / component.abs();
        }
    }
    step * scale
}

/// Quasi-Newton steps with Broyden's updates, for the last steps to a solution: on a fine grid they need
/// about three evaluations and not one Jacobian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct QuasiNewton {
    /// Scaled parameter change per change of the final error.
    inverse: Matrix5<f64>,
}

impl QuasiNewton {
    /// Starts with a Jacobian of roughly there, which may be one of a coarser grid. `None` if it is singular.
    pub fn new(jacobian: &[[f64; 5]; 5]) -> Option<Self> {
        let inverse = (matrix(jacobian) * Matrix5::from_diagonal(&scales())).try_inverse()?;
        Some(Self { inverse })
    }

    /// From `parameters`, whose evaluation on this grid is `here`, until the norm is below `tolerance`.
    /// `None` if it does not get there.
    pub fn polish(
        &mut self,
        problem: &Problem<'_>,
        mut parameters: [f64; 5],
        mut here: Evaluation,
        grid: Grid,
        tolerance: f64,
    ) -> Option<Descent> {
        for _ in 0..POLISH_STEPS_MAX {
            if here.error.norm() < tolerance {
                return Some(Descent { parameters, here, limits: Limits::NONE });
            }
            let step = -(self.inverse * vector(&here));
            let moved = step.component_mul(&scales());
            parameters = array::from_fn(|index| parameters[index] + moved[index]);
            let there = problem.evaluate(&parameters, grid).ok()?;
            if there.error.norm() > 0.5 * here.error.norm() {
                return None;
            }
            let change = self.inverse * (vector(&there) - vector(&here));
            let along = step.dot(&change);
            if along != 0.0 {
                self.inverse += (step - change) * (step.transpose() * self.inverse) / along;
            }
            here = there;
        }
        None
    }
}

/// Sizes of typical changes. Without them Broyden's update would blame everything on U1 and U5.
fn scales() -> Vector5<f64> {
    Vector5::new(1.0, 0.01, 0.01, 1.0, 0.01)
}

pub(crate) fn matrix(rows: &[[f64; 5]; 5]) -> Matrix5<f64> {
    Matrix5::from_fn(|row, column| rows[row][column])
}

fn vector(evaluation: &Evaluation) -> Vector5<f64> {
    Vector5::from(evaluation.error.to_array())
}
