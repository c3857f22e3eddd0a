//! Settings, an arena in virtual time, and what was heard in it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

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

/// The front door's binary as its sources are now. Cargo builds no binary of another package for a test, and one that
/// lies about may be older than what is tested: so cargo is asked, once, and has nothing to do where all is new.
pub fn front_door() -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let build = || {
        let test = std::env::current_exe().unwrap();
        let folder = test.parent().unwrap().parent().unwrap();
        let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
        let built = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--locked", "-p", "arena", "--bin", "arena", "--profile", profile])
            .args(["--target-dir".as_ref(), folder.parent().unwrap().as_os_str()])
            .current_dir(config().parent().unwrap())
            .status()
            .unwrap();
        assert!(built.success());
        folder.join("arena")
    };
    BUILT.get_or_init(build).clone()
}

/// Copies a folder and all below it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// A folder of its own for one test, with a copy of the settings on groups' ports of its own.
pub fn place(name: &str, port_offset: u16) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    copy(&config(), &folder.join("config"));
    let network = folder.join("config/network.toml");
    let text = fs::read_to_string(&network).unwrap();
    let text = [47101_u16, 47102, 47103, 51001, 52000, 52100]
        .iter()
        .fold(text, |text, port| text.replace(&port.to_string(), &(port + port_offset).to_string()));
    fs::write(&network, text).unwrap();
    folder
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

/// A director built this long after the beginning orders to land where an earlier one ordered to hover.
pub const LANDS_AFTER: Span = Span::from_secs(20);

/// Builds any node, with a director who orders to hover, and one who orders to land if it is restarted after
/// [`LANDS_AFTER`].
pub fn landing_node(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    if name == "arena" && now >= Time::ZERO + LANDS_AFTER {
        let mut director = Node::<Director>::new(arena, secret, identity, now)?;
        director.core_mut().order(now, OrderKind::Land);
        return Ok(Box::new(director));
    }
    hovering_node(name, arena, secret, identity, now)
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

    /// An arena whose vehicles hover, and land once its director is restarted after [`LANDS_AFTER`].
    pub fn to_hover_and_land(settings: Arena, seed: u64) -> Self {
        let arena = VirtualArena::new(&settings, seed, &services(), &landing_node).unwrap();
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
                if let Some(event) = message::<NodeEvent>(&heard, &topics::NODE_EVENT) {
                    assert_ne!(event.name.as_str(), "message-unsayable", "{}: {}", event.node, event.detail);
                    events.push(event);
                }
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
        services()
            .iter()
            .filter_map(|name| self.arena.node(name))
            .map(|node| (node.name(), node.steps()))
            .collect()
    }
}
