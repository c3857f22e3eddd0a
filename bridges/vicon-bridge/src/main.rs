//! The vicon bridge as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    service_shell::run::<vicon_bridge::ViconBridge>()
}
