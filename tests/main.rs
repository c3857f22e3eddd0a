//! The arena as a whole, in one test binary: one module per subject.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

/// The front door as people and scripts use it.
mod cli;
/// What several subjects share: settings, an arena in virtual time, what was heard.
mod common;
/// One fear each: what the arena does when something breaks.
mod faults;
/// Physics outcomes in the virtual arena.
mod flights;
/// What hostile datagrams change: nothing but counters.
mod hostile;
/// Real processes on loopback multicast.
mod live;
/// In how many slices the time is run through makes no difference.
mod slices;
/// The design's invariants, held against the source itself.
mod tidy;
/// The topic table is what the services say it is.
mod wiring;
/// N seeds draw the whole world: faults, network, places.
mod worlds;
