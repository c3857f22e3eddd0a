//! Settings, an arena in virtual time, and what was heard in it.

use std::path::{Path, PathBuf};

use front_door::director::Director;
use front_door::experiment::{message, node, services};
use quantity::{Span, Time, Vector, World};
use schemas::{NodeEvent, OrderKind, topics};
use service_core::{AnyNode, Identity, Node};
use settings::{Arena, ConfigError};
use virtual_arena::{Heard, VirtualArena};
use wire::{DropReason, Secret};

/// The folder of the settings.
pub fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../config")
}

/// A scenario's settings.
pub fn arena(scenario: &str) -> Arena {
    Arena::load(&config(), scenario).unwrap()
}

/// Builds any node, with a director who orders to hover.
pub fn hovering_node(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    if name == "arena" {
        let mut director = Node::<Director>::new(arena, secret, identity, now)?;
        director.core_mut().order(now, OrderKind::Hover);
        return Ok(Box::new(director));
    }
    node(name, arena, secret, identity, now)
}

/// An arena in virtual time with a watchful eye on its vehicles.
pub struct Flight {
    pub arena: VirtualArena<'static>,
    pub settings: Arena,
    pub events: Vec<NodeEvent>,
}

impl Flight {
    /// An arena whose vehicles take off and hover at their places; not yet begun.
    pub fn to_hover(settings: Arena, seed: u64) -> Self {
        let arena = VirtualArena::new(&settings, seed, &services(), &hovering_node).unwrap();
        Self { arena, settings, events: Vec::new() }
    }

    /// An arena that works through its scenario; not yet begun.
    pub fn to_learn(settings: Arena, seed: u64) -> Self {
        let arena = VirtualArena::new(&settings, seed, &services(), &node).unwrap();
        Self { arena, settings, events: Vec::new() }
    }

    /// A scenario's vehicles in a settled hover.
    pub fn hovering(scenario: &str, seed: u64) -> Self {
        let mut flight = Self::to_hover(arena(scenario), seed);
        flight.run(Span::from_secs(20));
        flight
    }

    /// Runs for a while, keeping events, and asserts after every 5 ms that no vehicle has left the hall.
    pub fn run(&mut self, span: Span) {
        let end = self.arena.now() + span;
        while self.arena.now() < end {
            let until = (self.arena.now() + Span::from_millis(5)).min(end);
            let events = &mut self.events;
            self.arena.run_until(until, &mut |heard: Heard<'_>| {
                events.extend(message::<NodeEvent>(&heard, &topics::NODE_EVENT));
            });
            for member in &self.settings.fleet {
                let at = self.position_m(member.vehicle.id);
                assert!(
                    self.settings.hall.contains(at.x, at.y, at.z + 1e-3),
                    "vehicle {} left the hall at {at:?}, {}",
                    member.vehicle.id,
                    self.arena.now()
                );
            }
        }
    }

    /// Where a vehicle truly is.
    pub fn position_m(&self, vehicle: u8) -> Vector<World> {
        self.arena.plant().truth(vehicle).unwrap().motion.position_m
    }

    /// How many datagrams all nodes have dropped for that reason.
    pub fn dropped(&self, reason: DropReason) -> u64 {
        services()
            .iter()
            .filter_map(|name| self.arena.node(name))
            .map(|node| node.counters().dropped(reason))
            .sum()
    }

    /// Steps of each node's core.
    pub fn steps_by_node(&self) -> Vec<(&'static str, u64)> {
        services().iter().filter_map(|name| self.arena.node(name)).map(|node| (node.name(), node.steps())).collect()
    }
}
