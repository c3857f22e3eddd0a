//! Files: the secret, the run, and room for the recording.

use std::io;
use std::path::Path;

use rustix::fs::{Access, access, statvfs};
use service_shell::{ShellError, read_run, read_secret, run_file_of};
use settings::Arena;
use wire::Domain;

use super::finding::Finding;

const GIB_BYTES: f64 = 1_073_741_824.0;
/// What the flip manager asks for unless it is told otherwise.
const FREE_GIB_MIN: f64 = 2.0;

/// Looks at the files of a domain, and at the folder for recordings.
pub fn check(arena: &Arena, domain: Domain, secret: &Path, recordings: &Path) -> Vec<Finding> {
    let run_file = run_file_of(domain);
    vec![
        judge_secret(secret, secret.exists(), read_secret(secret).map(|_| ())),
        judge_run(&run_file, run_file.exists().then(|| read_run(&run_file))),
        judge_room(recordings, room(recordings), free_gib_min(arena)),
    ]
}

fn free_gib_min(arena: &Arena) -> f64 {
    let section = arena.services.get("flip-manager").and_then(|section| section.get("recording"));
    section
        .and_then(|section| section.get("free_gib_min"))
        .and_then(|value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64)))
        .unwrap_or(FREE_GIB_MIN)
}

/// Bytes free for whoever runs this.
fn room(folder: &Path) -> io::Result<u64> {
    access(folder, Access::WRITE_OK | Access::EXEC_OK)?;
    let disk = statvfs(folder)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

fn judge_secret(path: &Path, exists: bool, read: Result<(), ShellError>) -> Finding {
    let shown = path.display();
    match read {
        Ok(()) => Finding::ok("secret", format!("{shown}, its owner's alone")),
        Err(_) if !exists => Finding::ok("secret", format!("{shown} is not there yet; `arena up` makes it")),
        Err(error @ ShellError::SecretMode { .. }) => {
            Finding::fail("secret", error.to_string(), format!("chmod 600 {shown}"))
        }
        Err(error) => Finding::fail(
            "secret",
            error.to_string(),
            format!("remove {shown} while no arena runs; `arena up` makes a new one"),
        ),
    }
}

fn judge_run(path: &Path, read: Option<Result<u64, ShellError>>) -> Finding {
    match read {
        None => Finding::ok("run", format!("{} is not there yet: no arena was up here", path.display())),
        Some(Ok(run)) => Finding::ok("run", format!("{run:016x}, the newest of this folder")),
        Some(Err(error)) => Finding::fail("run", error.to_string(), format!("remove {}", path.display())),
    }
}

fn judge_room(folder: &Path, free: io::Result<u64>, free_gib_min: f64) -> Finding {
    let (name, shown) = ("recordings", folder.display());
    match free.map(|bytes| bytes as f64 / GIB_BYTES) {
        Ok(free_gib) if free_gib >= free_gib_min => {
            Finding::ok(name, format!("{shown}: {free_gib:.1} GiB free"))
        }
        Ok(free_gib) => Finding::fail(
            name,
            format!("{shown}: {free_gib:.2} GiB free, {free_gib_min:.2} GiB are needed to take off"),
            "make room there, or record to another disk",
        ),
        Err(error) => Finding::fail(
            name,
            format!("{shown}: {error}"),
            "make the folder, writable for whoever runs the arena, or name another with --recordings",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn room_for_two_gibibytes_is_needed() {
        let judged = |bytes| judge_room(Path::new("x"), Ok(bytes), 2.0).verdict;
        assert_eq!(judged(2 << 30), Verdict::Ok);
        assert_eq!(judged((2 << 30) - (1 << 24)), Verdict::Fail);
        let none = judge_room(Path::new("x"), Err(io::ErrorKind::NotFound.into()), 2.0);
        assert_eq!(none.verdict, Verdict::Fail);
    }

    #[test]
    fn a_secret_that_others_may_read_fails_and_an_absent_one_is_yet_to_be_made() {
        let path = Path::new(".flyarena/secret");
        assert_eq!(judge_secret(path, true, Ok(())).verdict, Verdict::Ok);
        let mode = ShellError::SecretMode { path: path.to_owned(), mode: 0o644 };
        let open = judge_secret(path, true, Err(mode));
        assert_eq!(
            (open.verdict, open.advice.as_deref()),
            (Verdict::Fail, Some("chmod 600 .flyarena/secret"))
        );
        let absent =
            ShellError::SecretUnreadable { path: path.to_owned(), reason: "no such file".to_owned() };
        assert_eq!(judge_secret(path, false, Err(absent)).verdict, Verdict::Ok);
        let short = ShellError::SecretLength { path: path.to_owned(), found: 31 };
        assert_eq!(judge_secret(path, true, Err(short)).verdict, Verdict::Fail);
    }

    #[test]
    fn a_run_file_without_a_run_fails() {
        let path = Path::new(".flyarena/run");
        assert_eq!(judge_run(path, None).verdict, Verdict::Ok);
        assert_eq!(judge_run(path, Some(Ok(7))).verdict, Verdict::Ok);
        let torn = ShellError::Run { path: path.to_owned(), reason: "xyz".to_owned() };
        assert_eq!(judge_run(path, Some(Err(torn))).verdict, Verdict::Fail);
    }
}
