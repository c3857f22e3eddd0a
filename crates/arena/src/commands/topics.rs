//! `arena topics`: what is on the bus, or in a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use front_door::tools::{Heard, Tick, name_of_source};
use quantity::Time;
use recording::{Recording, Selection};
use serde::Serialize;
use service_shell::clock;
use wire::Kind;

use super::Failure;
use super::listening::{Place, listen, parse_seconds};

/// Topics that are told apart at most: names on the bus are not all ours.
const TOPICS_MAX: usize = 4096;

/// Options of `arena topics`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A recording; the live bus if none is named.
    file: Option<PathBuf>,
    /// How many seconds to listen to the live bus.
    #[arg(long, value_name = "S", default_value = "3", value_parser = parse_seconds)]
    duration: Duration,
    /// Print one JSON object per topic.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: Place,
}

/// One topic.
#[derive(Debug, Default, Serialize)]
struct Row {
    topic: String,
    #[serde(rename = "type")]
    types: BTreeSet<String>,
    sources: BTreeSet<String>,
    messages: u64,
    bytes: u64,
    rate_hz: f64,
    bandwidth_bytes_s: f64,
    /// Numbers that never came.
    lost: u64,
    /// Whether the tags of all messages were checked.
    verified: bool,
}

impl Row {
    fn new(topic: &str) -> Self {
        Self { topic: topic.to_owned(), verified: true, ..Self::default() }
    }

    fn per_second(&mut self, seconds: f64) {
        if seconds > 0.0 {
            self.rate_hz = self.messages as f64 / seconds;
            self.bandwidth_bytes_s = self.bytes as f64 / seconds;
        }
    }
}

/// Runs the command: exit code 1 where nothing was heard, or something could not be read.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (rows, whole) = match &arguments.file {
        Some(file) => of_file(&Recording::open(file)?),
        None => (live(arguments)?, true),
    };
    print(&rows, arguments.json)?;
    if rows.is_empty() {
        eprintln!("nothing was heard");
    }
    Ok(if rows.is_empty() || !whole { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn of_file(recording: &Recording) -> (Vec<Row>, bool) {
    let gaps = recording.gaps(&Selection::all(), |_| ());
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    for channel in recording.channels() {
        let row = rows.entry(&channel.topic).or_insert_with(|| Row::new(&channel.topic));
        row.types.extend(channel.schema.as_ref().map(|schema| schema.name.clone()));
        row.messages += recording.channel_count(channel.id);
        if let Some(stream) = &channel.stream {
            row.sources.insert(name_of_source(stream.source));
            row.verified &= stream.verified;
        }
    }
    for stream in &gaps.streams {
        if let Some(row) = rows.get_mut(stream.stream.topic.as_str()) {
            row.bytes += stream.bytes;
            row.lost += stream.missing();
        }
    }
    let seconds = recording.time_range().map_or(0.0, |(first, last)| (last - first).as_secs_f64());
    rows.values_mut().for_each(|row| row.per_second(seconds));
    for error in &gaps.damage {
        eprintln!("{error}");
    }
    (rows.into_values().collect(), gaps.damage.is_empty())
}

fn live(arguments: &Arguments) -> Result<Vec<Row>, Failure> {
    let setup = arguments.place.setup()?;
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    let started_at: Time = clock::now();
    let ear = listen(
        &setup,
        |_| true,
        Some(arguments.duration),
        |tick| {
            if let Tick::Heard(heard) = tick {
                take(&mut rows, &heard);
            }
            Ok(ControlFlow::Continue(()))
        },
    )?;
    let seconds = (clock::now() - started_at).as_secs_f64();
    for (topic, (_, _, kind), counts) in ear.observer().sequences() {
        if let (Some(row), Kind::Data | Kind::Journal) = (rows.get_mut(topic), kind) {
            row.lost += counts.lost;
        }
    }
    rows.values_mut().for_each(|row| row.per_second(seconds));
    Ok(rows.into_values().collect())
}

fn take(rows: &mut BTreeMap<String, Row>, heard: &Heard<'_>) {
    if !rows.contains_key(heard.topic) {
        if rows.len() >= TOPICS_MAX {
            return;
        }
        rows.insert(heard.topic.to_owned(), Row::new(heard.topic));
    }
    let Some(row) = rows.get_mut(heard.topic) else { return };
    row.messages += 1;
    row.bytes += heard.body.len() as u64;
    row.verified &= heard.verified != Some(false);
    // A sender, like a topic, may be anybody's invention.
    if row.sources.len() < TOPICS_MAX
        && let Some(source) = heard.source
    {
        row.sources.insert(name_of_source(source));
    }
    if let Some(name) = heard.type_name
        && !row.types.contains(name)
        && row.types.len() < TOPICS_MAX
    {
        row.types.insert(name.to_owned());
    }
}

fn print(rows: &[Row], json: bool) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    if json {
        for row in rows {
            writeln!(out, "{}", serde_json::to_string(row).map_err(std::io::Error::from)?)?;
        }
        return Ok(());
    }
    if rows.is_empty() {
        return Ok(());
    }
    let words = |set: &BTreeSet<String>| set.iter().cloned().collect::<Vec<_>>().join(" ");
    let width = |of: &dyn Fn(&Row) -> String, title: &str| {
        rows.iter().map(|row| of(row).chars().count()).max().unwrap_or(0).max(title.len())
    };
    let topic = width(&|row| row.topic.clone(), "topic");
    let types = width(&|row| words(&row.types), "type");
    writeln!(
        out,
        "{:topic$}  {:types$}  {:>9} {:>10} {:>10} {:>6}  from",
        "topic", "type", "messages", "Hz", "bytes/s", "lost"
    )?;
    for row in rows {
        let unverified = if row.verified { "" } else { " (unverified)" };
        writeln!(
            out,
            "{:topic$}  {:types$}  {:>9} {:>10.2} {:>10.0} {:>6}  {}{unverified}",
            row.topic,
            words(&row.types),
            row.messages,
            row.rate_hz,
            row.bandwidth_bytes_s,
            row.lost,
            words(&row.sources),
        )?;
    }
    Ok(())
}
