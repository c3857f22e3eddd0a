//! The tools without compiled-in types, as a user runs them: on files, on a live bus, and their definitions
//! beside the schemas they came from.

mod bus;
mod definitions;
mod files;
mod rig;
