//! `arena verify`: executes the services of a recording again, and says where the first bit differs.

use std::io::{IsTerminal as _, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use front_door::experiment;
use quantity::Time;
use recording::Recording;
use recording::verify::{
    Cause, Comparison, Damage, Divergence, DivergenceKind, Outcome, Report, Verdict, verify,
};
use settings::Arena;

use super::Failure;

/// Options of `arena verify`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A recording; the segments that follow it belong to it.
    file: PathBuf,
    /// Execute only this service.
    service: Option<String>,
    /// Execute with the settings of this folder instead of the recorded ones.
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// The scenario to take from that folder; the recorded one if not given.
    #[arg(long, value_name = "NAME", requires = "config")]
    scenario: Option<String>,
    /// Print one JSON object to standard output.
    #[arg(long)]
    json: bool,
}

/// Progress is shown so often, and only for what takes so long.
const PROGRESS_PERIOD: Duration = Duration::from_secs(1);
/// The clock is looked at once in so many messages.
const MESSAGES_PER_LOOK: u32 = 4096;

/// Runs the command: exit code 0 only where every journalled step of every service came out the same.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let recording = Recording::open(&arguments.file)?;
    let settings = settings(arguments, &recording)?;
    let started = Instant::now();
    let mut progress = Progress::new(&recording);
    let only = arguments.service.as_deref();
    let report = verify(&recording, &experiment::core, &settings, only, &mut |at| progress.tell(at));
    progress.end();
    let wall_s = started.elapsed().as_secs_f64();
    if let Some(service) = only
        && report.verdicts.is_empty()
        && report.unjournalled.is_empty()
    {
        return Err(Failure::Usage(format!("{}: nothing of {service} in it", arguments.file.display())));
    }
    let mut out = std::io::stdout().lock();
    if arguments.json {
        write_json(&mut out, arguments, &report, wall_s)?;
    } else {
        write_text(&mut out, &recording, &report, wall_s)?;
    }
    out.flush()?;
    Ok(if report.holds() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn settings(arguments: &Arguments, recording: &Recording) -> Result<Arena, Failure> {
    if let Some(folder) = &arguments.config {
        let recorded = || recording.about().map(|about| about.scenario.clone());
        let scenario = arguments.scenario.clone().or_else(recorded);
        let scenario = scenario.ok_or_else(|| {
            Failure::Usage(format!("{}: it names no scenario; give --scenario", arguments.file.display()))
        })?;
        return Ok(Arena::load(folder, &scenario)?);
    }
    recording.settings()?.ok_or_else(|| {
        Failure::Usage(format!("{}: it has no settings; give --config DIR", arguments.file.display()))
    })
}

/// Says on standard error how far a long verification has come.
struct Progress<'a> {
    recording: &'a Recording,
    shown_at: Instant,
    messages: u32,
    shown: bool,
    is_terminal: bool,
}

impl<'a> Progress<'a> {
    fn new(recording: &'a Recording) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        Self { recording, shown_at: Instant::now(), messages: 0, shown: false, is_terminal }
    }

    fn tell(&mut self, at: Time) {
        self.messages = self.messages.wrapping_add(1);
        let look = self.is_terminal && self.messages.is_multiple_of(MESSAGES_PER_LOOK);
        if !look || self.shown_at.elapsed() < PROGRESS_PERIOD {
            return;
        }
        (self.shown_at, self.shown) = (Instant::now(), true);
        let end = self.recording.time_range().map_or(at, |(_, to)| to);
        let seconds = |at| self.recording.seconds_at(at);
        // Progress is for people: a closed pipe must not end the work.
        let _ = write!(std::io::stderr(), "\r{:.0} of {:.0} s", seconds(at), seconds(end));
    }

