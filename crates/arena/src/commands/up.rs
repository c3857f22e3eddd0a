//! `arena up`: a live simulated arena on this machine.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use front_door::supervisor::{self, Ending, Plan, Screen};
use service_shell::{DomainOption, Options};

use super::Failure;

/// Options of `arena up`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A scenario of `config/scenarios/`.
    #[arg(default_value = "double-flip")]
    scenario: String,
    /// Seed of the simulated world.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Folder of the settings.
    #[arg(long, value_name = "DIR", default_value = "config")]
    config: PathBuf,
    /// What the services log into `.flyarena/logs/`.
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
}

/// Runs the command: exit code 0 where everything landed, 1 where it was stopped in the air.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging("warn");
    let options = Options {
        config: arguments.config.clone(),
        scenario: arguments.scenario.clone(),
        domain: DomainOption::Sim,
        log: arguments.log.clone(),
        ..Options::default()
    };
    let plan = Plan { options, seed: arguments.seed, folder: supervisor::default_folder().to_owned() };
    let mut screen = Screen::default();
    let ending = supervisor::up(&plan, &mut screen)?;
    screen.say(match ending {
        Ending::Finished => "every vehicle is done and down",
        Ending::Landed => "landed",
        Ending::Stopped => "stopped before everything was down",
    });
    Ok(if ending == Ending::Stopped { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
