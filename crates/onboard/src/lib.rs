//! The vehicle's firmware: rate loops, mixer, command generator, parameter store, failsafe.
