//! A live arena, recorded by the logger, is proven like a virtual one.

use std::process::Command;

use front_door::experiment::core;
use recording::Recording;
use recording::verify::verify;

use crate::common::{front_door, place};
use crate::process::Process;

#[test]
fn a_recorded_live_arena_is_proven_bit_for_bit() {
    let mut command = Command::new(front_door());
    command.args(["up", "double-flip", "--record", "flight.mcap"]);
    let mut arena = Process::start(place("verify-live", 900), command);
    arena.wait_for("flip", |line| line.contains("flip   0 completed"));
    arena.interrupt();
    arena.wait_for("landing", |line| line == "landed");
    assert!(arena.child.wait().unwrap().success());

    let recording = Recording::open(&arena.folder.join("flight.mcap")).unwrap();
    let settings = recording.settings().unwrap().unwrap();
    let report = verify(&recording, &core, &settings, None, &mut |_| ());
    for service in roster::SERVICES {
        let verdict = report.verdicts.iter().find(|verdict| verdict.service == *service);
        let verdict = verdict.unwrap_or_else(|| panic!("nothing of {service}: {report:#?}"));
        assert!(verdict.holds() && verdict.settings.is_none(), "{verdict:#?}");
        assert_eq!(verdict.steps_identical, verdict.steps_journalled, "{verdict:#?}");
        assert!(verdict.copies_absent == 0 && verdict.steps_identical > 10, "{verdict:#?}");
    }
    assert!(report.holds(), "{report:#?}");
}
