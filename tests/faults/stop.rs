//! A person presses the emergency stop, on a bad day: every link and the bus lose three frames of ten, the bridge dies
//! afterwards, and a controller that has heard of nothing goes on ordering to fly.

use std::thread;

use device::vehicle_link::FlightMode;
use front_door::experiment::{message, node, services};
use plant::faults::Fault;
use quantity::{Span, Time};
use schemas::{ArenaOrder, CommandMode, CommandSent, OrderKind, StopKind, StopOrder, VehicleCommand, topics};
use serde::Deserialize;
use service_core::{Core, Event, Node, Outbox, Start};
use settings::{Arena, ConfigError};
use virtual_arena::VirtualArena;

use crate::common::arena;

const LOSS_RATIO: f64 = 0.3;
const PRESSES: u64 = 1_000;
const EFFECTIVE_WITHIN: Span = Span::from_millis(200);

service_core::inputs! {
    /// It hears nothing.
    pub(super) enum Input {}
}

service_core::outputs! {
    /// What a controller that hears nothing says.
    enum Blind {
        /// Fly on.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
    }
}

service_core::outputs! {
    /// What the front door's person says.
    pub(super) enum Output {
        /// Fly.
        Order(ArenaOrder) = topics::ARENA_ORDER,
        /// Stop, or go again.
        Stop(StopOrder) = topics::STOP_ORDER,
    }
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct Tuning {}

/// Orders to fly, and at its instants to stop and to release, as `arena stop` does: at 50 Hz for a second.
#[derive(Debug)]
pub(super) struct Person {
    started_at: Time,
    next_at: Time,
    pub(super) stop_at: Time,
    pub(super) release_at: Time,
}

impl Core for Person {
    const NAME: &'static str = "arena";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        let never = Time::FAR_FUTURE;
        Ok(Self { started_at: start.at, next_at: start.at, stop_at: never, release_at: never })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, _event: Event<Input>, out: &mut Outbox<Output>) {
        self.next_at = now + Span::from_millis(20);
        out.publish(ArenaOrder { kind: OrderKind::Fly, given_at: self.started_at });
        for (given_at, kind) in [(self.stop_at, StopKind::Stop), (self.release_at, StopKind::Release)] {
            if now >= given_at && now < given_at.saturating_add(Span::from_secs(1)) {
                out.publish(StopOrder { kind, vehicle: 0, given_at });
            }
        }
    }
}

/// A controller that hears nothing and orders to climb, in the place of the arena's own.
#[derive(Debug)]
struct Stubborn {
    next_at: Time,
    lease_epoch: u32,
}

impl Core for Stubborn {
    const NAME: &'static str = "hover-controller";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Blind;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { next_at: start.at, lease_epoch: start.incarnation })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, _event: Event<Input>, out: &mut Outbox<Blind>) {
        self.next_at = now + Span::from_millis(5);
        out.publish(VehicleCommand {
            vehicle: 1,
            mode: CommandMode::Fly,
            lease_epoch: self.lease_epoch,
            valid_until: now + Span::from_millis(100),
            collective_m_s2: 15.0,
            ..VehicleCommand::default()
        });
    }
}

/// What became of a press.
#[derive(Clone, Copy, Debug)]
struct Pressed {
    /// What the vehicle did then.
    before: FlightMode,
    /// Until its motors were off, in truth.
    took: Span,
    /// Orders to fly that went out to it while it was stopped.
    defied: u64,
}

/// When what happens in one flight.
#[derive(Clone, Copy, Debug)]
struct Times {
    stop_at: Time,
    /// The bridge dies and comes back: while the person still says stop, or after.
    bridge_at: Time,
    stubborn_from: Time,
    stubborn_until: Time,
    release_at: Time,
}

impl Times {
    fn of(seed: u64) -> Self {
        // Presses fall into the climb, the hover, flips and what follows them.
        let stop_at = Time::ZERO + Span::from_millis(3_500 + (seed * 97) as i64 % 9_000);
        Self {
            stop_at,
            bridge_at: stop_at + Span::from_millis(if seed.is_multiple_of(2) { 300 } else { 1_300 }),
            stubborn_from: stop_at + Span::from_millis(1_500),
            stubborn_until: stop_at + Span::from_millis(3_000),
            release_at: stop_at + Span::from_secs(4),
        }
    }
}

fn is_off(flying: &VirtualArena<'_>) -> bool {
    let stopped = flying.plant().firmware(1).unwrap().mode() == FlightMode::Stopped;
    stopped && flying.plant().truth(1).unwrap().motors_off()
}

