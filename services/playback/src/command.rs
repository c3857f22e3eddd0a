//! Playback as a person runs it: orders on standard input, a status line, a summary.

use std::io::{BufRead, IsTerminal, Write, stderr, stdin, stdout};
use std::process::ExitCode;
use std::sync::mpsc::Sender;
use std::time::Duration;

use quantity::{Span, Time};
use schemas::ReplayState;
use service_shell::Stop;

use crate::control::{COMMANDS, Command, Status, Summary};
use crate::guard::refuse_beside_live;
use crate::options::Options;
use crate::recorded::Recorded;
use crate::source::Source;
use crate::{PlayError, Playback};

/// How often the status line is renewed.
const STATUS_PERIOD: Duration = Duration::from_millis(100);

/// Plays a recording until it ends or somebody ends it. Not to be called within a tokio runtime.
///
/// # Errors
/// A recording that cannot be read, a wish that cannot be granted, a live arena that can be heard.
pub fn run_with(options: &Options) -> Result<ExitCode, PlayError> {
    let recorded = Recorded::open(&options.file)?;
    let place = options.place(&recorded)?;
    let last = recorded.time_range().map_or(Time::ZERO, |(_, last)| last);
    let playback = service_shell::block_on(async {
        let mut stop = Stop::new(false)?;
        let begun = async {
            refuse_beside_live(&place.network).await?;
            Playback::start(Box::new(recorded), place, options.plan())
        };
        let playback = match begun.await {
            Ok(playback) => playback,
            Err(error) => return Ok(Err(error)),
        };
        listen(playback.orders(), options.step);
        attend(&playback, last, &mut stop).await;
        Ok(Ok(playback))
    })??;
    let summary = playback.join()?;
    report(&summary, options.json)?;
    Ok(ExitCode::SUCCESS)
}

/// Stays with it to its end.
async fn attend(playback: &Playback, last: Time, stop: &mut Stop) {
    let shows = stderr().is_terminal();
    let mut ticks = tokio::time::interval(STATUS_PERIOD);
    while !playback.is_over() {
        tokio::select! {
            _ = ticks.tick() => {}
            _ = std::future::poll_fn(|cx| stop.poll_signal(cx)) => playback.order(Command::Quit),
        }
        if shows {
            show(&playback.status(), playback.origin(), last);
        }
    }
    if shows {
        eprintln!();
    }
}

/// Reads orders in a thread of its own, which ends with the program.
fn listen(orders: Sender<Command>, steps: bool) {
    if stdin().is_terminal() {
        eprintln!("{COMMANDS}");
    }
    std::thread::spawn(move || {
        for line in stdin().lock().lines().map_while(Result::ok) {
            let command = match line.parse() {
                Ok(Command::Toggle) if steps => Command::Step(None),
                Ok(command) => command,
                Err(error) => {
                    eprintln!("error: {error}");
                    continue;
                }
            };
            if orders.send(command).is_err() {
                return;
            }
        }
        // What stands still when nobody can give orders any more would stand for ever.
        let _ = orders.send(Command::HangUp);
    });
}

fn show(status: &Status, origin: Time, last: Time) {
    let state = match status.state {
        ReplayState::Playing => "playing",
        ReplayState::Paused => "paused",
        ReplayState::Ended => "ended",
    };
    let seconds = |at: Time| at.as_secs_f64() - origin.as_secs_f64();
    let rate = if status.rate_ratio == 0.0 { "max".to_owned() } else { status.rate_ratio.to_string() };
    let nodes = match status.nodes.len() {
        0 => String::new(),
        count => format!("  {count} services"),
    };
    let (at_s, last_s) = (seconds(status.at), seconds(last));
    // Whoever closed the terminal does not want to know.
    let _ = write!(
        stderr(),
        "\r\x1b[K{state}  {at_s:.3} of {last_s:.3} s  rate {rate}  {} messages{nodes}",
        status.messages
    );
}

fn report(summary: &Summary, json: bool) -> Result<(), PlayError> {
    let text = if json { summary.to_json() } else { summary.to_string() };
    let mut out = stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(PlayError::Output(error.to_string()))
        }
        _ => Ok(()),
    }
}

impl Summary {
    /// The summary as one JSON object.
    #[must_use]
    pub fn to_json(&self) -> String {
        let milliseconds = |span: Span| span.as_secs_f64() * 1e3;
        serde_json::json!({
            "messages": self.messages,
            "bytes": self.bytes,
            "unsent": self.unsent,
            "measured": self.measured,
            "lateness_median_ms": milliseconds(self.lateness_median),
            "lateness_p99_ms": milliseconds(self.lateness_p99),
            "lateness_max_ms": milliseconds(self.lateness_max),
            "drift_ms": milliseconds(self.drift),
            "seek_max_ms": milliseconds(self.seek_max),
            "dropped_nodes": self.dropped_nodes,
        })
        .to_string()
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let milliseconds = |span: Span| format!("{:.3} ms", span.as_secs_f64() * 1e3);
        write!(f, "{} messages, {} bytes", self.messages, self.bytes)?;
        if self.measured > 0 {
            let median = milliseconds(self.lateness_median);
            let (p99, max) = (milliseconds(self.lateness_p99), milliseconds(self.lateness_max));
            write!(f, "; late by {median} (median), {p99} (99 %), {max} (most)")?;
            write!(f, "; drift {}", milliseconds(self.drift))?;
        }
        if self.seek_max > Span::ZERO {
            write!(f, "; slowest jump {}", milliseconds(self.seek_max))?;
        }
        if self.unsent > 0 {
            write!(f, "; {} could not be sent", self.unsent)?;
        }
        for node in &self.dropped_nodes {
            write!(f, "; {node} stopped answering")?;
        }
        Ok(())
    }
}
