//! Runs the estimator on the bus.

fn main() -> std::process::ExitCode {
    service_shell::run::<estimator::Estimator>()
}
