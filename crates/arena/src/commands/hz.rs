//! `arena hz`: how often messages come, how evenly, how late, and how many not at all.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use front_door::tools::rates::{Figures, Rates};
use front_door::tools::{Heard, Tick, ToolError, name_of_source};
use quantity::Span;
use recording::{Recording, Selection};
use serde::Serialize;
use service_core::Observer;
use service_shell::clock;

use super::listening::{Place, Stretch, address, go_through, listen, parse_seconds};
use super::{Failure, budget};

/// How often the figures of a live topic are printed.
const PRINT_PERIOD: Span = Span::from_secs(1);
/// Messages a live topic's figures are of.
const LIVE_WINDOW: usize = 1000;
/// Messages a window may hold.
const WINDOW_MAX: u64 = 10_000_000;

/// Options of `arena hz`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A topic.
    #[arg(required_unless_present = "budget")]
    topic: Option<String>,
    /// Show the latency budget instead: from the cameras' datagram to the radio's frame, and hop by hop. Live, or of
    /// the recording named in the topic's place.
    #[arg(long, conflicts_with_all = ["file", "window", "count", "vehicle"])]
    budget: bool,
    /// A recording; the live bus if none is named.
    file: Option<PathBuf>,
    /// Figures of the newest N messages [default: 1000 of a live topic, all of a recorded one].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=WINDOW_MAX))]
    window: Option<u64>,
    /// End after so many messages.
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// End after so many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    duration: Option<Duration>,
    /// Only messages that name this vehicle.
    #[arg(long, value_name = "ID")]
    vehicle: Option<u64>,
    /// Print one JSON object per line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    stretch: Stretch,
    #[command(flatten)]
    place: Place,
}

impl Arguments {
    /// The topic; only a budget is asked for without one.
    fn topic(&self) -> &str {
        self.topic.as_deref().unwrap_or_default()
    }
}

/// Whose messages: a sender's on one vehicle.
type Key = (Option<u32>, Option<u64>);

/// The figures of one sender, on one vehicle where messages name theirs.
#[derive(Debug, Serialize)]
struct Answer {
    topic: String,
    source: Option<String>,
    vehicle: Option<u64>,
    #[serde(flatten)]
    figures: Figures,
    /// Numbers of the sender that never came, on all vehicles.
    lost: u64,
}

struct Meter<'a> {
    arguments: &'a Arguments,
    window: usize,
    rates: BTreeMap<Key, Rates>,
    messages: u64,
}

impl Meter<'_> {
    fn take(&mut self, heard: &Heard<'_>) -> ControlFlow<()> {
        let vehicle = heard.vehicle();
        if self.arguments.vehicle.is_some() && vehicle != self.arguments.vehicle {
            return ControlFlow::Continue(());
        }
        let window = self.window;
        let rates = self.rates.entry((heard.source, vehicle)).or_insert_with(|| Rates::new(window));
        rates.take(heard.at, heard.published_at, heard.body.len());
        self.messages += 1;
        let enough = self.arguments.count.is_some_and(|count| self.messages >= count);
        if enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn print(&self, lost: &BTreeMap<Option<u32>, u64>) -> Result<(), ToolError> {
        let mut out = std::io::stdout().lock();
        for ((source, vehicle), rates) in &self.rates {
            let Some(figures) = rates.figures() else { continue };
            let answer = Answer {
                topic: self.arguments.topic().to_owned(),
                source: source.map(name_of_source),
                vehicle: *vehicle,
                figures,
                lost: lost.get(source).copied().unwrap_or(0),
            };
            if self.arguments.json {
                let line = serde_json::to_string(&answer).map_err(std::io::Error::from)?;
                writeln!(out, "{line}")?;
            } else {
                writeln!(out, "{}", answer.text())?;
            }
        }
        Ok(out.flush()?)
    }
}

