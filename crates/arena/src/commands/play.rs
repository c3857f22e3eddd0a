//! `arena play`: a recording, back on the bus of the replay domain.

use std::process::ExitCode;

use clap::Args;

use super::Failure;

/// Options of `arena play`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    options: playback::Options,
}

/// Runs the command: exit code 0 where it was played to its end, or as far as somebody wanted.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging("warn");
    Ok(playback::run_with(&arguments.options)?)
}
