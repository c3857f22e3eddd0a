//! The driver in virtual time, with cores small enough to count what they do.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

/// Cores small enough to count what they do.
mod cores;
/// The same seed gives the same bytes, however the time is run through and whoever listens.
mod digest;
/// What the network does to datagrams.
mod network;
/// Services that die, sleep and come back.
mod processes;
