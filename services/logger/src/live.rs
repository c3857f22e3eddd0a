//! The logger's clock, sockets and place on the bus.

use std::future::poll_fn;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::task::{Context, Poll};
use std::thread::JoinHandle;
use std::time::Duration;

use quantity::{Span, Time};
use recording::{About, Ending, Host, Notice, Plan, Segments, Totals, WriteError};
use reflect::Text;
use schemas::{LoggerState, LoggerStatus, Severity};
use service_core::{Observer, source_of};
use service_shell::{
    BusReceiver, During, Listen, Options, Setup, ShellError, Stop, StopReason, Timer, block_on, clock,
    new_run,
};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tracing::{Instrument, info, info_span};

use crate::ear::{Ear, table_definitions};
use crate::labels::{free_name, host, revision, utc_label};
use crate::ring::Ring;
use crate::scribe::{Desk, Memory, Progress, Scribe, Shared};
use crate::snapshot::Snapshot;
use crate::voice::Voice;
use crate::{NAME, RecordOptions, Telling};

/// Memory between bus and disk; there is as much again for what is being written. At 20 000 messages of 200
/// bytes a second it bridges two and a half seconds.
const RING_BYTES: usize = 16 << 20;
/// How often the recording's state is said.
const STATUS_PERIOD: Span = Span::from_millis(500);
/// How often definitions and health are announced.
const ANNOUNCE_PERIOD: Span = Span::from_secs(1);
/// What has come is left in the socket's queue for so long, so that a busy bus wakes nobody for every
/// datagram. The kernel's stamps are from before.
const LINGER: Duration = Duration::from_millis(2);
/// Looked after at least this often: requests for definitions, notices, orders.
const LOOK_PERIOD: Span = Span::from_millis(100);
/// Raised where a file grows beyond what the process may write; handled, it becomes an error of the write.
const SIGXFSZ: i32 = 25;

/// Records until the process is told to end.
pub(crate) fn run(
    options: &Options,
    record: &RecordOptions,
    tell: &mut dyn FnMut(Telling<'_>),
) -> Result<LoggerStatus, ShellError> {
    let mut setup = Setup::load(NAME, options)?;
    if !setup.supervised {
        // Started by hand it may not be the only one: with the arena's own numbers, each would be taken for
        // an earlier start of the other.
        setup.identity.source = source_of(&format!("{NAME} {}", setup.identity.incarnation));
    }
    let setup = setup;
    block_on(
        async {
            let mut stop = Stop::new(setup.supervised)?;
            let signals = Signals::new()?;
            let mut live = Live::open(&setup, record, signals, tell)?;
            let run = format!("{:016x}", setup.identity.run);
            info!(scenario = setup.arena.name, run, "started");
            let reason = live.serve(&mut stop).await?;
            let status = live.end().await?;
            info!(recorded = status.recorded, lost = status.lost, "ended: {reason}");
            Ok(status)
        }
        .instrument(info_span!("node", name = NAME)),
    )
}

/// Signals besides those that end a program.
struct Signals {
    dump: Signal,
    /// Only held, so that the signal does not end the process.
    _file_size: Signal,
}

impl Signals {
    fn new() -> Result<Self, ShellError> {
        let listen = |kind| signal(kind).during(|| "listening for signals".to_owned());
        Ok(Self {
            dump: listen(SignalKind::user_defined1())?,
            _file_size: listen(SignalKind::from_raw(SIGXFSZ))?,
        })
    }
}

/// Why the loop was woken.
enum Woken {
    Stop(StopReason),
    Dump,
    Bus,
    Time,
}

struct Live<'t> {
    bus: BusReceiver,
    timer: Timer,
    ear: Ear,
    voice: Voice,
    ring: Arc<Ring>,
    shared: Arc<Shared>,
    scribe: Option<JoinHandle<()>>,
    dumps: Sender<()>,
    notices: Receiver<Notice>,
    signals: Signals,
    tell: &'t mut dyn FnMut(Telling<'_>),
    status_at: Time,
    announce_at: Time,
    end_at: Option<Time>,
}

