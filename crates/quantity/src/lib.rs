//! What everything here computes with: integer time, frames, vectors, rotations, and pinned mathematics.
//!
//! *Time* is an integer count of nanoseconds, so that adding a tick a million times gives the same instant on
//! every machine. *Frames* are type parameters: a [`Rotation<Body, World>`](Rotation) times a
//! [`Vector<Body>`](Vector) is a `Vector<World>`, and the reverse does not compile. *Mathematics* beyond the four
//! IEEE operations comes from one portable implementation ([`math`]), because a platform's own `sin` differs in its
//! last bit from its neighbour's and a replay must not.
#![no_std]

pub mod math;
mod rotation;
mod time;
mod vector;

pub use rotation::Rotation;
pub use time::{Span, Time};
pub use vector::{Body, Frame, Vector, World};

/// Standard gravity as the multi-flip paper's model uses it, along -z of [`World`].
pub const GRAVITY_M_S2: f64 = 9.81;
