//! What people want, and what silence means.

use quantity::{Span, Time};
use schemas::{ArenaOrder, OrderKind};

/// The order that stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct StandingOrder {
    heard: Option<(Time, ArenaOrder)>,
}

/// What the standing order comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Nobody has said anything yet.
    Unknown,
    /// Work through the scenario; given at that instant.
    Fly(Time),
    /// Hover at the place; given at that instant.
    Hover(Time),
    /// Land.
    Land,
    /// An order stood, but it is no longer repeated: whoever gave it is gone.
    Lost,
}

impl Wanted {
    /// What it comes to for one vehicle: one that flies no flips hovers instead.
    pub(crate) const fn for_vehicle(self, flips: bool) -> Self {
        match self {
            Self::Fly(given_at) if !flips => Self::Hover(given_at),
            other => other,
        }
    }
}

impl StandingOrder {
    /// Takes an order. One given before the standing one is a late copy.
    pub(crate) fn take(&mut self, now: Time, order: ArenaOrder) {
        if self.heard.is_none_or(|(_, standing)| order.given_at >= standing.given_at) {
            self.heard = Some((now, order));
        }
    }

    /// What is wanted now.
    pub(crate) fn wanted(&self, now: Time, timeout: Span) -> Wanted {
        match self.heard {
            None => Wanted::Unknown,
            Some((heard_at, _)) if now - heard_at > timeout => Wanted::Lost,
            Some((_, ArenaOrder { kind, given_at })) => match kind {
                OrderKind::Fly => Wanted::Fly(given_at),
                OrderKind::Hover => Wanted::Hover(given_at),
                OrderKind::Land => Wanted::Land,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_to_fly_is_one_to_hover_for_a_vehicle_without_flips() {
        let at = Time::ZERO + Span::from_secs(3);
        assert_eq!(Wanted::Fly(at).for_vehicle(false), Wanted::Hover(at));
        assert_eq!(Wanted::Fly(at).for_vehicle(true), Wanted::Fly(at));
        assert_eq!(Wanted::Land.for_vehicle(false), Wanted::Land);
    }

    #[test]
    fn silence_is_lost_and_old_copies_do_not_count() {
        let timeout = Span::from_secs(3);
        let at = |seconds| Time::ZERO + Span::from_secs(seconds);
        let mut standing = StandingOrder::default();
        assert_eq!(standing.wanted(at(100), timeout), Wanted::Unknown);
        standing.take(at(10), ArenaOrder { kind: OrderKind::Fly, given_at: at(9) });
        assert_eq!(standing.wanted(at(13), timeout), Wanted::Fly(at(9)));
        standing.take(at(11), ArenaOrder { kind: OrderKind::Land, given_at: at(11) });
        standing.take(at(12), ArenaOrder { kind: OrderKind::Fly, given_at: at(9) });
        assert_eq!(standing.wanted(at(12), timeout), Wanted::Land);
        assert_eq!(standing.wanted(at(15), timeout), Wanted::Lost);
    }
}
