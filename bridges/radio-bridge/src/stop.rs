//! The emergency stop: needs no lease, silences every command, and holds until a person releases it.
//!
//! It goes out twice over: in every slot of the command link, and as often on the data link, which is another radio. The
//! vehicle latches at the first that arrives. The bridge latches too: whatever a controller goes on to say, no
//! command leaves for a stopped vehicle.

use device::vehicle_link::Uplink;
use quantity::{Span, Time};
use schemas::{StopKind, StopOrder};

/// How long a stop is repeated after it was last ordered.
const REPEATED_FOR: Span = Span::from_secs(1);
/// Time between two repetitions on the data link.
const REPEAT_PERIOD: Span = Span::from_millis(20);

/// The emergency stop of one vehicle.
#[derive(Clone, Debug, Default)]
pub(crate) struct EmergencyStop {
    state: State,
    /// When the newest order was given: an older one changes nothing.
    given_at: Option<Time>,
}

#[derive(Clone, Copy, Debug, Default)]
enum State {
    /// Commands pass.
    #[default]
    Clear,
    /// Commands do not pass; stops are sent until then.
    Stopped { until: Time, next_at: Time },
    /// Commands pass; releases are sent until then.
    Releasing { until: Time, next_at: Time },
}

impl EmergencyStop {
    /// Takes an order; answers whether it is one that was not known yet.
    pub(crate) fn order(&mut self, now: Time, order: &StopOrder) -> bool {
        let known = self.given_at.is_some_and(|newest| order.given_at <= newest);
        if known && self.given_at != Some(order.given_at) {
            return false;
        }
        self.given_at = Some(order.given_at);
        let until = now.saturating_add(REPEATED_FOR);
        let next_at = if known { self.due_at().unwrap_or(now) } else { now };
        self.state = match order.kind {
            StopKind::Stop => State::Stopped { until, next_at },
            StopKind::Release => State::Releasing { until, next_at },
        };
        !known
    }

    /// Whether no command may leave.
    pub(crate) const fn holds(&self) -> bool {
        matches!(self.state, State::Stopped { .. })
    }

    /// Whether a slot of the command link carries the stop.
    pub(crate) fn speaks(&self, now: Time) -> bool {
        matches!(self.state, State::Stopped { until, .. } if now <= until)
    }

    /// When to act next on the data link.
    pub(crate) fn due_at(&self) -> Option<Time> {
        match self.state {
            State::Stopped { until, next_at } | State::Releasing { until, next_at } => {
                (next_at <= until).then_some(next_at)
            }
            State::Clear => None,
        }
    }

    /// Sends what is due on the data link.
    pub(crate) fn send_due(&mut self, now: Time, mut send: impl FnMut(Uplink)) {
        if self.due_at().is_none_or(|at| now < at) {
            return;
        }
        match &mut self.state {
            State::Stopped { next_at, .. } => {
                *next_at = now.saturating_add(REPEAT_PERIOD);
                send(Uplink::Stop);
            }
            State::Releasing { next_at, .. } => {
                *next_at = now.saturating_add(REPEAT_PERIOD);
                send(Uplink::Rearm);
            }
            State::Clear => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn order(kind: StopKind, given_ms: i64) -> StopOrder {
        StopOrder { kind, vehicle: 0, given_at: ms(given_ms) }
    }

    fn sent(stop: &mut EmergencyStop, from: i64, to: i64) -> Vec<Uplink> {
        let mut sent = Vec::new();
        (from..to).for_each(|at| stop.send_due(ms(at), |uplink| sent.push(uplink)));
        sent
    }

    #[test]
    fn a_stop_is_repeated_for_a_second_and_holds_for_ever() {
        let mut stop = EmergencyStop::default();
        assert!(!stop.holds() && stop.due_at().is_none());
        assert!(stop.order(ms(100), &order(StopKind::Stop, 90)));
        let said = sent(&mut stop, 100, 3000);
        assert_eq!(said.len(), 51);
        assert!(said.iter().all(|uplink| *uplink == Uplink::Stop));
        assert!(stop.speaks(ms(1100)) && !stop.speaks(ms(1101)) && stop.holds());
    }

    #[test]
    fn the_same_order_again_prolongs_it_without_a_burst() {
        let mut stop = EmergencyStop::default();
        assert!(stop.order(ms(100), &order(StopKind::Stop, 90)));
        let mut said = Vec::new();
        for at in 100..200 {
            assert!(!stop.order(ms(at), &order(StopKind::Stop, 90)));
            stop.send_due(ms(at), |uplink| said.push(uplink));
        }
        assert_eq!(said.len(), 5);
        assert!(stop.speaks(ms(1199)));
    }

    #[test]
    fn only_a_later_order_releases_and_a_late_one_changes_nothing() {
        let mut stop = EmergencyStop::default();
        stop.order(ms(100), &order(StopKind::Stop, 90));
        assert!(!stop.order(ms(101), &order(StopKind::Release, 89)), "it was given before the stop");
        assert!(stop.holds());
        assert!(stop.order(ms(5000), &order(StopKind::Release, 4990)));
        assert!(!stop.holds());
        assert!(sent(&mut stop, 5000, 9000).iter().all(|uplink| *uplink == Uplink::Rearm));
        assert!(!stop.order(ms(9000), &order(StopKind::Stop, 90)), "a replay of the first");
        assert!(!stop.holds());
    }
}
