//! Puts a recording back on the bus, as live data for unmodified services, and out of any radio's reach.
//!
//! Playback speaks in the replay domain only: its own multicast group, port and keys. What it says there has the topic,
//! the body, the definition and the publish time of the recording; [`Signer`] seals it for the topic's writer. A program
//! of another domain cannot verify any of it, and there is no option that would change that. Services in the replay
//! domain live by the time that playback says (`service_shell`, module `replay`).
//!
//! [`Playback::start`] plays a [`Source`] in a thread of its own. By the clock, each message goes out on an absolute
//! schedule. At [`Rate::Max`] nodes and playback go in lock step: playback goes to the next instant at which a message
//! was heard or a node wants to be woken, and says it again until nobody has anything left to do at it. No node then
//! falls behind, however slow the machine; in which order two of them speak at one instant is still the machine's affair.

mod command;
mod control;
mod feed;
mod guard;
mod lockstep;
mod options;
mod pace;
mod plan;
mod player;
mod recorded;
mod selection;
mod signer;
mod source;
#[cfg(test)]
mod testing;

use std::process::ExitCode;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use clap::Parser;
use quantity::Time;
use schemas::{Topic, topics};
use service_core::{Observer, Publisher};
use service_shell::{BusReceiver, BusSender, Listen, ShellError, identity};
use thiserror::Error;
use wire::Domain;

pub use command::run_with;
pub use control::{COMMANDS, Command, Status, Summary};
pub use guard::refuse_beside_live;
pub use lockstep::LockStep;
pub use options::{Options, begin_run, network};
pub use pace::{Lateness, Pace, Rate};
pub use plan::{Await, Place, Plan};
pub use recorded::Recorded;
pub use selection::{Selection, SelectionError};
pub use signer::Signer;
pub use source::{Channel, Kept, Message, Source, SourceError, Take, Tape};

use feed::Feed;
use player::{Parts, Player};

/// Playback's name: its binary, its role on the bus.
pub const NAME: &str = "playback";

/// Why a recording is not played, or not to its end.
#[derive(Debug, Error)]
pub enum PlayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// There is nothing in the recording.
    #[error("the recording holds no messages")]
    Empty,
    /// A beginning or an end outside the recording.
    #[error(
        "--start {start_s:.3} s and --end {end_s:.3} s: there is nothing between them in a recording of {length_s:.3} s"
    )]
    Bounds {
        /// The beginning asked for.
        start_s: f64,
        /// The end asked for.
        end_s: f64,
        /// The recording's length.
        length_s: f64,
    },
    /// A wish that cannot be granted.
    #[error(transparent)]
    Selection(#[from] SelectionError),
    /// A time that cannot be said on the bus.
    #[error("the recording's time {at} cannot be said on the bus: {reason}")]
    Time {
        /// The time.
        at: Time,
        /// Why.
        reason: String,
    },
    /// Somebody who was awaited did not come.
    #[error("waited for {wanted}; there are only: {found}")]
    Await {
        /// Who was awaited.
        wanted: String,
        /// Who is there.
        found: String,
    },
    /// A live arena can be heard.
    #[error(
        "a live arena is up: {topic} was heard on {group}:{port}; nothing is played beside vehicles that fly"
    )]
    Live {
        /// What was heard.
        topic: String,
        /// On which group.
        group: std::net::Ipv4Addr,
        /// On which port.
        port: u16,
    },
    /// The bus.
    #[error(transparent)]
    Shell(#[from] ShellError),
    /// Neither a folder of settings nor settings in the recording.
    #[error("the recording carries no settings, and there is no folder `config`: --config DIR names one")]
    NoSettings,
    /// Standard output could not be written.
    #[error("standard output: {0}")]
    Output(String),
    /// The player's thread has died.
    #[error("the player has died")]
    Died,
}

impl PlayError {
    /// 2 for what was asked wrongly, 1 for what failed.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Bounds { .. } | Self::Selection(_) | Self::NoSettings => ExitCode::from(2),
            Self::Shell(error) => error.exit_code(),
            _ => ExitCode::FAILURE,
        }
    }
}

/// A recording being played.
#[derive(Debug)]
pub struct Playback {
    commands: Sender<Command>,
    status: Arc<Mutex<Status>>,
    thread: JoinHandle<Result<Summary, PlayError>>,
    origin: Time,
}

impl Playback {
    /// Begins to play, in a thread of its own.
    ///
    /// # Errors
    /// A plan that the recording cannot fulfil.
    pub fn start(source: Box<dyn Source>, place: Place, plan: Plan) -> Result<Self, PlayError> {
        let (first, last) = source.time_range().ok_or(PlayError::Empty)?;
        let origin = source.origin().unwrap_or(first);
        let from = plan.start.map_or(first, |start| origin.saturating_add(start));
        let to = plan.end.map_or(last, |end| origin.saturating_add(end).min(last));
        if from > to {
            let seconds = |at: Time| at.as_secs_f64() - origin.as_secs_f64();
            let (start_s, end_s, length_s) = (seconds(from), seconds(to), seconds(last));
            return Err(PlayError::Bounds { start_s, end_s, length_s });
        }
        let names = plan.selection.topics(source.channels())?;
        let Place { network, secret, run, incarnation } = place;
        let signer = Signer::new(&secret, run, incarnation, source.channels(), &names);
        let played = signer.played();
        let (commands, ordered) = channel();
        let status = Arc::new(Mutex::new(Status { at: from, ..Status::default() }));
        let shared = Arc::clone(&status);
        let play = move || {
            service_shell::block_on(async move {
                let (answers, domain): (&[&'static Topic], _) = (&[&topics::REPLAY_ANSWER], Domain::Replay);
                let player = Player::new(Parts {
                    bus: BusSender::open(&network, domain)?,
                    ear: BusReceiver::join(&network, domain, Listen::Topics(answers))?,
                    observer: Observer::new(&secret, domain, run),
                    voice: Publisher::new(NAME, &secret, identity(NAME, domain, run, incarnation)),
                    signer,
                    feed: Feed::start(source, played),
                    commands: ordered,
                    status: shared,
                    origin,
                    from,
                    to,
                    rate: plan.rate,
                    looped: plan.looped,
                    paused: plan.paused,
                    awaits: plan.awaits,
                });
                Ok(player.run().await)
            })?
        };
        let thread = std::thread::spawn(play);
        Ok(Self { commands, status, thread, origin })
    }

    /// When the recording begins.
    #[must_use]
    pub fn origin(&self) -> Time {
        self.origin
    }

    /// Tells it something; what has ended does not hear it.
    pub fn order(&self, command: Command) {
        let _ = self.commands.send(command);
    }

    /// Where others can tell it something.
    #[must_use]
    pub fn orders(&self) -> Sender<Command> {
        self.commands.clone()
    }

    /// How it fares.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether it is over.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until it is over.
    ///
    /// # Errors
    /// Why it was not played to its end.
    pub fn join(self) -> Result<Summary, PlayError> {
        self.thread.join().map_err(|_| PlayError::Died)?
    }
}

/// Playback's whole `main`: command line in, exit code out.
#[must_use]
pub fn run() -> ExitCode {
    let line = options::CommandLine::parse();
    service_shell::init_logging(&line.log);
    match run_with(&line.options) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            error.exit_code()
        }
    }
}