impl<'t> Live<'t> {
    fn open(
        setup: &Setup,
        record: &RecordOptions,
        signals: Signals,
        tell: &'t mut dyn FnMut(Telling<'_>),
    ) -> Result<Self, ShellError> {
        let identity = setup.identity;
        let bus = BusReceiver::join(&setup.arena.network, identity.domain, Listen::Everything)?;
        let voice = Voice::open(setup)?;
        let observer = Observer::new(&setup.secret, identity.domain, identity.run);
        let (ring, buffer) = Ring::new(RING_BYTES);
        let (ring, shared) = (Arc::new(ring), Arc::new(Shared::default()));
        let (dumps, dumps_taken) = channel();
        let (notices_given, notices) = channel();
        let now = clock::now();
        let scribe = Scribe {
            ring: ring.clone(),
            shared: shared.clone(),
            desk: desk(setup, record, now)?,
            dumps: dumps_taken,
            notices: notices_given,
            buffer,
            turns: 0,
        };
        let scribe = std::thread::Builder::new()
            .name("scribe".to_owned())
            .spawn(|| scribe.run())
            .during(|| "starting the thread that writes".to_owned())?;
        Ok(Self {
            bus,
            timer: Timer::new().during(|| "making a timer".to_owned())?,
            ear: Ear::new(observer),
            voice,
            ring,
            shared,
            scribe: Some(scribe),
            dumps,
            notices,
            signals,
            tell,
            status_at: now,
            announce_at: now,
            end_at: record.duration.map(|duration| now + duration),
        })
    }

    async fn serve(&mut self, stop: &mut Stop) -> Result<&'static str, ShellError> {
        loop {
            let now = clock::now();
            self.look_after(now);
            if self.end_at.is_some_and(|end| end <= now) {
                return Ok("the time asked for is over");
            }
            if let Some(reason) = stop.check_supervisor(now) {
                return Ok(reason.name());
            }
            self.timer.set(Some(now + LOOK_PERIOD)).during(|| "setting the timer".to_owned())?;
            match self.wait(stop).await.during(|| "waiting for the bus".to_owned())? {
                Woken::Stop(reason) => return Ok(reason.name()),
                Woken::Dump => self.dump(),
                Woken::Time => {}
                Woken::Bus => {
                    tokio::time::sleep(LINGER).await;
                    self.take_bus()?;
                }
            }
        }
    }

    async fn wait(&mut self, stop: &mut Stop) -> io::Result<Woken> {
        poll_fn(|cx| match stop.poll_signal(cx) {
            Poll::Ready(reason) => Poll::Ready(Ok(Woken::Stop(reason))),
            Poll::Pending => self.poll_work(cx),
        })
        .await
    }

    fn poll_work(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<Woken>> {
        if self.signals.dump.poll_recv(cx).is_ready() {
            return Poll::Ready(Ok(Woken::Dump));
        }
        match self.timer.poll_elapsed(cx) {
            Poll::Ready(elapsed) => Poll::Ready(elapsed.map(|()| Woken::Time)),
            Poll::Pending => self.bus.poll_readable(cx).map_ok(|()| Woken::Bus),
        }
    }

    fn take_bus(&mut self) -> Result<bool, ShellError> {
        let more = self.ear.take(clock::now(), &mut self.bus, &self.ring, &mut self.voice)?;
        for _ in 0..self.ear.take_dumps() {
            self.dump();
        }
        Ok(more)
    }

    fn dump(&mut self) {
        // A writer that has ended is told of elsewhere.
        let _ = self.dumps.send(());
    }

    fn look_after(&mut self, now: Time) {
        self.voice.ask(now);
        self.pass_notices(now);
        if self.scribe.as_ref().is_some_and(JoinHandle::is_finished) {
            self.scribe = None;
            let detail = "the thread that writes has ended: nothing is recorded any more".to_owned();
            let notice = Notice { severity: Severity::Fault, name: "recording-stopped", detail };
            self.notice(now, &notice);
        }
        if self.announce_at <= now {
            self.announce_at = now + ANNOUNCE_PERIOD;
            self.voice.announce(now, self.shared.progress().turns, &self.ear);
        }
        if self.status_at <= now {
            self.status_at = now + STATUS_PERIOD;
            self.say_status(now);
        }
    }

    fn pass_notices(&mut self, now: Time) {
        let notices: Vec<Notice> = self.notices.try_iter().collect();
        for notice in notices {
            self.notice(now, &notice);
        }
    }

    fn notice(&mut self, now: Time, notice: &Notice) {
        self.voice.notice(now, notice);
        (self.tell)(Telling::Notice(notice));
    }

    fn say_status(&mut self, now: Time) -> LoggerStatus {
        self.shared.set_losses(self.ending(now), self.ear.losses());
        let status = self.status();
        self.voice.status(now, &status);
        (self.tell)(Telling::Status(&status));
        status
    }

    fn ending(&self, now: Time) -> Ending {
        Ending {
            stopped_at: now,
            dropped_full: self.ear.dropped_full(),
            refused: self.ear.counters().dropped_total(),
            overflowed: self.ear.overflowed(),
            ..Ending::default()
        }
    }

    fn status(&self) -> LoggerStatus {
        let Progress { state, file, totals, .. } = self.shared.progress();
        let state = if self.scribe.is_none() { LoggerState::Stopped } else { state };
        LoggerStatus {
            state,
            file: Text::truncated(tail_of(&file)),
            segments: totals.segments,
            accepted: self.ear.accepted(),
            recorded: totals.recorded,
            definitions: self.ear.definitions(),
            written_bytes: totals.written_bytes,
            dropped_full: self.ear.dropped_full(),
            dropped_stopped: totals.dropped,
            refused: self.ear.counters().dropped_total(),
            lost: self.ear.lost(),
            overflowed: self.ear.overflowed(),
            free_bytes: totals.free_bytes,
        }
    }

    /// Takes what is still in the socket, has everything written and sealed, and says how it ended.
    async fn end(&mut self) -> Result<LoggerStatus, ShellError> {
        // The runtime looks at the socket once more: what came up to now is heard.
        tokio::time::sleep(LINGER).await;
        while self.take_bus()? {}
        let now = clock::now();
        self.shared.set_losses(self.ending(now), self.ear.losses());
        self.ring.close();
        if let Some(scribe) = self.scribe.take() {
            scribe.join().map_err(|_| io::Error::other("it panicked")).during(|| "writing".to_owned())?;
        }
        let now = clock::now();
        self.pass_notices(now);
        Ok(self.say_status(now))
    }
}

