//! The learner as a process of its own.

fn main() -> std::process::ExitCode {
    service_shell::run::<learner::Learner>()
}
