//! The simulated arena: vehicles, rotors, battery, air, cameras and radio links. It speaks device bytes.
//!
//! To the bridges [`Plant`] is the hardware: out come the motion-capture system's datagrams and the data-link
//! radio's serial bytes, in go SBUS or CRSF bytes for each vehicle's command link and the radio's API frames. On each
//! simulated vehicle runs the very firmware of the crate `onboard`, on a clock of its own; a Crazyflie flies by the same
//! rate loops, and speaks CRTP.
//!
//! * [`rigid_body`], [`rotor`], [`air`], [`battery`], [`floor`] are the physics, put together in
//!   [`airframe`];
//! * [`imu`] and [`clock`] are what the firmware senses;
//! * [`cameras`], [`command_link`] and [`data_link`] are what the ground senses and says, `crazyflie` what one of those
//!   does with it;
//! * [`faults`] is what may go wrong, [`truth`] what only a simulator knows.
//!
//! How the simulated vehicle differs from the believed one stands in the settings, every number by name.

pub mod air;
pub mod airframe;
pub mod battery;
pub mod cameras;
pub mod clock;
pub mod command_link;
mod crazyflie;
pub mod data_link;
pub mod faults;
mod firmware_settings;
pub mod floor;
pub mod imu;
mod natnet_server;
mod output;
mod plant;
mod queue;
pub mod random;
pub mod rigid_body;
pub mod rotor;
pub mod truth;
mod vehicle;

pub use faults::{Fault, Occlusion};
pub use firmware_settings::firmware_settings;
pub use output::{Device, DeviceOutput};
pub use plant::{Plant, PlantError};
pub use rigid_body::Motion;
pub use truth::{Extremes, FlipError, ManeuverTruth, Trajectory, TrajectorySample, Truth};

#[cfg(test)]
mod testing;
