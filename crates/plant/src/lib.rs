//! The physics: vehicles, rotors, battery, cameras and radio links; speaks device bytes.

pub mod air;
pub mod airframe;
pub mod battery;
pub mod cameras;
pub mod clock;
pub mod command_link;
pub mod data_link;
pub mod faults;
pub mod floor;
pub mod imu;
pub mod output;
mod queue;
pub mod random;
pub mod rigid_body;
pub mod rotor;

#[cfg(test)]
mod testing;
