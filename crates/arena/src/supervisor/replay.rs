//! A replay arena on this machine: services as processes of their own in the replay domain, fed by a recording.

use std::path::PathBuf;
use std::time::Duration;

use playback::{Await, Command, Place, PlayError, Playback, Rate, Recorded, Selection, Summary};
use service_core::{AnyNode, Core, Node};
use service_shell::{BusReceiver, DomainOption, Listen, Options, Setup, Stop, clock};
use settings::{Arena, ConfigError};
use wire::Domain;

use super::{Console, END_PATIENCE, Launch, Screen, Supervised, SupervisorError, TICK};

/// What a replay arena is brought up with.
#[derive(Clone, Debug)]
pub struct ReplayPlan {
    /// The recording.
    pub file: PathBuf,
    /// The services to run; what they say is not played.
    pub services: Vec<String>,
    /// Folder of other settings than the recorded ones.
    pub config: Option<PathBuf>,
    /// Scenario in that folder; the recorded one's name if `None`.
    pub scenario: Option<String>,
    /// How fast.
    pub rate: Rate,
    /// What the services log.
    pub log: String,
    /// Folder for secret, run id, settings and logs.
    pub folder: PathBuf,
}

/// Brings services up on a recording and stays with them to its end.
///
/// # Errors
/// A recording, settings or sockets that cannot be used, or a live arena that can be heard.
pub fn replay(plan: &ReplayPlan, screen: &mut Screen) -> Result<Summary, SupervisorError> {
    let recorded = Recorded::open(&plan.file).map_err(PlayError::from)?;
    let launch = prepare(plan, &recorded)?;
    let setup = Setup::load(Console::NAME, &launch.options)?;
    let playback = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| SupervisorError::System { what: "starting the runtime", source })?
        .block_on(async {
            playback::refuse_beside_live(&setup.arena.network).await?;
            let mut arena = ReplayArena { processes: Vec::new(), launch };
            let played = arena.play(plan, &setup, recorded, screen).await;
            // Whatever happened, no process is left behind.
            arena.end().await;
            played
        })?;
    Ok(playback.join()?)
}

fn prepare(plan: &ReplayPlan, recorded: &Recorded) -> Result<Launch, SupervisorError> {
    let known = roster::SERVICES;
    if let Some(name) = plan.services.iter().find(|name| !known.contains(&name.as_str())) {
        let (file, key) = ("--services".to_owned(), "service".to_owned());
        return Err(ConfigError::Unknown { file, key, value: name.clone(), known: known.join(", ") }.into());
    }
    let settings = settings_of(plan, recorded)?;
    service_core::check_sections(&settings)?;
    // Apart from those of an arena that runs beside the replay.
    let folder = plan.folder.join("replay");
    let logs = folder.join("logs");
    std::fs::create_dir_all(&logs).map_err(|source| SupervisorError::File { path: logs.clone(), source })?;
    let file = folder.join("settings.toml");
    std::fs::write(&file, settings.to_toml())
        .map_err(|source| SupervisorError::File { path: file.clone(), source })?;
    let secret_file = service_shell::secret_file(None);
    service_shell::create_secret_if_absent(&secret_file)?;
    let run = playback::begin_run()?;
    let options = Options {
        settings: Some(file),
        domain: DomainOption::Replay,
        run: Some(run),
        secret_file: Some(secret_file),
        log: plan.log.clone(),
        supervised: true,
        ..Options::default()
    };
    let program = std::env::current_exe()
        .map_err(|source| SupervisorError::System { what: "finding this program's own file", source })?;
    Ok(Launch { program, options, run, seed: None, logs, record: None })
}

/// The recorded settings, on this host's network; or others, if somebody wants to know what they would have done.
fn settings_of(plan: &ReplayPlan, recorded: &Recorded) -> Result<Arena, SupervisorError> {
    let attached = recorded.settings().map_err(PlayError::from)?;
    if let Some(folder) = &plan.config {
        let name = plan.scenario.clone().or_else(|| attached.map(|arena| arena.name));
        return Ok(Arena::load(folder, &name.unwrap_or_else(|| Options::default().scenario))?);
    }
    let network = playback::network(None, recorded)?;
    Ok(Arena { network, ..attached.ok_or(PlayError::NoSettings)? })
}

struct ReplayArena {
    processes: Vec<Supervised>,
    launch: Launch,
}

impl ReplayArena {
    /// Starts everything and stays to the recording's end.
    async fn play(
        &mut self,
        plan: &ReplayPlan,
        setup: &Setup,
        recorded: Recorded,
        screen: &mut Screen,
    ) -> Result<Playback, SupervisorError> {
        let mut stop = Stop::new(false)?;
        let network = setup.arena.network.clone();
        let mut node = Node::<Console>::new(&setup.arena, &setup.secret, setup.identity, setup.started_at)?;
        let mut bus = BusReceiver::join(&network, Domain::Replay, Listen::Topics(node.topics_in()))?;
        for service in &plan.services {
            // As whom it was recorded: the ids that vehicles echo and learners name follow from it.
            let incarnation = recorded.incarnation_of(service).unwrap_or_else(service_shell::incarnation_now);
            self.processes.push(Supervised::start_as(service, incarnation, &self.launch)?);
        }
        let place = Place {
            network,
            secret: setup.secret.clone(),
            run: self.launch.run,
            incarnation: service_shell::incarnation_now(),
        };
        let wanted = playback::Plan {
            selection: Selection { running: plan.services.clone(), ..Selection::default() },
            rate: plan.rate,
            awaits: Await::Nodes(plan.services.clone()),
            ..playback::Plan::default()
        };
        let playback = Playback::start(Box::new(recorded), place, wanted)?;
        let mut ticks = tokio::time::interval(TICK);
        while !playback.is_over() {
            tokio::select! {
                batch = bus.next_batch() => hear(&mut node, &bus, batch?),
                _ = ticks.tick() => self.look_after(&mut node, screen)?,
                _ = std::future::poll_fn(|cx| stop.poll_signal(cx)) => {
                    screen.say("stopping");
                    playback.order(Command::Quit);
                    tokio::time::sleep(Duration::from_millis(100)).await;
                }
            }
        }
        self.look_after(&mut node, screen)?;
        Ok(playback)
    }

    fn look_after(&mut self, node: &mut Node<Console>, screen: &mut Screen) -> Result<(), SupervisorError> {
        let now = clock::now();
        for process in &mut self.processes {
            process.look_after(now, &self.launch)?;
        }
        screen.show(now, node.core_mut(), &self.processes);
        Ok(())
    }

    async fn end(&mut self) {
        for process in &mut self.processes {
            process.terminate();
        }
        for process in &mut self.processes {
            process.wait_end(END_PATIENCE).await;
        }
    }
}

/// The console only listens: the orders of a replay are those of the recording.
fn hear(node: &mut Node<Console>, bus: &BusReceiver, count: usize) {
    for index in 0..count {
        let datagram = bus.datagram(index);
        // What is dropped, the node counts.
        let _ = node.receive(datagram.at, datagram.bytes, &mut |_| {});
    }
}
