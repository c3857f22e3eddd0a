//! The design page's invariants, held against the source itself.

use std::fs;
use std::path::{Path, PathBuf};

/// A file and a function stay readable in one sitting; the state machine is what grows into a monster.
const FILE_LINES_MAX: usize = 620;
const FUNCTION_LINES_MAX: usize = 70;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn files_below(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if name != "target" && name != "out" && !name.starts_with('.') {
                files_below(&path, ending, found);
            }
        } else if name.ends_with(ending) {
            found.push(path);
        }
    }
}

fn sources() -> Vec<(String, String)> {
    let mut found = Vec::new();
    files_below(&root(), ".rs", &mut found);
    assert!(found.len() > 60, "the walk found only {} sources", found.len());
    found
        .into_iter()
        .map(|path| {
            let name = path.strip_prefix(root()).unwrap().to_string_lossy().into_owned();
            let text = fs::read_to_string(&path).unwrap();
            (name, text)
        })
        .collect()
}

/// The part of a source that is not its unit tests.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod ").next().unwrap_or(text)
}

fn is_core_source(name: &str) -> bool {
    (name.starts_with("services/") || name.starts_with("bridges/"))
        && name.contains("/src/")
        && !name.ends_with("/main.rs")
        && !name.starts_with("services/simulator/")
        && !name.starts_with("services/logger/")
        && !name.starts_with("services/playback/")
}

#[test]
fn every_file_says_what_it_is_first() {
    for (name, text) in sources() {
        if name.contains("/tests/refused/") || name.contains("/tests/accepted/") {
            continue;
        }
        assert!(text.starts_with("//!"), "{name} does not open with //!");
    }
}

#[test]
fn files_stay_short() {
    for (name, text) in sources() {
        let lines = text.lines().count();
        assert!(
            lines <= FILE_LINES_MAX,
            "{name} has {lines} lines, more than {FILE_LINES_MAX}: split it by meaning"
        );
    }
}

#[test]
fn functions_stay_short() {
    // A golden text stands whole in its test.
    for (name, text) in sources().into_iter().filter(|(name, _)| !name.contains("/tests/")) {
        let mut open: Option<(usize, String, String)> = None;
        for (number, line) in text.lines().enumerate() {
            let indent: String = line.chars().take_while(|c| *c == ' ').collect();
            let word = line.trim_start();
            let is_function = [
                "fn ",
                "pub fn ",
                "pub(crate) fn ",
                "pub(super) fn ",
                "const fn ",
                "pub const fn ",
                "async fn ",
                "pub async fn ",
                "pub(crate) const fn ",
            ]
            .iter()
            .any(|start| word.starts_with(start));
            if is_function && !word.ends_with(';') && !word.ends_with('}') {
                open = Some((number, indent, word.to_owned()));
            } else if let Some((begin, begin_indent, signature)) = &open
                && line == format!("{begin_indent}}}")
            {
                let lines = number - begin + 1;
                assert!(lines <= FUNCTION_LINES_MAX, "{name}:{}: {lines} lines: {signature}", begin + 1);
                open = None;
            }
        }
    }
}

#[test]
fn cores_name_no_socket_clock_file_or_environment() {
    let banned = [
        "tokio",
        "socket2",
        "std::time",
        "std::fs",
        "std::net",
        "std::env",
        "std::thread",
        "SystemTime",
        "Instant",
    ];
    let mut seen = 0;
    for (name, text) in sources().iter().filter(|(name, _)| is_core_source(name)) {
        seen += 1;
        for (number, line) in without_tests(text).lines().enumerate() {
            let code = line.split("//").next().unwrap_or(line);
            for word in banned {
                assert!(!code.contains(word), "{name}:{}: a core names {word}", number + 1);
            }
        }
    }
    assert!(seen > 20, "only {seen} core sources were looked at");
}

#[test]
fn no_service_depends_on_another_and_the_learner_never_on_the_plant() {
    let cores = [
        "estimator",
        "hover-controller",
        "flip-manager",
        "learner",
        "vicon-bridge",
        "radio-bridge",
        "simulator",
    ];
    let mut manifests = Vec::new();
    files_below(&root().join("services"), "Cargo.toml", &mut manifests);
    files_below(&root().join("bridges"), "Cargo.toml", &mut manifests);
    assert!(manifests.len() >= cores.len());
    // The fuzz targets are a workspace of their own.
    for path in manifests.into_iter().filter(|path| !path.starts_with(root().join("fuzz"))) {
        let manifest: toml::Table = fs::read_to_string(&path).unwrap().parse().unwrap();
        let own = manifest["package"]["name"].as_str().unwrap().to_owned();
        let dependencies = manifest["dependencies"].as_table().unwrap();
        for other in cores.iter().filter(|other| **other != own) {
            assert!(!dependencies.contains_key(*other), "{own} depends on {other}");
        }
        if own != "simulator" {
            assert!(!dependencies.contains_key("plant"), "{own} depends on the plant");
        }
    }
}

#[test]
fn the_codec_is_named_in_one_crate() {
    for (name, text) in sources() {
        let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
        // Written apart, so that this line does not name it either.
        if code.contains(concat!("bin", "code::")) {
            assert!(name.starts_with("crates/wire/"), "{name} names the codec");
        }
    }
}

#[test]
fn unsafe_code_is_in_one_module() {
    for (name, text) in sources() {
        let code: String = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
        if code.contains(concat!("un", "safe {")) || code.contains(concat!("un", "safe fn")) {
            assert_eq!(name, "crates/service-shell/src/kernel.rs", "{name} has such a block");
        }
    }
}

#[test]
fn the_vehicle_needs_no_operating_system() {
    for name in ["crates/quantity", "crates/maneuver", "crates/device", "crates/onboard"] {
        let text = fs::read_to_string(root().join(name).join("src/lib.rs")).unwrap();
        assert!(text.contains("#![no_std]"), "{name} is not no_std");
        assert!(!text.contains("extern crate alloc"), "{name} allocates");
    }
}

#[test]
fn versions_are_named_once_in_the_workspace() {
    let mut manifests = Vec::new();
    files_below(&root(), "Cargo.toml", &mut manifests);
    // Fuzzing is a workspace of its own: its compiler flags are nobody else's.
    manifests.retain(|path| !path.starts_with(root().join("fuzz")));
    for path in manifests {
        let manifest: toml::Table = fs::read_to_string(&path).unwrap().parse().unwrap();
        for section in ["dependencies", "dev-dependencies"] {
            let Some(dependencies) = manifest.get(section).and_then(|section| section.as_table()) else {
                continue;
            };
            for (name, value) in dependencies {
                let shared = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
                assert!(shared, "{}: {name} does not come from the workspace", path.display());
            }
        }
    }
}
