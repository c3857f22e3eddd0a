//! The golden recordings: small, kept in the repository, proven bit for bit.
//!
//! `cargo test --release -p tests golden -- --ignored` makes them anew, after a change that is meant to change what a
//! service says or what a message is.

use std::fs;
use std::path::{Path, PathBuf};

use front_door::experiment::{core, node, services};
use front_door::virtual_recording::VirtualRecording;
use plant::faults::{Fault, Occlusion};
use quantity::Span;
use recording::verify::verify;
use recording::{Message, Recording, Selection};
use reflect::Message as Typed;
use schemas::{FlipOutcome, ManeuverResult, PlantTruth, Topic, Tracking, VehicleState, topics};
use settings::Arena;
use virtual_arena::{Heard, NodeFactory, VirtualArena};

use crate::common::{arena, hovering_node};

/// What is kept in the repository for ever is small.
const BYTES_MAX: u64 = 2_000_000;
const NAMES: [&str; 3] = ["double-flip", "dropout", "hover"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings")
}

fn open(name: &str) -> Recording {
    Recording::open(&folder().join(format!("{name}.mcap"))).unwrap()
}

/// Records what `fly` does with an arena.
fn record(settings: &Arena, seed: u64, factory: &NodeFactory, fly: impl FnOnce(&mut Flown<'_>)) -> Vec<u8> {
    let arena = VirtualArena::new(settings, seed, &services(), factory).unwrap();
    let recording = VirtualRecording::begin(Vec::new(), &arena, settings).unwrap();
    let mut flown = Flown { arena, recording };
    fly(&mut flown);
    let Flown { mut arena, mut recording } = flown;
    arena.close(&mut |heard| recording.hear(&heard));
    recording.finish().unwrap()
}

/// An arena, and the recording of it.
struct Flown<'f> {
    arena: VirtualArena<'f>,
    recording: VirtualRecording<Vec<u8>>,
}

impl Flown<'_> {
    fn run(&mut self, millis: i64) {
        self.watch(millis, |_| ());
    }

    fn watch(&mut self, millis: i64, mut watch: impl FnMut(&Heard<'_>)) {
        let Self { arena, recording } = self;
        arena.run_for(Span::from_millis(millis), &mut |heard| {
            recording.hear(&heard);
            watch(&heard);
        });
    }
}

fn hover(flown: &mut Flown<'_>) {
    flown.run(8000);
}

fn double_flip(flown: &mut Flown<'_>) {
    let (mut measured, mut answered) = (false, false);
    while !answered {
        flown.watch(100, |heard| {
            measured |= heard.published.is_data() && heard.published.topic == &topics::MANEUVER_RESULT;
            answered |= measured && heard.published.topic == &topics::MANEUVER_PARAMETERS;
        });
        assert!(flown.arena.elapsed() < Span::from_secs(30), "no flip");
    }
    flown.run(500);
}

fn dropout(flown: &mut Flown<'_>) {
    let occlude = |flown: &mut Flown<'_>, span| {
        let (now, fault) = (flown.arena.now(), Fault::Occluded { vehicle: 1, shown: Occlusion::Absent });
        flown.arena.plant_mut().fault(fault, now, now + span);
    };
    flown.run(6000);
    occlude(flown, Span::from_millis(80));
    flown.run(1000);
    occlude(flown, Span::from_secs(60));
    flown.run(4000);
}

#[test]
#[ignore = "makes the golden recordings anew"]
fn golden_recordings_are_made() {
    let settings = arena("double-flip");
    fs::create_dir_all(folder()).unwrap();
    let made = [
        ("double-flip", record(&settings, 61, &node, double_flip)),
        ("dropout", record(&settings, 62, &hovering_node, dropout)),
        ("hover", record(&settings, 63, &hovering_node, hover)),
    ];
    for (name, bytes) in made {
        fs::write(folder().join(format!("{name}.mcap")), bytes).unwrap();
    }
}

/// All messages of a topic.
fn all<M: Typed>(recording: &Recording, topic: &Topic) -> Vec<M> {
    let mut found = Vec::new();
    let mut messages = recording.messages(&Selection::topic(topic.name));
    while let Some(message) = messages.next() {
        let Message { body, .. } = message.unwrap();
        found.push(wire::decode(body).unwrap());
    }
    found
}

#[test]
fn golden_recordings_are_proven_bit_for_bit() {
    for name in NAMES {
        let recording = open(name);
        let settings = recording.settings().unwrap().unwrap();
        let report = verify(&recording, &core, &settings, None, &mut |_| ());
        assert!(report.holds(), "{name}: {report:#?}");
        for service in roster::SERVICES {
            let verdict = report.verdicts.iter().find(|verdict| verdict.service == *service);
            let verdict = verdict.unwrap_or_else(|| panic!("{name}: nothing of {service}"));
            assert!(verdict.settings.is_none() && verdict.copies_absent == 0, "{name}: {verdict:#?}");
            assert!(verdict.steps_identical == verdict.steps_journalled && verdict.steps_identical > 10);
        }
    }
}

#[test]
fn golden_recordings_show_what_their_page_says() {
    let page = fs::read_to_string(folder().join("README.md")).unwrap();
    for entry in fs::read_dir(folder()).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        assert!(name == "README.md" || page.contains(&format!("`{name}`")), "{name} is not on its page");
        assert!(entry.metadata().unwrap().len() <= BYTES_MAX, "{name} is too large to be kept");
    }
    let truths: Vec<PlantTruth> = all(&open("hover"), &topics::PLANT_TRUTH);
    let at = truths.last().unwrap().truth.position_m;
    assert!((at.z - 5.0).abs() < 0.1 && truths[0].truth.position_m.z < 0.1, "hover: ends at {at:?}");

    let results: Vec<ManeuverResult> = all(&open("double-flip"), &topics::MANEUVER_RESULT);
    assert!(results.iter().all(|result| result.outcome == FlipOutcome::Completed && result.iteration == 0));
    assert!(!results.is_empty());

    let states: Vec<VehicleState> = all(&open("dropout"), &topics::VEHICLE_STATE);
    let mut seen: Vec<Tracking> = states.iter().map(|state| state.tracking).collect();
    seen.dedup();
    let bridged = [Tracking::Tracking, Tracking::Coasting, Tracking::Tracking, Tracking::Coasting];
    assert!(seen.windows(4).any(|part| part == bridged), "dropout: {seen:?}");
    assert_eq!(seen.last(), Some(&Tracking::Invalid), "dropout: {seen:?}");
    let truths: Vec<PlantTruth> = all(&open("dropout"), &topics::PLANT_TRUTH);
    assert!(truths.last().unwrap().truth.velocity_m_s.z < 0.1, "dropout: it climbs");
}

#[test]
fn the_same_seed_records_the_same_bytes() {
    let settings = arena("double-flip");
    let short = |seed| record(&settings, seed, &node, |flown| flown.run(3000));
    assert!(short(71) == short(71), "the same seed");
    assert!(short(71) != short(72), "another seed");
}
