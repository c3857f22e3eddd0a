//! The arena as a whole, in one test binary: one module per subject.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

/// The front door as people and scripts use it.
mod cli;
/// What several subjects share: settings, an arena in virtual time, what was heard.
mod common;
/// What is on the wire, in decoders that are not ours.
mod devices;
/// What an arena needs of this host and its equipment.
mod doctor;
/// Each vendor's equipment, by configuration alone.
mod equipment;
/// One fear each: what the arena does when something breaks.
mod faults;
/// Physics outcomes in the virtual arena.
mod flights;
/// Before real equipment.
mod hardware;
/// What hostile datagrams change: nothing but counters.
mod hostile;
/// Real processes on loopback multicast.
mod live;
/// A recording back on the bus, as live data, and out of any radio's reach.
mod playback;
/// The front door as a process: its lines, its signals.
mod process;
/// Hostile bytes by the thousand: what the fuzz targets promise.
mod reading;
/// A live arena that is recorded: first steps, last words, a disk that fills.
mod recording;
/// In how many slices the time is run through makes no difference.
mod slices;
/// The design's invariants, held against the source itself.
mod tidy;
/// The tools without compiled-in types, on files and on a live bus.
mod tools;
/// What a recording proves of the services in it.
mod verify;
/// The topic table is what the services say it is.
mod wiring;
/// N seeds draw the whole world: faults, network, places.
mod worlds;