/// Presses once in a flight of its own.
fn press(settings: &Arena, seed: u64) -> Pressed {
    let times = Times::of(seed);
    let factory = move |name: &str, arena: &Arena, secret: &wire::Secret, identity, now: Time| {
        if name == "arena" {
            let mut node = Node::<Person>::new(arena, secret, identity, now)?;
            (node.core_mut().stop_at, node.core_mut().release_at) = (times.stop_at, times.release_at);
            return Ok(Box::new(node) as Box<dyn service_core::AnyNode>);
        }
        if name == "hover-controller" && now >= times.stubborn_from && now < times.stubborn_until {
            return Ok(Box::new(Node::<Stubborn>::new(arena, secret, identity, now)?) as _);
        }
        node(name, arena, secret, identity, now)
    };
    let mut flying = VirtualArena::new(settings, seed, &services(), &factory).unwrap();
    flying.run_until(times.stop_at, &mut |_| {});
    let before = flying.plant().firmware(1).unwrap().mode();
    for fault in [
        Fault::CommandLoss { vehicle: 1, loss_ratio: LOSS_RATIO },
        Fault::DataLoss { vehicle: 1, loss_ratio: LOSS_RATIO },
    ] {
        flying.plant_mut().fault(fault, times.stop_at, Time::FAR_FUTURE);
    }
    flying.network_mut().loss_ratio = LOSS_RATIO;
    while !is_off(&flying) && flying.now() - times.stop_at < Span::from_secs(2) {
        flying.run_for(Span::from_millis(1), &mut |_| {});
    }
    let took = flying.now() - times.stop_at;
    let defied = stays_off(&mut flying, &times, seed);
    flying.run_for(Span::from_secs(3), &mut |_| {});
    let mode = flying.plant().firmware(1).unwrap().mode();
    assert_eq!(mode, FlightMode::Disarmed, "seed {seed}: released, and nobody asks it to fly");
    Pressed { before, took, defied }
}

/// Watches the vehicle stay off until shortly before the release, whatever happens; answers how many orders to fly
/// went out to it meanwhile.
fn stays_off(flying: &mut VirtualArena<'_>, times: &Times, seed: u64) -> u64 {
    let mut defied = 0;
    let mut wait_until = |flying: &mut VirtualArena<'_>, end: Time| {
        while flying.now() < end {
            flying.run_until((flying.now() + Span::from_millis(10)).min(end), &mut |heard| {
                let sent = message::<CommandSent>(&heard, &topics::COMMAND_SENT);
                defied += u64::from(sent.is_some_and(|sent| sent.mode == CommandMode::Fly));
            });
            assert!(is_off(flying), "seed {seed}: it must stay off, {} after", flying.now() - times.stop_at);
        }
    };
    wait_until(flying, times.bridge_at);
    flying.kill("radio-bridge");
    wait_until(flying, times.bridge_at + Span::from_millis(100));
    flying.restart("radio-bridge").unwrap();
    wait_until(flying, times.stubborn_from);
    flying.kill("hover-controller");
    flying.restart("hover-controller").unwrap();
    wait_until(flying, times.stubborn_until);
    flying.kill("hover-controller");
    flying.restart("hover-controller").unwrap();
    wait_until(flying, times.release_at - Span::from_millis(20));
    defied
}

/// Presses in flights on all cores, each with a seed of its own.
fn presses() -> Vec<Pressed> {
    let settings = arena("double-flip");
    let workers = thread::available_parallelism().map_or(1, usize::from);
    let work = |first: u64| -> Vec<Pressed> {
        (first..=PRESSES).step_by(workers).map(|seed| press(&settings, seed)).collect()
    };
    thread::scope(|scope| {
        let work = &work;
        let running: Vec<_> = (1..=workers as u64).map(|first| scope.spawn(move || work(first))).collect();
        running.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    })
}

#[test]
fn an_emergency_stop_is_effective_at_once_and_lasts_until_released() {
    let all = presses();
    assert_eq!(all.len() as u64, PRESSES);
    let in_flight = |pressed: &&Pressed| matches!(pressed.before, FlightMode::Flying | FlightMode::Maneuver);
    for mode in [FlightMode::Flying, FlightMode::Maneuver] {
        let mut spans: Vec<Span> =
            all.iter().filter(|pressed| pressed.before == mode).map(|pressed| pressed.took).collect();
        spans.sort_unstable();
        let at = |ratio: f64| spans[((spans.len() - 1) as f64 * ratio) as usize];
        println!(
            "{} presses in {mode:?}: median {}, p90 {}, p99 {}, longest {}",
            spans.len(),
            at(0.5),
            at(0.9),
            at(0.99),
            at(1.0)
        );
    }
    let late: Vec<_> = all.iter().filter(|pressed| pressed.took > EFFECTIVE_WITHIN).collect();
    assert!(late.is_empty(), "{late:?}");
    let flying = all.iter().filter(in_flight).count();
    assert!(flying > all.len() / 2, "only {flying} presses met a flying vehicle");
    // A bridge that was started anew after the person fell silent knows of no stop, and passes orders on.
    let defied = all.iter().filter(|pressed| pressed.defied > 20).count();
    println!(
        "{} presses, {flying} in flight; {defied} vehicles were ordered to fly while stopped",
        all.len()
    );
    assert!(defied > all.len() / 3, "only {defied} vehicles were tempted");
}
