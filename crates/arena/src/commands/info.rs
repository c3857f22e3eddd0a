//! `arena info`: what a recording is, and what is in it.

use std::collections::BTreeSet;
use std::io::{IsTerminal as _, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use front_door::contents::{Contents, utc};
use recording::{Condition, Recording, Selection};

use super::Failure;

/// Options of `arena info`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Recordings; the segments that follow one belong to it.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Read only the index: at once also for a huge recording, but without sizes, missing numbers and a look
    /// at every checksum.
    #[arg(long)]
    quick: bool,
    /// Print one JSON object a recording.
    #[arg(long)]
    json: bool,
}

/// Progress is shown so often, and only for what takes so long.
const PROGRESS_PERIOD: Duration = Duration::from_secs(1);

/// Runs the command: exit code 1 where something is damaged. A torn recording is none of that: it says so.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut shown = BTreeSet::new();
    let mut damaged = false;
    for file in &arguments.files {
        let canonical = file.canonicalize().unwrap_or_else(|_| file.clone());
        if shown.contains(&canonical) {
            continue;
        }
        let recording = Recording::open(file)?;
        let segments = recording.segments().iter();
        shown.extend(segments.map(|segment| segment.path.canonicalize().unwrap_or(segment.path.clone())));
        let contents = contents(&recording, arguments.quick);
        damaged |= !contents.damage.is_empty();
        let mut out = std::io::stdout().lock();
        if arguments.json {
            writeln!(out, "{}", contents.json(&recording))?;
        } else {
            write(&mut out, &recording, &contents)?;
        }
    }
    Ok(if damaged { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn contents(recording: &Recording, quick: bool) -> Contents {
    if quick {
        return Contents::of_index(recording);
    }
    let total = recording.message_count();
    let mut next = Instant::now() + PROGRESS_PERIOD;
    let shown = std::io::stderr().is_terminal();
    let gaps = recording.gaps(&Selection::all(), |read| {
        if shown && Instant::now() >= next {
            next = Instant::now() + PROGRESS_PERIOD;
            eprint!("\rreading: {read} of {total} messages ");
        }
    });
    if shown {
        // Wipes the line, if there is one.
        eprint!("\r\x1b[K");
    }
    Contents::of_all(recording, &gaps)
}

fn write(out: &mut impl Write, recording: &Recording, contents: &Contents) -> Result<(), Failure> {
    for segment in recording.segments() {
        let condition = in_words(&segment.condition);
        let (path, bytes, messages) = (segment.path.display(), segment.bytes, segment.messages);
        writeln!(
            out,
            "{path}: {bytes} bytes, {messages} messages in {} chunks; {condition}",
            segment.chunks
        )?;
    }
    match recording.about() {
        Some(about) => {
            let (domain, run, scenario) = (about.domain.name(), about.run, &about.scenario);
            writeln!(out, "  arena     {domain}, run {run:016x}, scenario {scenario}")?;
            let revision = if about.revision.is_empty() { "unknown" } else { &about.revision };
            let (wall, host) = (utc(about.started_wall_ns), &about.host);
            writeln!(out, "  recorded  {wall} on {host}, revision {revision}")?;
            writeln!(
                out,
                "  identity  recording {:016x}, settings {:016x}",
                about.recording, about.settings_digest
            )?;
        }
        None => writeln!(out, "  written by {:?}, profile {:?}", recording.library(), recording.profile())?,
    }
    if let Some((first, last)) = recording.time_range() {
        let (first_s, last_s) = (recording.seconds_at(first), recording.seconds_at(last));
        writeln!(out, "  messages  {} from {first_s:.3} s to {last_s:.3} s", recording.message_count())?;
    }
    match recording.ending() {
        Some(ending) => {
            let (full, stopped) = (ending.dropped_full, ending.dropped_stopped);
            let (refused, overflowed) = (ending.refused, ending.overflowed);
            writeln!(
                out,
                "  ended     {}; dropped by the recorder: {full} (disk too slow), {stopped} (no file open); \
                 by the kernel: {overflowed}; refused: {refused}",
                ending.reason
            )?;
        }
        None if recording.about().is_some() => {
            writeln!(out, "  ended     nothing says how: it was not sealed")?
        }
        None => {}
    }
    let attachments: Vec<&str> = recording.attachments().into_iter().collect();
    if !attachments.is_empty() {
        writeln!(out, "  attached  {}", attachments.join(", "))?;
    }
    for error in &contents.damage {
        writeln!(out, "  DAMAGED   {error}")?;
    }
    write!(out, "{}", contents.table(recording))?;
    Ok(())
}

fn in_words(condition: &Condition) -> String {
    match condition {
        Condition::Sealed => "sealed".to_owned(),
        Condition::WithoutSummary => "whole, but without a summary that holds".to_owned(),
        Condition::Torn { whole_bytes, lost_bytes } => {
            format!(
                "torn after byte {whole_bytes}, {lost_bytes} bytes lost: not sealed, or still being written"
            )
        }
        Condition::Damaged { whole_bytes, lost_bytes } => {
            format!("damaged at byte {whole_bytes}, {lost_bytes} bytes lost")
        }
    }
}
