//! `arena learn`: an experiment in virtual time, its report and its pictures.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use front_door::experiment::{self, Observer};
use front_door::pictures;
use front_door::report::{FlipReport, LearnReport};
use front_door::virtual_recording::VirtualRecording;
use quantity::Span;
use schemas::{NodeEvent, Severity};
use settings::{Arena, ConfigError};
use virtual_arena::{Heard, VirtualArena};

use super::Failure;

/// Options of `arena learn`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A scenario of `config/scenarios/`.
    scenario: String,
    /// Flips to fly, instead of the scenario's number.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    iterations: Option<u32>,
    /// Seed of everything random.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Fly this many seeds, from `--seed` on, and print how their outcomes are distributed.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    seeds: Option<u64>,
    /// Record every datagram into this file. The learning is the same with and without, and the file has the same bytes
    /// for the same seed.
    #[arg(long, value_name = "FILE", conflicts_with = "seeds")]
    record: Option<PathBuf>,
    /// Print one JSON object to standard output and progress to standard error.
    #[arg(long)]
    json: bool,
    /// Folder for the results; `out/SCENARIO-seed-S` if not given.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of the settings.
    #[arg(long, value_name = "DIR", default_value = "config")]
    config: PathBuf,
}

/// A recording on its way to the file it will be: while it is not whole, its name says so.
struct Recorder<'a> {
    path: &'a Path,
    settings: &'a Arena,
    file: Option<File>,
    recording: Option<VirtualRecording<BufWriter<File>>>,
    failed: Option<Failure>,
}

impl<'a> Recorder<'a> {
    fn new(path: &'a Path, settings: &'a Arena) -> Result<Self, Failure> {
        let part = recording::part_of(path);
        let file = File::create(&part).map_err(|source| Failure::File { path: part, source })?;
        Ok(Self { path, settings, file: Some(file), recording: None, failed: None })
    }

    fn begin(&mut self, flying: &VirtualArena<'_>) {
        let Some(file) = self.file.take() else { return };
        match VirtualRecording::begin(BufWriter::new(file), flying, self.settings) {
            Ok(recording) => self.recording = Some(recording),
            Err(error) => self.failed = Some(self.failure(error)),
        }
    }

    fn finish(mut self) -> Result<(), Failure> {
        if let Some(recording) = self.recording.take() {
            recording.finish().map_err(|error| self.failure(error))?;
        }
        self.failed.map_or(Ok(()), Err)?;
        std::fs::rename(recording::part_of(self.path), self.path)
            .map_err(|source| Failure::File { path: self.path.to_owned(), source })
    }

    fn failure(&self, error: recording::WriteError) -> Failure {
        Failure::Recording { path: recording::part_of(self.path), reason: error.to_string() }
    }
}

/// Prints a line per flip while the experiment runs, and records it if asked to.
struct Progress<'a> {
    json: bool,
    flips: u32,
    recorder: Option<Recorder<'a>>,
}

impl Observer for Progress<'_> {
    fn begin(&mut self, flying: &VirtualArena<'_>) {
        if let Some(recorder) = &mut self.recorder {
            recorder.begin(flying);
        }
    }

    fn heard(&mut self, heard: &Heard<'_>) {
        if let Some(recording) = self.recorder.as_mut().and_then(|recorder| recorder.recording.as_mut()) {
            recording.hear(heard);
        }
    }

    fn flip(&mut self, vehicle: u8, flip: &FlipReport) {
        self.flips += 1;
        // Progress is for people: a closed pipe must not end the experiment.
        let _ = if self.json {
            writeln!(std::io::stderr(), "{}", flip.line(vehicle))
        } else {
            writeln!(std::io::stdout(), "{}", flip.line(vehicle))
        };
    }

    fn event(&mut self, event: &NodeEvent) {
        if event.severity != Severity::Info {
            let _ = writeln!(
                std::io::stderr(),
                "{} vehicle {} {}: {} ({})",
                event.at,
                event.vehicle,
                event.node,
                event.name,
                event.detail
            );
        }
    }

    fn progress(&mut self, _elapsed: Span) {}
}

/// Runs the command: exit code 1 where a vehicle's learning stopped before its time.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut arena = Arena::load(&arguments.config, &arguments.scenario)?;
    let Some(flip) = &mut arena.scenario.flip else {
        let reason =
            "it has no [flip]: its vehicles hover, and there is nothing to learn (arena up flies it)";
        let file = format!("scenarios/{}.toml", arguments.scenario);
        return Err(ConfigError::Malformed { file, reason: reason.to_owned() }.into());
    };
    flip.iterations = arguments.iterations.unwrap_or(flip.iterations);
    if let Some(seeds) = arguments.seeds {
        return super::seeds::run(&arena, arguments.seed..arguments.seed + seeds, arguments.json);
    }
    let started = Instant::now();
    let recorder = arguments.record.as_deref().map(|path| Recorder::new(path, &arena)).transpose()?;
    let mut progress = Progress { json: arguments.json, flips: 0, recorder };
    let flown = experiment::learn(&arena, arguments.seed, &mut progress)?;
    // What could not be recorded does not take the results away.
    let recorded = progress.recorder.take().map_or(Ok(()), Recorder::finish);
    let mut report = flown.report;
    report.wall_s = started.elapsed().as_secs_f64();
    let folder = arguments.out.clone().unwrap_or_else(|| {
        PathBuf::from("out").join(format!("{}-seed-{}", arguments.scenario, arguments.seed))
    });
    write_results(&folder, &report)?;
    for (stem, svg) in front_door::figures::all(&arena, &report, &flown.side_views)? {
        pictures::write(&folder, &stem, &svg)?;
    }
    let mut out = std::io::stdout().lock();
    if arguments.json {
        writeln!(out, "{}", serde_json::to_string(&report).map_err(std::io::Error::from)?)?;
    } else {
        writeln!(
            out,
            "\n{} flips in {:.0} virtual seconds, {:.2} s of wall time ({:.0} times real time)\ndigest {}\nresults and pictures in {}",
            progress.flips,
            report.virtual_s,
            report.wall_s,
            report.virtual_s / report.wall_s,
            report.digest,
            folder.display()
        )?;
    }
    let mut stopped = false;
    for vehicle in &report.vehicles {
        if let Some(reason) = &vehicle.stopped {
            stopped = true;
            eprintln!("vehicle {} stopped learning: {reason}", vehicle.id);
        }
    }
    recorded?;
    Ok(if stopped { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn write_results(folder: &Path, report: &LearnReport) -> Result<(), Failure> {
    let at = |path: &Path| {
        let path = path.to_owned();
        move |source| Failure::File { path, source }
    };
    std::fs::create_dir_all(folder).map_err(at(folder))?;
    let json = serde_json::to_string_pretty(report).map_err(std::io::Error::from)?;
    for (name, text) in [("results.json", json), ("results.csv", report.to_csv())] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(at(&path))?;
    }
    Ok(())
}
