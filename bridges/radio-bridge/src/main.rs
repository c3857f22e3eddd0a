//! The radio bridge as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    service_shell::run::<radio_bridge::RadioBridge>()
}
