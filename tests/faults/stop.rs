//! A person presses the emergency stop, on a bad day: every link loses three frames of ten.

use device::vehicle_link::FlightMode;
use front_door::experiment::{node, services};
use plant::faults::Fault;
use quantity::{Span, Time};
use schemas::{ArenaOrder, OrderKind, StopKind, StopOrder, topics};
use serde::Deserialize;
use service_core::{Core, Event, Node, Outbox, Start};
use settings::{Arena, ConfigError};
use virtual_arena::VirtualArena;

use crate::common::arena;

const LOSS_RATIO: f64 = 0.3;
/// Presses tried: a tenth of what `FLYARENA_LONG=1` asks for.
const PRESSES: u64 = 100;
const EFFECTIVE_WITHIN: Span = Span::from_millis(200);

service_core::inputs! {
    /// It hears nothing.
    pub(super) enum Input {}
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

fn mode(arena: &VirtualArena<'_>) -> FlightMode {
    arena.plant().firmware(1).unwrap().mode()
}

/// Presses once in a flight of its own; answers what the vehicle did then and how long it took to stop.
fn press(settings: &Arena, seed: u64) -> (FlightMode, Span) {
    // Presses fall into the climb, the hover, flips and what follows them.
    let stop_at = Time::ZERO + Span::from_millis(3_500 + (seed * 97) as i64 % 9_000);
    let release_at = stop_at + Span::from_secs(4);
    let factory = move |name: &str, arena: &Arena, secret: &wire::Secret, identity, now| {
        if name != "arena" {
            return node(name, arena, secret, identity, now);
        }
        let mut node = Node::<Person>::new(arena, secret, identity, now)?;
        (node.core_mut().stop_at, node.core_mut().release_at) = (stop_at, release_at);
        Ok(Box::new(node) as Box<dyn service_core::AnyNode>)
    };
    let mut flying = VirtualArena::new(settings, seed, &services(), &factory).unwrap();
    flying.run_until(stop_at, &mut |_| {});
    let before = mode(&flying);
    for fault in [
        Fault::CommandLoss { vehicle: 1, loss_ratio: LOSS_RATIO },
        Fault::DataLoss { vehicle: 1, loss_ratio: LOSS_RATIO },
    ] {
        flying.plant_mut().fault(fault, stop_at, Time::FAR_FUTURE);
    }
    flying.network_mut().loss_ratio = LOSS_RATIO;
    while mode(&flying) != FlightMode::Stopped && flying.now() - stop_at < Span::from_secs(2) {
        flying.run_for(Span::from_millis(1), &mut |_| {});
    }
    let took = flying.now() - stop_at;
    while flying.now() + Span::from_millis(20) < release_at {
        flying.run_for(Span::from_millis(20), &mut |_| {});
        assert_eq!(mode(&flying), FlightMode::Stopped, "seed {seed}: it must stay off");
        assert!(flying.plant().truth(1).unwrap().motors_off(), "seed {seed}");
    }
    flying.run_for(Span::from_secs(3), &mut |_| {});
    assert_eq!(mode(&flying), FlightMode::Disarmed, "seed {seed}: released, and nobody asks it to fly");
    (before, took)
}

#[test]
fn an_emergency_stop_is_effective_at_once_and_lasts_until_released() {
    let settings = arena("double-flip");
    let presses = if std::env::var_os("FLYARENA_LONG").is_some() { 10 * PRESSES } else { PRESSES };
    let mut spans = Vec::new();
    let mut in_flight = 0;
    for seed in 1..=presses {
        let (before, took) = press(&settings, seed);
        in_flight += u64::from(matches!(before, FlightMode::Flying | FlightMode::Maneuver));
        assert!(took <= EFFECTIVE_WITHIN, "seed {seed}: {took} after the press, in {before:?}");
        spans.push(took);
    }
    spans.sort_unstable();
    let at = |ratio: f64| spans[((spans.len() - 1) as f64 * ratio) as usize];
    println!(
        "{presses} presses, {in_flight} in flight: median {}, p99 {}, longest {}",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    assert!(in_flight > presses / 2, "only {in_flight} presses met a flying vehicle");
}