impl Answer {
    fn text(&self) -> String {
        let figures = &self.figures;
        let source = self.source.as_deref().unwrap_or("unknown");
        let vehicle = self.vehicle.map_or_else(String::new, |vehicle| format!(" vehicle {vehicle}"));
        format!(
            "{source}{vehicle}: {:.2} Hz, period {:.3} ms ({:.3} to {:.3}), jitter {:.3} ms, \
             lateness {:.3} ms (at most {:.3}), {} lost; of {} messages, {} in all",
            figures.rate_hz,
            figures.period_ms,
            figures.period_ms_min,
            figures.period_ms_max,
            figures.jitter_ms,
            figures.lateness_ms,
            figures.lateness_ms_max,
            self.lost,
            figures.window,
            figures.messages,
        )
    }
}

/// Runs the command: exit code 1 where fewer than two messages came.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.budget {
        let Arguments { topic: file, duration, json, stretch, place, .. } = arguments;
        return budget::run(file.as_deref().map(Path::new), *duration, *json, stretch, place);
    }
    let window = arguments.window.map(|window| window as usize);
    match &arguments.file {
        Some(file) => of_file(arguments, &Recording::open(file)?, window),
        None => live(arguments, window.unwrap_or(LIVE_WINDOW)),
    }
}

fn of_file(arguments: &Arguments, recording: &Recording, window: Option<usize>) -> Result<ExitCode, Failure> {
    let topic = address(recording, arguments.topic())?;
    if let Some(field) = topic.field {
        return Err(Failure::Usage(format!("{field}: a rate is that of a whole topic")));
    }
    let (from, mut to) = arguments.stretch.ends(recording)?;
    if let Some(duration) = arguments.duration {
        let begin = from.unwrap_or_else(|| recording.started_at());
        let end = begin.saturating_add(Span::from_secs_f64(duration.as_secs_f64()));
        to = Some(to.map_or(end, |to| to.min(end)));
    }
    let selection = Selection { from, to, ..Selection::topic(topic.topic) };
    let window =
        window.unwrap_or(usize::try_from(recording.message_count().min(WINDOW_MAX)).unwrap_or(usize::MAX));
    let mut meter = Meter { arguments, window, rates: BTreeMap::new(), messages: 0 };
    let code = go_through(recording, &selection, |heard| Ok(meter.take(heard)))?;
    let mut lost: BTreeMap<Option<u32>, u64> = BTreeMap::new();
    for stream in &recording.gaps(&selection, |_| ()).streams {
        *lost.entry(Some(stream.stream.source)).or_default() += stream.missing();
    }
    meter.print(&lost)?;
    Ok(if meter.messages < 2 { too_few(arguments, meter.messages) } else { code })
}

fn live(arguments: &Arguments, window: usize) -> Result<ExitCode, Failure> {
    arguments.stretch.refuse_live()?;
    let setup = arguments.place.setup()?;
    let mut meter = Meter { arguments, window, rates: BTreeMap::new(), messages: 0 };
    let topic = arguments.topic().to_owned();
    let mut print_at = clock::now() + PRINT_PERIOD;
    let ear = listen(
        &setup,
        move |heard| heard == topic,
        arguments.duration,
        |tick| match tick {
            Tick::Heard(heard) => Ok(meter.take(&heard)),
            Tick::Now(now, observer) => {
                if now >= print_at {
                    print_at = now + PRINT_PERIOD;
                    meter.print(&lost_by_source(arguments.topic(), observer))?;
                }
                Ok(ControlFlow::Continue(()))
            }
        },
    )?;
    meter.print(&lost_by_source(arguments.topic(), ear.observer()))?;
    Ok(if meter.messages < 2 { too_few(arguments, meter.messages) } else { ExitCode::SUCCESS })
}

fn lost_by_source(topic: &str, observer: &Observer) -> BTreeMap<Option<u32>, u64> {
    let mut lost: BTreeMap<Option<u32>, u64> = BTreeMap::new();
    for (name, (source, _, _), counts) in observer.sequences() {
        if name == topic {
            *lost.entry(Some(source)).or_default() += counts.lost;
        }
    }
    lost
}

fn too_few(arguments: &Arguments, messages: u64) -> ExitCode {
    eprintln!("{}: {messages} messages came, and a rate is that of two at least", arguments.topic());
    ExitCode::FAILURE
}
