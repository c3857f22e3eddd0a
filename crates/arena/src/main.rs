//! `arena`: the front door of flyarena.

mod commands;

use std::process::ExitCode;

use clap::Parser;
use commands::{Failure, Line};

/// A testbed for fast flying machines: solve a flip, learn it in virtual time, or bring a whole arena up.
#[derive(Debug, Parser)]
#[command(name = "arena", version, about, propagate_version = true)]
struct Arguments {
    #[command(subcommand)]
    line: Line,
}

fn main() -> ExitCode {
    match commands::run(Arguments::parse().line) {
        Ok(code) => code,
        // Whoever reads a pipe may stop reading; that is their right, not our failure.
        Err(Failure::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            failure.exit_code()
        }
    }
}
