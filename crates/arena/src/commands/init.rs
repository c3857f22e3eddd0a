//! `arena init`: what programs share that make up one run: a secret, the run's id, settings.
//!
//! `arena up` does this for itself; here it is for whoever starts the services otherwise. With `--hold` the command
//! stays: containers keep a memory file system only as long as somebody uses it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use front_door::profile;
use service_shell::{DEFAULT_SETTINGS_FILE, Options, ShellError, Stop};
use settings::{Arena, Change};
use tracing::info;

use super::Failure;

/// Options of `arena init`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Lay this file over the settings, as `arena up --hardware` does
    #[arg(long, value_name = "FILE")]
    hardware: Option<PathBuf>,
    /// Another value for a setting: the file's name, a dot, the key; may be repeated; goes before --hardware
    #[arg(long = "set", value_name = "FILE.KEY=VALUE")]
    changes: Vec<Change>,
    /// Stay until told to end
    #[arg(long)]
    hold: bool,
    #[command(flatten)]
    options: Options,
}

/// Runs the command. What there is already, it keeps: others may be using it.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let options = &arguments.options;
    service_shell::init_logging(&options.log);
    let run_file = service_shell::run_file_of(options.domain.into());
    service_shell::create_secret_if_absent(&service_shell::secret_file(options.secret_file.as_deref()))?;
    if !run_file.exists() {
        let arena = settings(arguments)?;
        let run = match options.run {
            Some(run) => run,
            None => service_shell::new_run()?,
        };
        service_shell::write_run_settings(Path::new(DEFAULT_SETTINGS_FILE), run, &arena)?;
        // Last, for whoever waits for a run to join.
        service_shell::write_run(&run_file, run)?;
    }
    let run = service_shell::read_run(&run_file)?;
    info!(run = format!("{run:016x}"), settings = DEFAULT_SETTINGS_FILE, "a run to join");
    if arguments.hold {
        service_shell::block_on(async {
            let mut stop = Stop::new(options.supervised)?;
            let reason = std::future::poll_fn(|cx| stop.poll_signal(cx)).await;
            info!("ended: {}", reason.name());
            Ok::<(), ShellError>(())
        })?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The settings that the options name, with the changes, checked as if they stood in the files.
fn settings(arguments: &Arguments) -> Result<Arena, Failure> {
    let Arguments { hardware, changes, options, .. } = arguments;
    let overlay = profile::overlay(hardware.as_ref(), changes)?;
    if overlay.is_empty() {
        let arena = service_shell::load_arena(options)?;
        service_core::check_sections(&arena)?;
        return Ok(arena);
    }
    if options.settings.is_some() {
        let reason = "--settings is a whole: nothing is laid over it; use --config and --scenario";
        return Err(Failure::Usage(reason.to_owned()));
    }
    Ok(profile::load(&options.config, &options.scenario, &overlay)?)
}
