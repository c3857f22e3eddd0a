//! The front door's own node: repeats the order that stands, and hears how the arena fares.

use quantity::{Span, Time};
use schemas::{ArenaOrder, FlipStatus, NodeEvent, NodeHealth, OrderKind, PlantManeuver, PlantTruth, topics};
use serde::Deserialize;
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError};

service_core::inputs! {
    /// What the front door hears.
    pub enum Input {
        /// What the flip manager is doing.
        Status(FlipStatus) = topics::FLIP_STATUS,
        /// Faults and turns of events.
        Event(NodeEvent) = topics::NODE_EVENT,
        /// How each node fares.
        Health(NodeHealth) = topics::NODE_HEALTH,
        /// The truth, in simulation.
        Truth(PlantTruth) = topics::PLANT_TRUTH,
        /// How maneuvers truly ended, in simulation.
        Maneuver(PlantManeuver) = topics::PLANT_MANEUVER,
    }
}

service_core::outputs! {
    /// What the front door says.
    pub enum Output {
        /// The order that stands.
        Order(ArenaOrder) = topics::ARENA_ORDER,
    }
}

/// The director has no settings of its own.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {}

/// How often the standing order is repeated: well within the flip manager's patience of some seconds.
const ORDER_PERIOD: Span = Span::from_millis(500);

/// Repeats one order.
#[derive(Clone, Debug)]
pub struct Director {
    order: ArenaOrder,
    next_at: Time,
}

impl Director {
    /// Gives another order, from now on.
    pub fn order(&mut self, now: Time, kind: OrderKind) {
        self.order = ArenaOrder { kind, given_at: now };
        self.next_at = now;
    }
}

impl Core for Director {
    const NAME: &'static str = "arena";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { order: ArenaOrder { kind: OrderKind::Fly, given_at: start.at }, next_at: start.at })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        // What it hears is for whoever watches the bus beside it; orders depend on people alone.
        if event == Event::Deadline && now >= self.next_at {
            self.next_at = now + ORDER_PERIOD;
            out.publish(self.order);
        }
    }
}