fn desk(setup: &Setup, record: &RecordOptions, now: Time) -> Result<Desk, ShellError> {
    let wall_ns = clock::wall_clock_ns();
    let label = || PathBuf::from(format!("{}-{}.mcap", setup.arena.name, utc_label(wall_ns)));
    let path = with_ending(record.file.clone().unwrap_or_else(label));
    // Started again after it was killed, it must not wait for anybody to clear its old file away.
    let path = if setup.supervised { free_name(&path) } else { path };
    let about = About {
        recording: new_run()?,
        segment: 0,
        run: setup.identity.run,
        domain: setup.identity.domain,
        scenario: setup.arena.name.clone(),
        settings_digest: setup.arena.digest(),
        started_at: now,
        started_wall_ns: wall_ns,
        host: host(),
        revision: revision(Path::new(".")),
    };
    let settings = Some(setup.arena.clone());
    let plan = Plan {
        path: path.clone(),
        about,
        settings,
        options: record.write_options(),
        limits: record.limits(),
    };
    if let Some(span) = record.snapshot {
        let snapshot = Snapshot::new(span, record.snapshot_bytes);
        return Ok(Desk::Memory(Box::new(Memory {
            snapshot,
            plan,
            written: Totals::default(),
            newest: path,
        })));
    }
    let mut segments = Segments::begin(Host, plan, now).map_err(|error| begin_error(error, &path))?;
    for definition in table_definitions() {
        segments.define(now, &definition);
    }
    Ok(Desk::Files(Box::new(segments)))
}

fn begin_error(error: WriteError, path: &Path) -> ShellError {
    let source = match error {
        WriteError::Sink(source) => source,
        other => io::Error::other(other.to_string()),
    };
    ShellError::System { what: format!("beginning the recording {}", path.display()), source }
}

/// The file's name with the ending that every reader expects.
fn with_ending(path: PathBuf) -> PathBuf {
    if path.extension().is_some_and(|ending| ending == "mcap") {
        return path;
    }
    let mut name = path.into_os_string();
    name.push(".mcap");
    name.into()
}

/// The end of a path, as far as a status has room for it.
fn tail_of(path: &Path) -> String {
    const CHARACTERS_MAX: usize = 120;
    let text = path.display().to_string();
    let count = text.chars().count();
    if count <= CHARACTERS_MAX {
        return text;
    }
    std::iter::once('…').chain(text.chars().skip(count - (CHARACTERS_MAX - 4))).collect()
}
