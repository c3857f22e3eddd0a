//! A live arena on this machine: every service as a process of its own, and the simulator unless there is real equipment;
//! looked after, watched, and landed before it ends.
//!
//! Before real equipment nobody takes off because this program was started: the order is a person's, given by
//! `arena fly`. Here they are watched, and landed when it is told to end.

mod console;
mod processes;
mod recording;
mod replay;
mod screen;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use quantity::{Span, Time};
use schemas::OrderKind;
use service_core::{AnyNode, Identity, Node, Published};
use service_shell::{
    BusReceiver, BusSender, DEFAULT_SETTINGS_FILE, DomainOption, LIVE_SETTINGS_FILE, Listen, Options, Setup,
    ShellError, clock, incarnation_now, program_digest, run_file_of,
};
use settings::Arena;
use thiserror::Error;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::MissedTickBehavior;
use wire::Domain;

use crate::tools::neighbours;

pub use console::{Console, VehicleView};
pub use processes::{Launch, Standing, Supervised};
pub use recording::RecordPlan;
pub use replay::{ReplayPlan, replay};
pub use screen::Screen;

/// How often processes are looked after and lines renewed.
const TICK: Duration = Duration::from_millis(100);
/// How long a landing may take before the processes are ended anyway.
const LANDING_MAX: Span = Span::from_secs(40);
/// How long a process may take to end when asked to.
const END_PATIENCE: Duration = Duration::from_secs(2);

/// Why a live arena failed.
#[derive(Debug, Error)]
pub enum SupervisorError {
    /// The bus, the settings or the secret.
    #[error(transparent)]
    Shell(#[from] ShellError),
    /// A setting.
    #[error(transparent)]
    Settings(#[from] settings::ConfigError),
    /// A process could not be started.
    #[error("{service} could not be started: {source}")]
    Process {
        /// The service.
        service: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another arena runs before real equipment.
    #[error("{group}:{port} carries {topic}: a live arena is running, and two would steer the same vehicles")]
    Another {
        /// The live domain's group.
        group: std::net::Ipv4Addr,
        /// The live domain's port.
        port: u16,
        /// What was heard there.
        topic: String,
    },
    /// The logger is not heard.
    #[error("the logger does not record; {} says why", log.display())]
    NoLogger {
        /// What it logged.
        log: PathBuf,
    },
    /// A recording is not played, or not to its end.
    #[error(transparent)]
    Playback(#[from] playback::PlayError),
    /// The operating system refused something else.
    #[error("{what}: {source}")]
    System {
        /// What was attempted.
        what: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
}

impl SupervisorError {
    /// 2 for what was asked wrongly, 1 for what failed.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Shell(error) => error.exit_code(),
            Self::Settings(_) => ExitCode::from(2),
            Self::Playback(error) => error.exit_code(),
            _ => ExitCode::FAILURE,
        }
    }
}

/// How a live arena ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Every vehicle flew its flips and landed.
    Finished,
    /// Somebody asked, and everything landed first.
    Landed,
    /// Somebody asked twice, or the landing took too long.
    Stopped,
}

/// What stands at the other end of the bridges' cables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Equipment {
    /// A simulator of that seed. The vehicles work through the scenario at once, and their end is the arena's.
    Simulated {
        /// Seed of its world.
        seed: u64,
    },
    /// Cameras, radios and vehicles. Nobody takes off, and nothing ends, before a person says so.
    Real,
}

/// What a live arena is brought up with.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The settings, judged already.
    pub arena: Arena,
    /// What there is of equipment.
    pub equipment: Equipment,
    /// What the services log.
    pub log: String,
    /// Folder for secret, run id and logs.
    pub folder: PathBuf,
    /// What everything is recorded into, if it shall be.
    pub record: Option<RecordPlan>,
}

/// Brings an arena up and stays with it to its end.
///
/// # Errors
/// Files or sockets that cannot be used, a process that cannot be started, or another arena before the same equipment.
pub fn up(plan: &Plan, screen: &mut Screen) -> Result<Ending, SupervisorError> {
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| SupervisorError::System { what: "starting the runtime", source })?
        .block_on(async {
            if plan.equipment == Equipment::Real {
                refuse_beside_another(&plan.arena).await?;
            }
            let (setup, launch) = prepare(plan)?;
            let mut arena = LiveArena::start(setup, launch, plan.equipment)?;
            let ending = arena.fly(screen).await;
            // Whatever happened, no process is left behind.
            arena.end().await;
            ending
        })
}

async fn refuse_beside_another(arena: &Arena) -> Result<(), SupervisorError> {
    let live = &arena.network.live;
    match neighbours::heard(&arena.network, Domain::Live).await? {
        None => Ok(()),
        Some(topic) => Err(SupervisorError::Another { group: live.group, port: live.port, topic }),
    }
}

fn prepare(plan: &Plan) -> Result<(Setup, Launch), SupervisorError> {
    let logs = plan.folder.join("logs");
    std::fs::create_dir_all(&logs).map_err(|source| SupervisorError::File { path: logs.clone(), source })?;
    let secret_file = service_shell::secret_file(None);
    service_shell::create_secret_if_absent(&secret_file)?;
    let run = service_shell::new_run()?;
    let (domain, settings, seed) = match plan.equipment {
        Equipment::Simulated { seed } => (DomainOption::Sim, DEFAULT_SETTINGS_FILE, Some(seed)),
        Equipment::Real => (DomainOption::Live, LIVE_SETTINGS_FILE, None),
    };
    // One file for all: a service that is restarted has the settings that the others have.
    service_shell::write_run_settings(Path::new(settings), run, &plan.arena)?;
    service_shell::write_run(&run_file_of(domain.into()), run)?;
    let options = Options {
        settings: Some(settings.into()),
        domain,
        run: Some(run),
        secret_file: Some(secret_file),
        log: plan.log.clone(),
        supervised: true,
        ..Options::default()
    };
    let setup = Setup::load("arena", &options)?;
    let program = std::env::current_exe()
        .map_err(|source| SupervisorError::System { what: "finding this program's own file", source })?;
    let record = plan.record.as_ref().map(RecordPlan::arguments);
    Ok((setup, Launch { program, options, run, seed, logs, record }))
}

