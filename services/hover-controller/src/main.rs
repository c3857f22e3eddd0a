//! Runs the hover controller on the bus.

fn main() -> std::process::ExitCode {
    service_shell::run::<hover_controller::HoverController>()
}
