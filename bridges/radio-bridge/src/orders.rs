//! Orders to begin and to end a maneuver, repeated until they are known to have arrived or no longer count.

use device::vehicle_link::Uplink;
use quantity::{Span, Time};
use schemas::{ManeuverAbort, ManeuverStart};

/// An order to begin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StartOrder {
    order: ManeuverStart,
    next_at: Time,
}

impl StartOrder {
    /// An order to be sent at once.
    pub(crate) const fn new(now: Time, order: ManeuverStart) -> Self {
        Self { order, next_at: now }
    }

    /// The maneuver.
    pub(crate) const fn maneuver_id(&self) -> u16 {
        self.order.maneuver_id
    }

    /// The same order came again: only its validity may have changed.
    pub(crate) const fn renew(&mut self, order: ManeuverStart) {
        self.order = order;
    }

    /// When to act next.
    pub(crate) const fn due_at(&self) -> Time {
        self.next_at
    }

    /// Whether a frame sent now, which takes `delay` to arrive, would come after the order's validity.
    pub(crate) fn is_over(&self, now: Time, delay: Span) -> bool {
        now.saturating_add(delay) > self.order.valid_until
    }

    /// Sends the order if it is due.
    pub(crate) fn send_due(&mut self, now: Time, retry: Span, mut send: impl FnMut(Uplink)) {
        if now >= self.next_at {
            self.next_at = now.saturating_add(retry);
            let ManeuverStart { maneuver_id, set_id, digest, .. } = self.order;
            send(Uplink::Start { maneuver_id, set_id, digest });
        }
    }
}

/// An order to end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AbortOrder {
    order: ManeuverAbort,
    left: u32,
    next_at: Time,
}

impl AbortOrder {
    /// An order to be sent at once, and `repeats` times in all.
    pub(crate) const fn new(now: Time, order: ManeuverAbort, repeats: u32) -> Self {
        Self { order, left: repeats, next_at: now }
    }

    /// The maneuver.
    pub(crate) const fn maneuver_id(&self) -> u16 {
        self.order.maneuver_id
    }

    /// When to act next.
    pub(crate) const fn due_at(&self) -> Time {
        self.next_at
    }

    /// Whether it has been sent as often as it should.
    pub(crate) const fn is_over(&self) -> bool {
        self.left == 0
    }

    /// The same order came again: it is sent as often again.
    pub(crate) const fn renew(&mut self, repeats: u32) {
        self.left = repeats;
    }

    /// Sends the order if it is due.
    pub(crate) fn send_due(&mut self, now: Time, retry: Span, mut send: impl FnMut(Uplink)) {
        if now >= self.next_at && self.left > 0 {
            self.next_at = now.saturating_add(retry);
            self.left -= 1;
            send(Uplink::Abort { maneuver_id: self.order.maneuver_id });
        }
    }
}
