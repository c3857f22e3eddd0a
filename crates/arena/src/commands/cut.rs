//! `arena cut`: a piece of a recording, as a recording.

use std::fs::OpenOptions;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use recording::{Compression, CutError, Recording, Selection, WriteError, WriteOptions, part_of};
use serde_json::json;

use super::Failure;

/// Options of `arena cut`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A recording; the segments that follow it belong to it.
    file: PathBuf,
    /// Keep what was logged so many seconds after the recording's start, or later.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Keep what was logged so many seconds after the recording's start, or earlier.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    to: Option<f64>,
    /// Keep only this topic; may be given several times. `vehicle/*` stands for all that begin so.
    #[arg(long = "topic", value_name = "TOPIC")]
    topics: Vec<String>,
    /// Leave out this topic; may be given several times.
    #[arg(long, value_name = "TOPIC")]
    exclude: Vec<String>,
    /// The file to make [default: the recording's name with `.cut.mcap`].
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// How its chunks are compressed.
    #[arg(long, value_enum, default_value_t = Packing::Lz4)]
    compression: Packing,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Packing {
    /// Fast.
    Lz4,
    /// Small.
    Zstd,
    /// Not at all.
    None,
}

impl From<Packing> for Compression {
    fn from(packing: Packing) -> Self {
        match packing {
            Packing::Lz4 => Self::Lz4,
            Packing::Zstd => Self::Zstd,
            Packing::None => Self::None,
        }
    }
}

/// Runs the command: exit code 1 where something of the piece could not be read.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let recording = Recording::open(&arguments.file)?;
    let selection = selection(arguments, &recording)?;
    let output = arguments.output.clone().unwrap_or_else(|| default_output(&arguments.file));
    if output.exists() {
        return Err(Failure::Usage(format!("{}: is there already", output.display())));
    }
    let part = part_of(&output);
    let piece = match make(arguments, &recording, &selection, &part) {
        Ok(piece) => piece,
        Err(failure) => {
            // Half a piece is of no use to anybody. What hinders its removal would not change the failure.
            let _ = std::fs::remove_file(&part);
            return Err(failure);
        }
    };
    std::fs::rename(&part, &output).map_err(|source| Failure::File { path: output.clone(), source })?;
    for error in &piece.damage {
        eprintln!("left out: {error}");
    }
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let object = json!({
            "output": output.display().to_string(),
            "messages": piece.messages,
            "latched": piece.latched,
            "damage": piece.damage,
        });
        writeln!(out, "{object}")?;
    } else {
        let (messages, latched) = (piece.messages, piece.latched);
        writeln!(out, "{}: {messages} messages, {latched} of them latched before it", output.display())?;
    }
    Ok(if piece.damage.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn selection(arguments: &Arguments, recording: &Recording) -> Result<Selection, Failure> {
    let instant = |seconds: Option<f64>| match seconds {
        Some(seconds) if !seconds.is_finite() => {
            Err(Failure::Usage(format!("{seconds} s is no time of a recording")))
        }
        Some(seconds) => Ok(Some(recording.at_seconds(seconds))),
        None => Ok(None),
    };
    if let (Some(from), Some(to)) = (arguments.from, arguments.to)
        && from > to
    {
        return Err(Failure::Usage(format!("--from {from} is after --to {to}")));
    }
    let selection = Selection {
        from: instant(arguments.from)?,
        to: instant(arguments.to)?,
        topics: arguments.topics.clone(),
        exclude: arguments.exclude.clone(),
        channels: None,
    };
    for topic in &arguments.topics {
        let one = Selection::topic(topic);
        if !recording.channels().iter().any(|channel| one.wants(channel)) {
            let file = arguments.file.display();
            return Err(Failure::Usage(format!("--topic {topic}: {file} has no such topic")));
        }
    }
    Ok(selection)
}

fn make(
    arguments: &Arguments,
    recording: &Recording,
    selection: &Selection,
    part: &Path,
) -> Result<recording::Piece, Failure> {
    let failed = |source| Failure::File { path: part.to_owned(), source };
    let file = OpenOptions::new().write(true).create_new(true).open(part).map_err(failed)?;
    let options = WriteOptions { compression: arguments.compression.into(), ..WriteOptions::default() };
    let name =
        arguments.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let (sink, piece) =
        recording::cut(recording, selection, options, &name, BufWriter::new(file)).map_err(|error| {
            match error {
                CutError::Read(error) => Failure::Read(error),
                CutError::Write(WriteError::Sink(source)) => failed(source),
                other => Failure::Recording { path: arguments.file.clone(), reason: other.to_string() },
            }
        })?;
    let file = sink.into_inner().map_err(|error| failed(error.into_error()))?;
    file.sync_all().map_err(failed)?;
    Ok(piece)
}

fn default_output(file: &Path) -> PathBuf {
    let name = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let stem = name.strip_suffix(".part").unwrap_or(&name);
    let stem = stem.strip_suffix(".mcap").unwrap_or(stem);
    file.with_file_name(format!("{stem}.cut.mcap"))
}
