//! A recording back on the bus: bit for bit, as live data for unmodified services, and never near a radio.

mod attack;
mod services;
mod stream;

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use front_door::experiment::{node, services as all_services};
use playback::{Kept, Place, Plan, Playback, Summary, Tape};
use quantity::{Span, Time};
use recording::{Definition, Stream};
use schemas::{ReplayClock, ReplayState, topics};
use service_core::Observer;
use service_shell::{BusReceiver, Listen};
use settings::Arena;
use virtual_arena::VirtualArena;
use wire::{Domain, Kind, Secret};

use crate::common::{front_door, place};

const RUN: u64 = 0xfeed;
/// Long enough for a crowded machine; a healthy one needs a tenth.
const PATIENCE: Duration = Duration::from_secs(120);

/// A replay domain of its own: a folder, ports, a secret.
struct Hall {
    folder: PathBuf,
    settings: Arena,
    secret: Secret,
}

impl Hall {
    fn new(name: &str, port_offset: u16) -> Self {
        let folder = place(&format!("playback-{name}"), port_offset);
        let secret = folder.join(".flyarena/secret");
        service_shell::create_secret_if_absent(&secret).unwrap();
        Self {
            settings: Arena::load(&folder.join("config"), "double-flip").unwrap(),
            secret: service_shell::read_secret(&secret).unwrap(),
            folder,
        }
    }

    /// Starts a service in the replay domain, as a person would by hand.
    fn run(&self, service: &str) -> Service {
        let child = Command::new(front_door())
            .args(["run", service, "--domain", "replay", "--run", &format!("{RUN:x}"), "--log", "warn"])
            .current_dir(&self.folder)
            .env_remove("FLYARENA_SECRET_FILE")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        Service(child)
    }

    /// Brings a simulated arena up, as a person would.
    fn up(&self) -> Simulated {
        let mut child = Command::new(front_door())
            .args(["up", "double-flip", "--log", "warn"])
            .current_dir(&self.folder)
            .env_remove("FLYARENA_SECRET_FILE")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        Simulated { child, lines }
    }

    fn play(&self, tape: &Tape, plan: Plan) -> Playback {
        let place = Place {
            network: self.settings.network.clone(),
            secret: self.secret.clone(),
            run: RUN,
            incarnation: service_shell::incarnation_now(),
        };
        Playback::start(Box::new(tape.clone()), place, plan).unwrap()
    }

    /// Plays a tape to its end; everything that was heard meanwhile on the replay's bus.
    fn hear(&self, tape: &Tape, plan: Plan) -> (Vec<Word>, Summary) {
        self.hear_while(tape, plan, &mut |_, _| {})
    }

    fn hear_while(
        &self,
        tape: &Tape,
        plan: Plan,
        attend: &mut dyn FnMut(&Playback, &ReplayClock),
    ) -> (Vec<Word>, Summary) {
        let mut words = Vec::new();
        let summary = service_shell::block_on(async {
            let network = &self.settings.network;
            let mut bus = BusReceiver::join(network, Domain::Replay, Listen::Everything)?;
            let mut observer = Observer::new(&self.secret, Domain::Replay, RUN);
            let playback = self.play(tape, plan);
            loop {
                let count = match tokio::time::timeout(PATIENCE, bus.next_batch()).await {
                    Ok(count) => count?,
                    Err(_) => panic!("silence on the bus; playback is at {:?}", playback.status()),
                };
                for index in 0..count {
                    let heard = observer.observe(bus.datagram(index).bytes).unwrap();
                    if heard.topic.name() == topics::REPLAY_CLOCK.name && heard.header.kind == Kind::Data {
                        let clock: ReplayClock = wire::decode(heard.body).unwrap();
                        attend(&playback, &clock);
                        if clock.state == ReplayState::Ended {
                            assert_eq!(bus.take_overflowed(), 0, "the listener was too slow to tell");
                            assert_eq!(observer.lost_total(), 0, "numbers that never came");
                            return Ok(playback.join().unwrap());
                        }
                    }
                    words.push(Word::of(&heard));
                }
            }
        });
        (words, summary.unwrap())
    }
}

/// What was said on the bus.
#[derive(Clone, Debug, PartialEq)]
struct Word {
    topic: String,
    kind: Kind,
    source: u32,
    schema_id: u64,
    published_at: Time,
    verified: bool,
    body: Vec<u8>,
}

impl Word {
    fn of(heard: &service_core::Observed<'_>) -> Self {
        Self {
            topic: heard.topic.name().to_owned(),
            kind: heard.header.kind,
            source: heard.header.source,
            schema_id: heard.header.schema_id,
            published_at: heard.header.published_at,
            verified: heard.verified,
            body: heard.body.to_vec(),
        }
    }

    fn is_of_the_recording(&self) -> bool {
        let own = [topics::REPLAY_CLOCK.name, topics::REPLAY_ANSWER.name];
        self.kind == Kind::Data && !own.contains(&self.topic.as_str())
    }
}

/// A simulated arena; it ends with the test.
struct Simulated {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Simulated {
    /// Waits for a line of a vehicle that is in the air and tracked.
    fn wait_for_hover(&mut self) {
        let mut line = String::new();
        while !(line.contains("Tracking") && line.contains(", 4.")) {
            line.clear();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "the arena has ended");
        }
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        // Twice: at once, with all its services.
        for _ in 0..2 {
            let _ = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status();
            std::thread::sleep(Duration::from_millis(300));
        }
        let _ = self.child.wait();
    }
}

/// A service as a process; it ends with the test.
struct Service(Child);

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An arena in virtual time, taken down for a while as a recorder would.
fn record(settings: &Arena, from: Span, span: Span) -> Tape {
    let mut arena = VirtualArena::new(settings, 5, &all_services(), &node).unwrap();
    let mut tape = Tape::default();
    let definitions: Vec<Arc<Definition>> = topics::ALL
        .iter()
        .map(|topic| {
            let (name, text) = (topic.schema.name.to_owned(), topic.schema_text().to_owned());
            Arc::new(Definition { id: topic.schema_id(), name, text })
        })
        .collect();
    arena.run_for(from, &mut |_| {});
    arena.run_for(span, &mut |heard| {
        let opened = wire::open(heard.published.datagram).unwrap();
        let header = *opened.claimed();
        if matches!(header.kind, Kind::Schema | Kind::SchemaRequest) {
            return;
        }
        let entry = recording::Entry {
            at: heard.at,
            header: &header,
            topic: heard.published.topic.name,
            verified: true,
            body: heard.published.body,
        };
        let definition = definitions.iter().find(|definition| definition.id == header.schema_id);
        let kept = Kept {
            channel: 0,
            sequence: header.sequence as u32,
            at: heard.at,
            published_at: header.published_at,
            body: heard.published.body.to_vec(),
        };
        tape.push(&Stream::of(&entry), definition, kept);
    });
    tape
}
