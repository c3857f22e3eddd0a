//! The command line that every program of the arena takes.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use wire::Domain;

use crate::run_id::parse_run;

/// Where a program's messages go and where their truth comes from, as people write it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DomainOption {
    /// Cameras, radios and vehicles.
    Live,
    /// A simulator.
    #[default]
    Sim,
    /// A recording, put back on the bus by playback.
    Replay,
}

impl From<DomainOption> for Domain {
    fn from(option: DomainOption) -> Self {
        match option {
            DomainOption::Live => Self::Live,
            DomainOption::Sim => Self::Sim,
            DomainOption::Replay => Self::Replay,
        }
    }
}

/// What every program of the arena can be told.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Options {
    /// Folder of settings
    #[arg(long, value_name = "DIR", default_value = "config")]
    pub config: PathBuf,
    /// Scenario, by its file's name
    #[arg(long, value_name = "NAME", default_value = "double-flip")]
    pub scenario: String,
    /// All settings in one file, as a recording carries them, instead of --config and --scenario [default:
    /// $FLYARENA_SETTINGS_FILE, if that is set]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// Where the messages' truth comes from
    #[arg(long, value_enum, default_value_t)]
    pub domain: DomainOption,
    /// Id of the run to join, in hexadecimal [default: what `arena up` wrote to .flyarena/run, with
    /// --hardware to .flyarena/live-run, or playback to .flyarena/replay-run]
    #[arg(long, value_name = "HEX", value_parser = parse_run)]
    pub run: Option<u64>,
    /// File with the arena's secret [default: $FLYARENA_SECRET_FILE, else .flyarena/secret]
    #[arg(long, value_name = "FILE")]
    pub secret_file: Option<PathBuf>,
    /// Number of this start, above that of any earlier start [default: from the wall clock]
    #[arg(long, value_name = "N")]
    pub incarnation: Option<u32>,
    /// What to log, for example `info` or `warn,estimator=debug`
    #[arg(long, value_name = "FILTER", default_value = "info")]
    pub log: String,
    /// End 30 s after the starting process has died: long enough for the vehicles to land
    #[arg(long)]
    pub supervised: bool,
}

impl Options {
    /// The same options as arguments for another program, with the run and incarnation it shall use.
    #[must_use]
    pub fn to_arguments(&self, run: u64, incarnation: u32) -> Vec<std::ffi::OsString> {
        let mut arguments: Vec<std::ffi::OsString> = vec!["--config".into(), self.config.clone().into()];
        let domain = Domain::from(self.domain).name();
        for (name, value) in [
            ("--scenario", self.scenario.clone()),
            ("--domain", domain.to_owned()),
            ("--run", format!("{run:016x}")),
            ("--incarnation", incarnation.to_string()),
            ("--log", self.log.clone()),
        ] {
            arguments.extend([name.into(), value.into()]);
        }
        if let Some(file) = &self.settings {
            arguments.extend(["--settings".into(), file.clone().into()]);
        }
        if let Some(file) = &self.secret_file {
            arguments.extend(["--secret-file".into(), file.clone().into()]);
        }
        if self.supervised {
            arguments.push("--supervised".into());
        }
        arguments
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            config: "config".into(),
            scenario: "double-flip".to_owned(),
            settings: None,
            domain: DomainOption::default(),
            run: None,
            secret_file: None,
            incarnation: None,
            log: "info".to_owned(),
            supervised: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct CommandLine {
        #[command(flatten)]
        options: Options,
    }

    fn parse(arguments: &[std::ffi::OsString]) -> Options {
        let program = std::ffi::OsString::from("estimator");
        CommandLine::try_parse_from([program].iter().chain(arguments)).unwrap().options
    }

    #[test]
    fn no_arguments_mean_the_defaults() {
        assert_eq!(parse(&[]), Options::default());
    }

    #[test]
    fn options_survive_being_handed_on() {
        let options = Options {
            config: "other folder".into(),
            scenario: "fleet".to_owned(),
            settings: Some("a file".into()),
            domain: DomainOption::Replay,
            secret_file: Some("a secret".into()),
            log: "debug".to_owned(),
            supervised: true,
            ..Options::default()
        };
        let handed_on = parse(&options.to_arguments(0xab, 7));
        assert_eq!(handed_on, Options { run: Some(0xab), incarnation: Some(7), ..options });
    }

    #[test]
    fn a_domain_or_run_that_is_none_is_refused() {
        for arguments in [["--domain", "elsewhere"], ["--run", "xyz"], ["--incarnation", "-1"]] {
            assert!(
                CommandLine::try_parse_from(["estimator"].iter().chain(&arguments)).is_err(),
                "{arguments:?}"
            );
        }
    }
}
