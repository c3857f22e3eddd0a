//! `arena export`: a recording as other programs take it.

use std::fs::File;
use std::io::{self, BufWriter, IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{ArgGroup, Args};
use recording::Recording;
use recording::export::{Address, ExportError, Outcome, Wanted, export_csv, export_json, export_ros2};

use super::Failure;
use super::listening::{Stretch, address, conclude, export_failure};

/// Options of `arena export`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("form").required(true).args(["csv", "json", "ros2"]))]
pub struct Arguments {
    /// A recording; the segments that follow it belong to it.
    file: PathBuf,
    /// Topics, or fields of them, that are wanted; everything if none is named.
    #[arg(value_name = "TOPIC[.FIELD]")]
    fields: Vec<String>,
    /// A topic that is wanted; may be given several times.
    #[arg(long, value_name = "TOPIC")]
    topic: Vec<String>,
    /// A table: seconds since the beginning, the vehicle where messages name one, then a column per field.
    #[arg(long)]
    csv: bool,
    /// One JSON object per message and line.
    #[arg(long)]
    json: bool,
    /// An MCAP file for ROS 2's tools: bodies in CDR, definitions as ros2msg.
    #[arg(long)]
    ros2: bool,
    /// Only messages that name this vehicle.
    #[arg(long, value_name = "ID", conflicts_with = "ros2")]
    vehicle: Option<u64>,
    /// Where to write; of --csv also a folder, which gets a file per topic [default: standard output; of
    /// --ros2 FILE.ros2.mcap].
    #[arg(long, short, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    stretch: Stretch,
}

/// Runs the command: exit code 1 where something could not be read or turned into what was asked for.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let recording = Recording::open(&arguments.file)?;
    let mut addresses = Vec::new();
    for text in arguments.fields.iter().chain(&arguments.topic) {
        addresses.push(address(&recording, text)?);
    }
    let (from, to) = arguments.stretch.ends(&recording)?;
    let wanted = Wanted { addresses, from, to, vehicle: arguments.vehicle };
    if arguments.ros2 {
        return to_ros2(arguments, &recording, &wanted);
    }
    let outcome = match &arguments.output {
        Some(folder) if arguments.csv && is_folder(folder) => {
            to_folder(arguments, &recording, &wanted, folder)?
        }
        Some(path) => {
            refuse_own(&recording, path)?;
            let mut sink = BufWriter::new(create(path)?);
            let outcome = write(arguments, &recording, &wanted, &mut sink)?;
            sink.flush().map_err(|source| Failure::File { path: path.clone(), source })?;
            outcome
        }
        None => write(arguments, &recording, &wanted, &mut io::stdout().lock())?,
    };
    Ok(conclude(&outcome))
}

fn write(
    arguments: &Arguments,
    recording: &Recording,
    wanted: &Wanted,
    sink: &mut dyn Write,
) -> Result<Outcome, Failure> {
    let written = if arguments.csv {
        export_csv(recording, wanted, sink)
    } else {
        export_json(recording, wanted, sink)
    };
    written.map_err(|error| match (&arguments.output, error) {
        (Some(path), ExportError::Sink(source)) => Failure::File { path: path.clone(), source },
        (_, error) => export_failure(&arguments.file, error),
    })
}

/// A file per topic.
fn to_folder(
    arguments: &Arguments,
    recording: &Recording,
    wanted: &Wanted,
    folder: &Path,
) -> Result<Outcome, Failure> {
    std::fs::create_dir_all(folder).map_err(|source| Failure::File { path: folder.to_owned(), source })?;
    let selection = wanted.selection();
    let mut topics: Vec<&str> = recording
        .channels()
        .iter()
        .filter(|channel| selection.wants(channel) && channel.definition.is_some())
        .map(|channel| channel.topic.as_str())
        .collect();
    topics.sort_unstable();
    topics.dedup();
    let mut whole = Outcome::default();
    for topic in topics {
        let of_topic = wanted.addresses.iter().filter(|address| address.topic == topic).cloned();
        let mut addresses: Vec<Address> = of_topic.collect();
        if addresses.is_empty() {
            addresses.push(Address { topic: topic.to_owned(), field: None });
        }
        let path = folder.join(file_name(topic));
        refuse_own(recording, &path)?;
        let mut sink = BufWriter::new(create(&path)?);
        let outcome = match write(arguments, recording, &Wanted { addresses, ..wanted.clone() }, &mut sink) {
            // Of several topics, those that name no vehicle are not about the one that is wanted.
            Err(Failure::Usage(_)) if wanted.vehicle.is_some() && wanted.addresses.is_empty() => {
                std::fs::remove_file(&path).map_err(|source| Failure::File { path: path.clone(), source })?;
                continue;
            }
            written => written?,
        };
        sink.flush().map_err(|source| Failure::File { path: path.clone(), source })?;
        whole.absorb(outcome);
    }
    Ok(whole)
}

fn to_ros2(arguments: &Arguments, recording: &Recording, wanted: &Wanted) -> Result<ExitCode, Failure> {
    if let Some(address) = wanted.addresses.iter().find(|address| address.field.is_some()) {
        let field = address.field.as_deref().unwrap_or("");
        return Err(Failure::Usage(format!("{}.{field}: --ros2 takes whole topics", address.topic)));
    }
    let path = arguments.output.clone().unwrap_or_else(|| arguments.file.with_extension("ros2.mcap"));
    refuse_own(recording, &path)?;
    let sink = BufWriter::new(create(&path)?);
    let outcome = export_ros2(recording, &wanted.selection(), sink).map_err(|error| match error {
        ExportError::Library(_) => Failure::Recording { path: path.clone(), reason: error.to_string() },
        error => export_failure(&arguments.file, error),
    })?;
    if io::stderr().is_terminal() {
        eprintln!("{} messages in {}", outcome.written, path.display());
    }
    Ok(conclude(&outcome))
}

fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/")
}

fn file_name(topic: &str) -> String {
    let plain = |letter: char| if letter.is_alphanumeric() || "-_.".contains(letter) { letter } else { '_' };
    topic.chars().map(plain).collect::<String>() + ".csv"
}

/// A recording is not to be written over by what is made of it.
pub(super) fn refuse_own(recording: &Recording, output: &Path) -> Result<(), Failure> {
    let Ok(output) = output.canonicalize() else { return Ok(()) };
    let own = recording
        .segments()
        .iter()
        .find(|segment| segment.path.canonicalize().is_ok_and(|path| path == output));
    match own {
        Some(segment) => Err(Failure::Usage(format!("{}: is the recording itself", segment.path.display()))),
        None => Ok(()),
    }
}

fn create(path: &Path) -> Result<File, Failure> {
    File::create(path).map_err(|source| Failure::File { path: path.to_owned(), source })
}
