//! A live arena, recorded by the logger, is proven like a virtual one.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use front_door::experiment::core;
use recording::Recording;
use recording::verify::verify;

use crate::common::{config, copy, front_door};

/// Long enough for a crowded machine.
const PATIENCE: Duration = Duration::from_secs(180);

/// Ends the arena whatever happens.
struct Ended(Child);

impl Ended {
    fn interrupt(&self) {
        let id = self.0.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(None)) {
            self.interrupt();
            std::thread::sleep(Duration::from_millis(300));
            self.interrupt();
            let _ = self.0.wait();
        }
    }
}

#[test]
fn a_recorded_live_arena_is_proven_bit_for_bit() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("verify-live");
    let _ = fs::remove_dir_all(&folder);
    copy(&config(), &folder.join("config"));
    let network = folder.join("config/network.toml");
    let ports = [47101_u16, 47102, 47103, 51001, 52000, 52100];
    let text = ports.iter().fold(fs::read_to_string(&network).unwrap(), |text, port| {
        text.replace(&port.to_string(), &(port + 900).to_string())
    });
    fs::write(&network, text).unwrap();
    let mut child = Command::new(front_door())
        .args(["up", "double-flip", "--record", "flight.mcap"])
        .current_dir(&folder)
        .env_remove("FLYARENA_SECRET_FILE")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let mut ended = Ended(child);
    let give_up = Instant::now() + PATIENCE;
    let mut landing = false;
    for line in lines {
        // Its lines come every second: nothing here waits for ever.
        assert!(Instant::now() < give_up, "no flip: {line}");
        if !landing && line.contains("flip   0 completed") {
            ended.interrupt();
            landing = true;
        }
        if line == "landed" {
            break;
        }
    }
    assert!(landing && ended.0.wait().unwrap().success());

    let recording = Recording::open(&folder.join("flight.mcap")).unwrap();
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
