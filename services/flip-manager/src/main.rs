//! The flip manager as a process of its own.

fn main() -> std::process::ExitCode {
    service_shell::run::<flip_manager::FlipManager>()
}
