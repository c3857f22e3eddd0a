//! The front door of a live arena on the bus: the standing order goes out, what the arena does comes in.

use std::collections::{BTreeMap, VecDeque};

use quantity::Time;
use schemas::{
    FlipPhase, FlipStatus, ManeuverResult, NodeEvent, NodeHealth, OrderKind, VehicleState, topics,
};
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError};

use crate::director::{Director, Output, Tuning};

service_core::inputs! {
    /// What the front door of a live arena watches.
    pub enum Input {
        /// Where the vehicles are believed to be.
        State(VehicleState) = topics::VEHICLE_STATE,
        /// What the flip manager is doing.
        Status(FlipStatus) = topics::FLIP_STATUS,
        /// How each flip ended.
        Result(ManeuverResult) = topics::MANEUVER_RESULT,
        /// Faults and turns of events.
        Event(NodeEvent) = topics::NODE_EVENT,
        /// How each node fares.
        Health(NodeHealth) = topics::NODE_HEALTH,
    }
}

/// Events kept for whoever prints them; older ones give way.
const EVENTS_MAX: usize = 256;

/// What is known of one vehicle.
#[derive(Clone, Copy, Debug, Default)]
pub struct VehicleView {
    /// Newest estimate.
    pub state: VehicleState,
    /// Newest word of the flip manager.
    pub status: FlipStatus,
    /// Newest flip's end.
    pub result: Option<ManeuverResult>,
}

/// Gives the orders and watches.
#[derive(Clone, Debug)]
pub struct Console {
    director: Director,
    vehicles: BTreeMap<u8, VehicleView>,
    events: VecDeque<NodeEvent>,
    health: BTreeMap<String, NodeHealth>,
}

impl Console {
    /// Gives another order, from now on.
    pub fn order(&mut self, now: Time, kind: OrderKind) {
        self.director.order(now, kind);
    }

    /// Gives no order until [`Console::order`].
    pub fn fall_silent(&mut self) {
        self.director.fall_silent();
    }

    /// Knows what another console knew.
    pub fn take_over(&mut self, other: &Self) {
        self.vehicles.clone_from(&other.vehicles);
        self.health.clone_from(&other.health);
    }

    /// What is known of each vehicle.
    #[must_use]
    pub fn vehicles(&self) -> &BTreeMap<u8, VehicleView> {
        &self.vehicles
    }

    /// How each node fared when it last said so.
    #[must_use]
    pub fn health(&self) -> &BTreeMap<String, NodeHealth> {
        &self.health
    }

    /// The events since the last call.
    pub fn take_events(&mut self) -> impl Iterator<Item = NodeEvent> + '_ {
        self.events.drain(..)
    }

    /// Whether every vehicle is down and has nothing left to do.
    #[must_use]
    pub fn all_down(&self) -> bool {
        self.vehicles.values().all(|view| matches!(view.status.phase, FlipPhase::Done | FlipPhase::Idle))
    }

    /// Whether every vehicle has flown all its flips, or was stopped, and is down.
    #[must_use]
    pub fn all_done(&self) -> bool {
        self.vehicles.values().all(|view| view.status.phase == FlipPhase::Done)
    }
}

impl Core for Console {
    const NAME: &'static str = Director::NAME;
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(arena: &Arena, tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self {
            director: Director::new(arena, tuning, start)?,
            vehicles: arena.fleet.iter().map(|member| (member.vehicle.id, VehicleView::default())).collect(),
            events: VecDeque::new(),
            health: BTreeMap::new(),
        })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.director.next_at())
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match event {
            Event::Deadline => {
                if let Some(order) = self.director.due(now) {
                    out.publish(order);
                }
            }
            Event::Input(Input::State(state)) => {
                if let Some(view) = self.vehicles.get_mut(&state.vehicle) {
                    view.state = state;
                }
            }
            Event::Input(Input::Status(status)) => {
                if let Some(view) = self.vehicles.get_mut(&status.vehicle) {
                    view.status = status;
                }
            }
            Event::Input(Input::Result(result)) => {
                if let Some(view) = self.vehicles.get_mut(&result.vehicle) {
                    view.result = Some(result);
                }
            }
            Event::Input(Input::Event(event)) => {
                if self.events.len() == EVENTS_MAX {
                    self.events.pop_front();
                }
                self.events.push_back(event);
            }
            Event::Input(Input::Health(health)) => {
                self.health.insert(health.node.to_string(), health);
            }
        }
    }
}