struct LiveArena {
    node: Node<Console>,
    receiver: BusReceiver,
    sender: BusSender,
    processes: Vec<Supervised>,
    launch: Launch,
    setup: Setup,
    equipment: Equipment,
    landing_since: Option<Time>,
}

impl LiveArena {
    fn start(setup: Setup, launch: Launch, equipment: Equipment) -> Result<Self, SupervisorError> {
        let network = &setup.arena.network;
        let mut node = Node::<Console>::new(&setup.arena, &setup.secret, setup.identity, clock::now())?;
        // People reach into it, which no recording can tell of: it keeps no journal from the start.
        let console = node.core_mut();
        if equipment == Equipment::Real {
            console.fall_silent();
        }
        node.identify_program(program_digest());
        let receiver = BusReceiver::join(network, setup.identity.domain, Listen::Topics(node.topics_in()))?;
        let sender = BusSender::open(network, setup.identity.domain)?;
        Ok(Self {
            node,
            receiver,
            sender,
            processes: Vec::new(),
            launch,
            setup,
            equipment,
            landing_since: None,
        })
    }

    /// Starts everything, the logger first, and stays to the end.
    async fn fly(&mut self, screen: &mut Screen) -> Result<Ending, SupervisorError> {
        self.start_logger().await?;
        let simulator = self.launch.seed.map(|_| "simulator");
        for service in roster::SERVICES.iter().copied().chain(simulator) {
            self.processes.push(Supervised::start(service, &self.launch)?);
        }
        if self.equipment == Equipment::Real {
            screen.say(
                "nobody takes off by itself: `arena fly --domain live` in another terminal gives the order",
            );
        }
        self.attend(screen).await
    }

    async fn attend(&mut self, screen: &mut Screen) -> Result<Ending, SupervisorError> {
        let listening = |source| SupervisorError::System { what: "listening for signals", source };
        let mut interrupted = signal(SignalKind::interrupt()).map_err(listening)?;
        let mut terminated = signal(SignalKind::terminate()).map_err(listening)?;
        let mut ticks = tokio::time::interval(TICK);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                batch = self.receiver.next_batch() => self.take(batch?),
                _ = ticks.tick() => {
                    if let Some(ending) = self.tick(screen)? {
                        return Ok(ending);
                    }
                }
                _ = interrupted.recv() => if self.land(screen)? { return Ok(Ending::Stopped) },
                _ = terminated.recv() => if self.land(screen)? { return Ok(Ending::Stopped) },
            }
        }
    }

    /// Orders a landing; says whether one was under way already.
    fn land(&mut self, screen: &mut Screen) -> Result<bool, SupervisorError> {
        if self.landing_since.is_some() {
            screen.say("stopping at once");
            return Ok(true);
        }
        screen.say("landing first; once more stops at once");
        let now = clock::now();
        self.landing_since = Some(now);
        if self.equipment == Equipment::Real {
            self.speak_last(now)?;
        }
        self.node.core_mut().order(now, OrderKind::Land);
        Ok(false)
    }

    /// Whoever gave the order to fly did so under this program's name, and was started later: only as one that is
    /// started later still is this program heard again.
    fn speak_last(&mut self, now: Time) -> Result<(), SupervisorError> {
        let Setup { arena, secret, identity, .. } = &self.setup;
        let identity = Identity { incarnation: incarnation_now().max(identity.incarnation + 1), ..*identity };
        let mut node = Node::<Console>::new(arena, secret, identity, now)?;
        node.core_mut().take_over(self.node.core());
        self.node = node;
        Ok(())
    }

    fn take(&mut self, count: usize) {
        let Self { node, receiver, sender, .. } = self;
        for index in 0..count {
            // What is dropped, the node counts.
            let _ =
                node.receive(clock::now(), receiver.datagram(index).bytes, &mut |published: Published<
                    '_,
                >| {
                    sender.send(published.datagram);
                });
        }
    }

    fn tick(&mut self, screen: &mut Screen) -> Result<Option<Ending>, SupervisorError> {
        let now = clock::now();
        for process in &mut self.processes {
            process.look_after(now, &self.launch)?;
        }
        let Self { node, sender, .. } = self;
        if node.deadline().is_some_and(|at| at <= now) {
            node.wake(now, &mut |published: Published<'_>| sender.send(published.datagram));
        }
        screen.show(now, node.core_mut(), &self.processes);
        if let Some(since) = self.landing_since {
            // The flip managers must have heard the order before "all down" means anything.
            if now - since > Span::from_secs(1) && node.core().all_down() {
                return Ok(Some(Ending::Landed));
            }
            return Ok((now - since > LANDING_MAX).then_some(Ending::Stopped));
        }
        let finished = self.equipment != Equipment::Real && node.core().all_done();
        Ok(finished.then_some(Ending::Finished))
    }
}

/// The folder for secret, run id and logs.
#[must_use]
pub fn default_folder() -> &'static Path {
    Path::new(".flyarena")
}
