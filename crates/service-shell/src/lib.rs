//! What gives a core its clock, its sockets and its devices.
//!
//! A service's `main` is one call, [`run`]. It reads the command line ([`Options`]), the settings, the secret
//! and the run id ([`Setup`]), makes the node, and drives it until SIGTERM or SIGINT ([`drive`]): a single
//! thread, one call of the node at a time. Exit code 0 for an orderly end, 1 for a failure, 2 for something
//! asked wrongly.
//!
//! Programs that are no cores (simulator, front door) use the parts: [`BusSender`], [`BusReceiver`],
//! [`DatagramSocket`], [`Timer`], [`Stop`].

mod bus;
pub mod clock;
mod datagrams;
mod devices;
mod error;
mod filter;
mod identity;
mod interface;
mod kernel;
mod latency;
mod logging;
mod options;
mod program;
mod replay;
mod run_id;
mod run_loop;
mod run_settings;
#[cfg(test)]
mod scratch;
mod secret;
mod setup;
mod stop;
mod timer;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use service_core::Core;

pub use bus::{BusReceiver, BusSender, endpoint};
pub use datagrams::{
    Datagram, DatagramSocket, connect_udp, granted_receive_buffer, listen_udp, send_udp, stream_udp,
};
pub use devices::{Address, Endpoint, LineAddress, PseudoTerminal, endpoints};
pub use error::{During, ShellError};
pub use filter::Listen;
pub use identity::{identity, incarnation_at, incarnation_now};
pub use interface::interface_address;
pub use logging::{echo_event, init_logging};
pub use options::{DomainOption, Options};
pub use program::program_digest;
pub use replay::{REPLAY_STEP_MAX, TICK_SPAN};
pub use run_id::{
    DEFAULT_RUN_FILE, LIVE_RUN_FILE, REPLAY_RUN_FILE, new_run, parse_run, read_run, run_file, run_file_of,
    write_run,
};
pub use run_loop::{NodeFactory, block_on, drive, run_with, serve};
pub use run_settings::{DEFAULT_SETTINGS_FILE, LIVE_SETTINGS_FILE, write_run_settings};
pub use secret::{
    DEFAULT_SECRET_FILE, SECRET_FILE_VARIABLE, create_secret_if_absent, read_secret, secret_file,
};
pub use service_core::QUEUE_AGE_MAX;
pub use setup::{SETTINGS_FILE_VARIABLE, Setup, load_arena};
pub use stop::{Stop, StopReason};
pub use timer::Timer;

#[derive(Debug, Parser)]
#[command(version)]
struct CommandLine {
    #[command(flatten)]
    options: Options,
}

/// A service's whole `main`: command line in, exit code out.
#[must_use]
pub fn run<C: Core + 'static>() -> ExitCode {
    let command = CommandLine::command().name(C::NAME).about("A service of the arena");
    let options = match CommandLine::from_arg_matches(&command.get_matches()) {
        Ok(command_line) => command_line.options,
        Err(error) => error.exit(),
    };
    init_logging(&options.log);
    finish(run_with::<C>(&options))
}

/// Reports how a program ended: its exit code, and an error on standard error.
#[must_use]
pub fn finish(result: Result<(), ShellError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            error.exit_code()
        }
    }
}
