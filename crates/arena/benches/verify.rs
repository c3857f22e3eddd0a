//! How many times faster than real time a recording is proven, beside only reading it and only flying it in the same run.
//!
//! `cargo bench -p arena --bench verify [-- FLIPS]`. A learning experiment is recorded in memory, then executed again from
//! there: all services at once, and each alone.

#![allow(clippy::unwrap_used, reason = "a benchmark that cannot go on says so by panicking")]

use std::path::Path;
use std::time::Instant;

use front_door::experiment::{self, Observer};
use front_door::virtual_recording::VirtualRecording;
use recording::verify::verify;
use recording::{Recording, Selection};
use settings::Arena;
use virtual_arena::{Heard, VirtualArena};

struct Recorder {
    settings: Arena,
    recording: Option<VirtualRecording<Vec<u8>>>,
}

impl Observer for Recorder {
    fn begin(&mut self, flying: &VirtualArena<'_>) {
        self.recording = Some(VirtualRecording::begin(Vec::new(), flying, &self.settings).unwrap());
    }

    fn heard(&mut self, heard: &Heard<'_>) {
        self.recording.as_mut().unwrap().hear(heard);
    }
}

fn main() {
    let flips = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(20);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let mut settings = Arena::load(&folder, "double-flip").unwrap();
    settings.scenario.flip.as_mut().expect("a flip").iterations = flips;

    let started = Instant::now();
    let flown = experiment::learn(&settings, 1, &mut ()).unwrap();
    let span_s = flown.report.virtual_s;
    let line = |what: &str, wall_s: f64| println!("{what:<32} {:>8.1} times real time", span_s / wall_s);
    println!("{flips} flips, {span_s:.0} s");
    line("flown", started.elapsed().as_secs_f64());

    let started = Instant::now();
    let mut recorder = Recorder { settings: settings.clone(), recording: None };
    let recorded = experiment::learn(&settings, 1, &mut recorder).unwrap();
    let bytes = recorder.recording.unwrap().finish().unwrap();
    line("flown and recorded", started.elapsed().as_secs_f64());
    assert_eq!(flown.report.digest, recorded.report.digest, "recording changes nothing");

    let recording = Recording::from_bytes("in memory", bytes).unwrap();
    let started = Instant::now();
    let mut messages = recording.messages(&Selection::all());
    let mut count = 0_u64;
    while let Some(message) = messages.next() {
        message.unwrap();
        count += 1;
    }
    line("read", started.elapsed().as_secs_f64());
    for only in [None].into_iter().chain(experiment::services().into_iter().map(Some)) {
        let started = Instant::now();
        let report = verify(&recording, &experiment::core, &settings, only, &mut |_| ());
        line(&format!("verified, {}", only.unwrap_or("all")), started.elapsed().as_secs_f64());
        assert!(report.holds() && report.messages == count, "{report:?}");
    }
}
