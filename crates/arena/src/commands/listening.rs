//! What the looking tools share: where they listen, a live arena or a recording, and for how long.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use front_door::tools::{Ear, Heard, Tick, ToolError, replay};
use quantity::{Span, Time};
use recording::export::{Address, ExportError, Outcome};
use recording::{Recording, Selection};
use service_shell::{DomainOption, Options, Setup, clock};

use super::Failure;

/// Where the looking tools listen when no file is named.
#[derive(Debug, Args)]
pub struct Place {
    /// Which bus to listen to.
    #[arg(long, value_enum, default_value_t)]
    domain: DomainOption,
    /// Folder of the settings, which say where the bus is.
    #[arg(long, value_name = "DIR", default_value = "config")]
    config: PathBuf,
    /// The scenario that runs.
    #[arg(long, value_name = "NAME", default_value = "double-flip")]
    scenario: String,
    /// Id of the run, in hexadecimal [default: the newest of this folder].
    #[arg(long, value_name = "HEX", value_parser = service_shell::parse_run)]
    run: Option<u64>,
    /// File with the arena's secret [default: $FLYARENA_SECRET_FILE, else .flyarena/secret].
    #[arg(long, value_name = "FILE")]
    secret_file: Option<PathBuf>,
}

/// The part of a recording that is looked at, in seconds from its beginning.
#[derive(Debug, Args)]
pub struct Stretch {
    /// Only from so many seconds after the recording's beginning on.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Only up to so many seconds after the recording's beginning.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to: Option<f64>,
}

impl Place {
    /// Settings, secret and run of the arena to listen to.
    pub fn setup(&self) -> Result<Setup, Failure> {
        service_shell::init_logging("warn");
        let options = Options {
            config: self.config.clone(),
            scenario: self.scenario.clone(),
            domain: self.domain,
            run: self.run,
            secret_file: self.secret_file.clone(),
            ..Options::default()
        };
        Ok(Setup::load("tool", &options.joining())?)
    }
}

impl Stretch {
    /// Both ends as instants of the recording.
    pub fn ends(&self, recording: &Recording) -> Result<(Option<Time>, Option<Time>), Failure> {
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from > to
        {
            return Err(Failure::Usage(format!("--from {from} is after --to {to}")));
        }
        let at = |seconds: Option<f64>| match seconds {
            Some(seconds) if !seconds.is_finite() => Err(Failure::Usage(format!("{seconds} is no time"))),
            seconds => Ok(seconds.map(|seconds| recording.at_seconds(seconds))),
        };
        Ok((at(self.from)?, at(self.to)?))
    }

    /// A live bus has no beginning to count from.
    pub fn refuse_live(&self) -> Result<(), Failure> {
        if self.from.is_some() || self.to.is_some() {
            return Err(Failure::Usage("--from and --to are for recordings: name a file".to_owned()));
        }
        Ok(())
    }
}

/// A duration of so many seconds.
pub fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("{text:?} is no number of seconds"))?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// Listens to the bus until `each` breaks off, time is up, or the process is told to end. `each` is told the
/// time now and then. Returns the ear, which knows what was lost.
pub fn listen(
    setup: &Setup,
    wants: impl Fn(&str) -> bool + 'static,
    duration: Option<Duration>,
    mut each: impl FnMut(Tick<'_>) -> Result<ControlFlow<()>, ToolError>,
) -> Result<Ear, Failure> {
    let span = duration.map(|duration| Span::from_secs_f64(duration.as_secs_f64()));
    let until = span.map_or(Time::FAR_FUTURE, |span| clock::now().saturating_add(span));
    let mut ear = Ear::new(setup, wants);
    ear.listen(setup, until, &mut each)?;
    if ear.overflowed() > 0 {
        eprintln!("{} datagrams came faster than this program could take them", ear.overflowed());
    }
    Ok(ear)
}

/// Goes through messages of a recording; exit code 1, and a line for each, where a chunk was damaged.
pub fn go_through(
    recording: &Recording,
    selection: &Selection,
    mut each: impl FnMut(&Heard<'_>) -> Result<ControlFlow<()>, ToolError>,
) -> Result<ExitCode, Failure> {
    let damage = replay(recording, selection, &mut each)?;
    for error in &damage {
        eprintln!("{error}");
    }
    Ok(if damage.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The topic, and the field of it, that a text names.
pub fn address(recording: &Recording, text: &str) -> Result<Address, Failure> {
    let topics = recording.channels().iter().map(|channel| channel.topic.as_str());
    Address::find(text, topics).map_err(|error| Failure::Usage(error.to_string()))
}

/// A failure of an export to or from this file.
pub fn export_failure(path: &Path, error: ExportError) -> Failure {
    match error {
        ExportError::Sink(error) => Failure::Output(error),
        error if error.is_usage() => Failure::Usage(format!("{}: {error}", path.display())),
        error => Failure::Recording { path: path.to_owned(), reason: error.to_string() },
    }
}

/// Says what could not be exported; exit code 1 if that is anything.
pub fn conclude(outcome: &Outcome) -> ExitCode {
    for line in outcome.complaints() {
        eprintln!("{line}");
    }
    if outcome.is_whole() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
