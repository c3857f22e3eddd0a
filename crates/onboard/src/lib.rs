//! The vehicle's firmware, without hardware: sensor samples and radio bytes in, motor commands and radio
//! bytes out.
//!
//! [`Firmware`] is called from two sides. Its owner, a flight computer's main loop or the simulator, calls
//! [`Firmware::tick`] 800 times a second with what the sensors read and gives the answer to the four motor
//! controllers; whenever a radio has something it calls [`Firmware::receive_channels`] or
//! [`Firmware::receive_payload`], and [`Firmware::poll_transmit`] until there is nothing to send. Time is the
//! vehicle's own and comes in with every call.
//!
//! What it does, file by file (Lupashin 2010, section V.A and Fig. 7):
//!
//! * `rate_loop`, `mixer`: body rates to motor commands;
//! * `command_generator`, `gate`: fly a stored flip, if the vehicle's own conditions hold, under guard;
//! * `parameters`: the store the flip comes from, replaced whole or not at all;
//! * `failsafe`: who flies when the commands stop, and when the motors do;
//! * `attitude`, `drift`, `sensors`: what the vehicle knows of itself for that;
//! * `telemetry`: what it tells the ground, and when.
//!
//! Nothing here allocates, reads a clock, or trusts the ground more than the vehicle's own limits.
#![no_std]

#[cfg(test)]
extern crate std;

mod attitude;
mod command_generator;
mod drift;
mod failsafe;
mod firmware;
mod gate;
mod mixer;
mod parameters;
mod rate_loop;
mod sensors;
mod settings;
mod telemetry;
#[cfg(test)]
mod tests;

pub use firmware::{Firmware, ReceiveCounters};
pub use mixer::MOTOR_COMMAND_MAX;
pub use sensors::ImuSample;
pub use settings::{
    Airframe, AttitudeSettings, DriftSettings, FailsafeSettings, FirmwareSettings, LOOP_HZ, ManeuverGuard,
    ManeuverLimits, RateGains, RateSettings, SettingsError, StartGate, TICK,
};
