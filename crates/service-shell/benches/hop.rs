//! One hop over the bus: from sealing a message to the step of the core that reads it, next to a blocking raw
//! socket reading the same datagrams without authenticating or decoding them. Ratios within one run count.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;
use std::thread;
use std::time::Duration;

use quantity::{Span, Time};
use schemas::{VehicleCommand, VehicleState, topics};
use service_core::{Core, Event, Node, Outbox, Publisher, Start, inputs, outputs};
use service_shell::{BusSender, Setup, ShellError, clock, drive, endpoint, identity};
use settings::{Arena, ConfigError, Endpoint};
use socket2::{Domain as Family, Protocol, Socket, Type};
use wire::{Domain, Secret};

const DATAGRAMS: usize = 6_000;
const PERIOD: Duration = Duration::from_micros(500);
const ROUNDS: usize = 3;

static LATENCIES: Mutex<Vec<Span>> = Mutex::new(Vec::new());

inputs! {
    /// What the measured service hears.
    pub enum Input {
        /// States.
        State(VehicleState) = topics::VEHICLE_STATE,
    }
}
outputs! {
    /// What it could say.
    pub enum Output {
        /// Commands.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
    }
}

/// Notes how old each state is.
struct Listener;

impl Core for Listener {
    const NAME: &'static str = "hover-controller";
    type Tuning = toml::Table;
    type Input = Input;
    type Output = Output;

    fn new(_: &Arena, _: toml::Table, _: Start) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn deadline(&self) -> Option<Time> {
        None
    }

    fn step(&mut self, _: Time, event: Event<Input>, _: &mut Outbox<Output>) {
        if let Event::Input(Input::State(state)) = event {
            note(clock::now() - state.estimated_for);
        }
    }
}

fn note(latency: Span) {
    if let Ok(mut latencies) = LATENCIES.lock() {
        latencies.push(latency);
    }
}

fn percentile_us(sorted: &[Span], percent: usize) -> f64 {
    let index = (sorted.len() * percent / 100).min(sorted.len().saturating_sub(1));
    sorted.get(index).map_or(f64::NAN, |span| span.as_secs_f64() * 1e6)
}

/// Ends a measurement: prints it and gives its median.
fn report(name: &str) -> f64 {
    let mut latencies = LATENCIES.lock().map(|mut all| std::mem::take(&mut *all)).unwrap_or_default();
    latencies.sort_unstable();
    let [p50, p90, p99] = [50, 90, 99].map(|percent| percentile_us(&latencies, percent));
    println!("{name}: {} of {DATAGRAMS}, p50 {p50:.1} us, p90 {p90:.1} us, p99 {p99:.1} us", latencies.len());
    p50
}

fn send_all(setup: &Setup, incarnation: u32) -> Result<(), ShellError> {
    let mut bus = BusSender::open(&setup.arena.network, Domain::Sim)?;
    let sender = identity("estimator", Domain::Sim, setup.identity.run, incarnation);
    let mut publisher = Publisher::new("estimator", &setup.secret, sender);
    thread::sleep(Duration::from_millis(200));
    for _ in 0..DATAGRAMS {
        thread::sleep(PERIOD);
        let now = clock::now();
        let state = VehicleState { vehicle: 1, estimated_for: now, ..VehicleState::default() };
        let _ = publisher.publish(now, &topics::VEHICLE_STATE, &state, &mut |said| bus.send(said.datagram));
    }
    thread::sleep(Duration::from_millis(100));
    Ok(())
}

fn raw(setup: &Setup, incarnation: u32) -> Result<(), ShellError> {
    let (network, bus) = (&setup.arena.network, endpoint(&setup.arena.network, Domain::Sim));
    let open = || {
        let socket = Socket::new(Family::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        socket.set_reuse_address(true)?;
        socket.bind(&SocketAddrV4::new(bus.group, bus.port).into())?;
        socket.join_multicast_v4(&bus.group, &network.interface.address())?;
        socket.set_read_timeout(Some(Duration::from_secs(1)))?;
        Ok::<UdpSocket, std::io::Error>(std::os::fd::OwnedFd::from(socket).into())
    };
    let socket =
        open().map_err(|source| ShellError::System { what: "opening a raw socket".to_owned(), source })?;
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut bytes = [0; 2048];
            for _ in 0..DATAGRAMS {
                let Ok(count) = socket.recv(&mut bytes) else { break };
                let now = clock::now();
                if let Some(stamp) = bytes[..count].get(48..56).and_then(|stamp| stamp.first_chunk()) {
                    note(now - Time::from_nanos(i64::from_le_bytes(*stamp)));
                }
            }
        });
        send_all(setup, incarnation)
    })
}

fn shell(setup: &Setup, incarnation: u32) -> Result<(), ShellError> {
    let mut node = Node::<Listener>::new(&setup.arena, &setup.secret, setup.identity, clock::now())?;
    thread::scope(|scope| {
        let sender = scope.spawn(|| {
            let sent = send_all(setup, incarnation);
            // How a node is told to end, here by its own process.
            let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::TERM);
            sent
        });
        drive(setup, &mut node)?;
        sender.join().unwrap_or(Ok(()))
    })
}

fn measure() -> Result<(), ShellError> {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let mut arena = Arena::load(&config, "double-flip")?;
    // Not where a simulated arena may be running.
    arena.network.sim = Endpoint { group: Ipv4Addr::new(239, 255, 71, 200), port: 47_200 };
    let run = u64::from(std::process::id()) << 32;
    let identity = identity("hover-controller", Domain::Sim, run, 1);
    let setup =
        Setup { arena, secret: Secret::new([3; 32]), identity, started_at: clock::now(), supervised: false };
    let mut ratios = Vec::new();
    for round in 0..ROUNDS as u32 {
        raw(&setup, 2 * round + 1)?;
        let plain = report("raw socket, blocking      ");
        shell(&setup, 2 * round + 2)?;
        let ours = report("shell: authentic, decoded ");
        ratios.push(ours / plain);
    }
    ratios.sort_unstable_by(f64::total_cmp);
    println!("p50 ratio, median of {ROUNDS} rounds: {:.2}", ratios[ROUNDS / 2]);
    Ok(())
}

fn main() -> ExitCode {
    service_shell::finish(measure())
}
