//! `arena plot`: fields of a recording over time.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use front_door::pictures::{self, Trace};
use recording::Recording;
use recording::export::{Columns, Outcome, Types, Wanted};
use reflect::ViewError;

use super::Failure;
use super::export::refuse_own;
use super::listening::{Stretch, address, conclude, export_failure};

/// Lines of one picture, at most.
const TRACES_MAX: usize = 64;

/// Options of `arena plot`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A recording; the segments that follow it belong to it.
    file: PathBuf,
    /// Fields; a field with parts stands for all its parts. One unit, one panel; one vehicle, one line.
    #[arg(value_name = "TOPIC.FIELD", required = true)]
    fields: Vec<String>,
    /// The picture, .svg or .png [default: FILE.svg].
    #[arg(long, short, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Only messages that name this vehicle.
    #[arg(long, value_name = "ID")]
    vehicle: Option<u64>,
    #[command(flatten)]
    stretch: Stretch,
}

/// A field's place among the columns, and the vehicle.
type Key = (usize, Option<u64>);

/// Points of a stretch of time.
#[derive(Default)]
struct Points {
    points: Vec<(Key, f64, f64)>,
    unreadable: u64,
    first: Option<(String, ViewError)>,
}

/// Runs the command: exit code 1 where something could not be read.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let recording = Recording::open(&arguments.file)?;
    let output = arguments.output.clone().unwrap_or_else(|| arguments.file.with_extension("svg"));
    let as_png = is_png(&output)?;
    refuse_own(&recording, &output)?;
    let mut addresses = Vec::new();
    for text in &arguments.fields {
        addresses.push(address(&recording, text)?);
    }
    let (from, to) = arguments.stretch.ends(&recording)?;
    let wanted = Wanted { addresses, from, to, vehicle: arguments.vehicle };
    let types = Types::of(&recording);
    let columns =
        Columns::new(&recording, &types, &wanted).map_err(|error| export_failure(&arguments.file, error))?;
    refuse_what_cannot_be_drawn(&recording, &columns)?;
    let (traces, outcome) = collect(&recording, &wanted, &columns)?;
    let title = arguments.file.file_name().unwrap_or_default().to_string_lossy();
    let svg = pictures::time_plot(&title, &traces)?;
    let bytes = if as_png { pictures::png_of(&svg)? } else { svg.into_bytes() };
    std::fs::write(&output, bytes).map_err(|source| Failure::File { path: output, source })?;
    if traces.iter().all(|trace| trace.points() == 0) {
        eprintln!("there are no points to draw");
        return Ok(ExitCode::FAILURE);
    }
    Ok(conclude(&outcome))
}

fn is_png(output: &Path) -> Result<bool, Failure> {
    match output.extension().and_then(|extension| extension.to_str()) {
        Some("svg") => Ok(false),
        Some("png") => Ok(true),
        _ => Err(Failure::Usage(format!("{}: a picture ends in .svg or .png", output.display()))),
    }
}

fn refuse_what_cannot_be_drawn(recording: &Recording, columns: &Columns) -> Result<(), Failure> {
    for channel in recording.channels() {
        for (place, reader) in columns.fields(channel.id) {
            if !reader.is_number() {
                let column = &columns.columns[place];
                return Err(Failure::Usage(format!(
                    "{}.{}: stands for no number",
                    column.topic, column.path
                )));
            }
        }
    }
    Ok(())
}

fn collect(
    recording: &Recording,
    wanted: &Wanted,
    columns: &Columns,
) -> Result<(Vec<Trace>, Outcome), Failure> {
    let range = recording.time_range().unwrap_or_default();
    let ends = (wanted.from.unwrap_or(range.0).max(range.0), wanted.to.unwrap_or(range.1).min(range.1));
    let range_s = (recording.seconds_at(ends.0), recording.seconds_at(ends.1));
    let mut outcome = Outcome::default();
    let mut too_many = false;
    let mut traces: BTreeMap<Key, Trace> = BTreeMap::new();
    recording.visit(
        &wanted.selection(),
        Points::default,
        |points: &mut Points, message| {
            let (channel, body) = (message.channel.id, message.body);
            if !columns.wants(channel, body) {
                return;
            }
            let vehicle = columns.by_vehicle.then(|| columns.vehicle(channel, body)).flatten();
            let time_s = recording.seconds_at(message.at);
            for (place, reader) in columns.fields(channel) {
                match reader.read(body) {
                    Ok(value) => {
                        let number = value.and_then(|value| value.number());
                        points.points.extend(number.map(|number| ((place, vehicle), time_s, number)));
                    }
                    Err(error) => {
                        points.unreadable += 1;
                        points.first.get_or_insert_with(|| (message.channel.topic.clone(), error));
                    }
                }
            }
        },
        |points| {
            match points {
                Ok(points) => {
                    outcome.undecodable += points.unreadable;
                    let first = points.first.map(|(topic, error)| format!("{topic}: {error}"));
                    outcome.first_undecodable = outcome.first_undecodable.take().or(first);
                    for (key, time_s, number) in points.points {
                        if traces.len() < TRACES_MAX || traces.contains_key(&key) {
                            let trace = || {
                                Trace::new(label(columns, key), columns.columns[key.0].unit.clone(), range_s)
                            };
                            traces.entry(key).or_insert_with(trace).take(time_s, number);
                        } else {
                            too_many = true;
                        }
                    }
                }
                Err(damage) => outcome.damage.push(damage),
            }
            ControlFlow::Continue(())
        },
    );
    if too_many {
        return Err(Failure::Usage(format!(
            "more than {TRACES_MAX} lines: name fewer fields, or one --vehicle"
        )));
    }
    Ok((traces.into_values().collect(), outcome))
}

fn label(columns: &Columns, (place, vehicle): Key) -> String {
    let column = &columns.columns[place];
    let several = columns.columns.iter().any(|other| other.topic != column.topic);
    let topic = if several { format!("{}.", column.topic) } else { String::new() };
    let vehicle = vehicle.map_or_else(String::new, |vehicle| format!(", vehicle {vehicle}"));
    format!("{topic}{}{vehicle}", column.path)
}
