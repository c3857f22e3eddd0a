//! Physics outcomes in the virtual arena.

/// A Crazyflie, told by CRTP.
mod crazyflie;
/// A minute of hovering.
mod hover;
/// The three experiments of the paper, and the fleet.
mod learning;
/// Prediction through the queue of sent commands.
mod prediction;
/// Out of any attitude, and flips in any direction.
mod recovery;
