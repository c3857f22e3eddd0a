//! Cores small enough to count what they do: one that ticks, one that answers each tick, one that counts frames.

use std::path::Path;

use quantity::{Span, Time};
use schemas::{ArenaOrder, DeviceBytes, ManeuverResult, MocapFrame, topics};
use serde::Deserialize;
use service_core::{AnyNode, Core, Event, Identity, Node, Outbox, Seed, Start, inputs, outputs};
use settings::{Arena, ConfigError};
use virtual_arena::VirtualArena;
use wire::Secret;

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {}

mod silence {
    service_core::inputs! {
        /// Nothing.
        pub enum Input {}
    }
}

mod ticks {
    use super::*;
    outputs! {
        /// Ticks.
        pub enum Output {
            /// A tick.
            Order(ArenaOrder) = topics::ARENA_ORDER,
        }
    }
}

mod answers {
    use super::*;
    inputs! {
        /// Ticks.
        pub enum Input {
            /// A tick.
            Order(ArenaOrder) = topics::ARENA_ORDER,
        }
    }
    outputs! {
        /// Answers.
        pub enum Output {
            /// An answer: which tick it was for, and how many there were.
            Result(ManeuverResult) = topics::MANEUVER_RESULT,
        }
    }
}

mod frames {
    use super::*;
    inputs! {
        /// The cameras' bytes.
        pub enum Input {
            /// Bytes.
            Bytes(DeviceBytes) = topics::VICON_RX,
        }
    }
    outputs! {
        /// Frames.
        pub enum Output {
            /// How many came.
            Frame(MocapFrame) = topics::MOCAP_FRAME,
        }
    }
}

/// Ticks every 10 ms, as the front door.
pub struct Ticker(Time);

pub const TICK: Span = Span::from_millis(10);

impl Core for Ticker {
    const NAME: &'static str = "arena";
    type Tuning = Tuning;
    type Input = silence::Input;
    type Output = ticks::Output;

    fn new(_: &Arena, _: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self(start.at))
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.0)
    }

    fn step(&mut self, now: Time, _: Event<silence::Input>, out: &mut Outbox<ticks::Output>) {
        self.0 = now + TICK;
        out.publish(ArenaOrder { given_at: now, ..ArenaOrder::default() });
    }
}

/// Answers each tick, as the flip manager; `vehicle` of its answers is its incarnation.
pub struct Answerer {
    start: Start,
    count: u32,
}

impl Core for Answerer {
    const NAME: &'static str = "flip-manager";
    type Tuning = Tuning;
    type Input = answers::Input;
    type Output = answers::Output;

    fn new(_: &Arena, _: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { start, count: 0 })
    }

    fn deadline(&self) -> Option<Time> {
        None
    }

    fn step(&mut self, _: Time, event: Event<answers::Input>, out: &mut Outbox<answers::Output>) {
        if let Event::Input(answers::Input::Order(order)) = event {
            self.count += 1;
            out.publish(ManeuverResult {
                vehicle: self.start.incarnation as u8,
                iteration: self.count,
                began_at: order.given_at,
                ..ManeuverResult::default()
            });
        }
    }
}

/// Counts what comes from the cameras, as the vicon bridge.
pub struct Eye(u64);

impl Core for Eye {
    const NAME: &'static str = "vicon-bridge";
    type Tuning = Tuning;
    type Input = frames::Input;
    type Output = frames::Output;

    fn new(_: &Arena, _: Tuning, start: Start) -> Result<Self, ConfigError> {
        assert_ne!(start.seed, Seed(0));
        Ok(Self(0))
    }

    fn deadline(&self) -> Option<Time> {
        None
    }

    fn step(&mut self, _: Time, event: Event<frames::Input>, out: &mut Outbox<frames::Output>) {
        if let Event::Input(frames::Input::Bytes(bytes)) = event {
            self.0 += 1;
            out.publish(MocapFrame { frame: self.0, exposed_at: bytes.at, ..MocapFrame::default() });
        }
    }
}

/// Asks to be woken at the same instant for ever.
pub struct Restless;

impl Core for Restless {
    const NAME: &'static str = "learner";
    type Tuning = Tuning;
    type Input = silence::Input;
    type Output = ticks::Output;

    fn new(_: &Arena, _: Tuning, _: Start) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn deadline(&self) -> Option<Time> {
        Some(Time::ZERO)
    }

    fn step(&mut self, _: Time, _: Event<silence::Input>, _: &mut Outbox<ticks::Output>) {}
}

pub fn node(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    Ok(match name {
        Ticker::NAME => Box::new(Node::<Ticker>::new(arena, secret, identity, now)?),
        Answerer::NAME => Box::new(Node::<Answerer>::new(arena, secret, identity, now)?),
        Eye::NAME => Box::new(Node::<Eye>::new(arena, secret, identity, now)?),
        Restless::NAME => Box::new(Node::<Restless>::new(arena, secret, identity, now)?),
        other => panic!("no core is called {other}"),
    })
}

pub const SERVICES: [&str; 3] = [Ticker::NAME, Answerer::NAME, Eye::NAME];

pub fn settings() -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), "fleet").unwrap()
}

pub fn arena(seed: u64) -> VirtualArena<'static> {
    VirtualArena::new(&settings(), seed, &SERVICES, &node).unwrap()
}

/// Everything the answerer says for a while: when, its incarnation, which tick, how many.
pub fn answers(arena: &mut VirtualArena<'_>, span: Span) -> Vec<(Time, ManeuverResult)> {
    let mut heard = Vec::new();
    arena.run_for(span, &mut |said| {
        if said.published.is_data() && said.published.topic == &topics::MANEUVER_RESULT {
            heard.push((said.at, wire::decode(said.published.body).unwrap()));
        }
    });
    heard
}
