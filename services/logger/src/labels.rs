//! What a recording says of where and when it was made.

use std::fs;
use std::path::{Path, PathBuf};

/// The host's name; empty if the system does not tell.
#[must_use]
pub fn host() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").map(|name| name.trim().to_owned()).unwrap_or_default()
}

/// The revision of the source tree that a folder is in; empty if it is in none.
#[must_use]
pub fn revision(folder: &Path) -> String {
    let Ok(folder) = folder.canonicalize() else { return String::new() };
    let git = folder.ancestors().map(|ancestor| ancestor.join(".git")).find(|git| git.is_dir());
    git.and_then(|git| revision_in(&git)).unwrap_or_default()
}

fn revision_in(git: &Path) -> Option<String> {
    let head = fs::read_to_string(git.join("HEAD")).ok()?;
    let Some(reference) = head.trim().strip_prefix("ref: ") else { return whole(&head) };
    if let Ok(text) = fs::read_to_string(git.join(reference)) {
        return whole(&text);
    }
    let packed = fs::read_to_string(git.join("packed-refs")).ok()?;
    packed.lines().find_map(|line| whole(line.strip_suffix(reference)?))
}

/// A revision's number, if that is what stands there.
fn whole(text: &str) -> Option<String> {
    let text = text.trim();
    (text.len() >= 40 && text.chars().all(|c| c.is_ascii_hexdigit())).then(|| text.to_owned())
}

/// An instant of the wall clock in UTC, as part of a file's name: `20261122-080532`.
#[must_use]
pub fn utc_label(wall_ns: i64) -> String {
    let seconds = wall_ns.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Years that begin in March have their odd day at the end; 400 of them have always the same length.
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// The first name after `path` that no recording has: `stem.mcap`, `stem-2.mcap`, …
#[must_use]
pub(crate) fn free_name(path: &Path) -> PathBuf {
    let taken = |path: &Path| path.exists() || recording::part_of(path).exists();
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.strip_suffix(".mcap").unwrap_or(&name);
    std::iter::once(path.to_owned())
        .chain((2_u32..).map(|number| path.with_file_name(format!("{stem}-{number}.mcap"))))
        .find(|path| !taken(path))
        .unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_are_named_as_calendars_do() {
        for (seconds, label) in [
            (0, "19700101-000000"),
            (951_782_399, "20000228-235959"),
            (951_782_400, "20000229-000000"),
            (951_868_800, "20000301-000000"),
            (1_795_334_732, "20261122-080532"),
            (4_107_542_399, "21000228-235959"),
            (4_107_542_400, "21000301-000000"),
            (-1, "19691231-235959"),
        ] {
            assert_eq!(utc_label(seconds * 1_000_000_000), label);
        }
    }

    #[test]
    fn a_name_that_is_taken_gets_a_number() {
        let folder = std::env::temp_dir().join(format!("logger-labels-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.b.mcap");
        assert_eq!(free_name(&path), path);
        fs::write(recording::part_of(&path), "").unwrap();
        assert_eq!(free_name(&path), folder.join("a.b-2.mcap"));
        fs::write(folder.join("a.b-2.mcap"), "").unwrap();
        assert_eq!(free_name(&path), folder.join("a.b-3.mcap"));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_revision_is_found_above_the_folder_loose_or_packed() {
        let folder = std::env::temp_dir().join(format!("logger-revision-{}", std::process::id()));
        let (git, below) = (folder.join(".git"), folder.join("some/where"));
        fs::create_dir_all(git.join("refs/heads")).unwrap();
        fs::create_dir_all(&below).unwrap();
        let (one, other) = ("1".repeat(40), "2".repeat(40));
        fs::write(git.join("HEAD"), "ref: refs/heads/main\n").unwrap();
        assert_eq!(revision(&below), "");
        fs::write(git.join("packed-refs"), format!("# pack-refs\n{one} refs/heads/main\n")).unwrap();
        assert_eq!(revision(&below), one);
        fs::write(git.join("refs/heads/main"), format!("{other}\n")).unwrap();
        assert_eq!(revision(&below), other);
        fs::write(git.join("HEAD"), format!("{one}\n")).unwrap();
        assert_eq!(revision(&below), one);
        fs::remove_dir_all(&folder).unwrap();
    }
}
