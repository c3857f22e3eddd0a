//! `arena run`: one service in this process.

use std::process::ExitCode;

use clap::Args;
use service_shell::Setup;

use super::Failure;

/// Options of `arena run`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A service, a bridge, `simulator`, or `logger`.
    service: String,
    /// Seed of the simulator's world; the other services take none.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    #[command(flatten, next_help_heading = "Options of the logger")]
    record: logger::RecordOptions,
    #[command(flatten)]
    options: service_shell::Options,
}

/// Runs the command.
pub fn run(arguments: Arguments) -> Result<ExitCode, Failure> {
    let Arguments { service, seed, record, options } = arguments;
    service_shell::init_logging(&options.log);
    if service == "simulator" {
        simulator::run_with(&options, seed)?;
        return Ok(ExitCode::SUCCESS);
    }
    if service == logger::NAME {
        logger::run_with(&options, &record, &mut |_| {})?;
        return Ok(ExitCode::SUCCESS);
    }
    if record != logger::RecordOptions::default() {
        return Err(Failure::Usage(format!(
            "{service} records nothing: files and their options are the logger's"
        )));
    }
    let setup = Setup::load(&service, &options)?;
    service_shell::serve(&setup, &|identity, now| {
        roster::node(&service, &setup.arena, &setup.secret, identity, now)
    })?;
    Ok(ExitCode::SUCCESS)
}
