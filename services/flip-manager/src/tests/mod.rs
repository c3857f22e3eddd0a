//! Tests of the whole core, and of what needs a flight to be tested with.

mod course;
mod end_state;
mod flight;
mod gate;
mod random;
mod rig;
