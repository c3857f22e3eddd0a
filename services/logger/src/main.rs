//! The logger's program.

fn main() -> std::process::ExitCode {
    logger::run()
}
