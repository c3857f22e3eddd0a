//! What the front door does: one module per command.

mod budget;
mod cut;
mod doctor;
mod echo;
mod export;
mod fly;
mod health;
mod hz;
mod info;
mod init;
mod learn;
mod listening;
mod play;
mod plot;
mod record;
mod recover;
mod run;
mod seeds;
mod solve;
mod stop;
mod topics;
mod up;
mod verify;

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
    /// Bring an arena up on this machine, every service a process of its own: simulated, or with --hardware before real
    /// equipment.
    Up(up::Arguments),
    /// Record everything on the bus into an MCAP file.
    Record(record::Arguments),
    /// Put a recording back on the bus, for services of the replay domain and for tools.
    Play(play::Arguments),
    /// Say what a recording is and what is in it, and check all of it.
    Info(info::Arguments),
    /// Cut a piece out of a recording; the piece is a recording too.
    Cut(cut::Arguments),
    /// List the topics of a live arena or a recording: type, rate, bandwidth, senders, losses.
    Topics(topics::Arguments),
    /// Print messages, or one field of them, as they come or as they were recorded.
    Echo(echo::Arguments),
    /// Measure how often a topic's messages come, how evenly, how late, and how many not at all.
    Hz(hz::Arguments),
    /// Turn a recording into a table, lines of JSON, or a file for ROS 2's tools.
    Export(export::Arguments),
    /// Draw fields of a recording over time.
    Plot(plot::Arguments),
    /// Make a whole file of a recording that was torn by a crash.
    Recover(recover::Arguments),
    /// Emergency stop: every motor off, latched until `arena stop --release`.
    Stop(stop::Arguments),
    /// Execute the services of a recording again, and find the first bit that differs.
    Verify(verify::Arguments),
    /// Give the orders to an arena that is running, and land it when told to end.
    Fly(fly::Arguments),
    /// Make what a run's programs share: a secret, the run's id, settings.
    Init(init::Arguments),
    /// Look at what an arena needs of this host and its equipment, and say what to do about it.
    Doctor(doctor::Arguments),
    /// Ask whether a service makes progress.
    Health(health::Arguments),
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
    /// A recording could not be written.
    #[error("{}: {reason}", path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A recording could not be read.
    #[error(transparent)]
    Read(#[from] recording::ReadError),
    /// Standard output could not be written.
    #[error("standard output: {0}")]
    Output(#[from] std::io::Error),
    /// An argument that parses but cannot be.
    #[error("{0}")]
    Usage(String),
    /// A live service failed.
    #[error(transparent)]
    Shell(#[from] service_shell::ShellError),
    /// A recording is not played, or not to its end.
    #[error(transparent)]
    Playback(#[from] playback::PlayError),
    /// The live arena failed.
    #[error(transparent)]
    Supervisor(#[from] front_door::supervisor::SupervisorError),
}

impl From<front_door::tools::ToolError> for Failure {
    fn from(error: front_door::tools::ToolError) -> Self {
        match error {
            front_door::tools::ToolError::Shell(error) => Self::Shell(error),
            front_door::tools::ToolError::Output(error) => Self::Output(error),
        }
    }
}

impl Failure {
    /// 2 for what the caller wrote wrongly, 1 for everything else.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Settings(_) | Self::Usage(_) => ExitCode::from(2),
            Self::Shell(error) => error.exit_code(),
            Self::Supervisor(error) => error.exit_code(),
            Self::Playback(error) => error.exit_code(),
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
        Line::Record(arguments) => record::run(&arguments),
        Line::Play(arguments) => play::run(&arguments),
        Line::Info(arguments) => info::run(&arguments),
        Line::Cut(arguments) => cut::run(&arguments),
        Line::Topics(arguments) => topics::run(&arguments),
        Line::Echo(arguments) => echo::run(&arguments),
        Line::Hz(arguments) => hz::run(&arguments),
        Line::Export(arguments) => export::run(&arguments),
        Line::Plot(arguments) => plot::run(&arguments),
        Line::Recover(arguments) => recover::run(&arguments),
        Line::Stop(arguments) => stop::run(&arguments),
        Line::Verify(arguments) => verify::run(&arguments),
        Line::Fly(arguments) => fly::run(&arguments),
        Line::Init(arguments) => init::run(&arguments),
        Line::Doctor(arguments) => doctor::run(&arguments),
        Line::Health(arguments) => health::run(&arguments),
        Line::Run(arguments) => run::run(arguments),
    }
}
