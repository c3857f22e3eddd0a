//! `arena stop`: the emergency stop, and its release.

use std::io::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use quantity::{Span, Time};
use schemas::{FlightMode, StopKind, StopOrder, VehicleTelemetry, topics};
use service_core::{Identity, Observer, Publisher, source_of};
use service_shell::{BusReceiver, BusSender, Listen, Options, Setup, ShellError, block_on, clock};

use super::Failure;

/// The order is repeated this often, and for this long.
const PERIOD: Duration = Duration::from_millis(20);
const REPEATED_FOR: Span = Span::from_secs(1);
/// So long after the first order the vehicles must have said that it took effect.
const PATIENCE: Span = Span::from_secs(2);

/// Options of `arena stop`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The vehicle, by its number; every vehicle of the scenario if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    vehicle: Option<u8>,
    /// Release the latch instead: the vehicles may be armed again.
    #[arg(long)]
    release: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    options: Options,
}

/// One vehicle's newest word since the order.
#[derive(Clone, Copy, Debug)]
struct Word {
    vehicle: u8,
    mode: Option<FlightMode>,
}

/// Runs the command: exit code 0 once every vehicle has said that it obeyed, 1 where one has not.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging(&arguments.options.log);
    let setup = Setup::load("arena", &arguments.options.joining())?;
    let mut words: Vec<Word> = setup
        .arena
        .fleet
        .iter()
        .map(|member| Word { vehicle: member.vehicle.id, mode: None })
        .filter(|word| arguments.vehicle.is_none_or(|id| id == word.vehicle))
        .collect();
    if words.is_empty() {
        let known: Vec<String> =
            setup.arena.fleet.iter().map(|member| member.vehicle.id.to_string()).collect();
        return Err(Failure::Usage(format!(
            "no vehicle {} in scenario {}; there are {}",
            arguments.vehicle.unwrap_or_default(),
            setup.arena.name,
            known.join(", ")
        )));
    }
    let kind = if arguments.release { StopKind::Release } else { StopKind::Stop };
    block_on(order(&setup, kind, arguments.vehicle.unwrap_or_default(), &mut words))?;
    report(&words, kind, arguments.json)
}

/// Says the order for its second, and listens until every vehicle has obeyed or patience ends.
async fn order(setup: &Setup, kind: StopKind, vehicle: u8, words: &mut [Word]) -> Result<(), ShellError> {
    let (network, identity) = (&setup.arena.network, setup.identity);
    // A source of its own: the front door that brought the arena up numbers its own messages.
    let identity = Identity { source: source_of("arena stop"), ..identity };
    let mut publisher = Publisher::new("arena", &setup.secret, identity);
    let mut observer = Observer::new(&setup.secret, identity.domain, identity.run);
    let mut receiver =
        BusReceiver::join(network, identity.domain, Listen::Topics(&[&topics::VEHICLE_TELEMETRY]))?;
    let mut sender = BusSender::open(network, identity.domain)?;
    let given_at = clock::now();
    let message = StopOrder { kind, vehicle, given_at };
    let mut ticks = tokio::time::interval(PERIOD);
    loop {
        let now = clock::now();
        let repeats = now - given_at < REPEATED_FOR;
        if now - given_at > PATIENCE || (!repeats && words.iter().all(|word| word.obeyed(kind))) {
            return Ok(());
        }
        tokio::select! {
            _ = ticks.tick(), if repeats => {
                // Numbers and a time of this clock: there is nothing in it that could not be said.
                let _ = publisher.publish(now, &topics::STOP_ORDER, &message, &mut |published| {
                    sender.send(published.datagram);
                });
            }
            batch = receiver.next_batch() => {
                for index in 0..batch? {
                    hear(&mut observer, receiver.datagram(index).bytes, given_at, words);
                }
            }
            () = tokio::time::sleep(PERIOD), if !repeats => {}
        }
    }
}

/// Takes a vehicle's word that is newer than the order.
fn hear(observer: &mut Observer, datagram: &[u8], given_at: Time, words: &mut [Word]) {
    let Ok(observed) = observer.observe(datagram) else { return };
    let Ok(report) = wire::decode::<VehicleTelemetry>(observed.body) else { return };
    if report.received_at < given_at {
        return;
    }
    if let Some(word) = words.iter_mut().find(|word| word.vehicle == report.vehicle) {
        word.mode = Some(report.mode);
    }
}

impl Word {
    fn obeyed(self, kind: StopKind) -> bool {
        match kind {
            StopKind::Stop => self.mode == Some(FlightMode::Stopped),
            StopKind::Release => {
                self.mode.is_some_and(|mode| !matches!(mode, FlightMode::Stopped | FlightMode::Landed))
            }
        }
    }
}

fn report(words: &[Word], kind: StopKind, json: bool) -> Result<ExitCode, Failure> {
    let mut out = std::io::stdout().lock();
    let obeyed = words.iter().all(|word| word.obeyed(kind));
    if json {
        let vehicles: Vec<serde_json::Value> = words
            .iter()
            .map(|word| {
                let mode = word.mode.map(|mode| format!("{mode:?}"));
                serde_json::json!({ "vehicle": word.vehicle, "mode": mode, "obeyed": word.obeyed(kind) })
            })
            .collect();
        writeln!(out, "{}", serde_json::json!({ "obeyed": obeyed, "vehicles": vehicles }))?;
    } else {
        for word in words {
            let mode =
                word.mode.map_or_else(|| "silent".to_owned(), |mode| format!("{mode:?}").to_lowercase());
            writeln!(out, "vehicle {}: {mode}", word.vehicle)?;
        }
    }
    if !obeyed {
        eprintln!("error: not every vehicle has said that it obeyed; cut the power by hand");
    }
    Ok(if obeyed { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
