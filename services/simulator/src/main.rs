//! The simulator's program.

fn main() -> std::process::ExitCode {
    simulator::run()
}
