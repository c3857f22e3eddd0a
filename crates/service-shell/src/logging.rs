//! Logs: one line per event on standard error.
//!
//! Typed events on the bus are the record; a log line is their echo for people, written by the node that
//! emits them.

use std::io::{IsTerminal, stderr};

use schemas::{NodeEvent, Severity, topics};
use service_core::Published;
use tracing::{error, info, warn};
use tracing_subscriber::EnvFilter;

/// Starts logging to standard error, coloured on a terminal only; does nothing if something logs already.
///
/// A filter that cannot be read is replaced by `info`, with a warning that names it.
pub fn init_logging(filter: &str) {
    let (filter, complaint) = match EnvFilter::try_new(filter) {
        Ok(parsed) => (parsed, None),
        Err(error) => (EnvFilter::new("info"), Some(format!("--log {filter:?}: {error}; logging `info`"))),
    };
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(stderr)
        .with_ansi(stderr().is_terminal())
        .with_target(false)
        .finish();
    let ours = tracing::subscriber::set_global_default(subscriber).is_ok();
    if let (true, Some(complaint)) = (ours, complaint) {
        warn!("{complaint}");
    }
}

/// Logs an event that its node puts on the bus; other messages pass in silence.
pub fn echo_event(published: &Published<'_>) {
    if !published.is_data() || *published.topic != topics::NODE_EVENT {
        return;
    }
    let Ok(event) = wire::decode::<NodeEvent>(published.body) else {
        return;
    };
    let (name, vehicle, detail) = (event.name.as_str(), event.vehicle, event.detail.as_str());
    match event.severity {
        Severity::Info => info!(vehicle, "{name}: {detail}"),
        Severity::Warning => warn!(vehicle, "{name}: {detail}"),
        Severity::Fault => error!(vehicle, "{name}: {detail}"),
    }
}
