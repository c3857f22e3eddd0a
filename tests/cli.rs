//! The front door as people and scripts use it: exit codes, what is printed where, and the files it writes.

use std::fs::{self, Permissions};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::common::{config, copy, front_door};

/// A folder of its own for one test, with a copy of the settings.
struct Place(PathBuf);

impl Place {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("cli-{name}"));
        let _ = fs::remove_dir_all(&folder);
        copy(&config(), &folder.join("config"));
        Self(folder)
    }

    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(front_door());
        command.args(line.split_whitespace()).current_dir(&self.0).stdin(Stdio::null());
        command.env_remove("FLYARENA_SECRET_FILE").env_remove("RUST_LOG");
        command
    }

    fn run(&self, line: &str) -> Said {
        Said::from(self.command(line).output().unwrap())
    }

    fn write_secret(&self, bytes: &[u8], mode: u32) {
        let path = self.0.join(".flyarena/secret");
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
    }
}

#[derive(Debug)]
struct Said {
    code: Option<i32>,
    out: String,
    errors: String,
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), errors: text(output.stderr) }
    }
}

impl Said {
    /// Refused as asked wrongly: code 2, nothing on standard output, one error with these words.
    fn assert_refused(&self, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(2), ""), "{self:?}");
        assert!(self.errors.starts_with("error: "), "{self:?}");
        for word in words {
            assert!(self.errors.contains(word), "no {word} in {}", self.errors);
        }
    }

    fn json(&self) -> Value {
        assert_eq!(self.out.lines().count(), 1, "{}", self.out);
        serde_json::from_str(&self.out).unwrap()
    }
}

