//! The front door's own voice on the bus: repeats the order that stands.

use quantity::{Span, Time};
use schemas::{ArenaOrder, OrderKind, topics};
use serde::Deserialize;
use service_core::{Core, Event, Outbox, Start};
use settings::{Arena, ConfigError};

service_core::inputs! {
    /// The director hears nothing: orders depend on people alone.
    pub enum Input {}
}

service_core::outputs! {
    /// What the front door says.
    pub enum Output {
        /// The order that stands.
        Order(ArenaOrder) = topics::ARENA_ORDER,
    }
}

/// The front door has no settings of its own.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {}

/// How often the standing order is repeated: well within the flip manager's patience of some seconds.
const ORDER_PERIOD: Span = Span::from_millis(500);

/// Repeats one order.
#[derive(Clone, Copy, Debug)]
pub struct Director {
    order: ArenaOrder,
    next_at: Time,
}

impl Director {
    /// The director who ordered `kind` at `now`.
    #[must_use]
    pub fn ordering(now: Time, kind: OrderKind) -> Self {
        Self { order: ArenaOrder { kind, given_at: now }, next_at: now }
    }

    /// Gives another order, from now on.
    pub fn order(&mut self, now: Time, kind: OrderKind) {
        *self = Self::ordering(now, kind);
    }

    /// Gives no order until the next [`Director::order`].
    pub fn fall_silent(&mut self) {
        self.next_at = Time::FAR_FUTURE;
    }

    /// When the order is to be repeated.
    #[must_use]
    pub fn next_at(&self) -> Time {
        self.next_at
    }

    /// The order, if it is time to repeat it.
    pub fn due(&mut self, now: Time) -> Option<ArenaOrder> {
        (now >= self.next_at).then(|| {
            self.next_at = now + ORDER_PERIOD;
            self.order
        })
    }
}

impl Core for Director {
    const NAME: &'static str = "arena";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        Ok(Self::ordering(start.at, OrderKind::Fly))
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, _event: Event<Input>, out: &mut Outbox<Output>) {
        if let Some(order) = self.due(now) {
            out.publish(order);
        }
    }
}
