//! The logger of a live arena: it hears before anybody speaks, and until everybody has fallen silent.

use std::ffi::OsString;
use std::path::PathBuf;

use quantity::{Span, Time};
use service_core::AnyNode as _;
use service_shell::clock;

use super::{END_PATIENCE, LiveArena, Supervised, SupervisorError, TICK};

/// How long the logger may take to be heard. It is not, if its file cannot be begun.
const HEARING_MAX: Span = Span::from_secs(10);
/// What the logger's sealing may take longer than another service's end.
const SEAL_PATIENCE: std::time::Duration = std::time::Duration::from_secs(10);

/// What a live arena is recorded into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordPlan {
    /// The first segment's file.
    pub file: PathBuf,
    /// Further options of `arena record`.
    pub options: Vec<OsString>,
}

impl RecordPlan {
    /// The logger's own arguments.
    pub(super) fn arguments(&self) -> Vec<OsString> {
        [self.file.clone().into_os_string()].into_iter().chain(self.options.iter().cloned()).collect()
    }
}

impl LiveArena {
    /// Starts the logger, if there shall be one, and waits until it is heard: what hears is heard.
    pub(super) async fn start_logger(&mut self) -> Result<(), SupervisorError> {
        if self.launch.record.is_none() {
            return Ok(());
        }
        self.processes.push(Supervised::start(logger::NAME, &self.launch)?);
        let since = clock::now();
        let mut ticks = tokio::time::interval(TICK);
        while !self.node.core().health().contains_key(logger::NAME) {
            tokio::select! {
                batch = self.receiver.next_batch() => self.take(batch?),
                _ = ticks.tick() => self.wait_for_logger(since)?,
            }
        }
        Ok(())
    }

    fn wait_for_logger(&mut self, since: Time) -> Result<(), SupervisorError> {
        let now = clock::now();
        let Self { node, sender, processes, launch, .. } = self;
        if node.deadline().is_some_and(|at| at <= now) {
            node.wake(now, &mut |published| sender.send(published.datagram));
        }
        let ended = processes.iter_mut().any(|process| process.has_ended());
        if ended || now - since > HEARING_MAX {
            let log = launch.logs.join(format!("{}.log", logger::NAME));
            return Err(SupervisorError::NoLogger { log });
        }
        Ok(())
    }

    /// Ends every process: the services first, then the logger, so that it hears their last words.
    pub(super) async fn end(&mut self) {
        let (loggers, others): (Vec<_>, Vec<_>) =
            self.processes.iter_mut().partition(|process| process.service() == logger::NAME);
        for (group, patience) in [(others, END_PATIENCE), (loggers, SEAL_PATIENCE)] {
            let mut group = group;
            for process in &mut group {
                process.terminate();
            }
            for process in &mut group {
                process.wait_end(patience).await;
            }
        }
    }
}
