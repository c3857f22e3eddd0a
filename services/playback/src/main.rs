//! Playback's program.

fn main() -> std::process::ExitCode {
    playback::run()
}
