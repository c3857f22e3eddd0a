//! Settings as people write them: what is shipped loads, what is wrong is refused with file, key and both values.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

/// A Crazyflie, and a scenario without a flip.
mod crazyflie;
/// The digest of resolved settings.
mod digest;
/// A copy of the shipped settings to spoil.
mod folder;
/// What one file inherits from another, and what a scenario lays over its vehicles.
mod layers;
/// What is laid over a folder.
mod overlay;
/// What is refused, and in which words.
mod refusals;
/// What is shipped.
mod shipped;
