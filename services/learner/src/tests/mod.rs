//! Tests of the whole core.

mod learning;
mod random;
mod refusals;
mod rig;
