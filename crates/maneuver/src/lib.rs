//! The five-step flip primitive, its planar model, its solver and its Jacobian.
#![no_std]

mod continuous;
mod descend;
mod dynamics;
mod envelope;
mod lanes;
mod limits;
mod model;
mod parameters;
mod planar;
mod primitive;
mod problem;
mod solve;
mod stress;
mod ticks;

pub use dynamics::PlanarState;
pub use envelope::{Envelope, EnvelopeError};
pub use limits::Limits;
pub use model::{Integral, Model, ModelError};
pub use parameters::{FinalError, FlipDesign, Parameters};
pub use planar::{CONTINUOUS_HZ, Discretisation, FlipError, LOOP_HZ, apex_m, final_error, trajectory};
pub use primitive::{Primitive, PrimitiveError, Setpoint, Step};
pub use solve::{Infeasible, Solution, SolveError, rough_guess, solve};
pub use stress::{Deviation, StressCase, StressReport, deviate, stress};
