//! Playback's command line, for its own binary and for the front door alike.

use std::path::{Path, PathBuf};

use clap::Args;
use quantity::Span;
use service_shell::{Options as ShellOptions, load_arena, parse_run};
use settings::{Arena, Network};

use crate::pace::Rate;
use crate::plan::{Await, Place, Plan};
use crate::recorded::Recorded;
use crate::selection::Selection;
use crate::{NAME, PlayError};

/// What playback can be told.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Options {
    /// The recording: its file, or the first of its segments
    pub file: PathBuf,
    /// How fast: 0.1 to 20, or `max` for as fast as the services of the replay can follow, in lock step
    #[arg(long, value_name = "RATE", default_value_t = Rate::REAL_TIME)]
    pub rate: Rate,
    /// Where to begin, in seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub start: Option<Span>,
    /// Where to end, in seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub end: Option<Span>,
    /// Begin again at the end
    #[arg(long = "loop")]
    pub looped: bool,
    /// Play this topic and no others but those also included; a `*` at the end stands for any ending
    #[arg(long, value_name = "TOPIC")]
    pub include: Vec<String>,
    /// Do not play this topic
    #[arg(long, value_name = "TOPIC")]
    pub exclude: Vec<String>,
    /// Play a topic under another name
    #[arg(long, value_name = "FROM=TO", value_parser = renaming)]
    pub rename: Vec<(String, String)>,
    /// Play the nodes' journals too, of which no service takes notice
    #[arg(long)]
    pub journals: bool,
    /// Stand still at first, and wait for orders on standard input
    #[arg(long)]
    pub paused: bool,
    /// Stand still at first; an empty line on standard input plays one message
    #[arg(long)]
    pub step: bool,
    /// Begin only when so many services of the replay have answered
    #[arg(long = "await", value_name = "N", default_value_t = 0)]
    pub awaits: usize,
    /// Print the summary as a JSON object
    #[arg(long)]
    pub json: bool,
    /// Folder of the settings that say which network to use [default: config if there is one, else the recording's]
    #[arg(long, value_name = "DIR")]
    pub config: Option<PathBuf>,
    /// Id of the replay's run to join, in hexadecimal [default: a new one, written to .flyarena/replay-run]
    #[arg(long, value_name = "HEX", value_parser = parse_run)]
    pub run: Option<u64>,
    /// File with the arena's secret [default: $FLYARENA_SECRET_FILE, else .flyarena/secret]
    #[arg(long, value_name = "FILE")]
    pub secret_file: Option<PathBuf>,
}

impl Options {
    /// What these options ask to be played.
    #[must_use]
    pub fn plan(&self) -> Plan {
        Plan {
            selection: Selection {
                include: self.include.clone(),
                exclude: self.exclude.clone(),
                rename: self.rename.clone(),
                journals: self.journals,
                running: Vec::new(),
            },
            rate: self.rate,
            start: self.start,
            end: self.end,
            looped: self.looped,
            paused: self.paused || self.step,
            awaits: Await::Count(self.awaits),
        }
    }

    /// Where to play: a run of its own, unless one is to be joined.
    ///
    /// # Errors
    /// Settings, secret or run file that cannot be used.
    pub fn place(&self, recorded: &Recorded) -> Result<Place, PlayError> {
        let network = network(self.config.as_deref(), recorded)?;
        let secret_file = service_shell::secret_file(self.secret_file.as_deref());
        service_shell::create_secret_if_absent(&secret_file)?;
        let secret = service_shell::read_secret(&secret_file)?;
        let run = match self.run {
            Some(run) => run,
            None => begin_run()?,
        };
        Ok(Place { network, secret, run, incarnation: service_shell::incarnation_now() })
    }
}

/// Draws the id of a new replay's run and leaves it where services that are started by hand look for it.
///
/// # Errors
/// What the system says.
pub fn begin_run() -> Result<u64, PlayError> {
    let run = service_shell::new_run()?;
    service_shell::write_run(&service_shell::run_file_of(wire::Domain::Replay), run)?;
    Ok(run)
}

/// The network to play on: that of a folder of settings, since a recording may come from another host; the recording's
/// own where there is no folder.
///
/// # Errors
/// Settings that cannot be used, or none at all.
pub fn network(config: Option<&Path>, recorded: &Recorded) -> Result<Network, PlayError> {
    let default = Path::new("config");
    if let Some(folder) = config.or_else(|| default.is_dir().then_some(default)) {
        let known = Arena::scenarios(folder).map_err(service_shell::ShellError::from)?;
        let scenario = known.into_iter().next().unwrap_or_default();
        let options = ShellOptions { config: folder.to_owned(), scenario, ..ShellOptions::default() };
        return Ok(load_arena(&options)?.network);
    }
    match recorded.settings()? {
        Some(arena) => Ok(arena.network),
        None => Err(PlayError::NoSettings),
    }
}

fn seconds(text: &str) -> Result<Span, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds >= 0.0 && seconds.is_finite() => Ok(Span::from_secs_f64(seconds)),
        _ => Err("seconds from the recording's beginning, zero or more".to_owned()),
    }
}

fn renaming(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((from, to)) if !from.is_empty() && !to.is_empty() => Ok((from.to_owned(), to.to_owned())),
        _ => Err("a topic's name, `=`, its new name".to_owned()),
    }
}

/// Puts a recording back on the bus, in the replay domain
#[derive(Clone, Debug, clap::Parser)]
#[command(name = NAME, version)]
pub(crate) struct CommandLine {
    #[command(flatten)]
    pub options: Options,
    /// What to log, for example `info` or `warn,playback=debug`
    #[arg(long, value_name = "FILTER", default_value = "warn")]
    pub log: String,
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    fn parse(line: &str) -> Result<Options, clap::Error> {
        CommandLine::try_parse_from([NAME].into_iter().chain(line.split(' '))).map(|line| line.options)
    }

    #[test]
    fn a_line_becomes_a_plan() {
        let plan =
            parse("a.mcap --rate 0.5 --start 1.5 --end 9 --loop --step --exclude b --rename c=d --await 2")
                .unwrap()
                .plan();
        assert_eq!(
            plan,
            Plan {
                selection: Selection {
                    exclude: vec!["b".to_owned()],
                    rename: vec![("c".to_owned(), "d".to_owned())],
                    ..Selection::default()
                },
                rate: Rate::Ratio(0.5),
                start: Some(Span::from_millis(1_500)),
                end: Some(Span::from_secs(9)),
                looped: true,
                paused: true,
                awaits: Await::Count(2),
            }
        );
        assert_eq!(parse("a.mcap").unwrap().plan(), Plan::default());
    }

    #[test]
    fn what_cannot_be_is_refused_and_no_domain_can_be_named() {
        for line in [
            "",
            "a.mcap --rate 0",
            "a.mcap --start -1",
            "a.mcap --end never",
            "a.mcap --rename a",
            "a.mcap --rename =b",
            "a.mcap --domain live",
            "a.mcap --domain sim",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
