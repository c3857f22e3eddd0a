//! The front door's library: experiments in virtual time, their reports and pictures, and the supervisor of a live
//! arena.

pub mod campaign;
pub mod contents;
pub mod director;
pub mod experiment;
pub mod figures;
pub mod pictures;
pub mod profile;
pub mod report;
pub mod supervisor;
pub mod tools;
pub mod virtual_recording;
