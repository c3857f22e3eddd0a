//! `arena hz --budget`: where the time goes from the cameras' datagram to the radio's frame.

use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use front_door::tools::budget::Budget;
use front_door::tools::{Heard, Tick};
use recording::{Recording, Selection};
use schemas::{CommandSent, NodeLatency, topics};
use wire::Kind;

use super::Failure;
use super::listening::{Place, Stretch, go_through, listen};

/// How long a live arena is listened to unless said otherwise.
const DURATION: Duration = Duration::from_secs(10);

/// Runs the command: exit code 1 where no radio frame was heard.
pub fn run(
    file: Option<&Path>,
    duration: Option<Duration>,
    json: bool,
    stretch: &Stretch,
    place: &Place,
) -> Result<ExitCode, Failure> {
    let mut budget = Budget::default();
    let damaged = match file {
        Some(file) => {
            let recording = Recording::open(file)?;
            let (from, to) = stretch.ends(&recording)?;
            let mut damaged = ExitCode::SUCCESS;
            for topic in [topics::COMMAND_SENT.name, topics::NODE_LATENCY.name] {
                let selection = Selection { from, to, ..Selection::topic(topic) };
                let code = go_through(&recording, &selection, |heard| {
                    take(&mut budget, heard);
                    Ok(ControlFlow::Continue(()))
                })?;
                if code != ExitCode::SUCCESS {
                    damaged = code;
                }
            }
            damaged
        }
        None => {
            stretch.refuse_live()?;
            let wanted =
                |topic: &str| topic == topics::COMMAND_SENT.name || topic == topics::NODE_LATENCY.name;
            listen(&place.setup()?, wanted, Some(duration.unwrap_or(DURATION)), |tick| {
                if let Tick::Heard(heard) = tick {
                    take(&mut budget, &heard);
                }
                Ok(ControlFlow::Continue(()))
            })?;
            ExitCode::SUCCESS
        }
    };
    let figures = budget.figures();
    let text = if json {
        serde_json::to_string(&figures).map_err(std::io::Error::from)? + "\n"
    } else {
        figures.table()
    };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(if figures.commands == 0 { ExitCode::FAILURE } else { damaged })
}

/// Of another type under the same name nothing is taken.
fn take(budget: &mut Budget, heard: &Heard<'_>) {
    if heard.kind != Kind::Data {
        return;
    }
    if heard.topic == topics::COMMAND_SENT.name {
        if let Ok(sent) = wire::decode::<CommandSent>(heard.body) {
            budget.take_slot(&sent);
        }
    } else if let Ok(share) = wire::decode::<NodeLatency>(heard.body) {
        budget.take_share(&share);
    }
}
