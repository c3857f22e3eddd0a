//! `arena record`: everything on the bus into an MCAP file.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use logger::{RecordOptions, Telling};
use quantity::{Span, Time};
use recording::Notice;
use reflect::Text;
use schemas::{LoggerOrder, LoggerOrderKind, LoggerState, LoggerStatus, NodeEvent, Severity, topics};
use serde_json::json;
use service_core::{Identity, Observer, Publisher, source_of};
use service_shell::{
    BusReceiver, BusSender, DomainOption, Listen, Options, Setup, ShellError, block_on, clock,
};

use super::Failure;

/// How long a logger may take to write what it keeps in memory.
const ANSWER_MAX: Span = Span::from_secs(30);
/// An order is repeated until it is answered: the bus may lose it.
const REPEAT_PERIOD: Duration = Duration::from_millis(300);

/// Options of `arena record`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    record: RecordOptions,
    /// Tell the logger that runs with --snapshot to write what it keeps in memory, and end.
    #[arg(long, conflicts_with_all = ["file", "duration", "snapshot", "keep"])]
    dump: bool,
    /// Print one JSON object per line: how the recording fares, and what happens.
    #[arg(long)]
    json: bool,
    /// The scenario that runs: its settings are attached to the recording.
    #[arg(long, value_name = "NAME", default_value = "double-flip")]
    scenario: String,
    /// Folder of the settings.
    #[arg(long, value_name = "DIR", default_value = "config")]
    config: PathBuf,
    /// All settings in one file, as a recording carries them, instead of --config and --scenario.
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// What is listened to.
    #[arg(long, value_enum, default_value_t)]
    domain: DomainOption,
    /// Id of the run, in hexadecimal [default: the newest of this folder].
    #[arg(long, value_name = "HEX", value_parser = service_shell::parse_run)]
    run: Option<u64>,
    /// File with the arena's secret [default: $FLYARENA_SECRET_FILE, else .flyarena/secret].
    #[arg(long, value_name = "FILE")]
    secret_file: Option<PathBuf>,
    /// What to log on standard error.
    #[arg(long, value_name = "FILTER", default_value = "error")]
    log: String,
}

impl Arguments {
    fn options(&self) -> Options {
        Options {
            config: self.config.clone(),
            scenario: self.scenario.clone(),
            settings: self.settings.clone(),
            domain: self.domain,
            run: self.run,
            secret_file: self.secret_file.clone(),
            log: self.log.clone(),
            ..Options::default()
        }
    }
}

/// Runs the command: exit code 1 if the recording had to stop before it was told to.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging(&arguments.log);
    if arguments.dump {
        return dump(arguments);
    }
    let mut display = Display { json: arguments.json, ..Display::default() };
    let status =
        logger::run_with(&arguments.options().joining(), &arguments.record, &mut |telling| match telling {
            Telling::Status(status) => display.status(status),
            Telling::Notice(notice) => display.notice(notice),
        })?;
    display.end(&status)?;
    Ok(if display.failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// What a person or a program sees of a recording.
#[derive(Debug, Default)]
struct Display {
    json: bool,
    failed: bool,
    line_open: bool,
}

impl Display {
    fn status(&mut self, status: &LoggerStatus) {
        if self.json {
            return print_object(&status_object("status", status));
        }
        let mut errors = io::stderr().lock();
        if errors.is_terminal() {
            // What nobody can see does not matter.
            let _ = write!(errors, "\r\x1b[K{}", summary(status));
            let _ = errors.flush();
            self.line_open = true;
        }
    }

    fn notice(&mut self, notice: &Notice) {
        self.failed |= notice.severity == Severity::Fault;
        let Notice { severity, name, detail } = notice;
        if self.json {
            let severity = severity_word(*severity);
            return print_object(
                &json!({ "event": "notice", "severity": severity, "name": name, "detail": detail }),
            );
        }
        self.end_line();
        eprintln!("{}: {name}: {detail}", severity_word(*severity));
    }

    fn end(&mut self, status: &LoggerStatus) -> Result<(), Failure> {
        self.end_line();
        let text = if self.json {
            format!("{}\n", status_object("end", status))
        } else {
            format!("{}\n", summary(status))
        };
        io::stdout().lock().write_all(text.as_bytes())?;
        Ok(())
    }

    fn end_line(&mut self) {
        if std::mem::take(&mut self.line_open) {
            eprintln!();
        }
    }
}

fn summary(status: &LoggerStatus) -> String {
    format!(
        "{}: {} messages in {} segments, {:.1} MB; lost {}, dropped {}, refused {}",
        status.file,
        status.recorded,
        status.segments,
        status.written_bytes as f64 / 1e6,
        status.lost,
        status.dropped_full + status.dropped_stopped + status.overflowed,
        status.refused,
    )
}

fn status_object(event: &str, status: &LoggerStatus) -> serde_json::Value {
    let state = match status.state {
        LoggerState::Recording => "recording",
        LoggerState::Snapshot => "snapshot",
        LoggerState::Stopped => "stopped",
    };
    json!({
        "event": event,
        "state": state,
        "file": status.file.as_str(),
        "segments": status.segments,
        "accepted": status.accepted,
        "recorded": status.recorded,
        "definitions": status.definitions,
        "written_bytes": status.written_bytes,
        "dropped_full": status.dropped_full,
        "dropped_stopped": status.dropped_stopped,
        "refused": status.refused,
        "lost": status.lost,
        "overflowed": status.overflowed,
        "free_bytes": status.free_bytes,
    })
}

fn print_object(object: &serde_json::Value) {
    // Whoever closed the pipe does not want to know; the recording goes on.
    let _ = writeln!(io::stdout().lock(), "{object}");
}

fn severity_word(severity: Severity) -> &'static str {
    match severity {
        Severity::Info => "info",
        Severity::Warning => "warning",
        Severity::Fault => "fault",
    }
}

