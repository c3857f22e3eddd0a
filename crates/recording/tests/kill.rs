//! A recorder that is killed at any moment leaves an exact prefix, and loses little.
//!
//! The recorder is this test's own program, started again: it records one message each half millisecond of a
//! clock that it moves itself, and acknowledges each in a file before the next. However slow the machine is,
//! what is lost can be counted in messages.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use quantity::{Span, Time};
use recording::{About, Host, Limits, Plan, Segments, WriteOptions, recover_file};
use service_core::Observed;
use wire::{Domain, Header, Kind, TopicName};

const PERIOD: Span = Span::from_micros(500);
/// The chunk of a tenth of a second that is open, and the one before it, are all there is to lose.
const LOST_MAX: u64 = 300_000_000 / 500_000;
const ROUNDS: u64 = 50;
const FOLDER_VARIABLE: &str = "FLYARENA_KILLED_RECORDER";

fn at(number: u64) -> Time {
    Time::ZERO + PERIOD * number as i64
}

fn body(number: u64) -> Vec<u8> {
    (0..200_u64).map(|index| (number.wrapping_mul(31) ^ (index * 7)) as u8).collect()
}

fn observe(segments: &mut Segments<Host>, number: u64) {
    let header = Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: false,
        source: 1,
        schema_id: 2,
        run: 3,
        incarnation: 4,
        sequence: number,
        published_at: at(number),
    };
    let (topic, body) = (TopicName::new("a/topic").unwrap(), body(number));
    segments.observe(at(number), at(number), &Observed { header, topic, body: &body, verified: true });
}

/// The recorder: goes on until it is killed.
fn record(folder: &Path) {
    let about = About {
        recording: 1,
        segment: 0,
        run: 3,
        domain: Domain::Sim,
        scenario: String::new(),
        settings_digest: 0,
        started_at: at(0),
        started_wall_ns: 0,
        host: String::new(),
        revision: String::new(),
    };
    let plan = Plan {
        path: folder.join("a.mcap"),
        about,
        settings: None,
        options: WriteOptions::default(),
        limits: Limits { min_free_bytes: 0, ..Limits::one_file() },
    };
    let mut segments = Segments::begin(Host, plan, at(0)).unwrap();
    let acknowledged = File::create(folder.join("acknowledged")).unwrap();
    for number in 0.. {
        observe(&mut segments, number);
        if number % 40 == 0 {
            segments.tick(at(number));
            std::thread::sleep(Duration::from_micros(200));
        }
        acknowledged.write_all_at(&number.to_le_bytes(), 0).unwrap();
    }
}

fn acknowledged(folder: &Path) -> Option<u64> {
    let bytes = fs::read(folder.join("acknowledged")).ok()?;
    Some(u64::from_le_bytes(bytes.try_into().ok()?))
}

fn killed_after(round: u64, span: Duration) -> (PathBuf, u64) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("killed-{round}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let mut recorder = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_killed_recorder_leaves_an_exact_prefix"])
        .env(FOLDER_VARIABLE, &folder)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let give_up = Instant::now() + Duration::from_secs(60);
    while acknowledged(&folder).is_none() {
        assert!(Instant::now() < give_up, "the recorder does not begin");
        std::thread::sleep(Duration::from_millis(1));
    }
    std::thread::sleep(span);
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let last = acknowledged(&folder).unwrap();
    (folder, last)
}

#[test]
fn a_killed_recorder_leaves_an_exact_prefix() {
    if let Some(folder) = std::env::var_os(FOLDER_VARIABLE) {
        return record(Path::new(&folder));
    }
    let mut random = u64::from(std::process::id());
    let mut worst = 0;
    for round in 0..ROUNDS {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let (folder, last) = killed_after(round, Duration::from_micros((random >> 33) % 150_000));
        let (torn, whole) = (folder.join("a.mcap.part"), folder.join("a.mcap"));
        let recovered = recover_file(&torn, &whole).unwrap();
        let bytes = fs::read(&whole).unwrap();
        let mut found = 0;
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            assert_eq!(u64::from(message.sequence), found, "round {round}");
            assert_eq!(message.data.as_ref(), body(found), "round {round}");
            found += 1;
        }
        assert_eq!(recovered.messages, found);
        assert!(recovered.missing.is_some(), "it was not sealed");
        let lost = (last + 1).saturating_sub(found);
        assert!(lost <= LOST_MAX, "round {round}: {lost} of {last} lost");
        worst = worst.max(lost);
        fs::remove_dir_all(&folder).unwrap();
    }
    println!("{ROUNDS} kills, at most {worst} messages ({:.1} ms) lost", worst as f64 * 0.5);
}
