//! Records every datagram of the arena.
//!
//! Two threads: one takes datagrams from the bus with the kernel's time stamps, checks and numbers them
//! (`ear.rs`) and puts them into a bounded ring (`ring.rs`); the other writes them to files, or keeps the
//! last seconds in memory (`scribe.rs`). The ring never blocks: when the disk is slower than the arena for
//! longer than it can bridge, messages are dropped, counted by topic, and the file says where. Whatever
//! happens to the disk, the arena flies on, and hears of it in one clear message.

mod ear;
mod labels;
mod live;
mod options;
mod ring;
mod scribe;
mod snapshot;
mod voice;

use std::process::ExitCode;

use clap::Parser;
use schemas::LoggerStatus;
use service_shell::{Options, ShellError, finish, init_logging};

pub use labels::{host, revision, utc_label};
pub use options::{RecordOptions, parse_bytes, parse_keep, parse_span};

/// The logger's name: its binary, its role on the bus.
pub const NAME: &str = "logger";

/// Records every datagram of the arena
#[derive(Debug, Parser)]
#[command(name = NAME, version)]
struct CommandLine {
    #[command(flatten)]
    record: RecordOptions,
    #[command(flatten)]
    options: Options,
}

/// What a recorder tells whoever started it, while it runs.
#[derive(Clone, Debug, PartialEq)]
pub enum Telling<'a> {
    /// How it fares; twice a second, and once at the end.
    Status(&'a LoggerStatus),
    /// Something happened; it is on the bus as well.
    Notice(&'a recording::Notice),
}

/// The logger's whole `main`: command line in, exit code out.
#[must_use]
pub fn run() -> ExitCode {
    let command_line = CommandLine::parse();
    init_logging(&command_line.options.log);
    finish(run_with(&command_line.options, &command_line.record, &mut |_| {}).map(|_| ()))
}

/// Records until the process is told to end: how it fared. Not to be called within a tokio runtime.
///
/// # Errors
/// Settings that cannot be used, a bus that cannot be heard, or a file that cannot be begun.
pub fn run_with(
    options: &Options,
    record: &RecordOptions,
    tell: &mut dyn FnMut(Telling<'_>),
) -> Result<LoggerStatus, ShellError> {
    live::run(options, record, tell)
}
