//! The plant in real time, speaking device bytes.
//!
//! To the bridges this program is the hardware: it sends the motion-capture system's datagrams to where the
//! vicon bridge listens, takes the radio bridge's bytes at the place of each vehicle's command-link
//! encoder, and is the data-link radio. Swapping in hardware changes addresses in `network.toml` and nothing
//! else.
//!
//! [`Simulation`] is the plant with what reaches it and what it says, in order of time and without a clock;
//! `live.rs` gives it one, with sockets (`cables.rs`). What only a simulator knows goes on the bus as
//! `plant/truth` and `plant/maneuver`.

mod cables;
mod live;
mod simulation;

use std::process::ExitCode;

use clap::Parser;
use service_shell::{Options, ShellError, finish, init_logging};

pub use simulation::{Arrival, Said, Simulation};

/// The simulator's name: its binary, its role on the bus.
pub const NAME: &str = "simulator";

/// The seed unless said otherwise.
pub const DEFAULT_SEED: u64 = 1;

/// Simulates the arena's hardware: cameras, radios and vehicles
#[derive(Debug, Parser)]
#[command(name = NAME, version)]
struct CommandLine {
    #[command(flatten)]
    options: Options,
    /// Seed of everything random: noise, gusts, losses
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SEED)]
    seed: u64,
}

/// The simulator's whole `main`: command line in, exit code out.
#[must_use]
pub fn run() -> ExitCode {
    let command_line = CommandLine::parse();
    init_logging(&command_line.options.log);
    finish(run_with(&command_line.options, command_line.seed))
}

/// Simulates until the process is told to end. Not to be called within a tokio runtime.
///
/// # Errors
/// Settings that cannot be used, a domain other than sim, or an address that cannot be listened on.
pub fn run_with(options: &Options, seed: u64) -> Result<(), ShellError> {
    live::run(options, seed)
}
