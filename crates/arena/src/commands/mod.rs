//! What the front door does: one module per command.

mod learn;
mod run;
mod seeds;
mod solve;
mod up;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Subcommand;
use front_door::pictures::PictureError;
use settings::ConfigError;
use thiserror::Error;

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Line {
    /// Solve a flip on the planar model: rough guess, P0, Jacobian.
    Solve(solve::Arguments),
    /// Learn a scenario in virtual time: the whole arena, as fast as the machine allows.
    Learn(learn::Arguments),
    /// Bring the simulated arena up on this machine: every service a process of its own, on loopback multicast.
    Up(up::Arguments),
    /// Run one service, bridge or the simulator, as `arena up` does.
    Run(run::Arguments),
}

/// Why a command failed.
#[derive(Debug, Error)]
pub enum Failure {
    /// A setting is wrong.
    #[error(transparent)]
    Settings(#[from] ConfigError),
    /// A picture could not be made.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A file could not be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Standard output could not be written.
    #[error("standard output: {0}")]
    Output(#[from] std::io::Error),
    /// An argument that parses but cannot be.
    #[error("{0}")]
    Usage(String),
    /// A live service failed.
    #[error(transparent)]
    Shell(#[from] service_shell::ShellError),
    /// The live arena failed.
    #[error(transparent)]
    Supervisor(#[from] front_door::supervisor::SupervisorError),
}

impl Failure {
    /// 2 for what the caller wrote wrongly, 1 for everything else.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Settings(_) | Self::Usage(_) => ExitCode::from(2),
            Self::Shell(error) => error.exit_code(),
            Self::Supervisor(error) => error.exit_code(),
            _ => ExitCode::FAILURE,
        }
    }
}

/// Runs one command.
pub fn run(line: Line) -> Result<ExitCode, Failure> {
    match line {
        Line::Solve(arguments) => solve::run(&arguments),
        Line::Learn(arguments) => learn::run(&arguments),
        Line::Up(arguments) => up::run(&arguments),
        Line::Run(arguments) => run::run(arguments),
    }
}
