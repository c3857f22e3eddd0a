//! `arena run`: one service in this process.

use std::process::ExitCode;

use clap::Args;
use service_shell::{Setup, clock};

use super::Failure;

/// Options of `arena run`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A service, a bridge, or `simulator`.
    service: String,
    /// Seed of the simulator's world; the other services take none.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    options: service_shell::Options,
}

/// Runs the command.
pub fn run(arguments: Arguments) -> Result<ExitCode, Failure> {
    let Arguments { service, seed, options } = arguments;
    service_shell::init_logging(&options.log);
    if service == "simulator" {
        simulator::run_with(&options, seed)?;
        return Ok(ExitCode::SUCCESS);
    }
    let setup = Setup::load(&service, &options)?;
    let mut node = roster::node(&service, &setup.arena, &setup.secret, setup.identity, clock::now())?;
    service_shell::drive(&setup, node.as_mut())?;
    Ok(ExitCode::SUCCESS)
}
