//! The five-step flip primitive, its planar model, its solver and its Jacobian.
//!
//! A *design* ([`FlipDesign`]) says what a flip is meant to be: how many turns, how fast, inside which part
//! of the thrust range. Five *parameters* ([`Parameters`]) are left open. Together they give a [`Primitive`]:
//! collective and rate as functions of time, which a vehicle flies by itself and [`final_error`] flies on the
//! [`Model`]. [`solve()`] finds the parameters that end where they began, and the Jacobian a learner corrects
//! them with; [`stress()`] asks what they do on a vehicle that is not the model.
//!
//! Everything follows Lupashin, Schöllig, Sherback and D'Andrea, "A Simple Learning Strategy for High-Speed
//! Quadrocopter Multi-Flips", ICRA 2010, whose equation numbers the comments cite. SI units and radians
//! throughout. x is lateral, z up, theta the pitch; positive pitch tips the thrust toward +x.
//!
//! ```
//! use maneuver::{Discretisation, Envelope, FlipDesign, Model, solve};
//!
//! let model = Model::TABLE_I;
//! let envelope = Envelope::with_margin(&model, Envelope::MARGIN)?;
//! let design = FlipDesign { flips: 2, rate_rad_s_max: 1600_f64.to_radians(), envelope };
//! let solution = solve(&model, &design, Discretisation::Continuous)?;
//! assert!(solution.final_error.norm() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! No allocation, no clock, no I/O: `onboard` compiles the primitive for the vehicle.
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
