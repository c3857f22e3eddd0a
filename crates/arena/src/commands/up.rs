//! `arena up`: a live arena on this machine, simulated or before real equipment, or services on a recording.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use front_door::profile;
use front_door::supervisor::{self, Ending, Equipment, Plan, RecordPlan, ReplayPlan, Screen};
use playback::Rate;
use service_shell::Options;

use super::Failure;

/// Options of `arena up`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A scenario of `config/scenarios/` [default: double-flip, or what was recorded].
    scenario: Option<String>,
    /// Seed of the simulated world.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Folder of the settings [default: config, or what was recorded].
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// What the services log into `.flyarena/logs/`, in a replay into `.flyarena/replay/logs/`.
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
    /// Record everything into this MCAP file, from the first message on.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// With --record: seal and stop recording when the disk has less free than this.
    #[arg(long, value_name = "SIZE", value_parser = logger::parse_bytes, requires = "record")]
    min_free: Option<u64>,
    /// Before real equipment: no simulator, domain live, and this file laid over the settings. Nobody takes off before
    /// `arena fly --domain live` says so
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seed", "replay"])]
    hardware: Option<PathBuf>,
    /// Run services on this recording instead of a simulator, in the replay domain, and end with it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seed", "record"])]
    replay: Option<PathBuf>,
    /// With --replay: the services to run; what the others said is played [default: all].
    #[arg(long, value_name = "A,B", value_delimiter = ',', requires = "replay")]
    services: Option<Vec<String>>,
    /// With --replay: how fast, 0.1 to 20, or `max` for as fast as the services can follow, in lock step.
    #[arg(long, value_name = "RATE", default_value_t = Rate::REAL_TIME, requires = "replay")]
    rate: Rate,
}

/// Runs the command: exit code 0 where everything landed, 1 where it was stopped in the air.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging("warn");
    if let Some(file) = &arguments.replay {
        return replay(arguments, file);
    }
    let default = Options::default();
    let folder = arguments.config.clone().unwrap_or(default.config);
    let scenario = arguments.scenario.clone().unwrap_or(default.scenario);
    let overlay = profile::overlay(arguments.hardware.as_ref(), &[])?;
    // Settings that cannot be used leave no trace: no other arena's run id is overwritten for them.
    let arena = profile::load(&folder, &scenario, &overlay)?;
    let equipment = match arguments.hardware {
        Some(_) => Equipment::Real,
        None => Equipment::Simulated { seed: arguments.seed },
    };
    let record = arguments.record.clone().map(|file| RecordPlan {
        file,
        options: arguments.min_free.map(|bytes| format!("--min-free={bytes}").into()).into_iter().collect(),
    });
    let log = arguments.log.clone();
    let plan = Plan { arena, equipment, log, folder: supervisor::default_folder().to_owned(), record };
    let mut screen = Screen::default();
    let ending = supervisor::up(&plan, &mut screen)?;
    screen.say(match ending {
        Ending::Finished => "every vehicle is done and down",
        Ending::Landed => "landed",
        Ending::Stopped => "stopped before everything was down",
    });
    Ok(if ending == Ending::Stopped { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn replay(arguments: &Arguments, file: &Path) -> Result<ExitCode, Failure> {
    let all = || roster::SERVICES.iter().map(|name| (*name).to_owned()).collect();
    let plan = ReplayPlan {
        file: file.to_owned(),
        services: arguments.services.clone().unwrap_or_else(all),
        config: arguments.config.clone(),
        scenario: arguments.scenario.clone(),
        rate: arguments.rate,
        log: arguments.log.clone(),
        folder: supervisor::default_folder().to_owned(),
    };
    let mut screen = Screen::default();
    let summary = supervisor::replay(&plan, &mut screen)?;
    screen.say(&summary.to_string());
    Ok(ExitCode::SUCCESS)
}