    fn end(&self) {
        if self.shown {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}

fn times_real_time(report: &Report, wall_s: f64) -> f64 {
    report.span().as_secs_f64() / wall_s
}

fn write_json(
    out: &mut dyn Write,
    arguments: &Arguments,
    report: &Report,
    wall_s: f64,
) -> Result<(), Failure> {
    let mut object = serde_json::to_value(report).map_err(std::io::Error::from)?;
    object["file"] = arguments.file.display().to_string().into();
    object["holds"] = report.holds().into();
    object["wall_s"] = wall_s.into();
    object["times_real_time"] = times_real_time(report, wall_s).into();
    writeln!(out, "{object}")?;
    Ok(())
}

fn write_text(
    out: &mut dyn Write,
    recording: &Recording,
    report: &Report,
    wall_s: f64,
) -> Result<(), Failure> {
    let seconds = |at: Time| format!("{:.6} s", recording.seconds_at(at));
    for verdict in &report.verdicts {
        let Verdict { service, incarnation, .. } = verdict;
        writeln!(out, "{service:<16} incarnation {incarnation}: {}", summary(verdict, &seconds))?;
        if let Outcome::Diverged(divergence) = &verdict.outcome {
            write_divergence(out, divergence)?;
        }
        if let Some(damage) = &verdict.first_damage {
            let Damage { step, at, message } = &**damage;
            writeln!(out, "  said in step {step} ({}), and not what is recorded:", seconds(*at))?;
            write_comparison(out, message)?;
        }
        if let Some(other) = verdict.settings {
            let (had, given) = (other.had, other.given);
            writeln!(out, "  note: it had settings {had:016x} and is executed with {given:016x}")?;
        }
    }
    for node in &report.unjournalled {
        writeln!(out, "{:<16} incarnation {}: keeps no journal", node.service, node.incarnation)?;
    }
    if report.verdicts.is_empty() {
        writeln!(out, "no journal in it: nothing is proven")?;
    }
    if let Some(reason) = &report.unreadable {
        writeln!(out, "not all of it can be read: {reason}")?;
    }
    writeln!(
        out,
        "{} messages, {:.1} s, verified in {wall_s:.2} s: {:.0} times real time",
        report.messages,
        report.span().as_secs_f64(),
        times_real_time(report, wall_s)
    )?;
    Ok(())
}

fn summary(verdict: &Verdict, seconds: &dyn Fn(Time) -> String) -> String {
    let Verdict { steps_identical, steps_journalled, copies_absent, copies_damaged, .. } = verdict;
    let mut text = match &verdict.outcome {
        Outcome::Identical => format!("identical, {steps_identical} steps"),
        Outcome::Diverged(divergence) => {
            let Divergence { step, at, .. } = &**divergence;
            format!("first divergence at step {step} of {steps_journalled}, at {}", seconds(*at))
        }
        Outcome::Unverifiable { from_step, at, reason } => {
            let at = at.map_or_else(String::new, |at| format!(", at {}", seconds(at)));
            format!("identical, {steps_identical} steps; unverifiable from step {from_step}{at}: {reason}")
        }
    };
    if *copies_damaged > 0 {
        text.push_str(&format!("; {copies_damaged} of its messages are recorded otherwise"));
    }
    if *copies_absent > 0 {
        text.push_str(&format!("; {copies_absent} of its messages were not recorded"));
    }
    text
}

fn write_divergence(out: &mut dyn Write, divergence: &Divergence) -> Result<(), Failure> {
    match &divergence.cause {
        Cause::Deadline => writeln!(out, "  cause: its own deadline")?,
        Cause::Message { input, fields } => {
            writeln!(out, "  cause: {input}")?;
            for (path, value) in fields {
                writeln!(out, "      {path:<40} {value}")?;
            }
        }
    }
    match &divergence.kind {
        DivergenceKind::Output { outputs_then, outputs_now } => {
            writeln!(out, "  messages then: {outputs_then}, now: {outputs_now}")?;
        }
        DivergenceKind::Deadline { now: None } => {
            writeln!(out, "  woken then; now it has no deadline")?;
        }
        DivergenceKind::Deadline { now: Some(now) } => {
            writeln!(out, "  woken at {} then; now its deadline is {now}", divergence.at)?;
        }
    }
    for message in &divergence.messages {
        write_comparison(out, message)?;
    }
    if !divergence.recorded_proven {
        writeln!(
            out,
            "  what was said then is not all recorded as it was said: the journal's digest differs"
        )?;
    }
    Ok(())
}

fn write_comparison(out: &mut dyn Write, comparison: &Comparison) -> Result<(), Failure> {
    let Comparison { topic, sequence, is_recorded, is_produced, fields } = comparison;
    let where_found = match (is_recorded, is_produced) {
        (true, true) => "recorded | now",
        (true, false) => "recorded, not said now",
        (false, _) => "said now, not recorded",
    };
    writeln!(out, "  {topic} number {sequence}: {where_found}")?;
    for field in fields {
        let mark = if field.differs() { '!' } else { ' ' };
        let value = |side: &Option<String>| side.clone().unwrap_or_else(|| "-".to_owned());
        let (recorded, produced) = (value(&field.recorded), value(&field.produced));
        let path = &field.path;
        if field.differs() && *is_recorded && *is_produced {
            writeln!(out, "    {mark} {path:<40} {recorded} | {produced}")?;
        } else {
            let only = if *is_recorded { recorded } else { produced };
            writeln!(out, "    {mark} {path:<40} {only}")?;
        }
    }
    Ok(())
}