/// The keys of an object, in the order they were written.
fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn assert_keys(value: &Value, expected: &[&str]) {
    let mut expected = expected.to_vec();
    expected.sort_unstable();
    let mut found = keys(value);
    found.sort_unstable();
    assert_eq!(found, expected);
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

const ANSWER: [&str; 10] = [
    "feasible",
    "residual",
    "limits",
    "rough_guess",
    "parameters",
    "final_error",
    "jacobian",
    "condition",
    "durations_s",
    "apex_m",
];

#[test]
fn a_solved_flip_is_one_json_object() {
    let said = Place::new("solve").run("solve --flips 2 --rate 1600 --json");
    assert_eq!((said.code, said.errors.as_str()), (Some(0), ""));
    let answer = said.json();
    assert_keys(&answer, &ANSWER);
    assert_eq!(answer["feasible"], true);
    assert!(answer["residual"].as_f64().unwrap() < 1e-6);
    assert_eq!(answer["limits"], serde_json::json!([]));
    for key in ["rough_guess", "parameters", "final_error", "durations_s"] {
        assert_eq!(numbers(&answer[key]).len(), 5, "{key}");
    }
    let rows = answer["jacobian"].as_array().unwrap();
    assert!(rows.len() == 5 && rows.iter().all(|row| numbers(row).len() == 5));
    assert!(answer["condition"].as_f64().unwrap() > 1.0);
    assert!(answer["apex_m"].as_f64().unwrap() > 0.0);
    assert!(numbers(&answer["final_error"]).iter().all(|error| error.abs() < 1e-6));
}

#[test]
fn a_flip_without_solution_exits_with_1_and_says_how_near_and_why() {
    let place = Place::new("infeasible");
    let said = place.run("solve --flips 1 --rate 1600 --margin 0.4 --json");
    assert_eq!((said.code, said.errors.as_str()), (Some(1), ""));
    let answer = said.json();
    assert_keys(&answer, &ANSWER);
    assert_eq!(answer["feasible"], false);
    assert!(answer["residual"].as_f64().unwrap() > 1e-3);
    assert!(!answer["limits"].as_array().unwrap().is_empty());
    assert_eq!(numbers(&answer["rough_guess"]).len(), 5);
    for key in ["parameters", "final_error", "jacobian", "condition", "durations_s", "apex_m"] {
        assert_eq!(answer[key], Value::Null, "{key}");
    }
    let said = place.run("solve --flips 1 --rate 1600 --margin 0.4");
    assert_eq!(said.code, Some(1));
    assert!(said.out.contains("least residual") && said.out.contains("limited by"), "{}", said.out);
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    let place = Place::new("numbers");
    for (line, word) in [
        ("solve --flips 2 --rate nan", "finite"),
        ("solve --flips 2 --rate inf", "finite"),
        ("solve --flips 2 --rate 0", "above zero"),
        ("solve --flips 2 --rate -1600", "above zero"),
        ("solve --flips 2 --rate fast", "invalid value"),
        ("solve --flips 2 --rate 1600 --margin nan", "margin"),
        ("solve --flips 2 --rate 1600 --margin -0.1", "margin"),
        ("solve --flips 2 --rate 1600 --margin 0.5", "margin"),
        ("solve --flips 0 --rate 1600", "--flips"),
        ("solve --flips 11 --rate 1600", "--flips"),
        ("solve --flips 2 --rate 1600 --model exact", "--model"),
        ("solve --flips 2", "--rate"),
        ("learn double-flip --iterations 0", "--iterations"),
        ("learn double-flip --seeds 0", "--seeds"),
        ("learn double-flip --seed -1", "-1"),
        ("frobnicate", "frobnicate"),
    ] {
        place.run(line).assert_refused(&[word]);
    }
}

#[test]
fn an_unknown_scenario_or_service_is_refused_with_those_there_are() {
    let place = Place::new("unknown");
    place.write_secret(&[7; 32], 0o600);
    for line in ["learn duble-flip", "up duble-flip", "run estimator --scenario duble-flip --run 1"] {
        place.run(line).assert_refused(&["duble-flip", "double-flip, fleet, rate-mismatch"]);
    }
    assert!(!place.0.join(".flyarena/run").exists(), "an arena that cannot come up has no run");
    place.run("run estimater --run 1").assert_refused(&["estimater", "estimator", "radio-bridge"]);
    place.run("learn double-flip --config elsewhere").assert_refused(&["elsewhere"]);
}

#[test]
fn a_wrong_setting_is_refused_by_every_command_that_reads_it() {
    let place = Place::new("setting");
    place.write_secret(&[7; 32], 0o600);
    fs::write(place.0.join("config/services.toml"), "[estimater]\n").unwrap();
    let lines = [
        "learn double-flip",
        "up",
        "run estimator --run 1",
        "run simulator --run 1",
        "learn double-flip --seeds 2",
    ];
    for line in lines {
        place.run(line).assert_refused(&["services.toml", "estimater", "estimator"]);
    }
    fs::write(place.0.join("config/services.toml"), "[estimator]\nno_such_gain = 1.0\n").unwrap();
    place.run("learn double-flip").assert_refused(&["services.toml", "[estimator]", "no_such_gain"]);
}

#[test]
fn a_secret_that_is_none_keeps_a_service_from_starting() {
    let place = Place::new("secret");
    place.run("run estimator --run 1").assert_refused(&[".flyarena/secret", "--secret-file"]);
    place.write_secret(&[7; 31], 0o600);
    place.run("run estimator --run 1").assert_refused(&[".flyarena/secret", "31 bytes", "32"]);
    place.write_secret(&[7; 33], 0o600);
    place.run("run estimator --run 1").assert_refused(&["33 bytes", "32"]);
    place.write_secret(&[7; 32], 0o644);
    place.run("run estimator --run 1").assert_refused(&["0644", "0600"]);
    place.write_secret(&[7; 32], 0o600);
    place.run("run estimator").assert_refused(&[".flyarena/run", "--run"]);
    place.run("run estimator --run 1 --secret-file elsewhere").assert_refused(&["elsewhere"]);
}

#[test]
fn learning_prints_one_json_object_and_writes_its_files() {
    let place = Place::new("learn");
    let said = place.run("learn double-flip --iterations 2 --seed 3 --json --out results/here");
    assert_eq!(said.code, Some(0), "{said:?}");
    let report = said.json();
    assert_keys(&report, &["scenario", "seed", "digest", "virtual_s", "wall_s", "vehicles"]);
    assert_eq!((&report["scenario"], &report["seed"]), (&"double-flip".into(), &3.into()));
    assert_eq!(report["digest"].as_str().unwrap().len(), 64);
    let vehicles = report["vehicles"].as_array().unwrap();
    assert_eq!(vehicles.len(), 1);
    assert_keys(&vehicles[0], &["id", "iterations"]);
    assert_eq!(vehicles[0]["id"], 1);
    let iterations = vehicles[0]["iterations"].as_array().unwrap();
    assert_eq!(iterations.len(), 2);
    let error = ["x_m", "z_m", "vx_m_s", "vz_m_s", "theta_rad"];
    for (index, flip) in iterations.iter().enumerate() {
        for key in ["index", "outcome", "parameters", "error", "true_error"] {
            assert!(keys(flip).contains(&key), "no {key}");
        }
        assert_eq!((&flip["index"], &flip["outcome"]), (&index.into(), &"completed".into()));
        assert_keys(&flip["parameters"], &["u1_m_s2", "t1_s", "t3_s", "u5_m_s2", "t5_s"]);
        assert_keys(&flip["error"], &error);
        assert_keys(&flip["true_error"], &error);
        assert!(
            flip["true_error"]["x_m"].as_f64().unwrap() != 0.0,
            "the truth was known when the result came"
        );
    }
    assert_eq!(
        said.errors.lines().filter(|line| line.contains("Completed")).count(),
        2,
        "progress: {}",
        said.errors
    );
    assert!(!said.errors.contains('\x1b') && !said.out.contains('\x1b'), "colours in a pipe");
    assert_files(&place.0.join("results/here"), &report);
}

fn assert_files(folder: &Path, report: &Value) {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort_unstable();
    let mut expected = vec!["results.csv".to_owned(), "results.json".to_owned()];
    for stem in ["errors", "parameters", "side-view"] {
        expected.extend(["svg", "png"].map(|ending| format!("{stem}-vehicle-1.{ending}")));
    }
    expected.sort_unstable();
    assert_eq!(names, expected);
    let written: Value = serde_json::from_slice(&fs::read(folder.join("results.json")).unwrap()).unwrap();
    assert_eq!(&written, report, "the file says what was printed");
    let csv = fs::read_to_string(folder.join("results.csv")).unwrap();
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert_eq!(columns, [20, 20, 20]);
    for name in names.iter().filter(|name| name.contains("vehicle")) {
        let bytes = fs::read(folder.join(name)).unwrap();
        let magic: &[u8] = if name.ends_with("png") { b"\x89PNG\r\n\x1a\n" } else { b"<svg" };
        assert!(bytes.starts_with(magic) && bytes.len() > 1000, "{name}");
    }
}

#[test]
fn without_json_people_read_a_line_per_flip_and_where_the_files_are() {
    let said = Place::new("people").run("learn double-flip --iterations 1");
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.out.starts_with("vehicle 1  flip   0  Completed"), "{}", said.out);
    assert!(said.out.contains("digest ") && said.out.contains("out/double-flip-seed-1"), "{}", said.out);
    assert!(!said.out.contains('\x1b') && !said.errors.contains('\x1b'), "colours in a pipe");
}

#[test]
fn a_folder_that_cannot_be_written_is_a_failure_and_not_a_misuse() {
    let place = Place::new("unwritable");
    fs::write(place.0.join("out"), "a file").unwrap();
    let said = place.run("learn double-flip --iterations 1 --out out/here");
    assert_eq!(said.code, Some(1), "{said:?}");
    assert!(said.errors.contains("error: out/here"), "{}", said.errors);
}

#[test]
fn whoever_stops_reading_makes_no_error() {
    let place = Place::new("pipe");
    for line in [
        "solve --flips 2 --rate 1600",
        "solve --flips 2 --rate 1600 --json",
        "learn double-flip --iterations 2",
    ] {
        for lines in [0, 1] {
            let mut child =
                place.command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
            let mut reader = BufReader::new(child.stdout.take().unwrap());
            let mut text = String::new();
            for _ in 0..lines {
                reader.read_line(&mut text).unwrap();
            }
            drop(reader);
            let said = Said::from(child.wait_with_output().unwrap());
            assert_eq!(said.code, Some(0), "{line}: {said:?}");
            assert!(!said.errors.contains("panicked") && !said.errors.contains("error:"), "{line}: {said:?}");
        }
    }
}
