//! Serial lines: there, a line, ours to use, and nobody else's.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};
use service_shell::LineAddress;
use settings::SerialLine;

use super::finding::Finding;

/// Adapters' names by the order in which they were plugged in.
const NAMES_BY_ORDER: [&str; 2] = ["/dev/ttyUSB", "/dev/ttyACM"];

/// What was found at a line's path.
#[derive(Debug)]
struct Seen {
    path: PathBuf,
    /// Whether it is a character device, and its group; what the system said, if it is not there.
    device: io::Result<(bool, String)>,
    may_use: bool,
    opened: io::Result<()>,
    /// Processes that hold it, as far as this user may see.
    holders: Vec<u32>,
}

/// Looks at a line; it is open for a moment.
pub fn check(name: &str, line: &SerialLine) -> Finding {
    let path = line.path.clone();
    let device = fs::metadata(&path).map(|data| {
        (data.file_type().is_char_device(), group_name(data.gid()).unwrap_or(data.gid().to_string()))
    });
    let may_use = access(&path, Access::READ_OK | Access::WRITE_OK).is_ok();
    let opened = LineAddress::Serial(line.clone()).open().map(|_| ());
    let holders = if opened.is_err() { holders(&path) } else { Vec::new() };
    judge(name, &Seen { path, device, may_use, opened, holders })
}

fn group_name(id: u32) -> Option<String> {
    let groups = fs::read_to_string("/etc/group").ok()?;
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == id.to_string()).then(|| name.to_owned())
    })
}

/// The processes that have a file open.
fn holders(path: &Path) -> Vec<u32> {
    let Ok(path) = fs::canonicalize(path) else { return Vec::new() };
    let holds = |process: &Path| {
        let files = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        files.into_iter().any(|file| fs::read_link(file.path()).is_ok_and(|target| target == path))
    };
    fs::read_dir("/proc")
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Some((entry.file_name().to_str()?.parse().ok()?, entry.path())))
        .filter(|(_, process)| holds(process))
        .map(|(id, _)| id)
        .collect()
}

fn judge(name: &str, seen: &Seen) -> Finding {
    let shown = seen.path.display();
    let group = match &seen.device {
        Err(error) => {
            let advice = "plug the adapter in; ls -l /dev/serial/by-id/ lists those there are";
            return Finding::fail(name, format!("{shown}: {error}"), advice);
        }
        Ok((false, _)) => {
            let advice = "name the adapter's device; ls -l /dev/serial/by-id/ lists those there are";
            return Finding::fail(name, format!("{shown} is no serial line"), advice);
        }
        Ok((true, group)) => group,
    };
    if !seen.may_use {
        let found = format!("{shown} belongs to the group {group}, in which this user is not");
        return Finding::fail(name, found, format!("sudo usermod -aG {group} $USER, and log in anew"));
    }
    match &seen.opened {
        Err(error) if error.kind() == io::ErrorKind::ResourceBusy => {
            let by = match &seen.holders[..] {
                [] => "by another user's program".to_owned(),
                ids => {
                    format!("by process {}", ids.iter().map(u32::to_string).collect::<Vec<_>>().join(", "))
                }
            };
            let advice =
                "end that program; a modem manager is kept away by udev (ENV{ID_MM_DEVICE_IGNORE}=\"1\")";
            Finding::fail(name, format!("{shown} is held {by}"), advice)
        }
        Err(error) => {
            Finding::fail(name, format!("{shown}: {error}"), "check device, rate and framing in the URL")
        }
        Ok(()) if NAMES_BY_ORDER.iter().any(|prefix| shown.to_string().starts_with(prefix)) => Finding::warn(
            name,
            format!("{shown} opens, under a name that depends on the order of plugging in"),
            "use its name under /dev/serial/by-id/",
        ),
        Ok(()) => Finding::ok(name, format!("{shown} opens")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn seen() -> Seen {
        Seen {
            path: "/dev/serial/by-id/usb-x".into(),
            device: Ok((true, "dialout".to_owned())),
            may_use: true,
            opened: Ok(()),
            holders: Vec::new(),
        }
    }

    #[test]
    fn each_way_in_which_a_line_may_not_do_has_its_remedy() {
        let judged = |seen: &Seen| {
            let finding = judge("line", seen);
            (finding.verdict, format!("{} / {}", finding.found, finding.advice.unwrap_or_default()))
        };
        assert_eq!(judged(&seen()).0, Verdict::Ok);
        let named = judged(&Seen { path: "/dev/ttyUSB0".into(), ..seen() });
        assert!(named.0 == Verdict::Warn && named.1.contains("by-id"), "{named:?}");
        for (seen, word) in [
            (Seen { device: Err(io::ErrorKind::NotFound.into()), ..seen() }, "plug the adapter in"),
            (Seen { device: Ok((false, "root".to_owned())), ..seen() }, "no serial line"),
            (Seen { may_use: false, ..seen() }, "usermod -aG dialout"),
            (
                Seen { opened: Err(io::ErrorKind::ResourceBusy.into()), holders: vec![42], ..seen() },
                "held by process 42",
            ),
            (Seen { opened: Err(io::ErrorKind::InvalidInput.into()), ..seen() }, "rate and framing"),
        ] {
            let (verdict, text) = judged(&seen);
            assert!(verdict == Verdict::Fail && text.contains(word), "{text}");
        }
    }
}
