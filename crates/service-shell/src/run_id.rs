//! The run's id: random at arena start, part of every key, so that nothing of one run is believed in another.

use std::fs;
use std::path::{Path, PathBuf};

use wire::Domain;

use crate::ShellError;
use crate::error::During;
use crate::secret::{create_parent, random_bytes};

/// Where the current run's id stands.
pub const DEFAULT_RUN_FILE: &str = ".flyarena/run";
/// Where the current run's id of the live domain stands: no simulated arena of the same folder takes its place.
pub const LIVE_RUN_FILE: &str = ".flyarena/live-run";
/// Where the current replay's run id stands: a replay beside a running arena leaves that arena's alone.
pub const REPLAY_RUN_FILE: &str = ".flyarena/replay-run";

/// Draws a new run's id; never zero.
///
/// # Errors
/// The system gives no random bytes.
pub fn new_run() -> Result<u64, ShellError> {
    loop {
        let run = u64::from_le_bytes(random_bytes()?);
        if run != 0 {
            return Ok(run);
        }
    }
}

/// Writes the current run's id, for programs started by hand to join it. Replaces the file in one step.
///
/// # Errors
/// What the system says.
pub fn write_run(path: &Path, run: u64) -> Result<(), ShellError> {
    create_parent(path)?;
    let draft = path.with_extension(format!("draft-{}", std::process::id()));
    fs::write(&draft, format!("{run:016x}\n"))
        .and_then(|()| fs::rename(&draft, path))
        .during(|| format!("writing run file {}", path.display()))
}

/// Reads the current run's id.
///
/// # Errors
/// No such file, or no id in it.
pub fn read_run(path: &Path) -> Result<u64, ShellError> {
    let refuse = |reason: String| ShellError::Run { path: path.to_owned(), reason };
    let text = fs::read_to_string(path).map_err(|error| refuse(error.to_string()))?;
    parse_run(text.trim()).map_err(refuse)
}

/// Reads an id of 1 to 16 hexadecimal digits, with or without `0x`.
///
/// # Errors
/// What is wrong with it.
pub fn parse_run(text: &str) -> Result<u64, String> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    if digits.starts_with(['+', '-']) {
        return Err(format!("{text:?} is not a run id of 1 to 16 hexadecimal digits"));
    }
    u64::from_str_radix(digits, 16)
        .map_err(|_| format!("{text:?} is not a run id of 1 to 16 hexadecimal digits"))
}

/// The run file's path.
#[must_use]
pub fn run_file() -> PathBuf {
    PathBuf::from(DEFAULT_RUN_FILE)
}

/// The path of a domain's run file.
#[must_use]
pub fn run_file_of(domain: Domain) -> PathBuf {
    match domain {
        Domain::Live => PathBuf::from(LIVE_RUN_FILE),
        Domain::Sim => run_file(),
        Domain::Replay => PathBuf::from(REPLAY_RUN_FILE),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::Scratch;

    #[test]
    fn what_was_written_is_read() {
        let scratch = Scratch::new("run-written");
        let path = scratch.path("state/run");
        for run in [1, 0x0123_4567_89ab_cdef, u64::MAX] {
            write_run(&path, run).unwrap();
            assert_eq!(read_run(&path).unwrap(), run);
        }
    }

    #[test]
    fn what_is_no_id_is_refused_with_the_text_found() {
        for text in ["", "0x", "xyz", "-1", "+1", "11112222333344445", "12 34"] {
            let reason = parse_run(text).unwrap_err();
            assert!(reason.contains(text), "{reason}");
        }
        assert_eq!(parse_run("0xFf"), Ok(255));
    }

    #[test]
    fn no_run_is_refused_with_the_ways_to_one() {
        let scratch = Scratch::new("run-absent");
        let text = read_run(&scratch.path("run")).unwrap_err().to_string();
        assert!(text.contains("arena up") && text.contains("--run"), "{text}");
    }
}
