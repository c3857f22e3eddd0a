//! From the ring to the disk, in a thread of its own.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use quantity::{Span, Time};
use recording::{Ending, Gap, Host, Loss, Notice, Plan, Segments, Standing, Totals};
use schemas::{LoggerState, Severity};
use service_shell::clock;

use crate::labels::free_name;
use crate::ring::{Ring, datagrams};
use crate::snapshot::Snapshot;
use crate::voice::info;

/// The ring is emptied this often, or when it is half full.
const DRAIN_PERIOD: Duration = Duration::from_millis(20);
/// The file says this often at most where messages were dropped.
const GAP_PERIOD: Span = Span::from_secs(1);

/// What the two threads share besides the ring.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    progress: Mutex<Progress>,
    /// What is new of them since the writer took them last.
    losses: Mutex<Option<(Ending, Vec<Loss>)>>,
}

/// How the writing fares.
#[derive(Clone, Debug, Default)]
pub(crate) struct Progress {
    /// Turns of the writer's loop: they rise even while nothing comes, and not while the disk holds it up.
    pub(crate) turns: u64,
    pub(crate) state: LoggerState,
    pub(crate) file: PathBuf,
    pub(crate) totals: Totals,
}

impl Shared {
    pub(crate) fn progress(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_progress(&self, progress: Progress) {
        *self.progress.lock().unwrap_or_else(PoisonError::into_inner) = progress;
    }

    /// What the file's ending shall say of what never came to the ring.
    pub(crate) fn set_losses(&self, ending: Ending, losses: Vec<Loss>) {
        *self.losses.lock().unwrap_or_else(PoisonError::into_inner) = Some((ending, losses));
    }

    fn take_losses(&self) -> Option<(Ending, Vec<Loss>)> {
        self.losses.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Where messages go.
pub(crate) enum Desk {
    /// Into files.
    Files(Box<Segments<Host>>),
    /// Into memory, and from there into files when asked for.
    Memory(Box<Memory>),
}

/// The last seconds, and what a file of them is begun with.
pub(crate) struct Memory {
    pub(crate) snapshot: Snapshot,
    pub(crate) plan: Plan,
    pub(crate) written: Totals,
    pub(crate) newest: PathBuf,
}

/// The thread that writes.
pub(crate) struct Scribe {
    pub(crate) ring: Arc<Ring>,
    pub(crate) shared: Arc<Shared>,
    pub(crate) desk: Desk,
    /// Each is a wish to write what is kept in memory.
    pub(crate) dumps: Receiver<()>,
    pub(crate) notices: Sender<Notice>,
    pub(crate) buffer: Vec<u8>,
    pub(crate) turns: u64,
}

impl Scribe {
    /// Writes until the ring is closed and empty.
    pub(crate) fn run(mut self) {
        let mut buffer = std::mem::take(&mut self.buffer);
        let mut gap: Option<Gap> = None;
        let mut gap_at = clock::now();
        loop {
            let drained = self.ring.drain(&mut buffer, DRAIN_PERIOD);
            let now = clock::now();
            self.write(now, &buffer);
            gap = merged(gap, drained.gap);
            if gap.is_some() && (gap_at <= now || drained.closed) {
                gap_at = now + GAP_PERIOD;
                self.note_gap(now, gap.take());
            }
            self.take_dumps(now);
            if let Desk::Files(segments) = &mut self.desk {
                segments.tick(now);
            }
            if drained.closed {
                self.finish(clock::now(), "stopped");
                return;
            }
            self.report();
        }
    }

    fn write(&mut self, now: Time, drained: &[u8]) {
        match &mut self.desk {
            Desk::Files(segments) => {
                for (at, observed) in datagrams(drained) {
                    segments.observe(now, at, &observed);
                }
            }
            Desk::Memory(memory) => memory.snapshot.take(now, drained),
        }
    }

    fn note_gap(&mut self, now: Time, gap: Option<Gap>) {
        let Some(gap) = gap else { return };
        let dropped: u64 = gap.dropped.values().sum();
        let detail = format!("the disk was too slow: {dropped} messages dropped in {}", gap.until - gap.from);
        self.tell(Notice { severity: Severity::Warning, name: "recording-gap", detail });
        if let Desk::Files(segments) = &mut self.desk {
            segments.note_gap(now, &gap);
        }
    }

    fn take_dumps(&mut self, now: Time) {
        // Several wishes at once are one.
        if self.dumps.try_iter().count() == 0 {
            return;
        }
        let Desk::Memory(memory) = &mut self.desk else {
            self.tell(info("snapshot-refused", "everything is being recorded already".to_owned()));
            return;
        };
        let mut plan = memory.plan.clone();
        plan.path = free_name(&plan.path);
        let elapsed = now - plan.about.started_at;
        plan.about.started_at = now;
        plan.about.started_wall_ns = plan.about.started_wall_ns.saturating_add(elapsed.as_nanos());
        // Each is a recording of its own; the first number was random.
        plan.about.recording = plan.about.recording.wrapping_add(u64::from(memory.written.segments));
        let path = plan.path.clone();
        let notice = match memory.snapshot.dump(now, plan) {
            Ok(totals) => {
                let messages = totals.recorded;
                memory.written.segments += 1;
                memory.written.recorded += messages;
                memory.written.written_bytes += totals.written_bytes;
                memory.written.free_bytes = totals.free_bytes;
                memory.newest.clone_from(&path);
                info("snapshot-written", format!("{messages} messages in {}", path.display()))
            }
            Err(error) => {
                let detail = format!("{}: {error}", path.display());
                Notice { severity: Severity::Fault, name: "snapshot-failed", detail }
            }
        };
        self.tell(notice);
    }

    fn finish(&mut self, now: Time, reason: &str) {
        if let Desk::Files(segments) = &mut self.desk {
            if let Some((ending, losses)) = self.shared.take_losses() {
                segments.set_losses(ending, losses);
            }
            segments.finish(now, reason);
        }
        self.report();
    }

    fn report(&mut self) {
        self.turns += 1;
        let turns = self.turns;
        let progress = match &mut self.desk {
            Desk::Files(segments) => {
                for notice in segments.take_notices() {
                    // Whoever listened is gone only when the process ends.
                    let _ = self.notices.send(notice);
                }
                if let Some((ending, losses)) = self.shared.take_losses() {
                    segments.set_losses(ending, losses);
                }
                let state = match segments.standing() {
                    Standing::Recording => LoggerState::Recording,
                    Standing::Stopped => LoggerState::Stopped,
                };
                Progress { turns, state, file: segments.file(), totals: segments.totals() }
            }
            Desk::Memory(memory) => {
                let (state, file) = (LoggerState::Snapshot, memory.newest.clone());
                Progress { turns, state, file, totals: memory.written }
            }
        };
        self.shared.set_progress(progress);
    }

    fn tell(&self, notice: Notice) {
        // As for the recording's own.
        let _ = self.notices.send(notice);
    }
}

fn merged(one: Option<Gap>, other: Option<Gap>) -> Option<Gap> {
    match (one, other) {
        (Some(mut one), Some(other)) => {
            one.from = one.from.min(other.from);
            one.until = one.until.max(other.until);
            for (topic, dropped) in other.dropped {
                *one.dropped.entry(topic).or_insert(0) += dropped;
            }
            Some(one)
        }
        (one, other) => one.or(other),
    }
}