/// Gives the order and waits for the logger's answer.
fn dump(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let setup = Setup::load("arena", &arguments.options())?;
    let answer = block_on(async { ask_for_dump(&setup).await })?;
    let Some(event) = answer else {
        let waited = format!("no logger with --snapshot has answered in {ANSWER_MAX}");
        eprintln!("error: {waited}");
        return Ok(ExitCode::FAILURE);
    };
    let done = event.name.as_str() == "snapshot-written";
    let text = if arguments.json {
        format!("{}\n", json!({ "event": event.name.as_str(), "detail": event.detail.as_str() }))
    } else {
        format!("{}: {}\n", event.name, event.detail)
    };
    io::stdout().lock().write_all(text.as_bytes())?;
    Ok(if done { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn ask_for_dump(setup: &Setup) -> Result<Option<NodeEvent>, ShellError> {
    let network = &setup.arena.network;
    let domain = setup.identity.domain;
    let mut bus = BusReceiver::join(network, domain, Listen::Topics(&[&topics::NODE_EVENT]))?;
    let mut sender = BusSender::open(network, domain)?;
    // A source of its own: nothing it says is taken for the front door that flies the arena.
    let identity = Identity { source: source_of("arena record"), ..setup.identity };
    let mut publisher = Publisher::new("arena", &setup.secret, identity);
    let mut observer = Observer::new(&setup.secret, domain, identity.run);
    let given_at = clock::now();
    let order = LoggerOrder { kind: LoggerOrderKind::Dump, given_at };
    let mut repeats = tokio::time::interval(REPEAT_PERIOD);
    while clock::now() - given_at < ANSWER_MAX {
        tokio::select! {
            _ = repeats.tick() => {
                // Nothing in an order can be refused.
                let _ = publisher.publish(clock::now(), &topics::LOGGER_ORDER, &order, &mut |published| {
                    sender.send(published.datagram);
                });
            }
            count = bus.next_batch() => {
                if let Some(event) = answer_in(&bus, count?, &mut observer, given_at) {
                    return Ok(Some(event));
                }
            }
        }
    }
    Ok(None)
}

fn answer_in(bus: &BusReceiver, count: usize, observer: &mut Observer, since: Time) -> Option<NodeEvent> {
    (0..count).find_map(|index| {
        let observed = observer.observe(bus.datagram(index).bytes).ok()?;
        if !observed.verified || observed.header.schema_id != topics::NODE_EVENT.schema_id() {
            return None;
        }
        let event: NodeEvent = wire::decode(observed.body).ok()?;
        let is_answer = event.node == Text::truncated(logger::NAME)
            && event.name.as_str().starts_with("snapshot-")
            && event.at >= since;
        is_answer.then_some(event)
    })
}
