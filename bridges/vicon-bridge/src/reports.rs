//! What the bridge counts, and how often it speaks of it.

use std::collections::BTreeMap;

use quantity::{Span, Time};
use schemas::Severity;
use service_core::Outbox;

use crate::Output;

/// What came in since the start, and what was left out of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Datagrams received.
    pub datagrams: u64,
    /// Frames published.
    pub frames: u64,
    /// Messages of another device endpoint than the stream's.
    pub foreign: u64,
    /// Datagrams that are not of the stream.
    pub undecodable: u64,
    /// Datagrams that came before the server had said who it is.
    pub too_early: u64,
    /// Datagrams of a frame already published or overtaken.
    pub late: u64,
    /// Objects that are no vehicle.
    pub unknown_objects: u64,
    /// Objects a frame had already reported.
    pub duplicate_objects: u64,
    /// Objects the system itself says it did not see.
    pub untracked: u64,
    /// Poses refused: not finite.
    pub not_finite: u64,
    /// Poses refused: at zero.
    pub zero: u64,
    /// Poses refused: bit for bit the one before.
    pub repeated: u64,
    /// Poses refused: far outside the hall, or metres for millimetres, or angles beyond reason.
    pub absurd: u64,
    /// Breaks of the fit of frame numbers to time.
    pub clock_breaks: u64,
}

/// Lets each kind of report through once in a while, per vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Reports {
    every: Span,
    told: BTreeMap<(&'static str, u8), (Time, u64)>,
}

impl Reports {
    /// At most one report of a kind and vehicle in `every`.
    pub(crate) const fn new(every: Span) -> Self {
        Self { every, told: BTreeMap::new() }
    }

    /// Reports a warning, unless one of its kind was reported lately; those are counted and told of with the
    /// next.
    pub(crate) fn warn(
        &mut self,
        now: Time,
        vehicle: u8,
        name: &'static str,
        detail: impl FnOnce() -> String,
        out: &mut Outbox<Output>,
    ) {
        let silenced = match self.told.get_mut(&(name, vehicle)) {
            Some((next, silenced)) if now < *next => {
                *silenced += 1;
                return;
            }
            Some((_, silenced)) => *silenced,
            None => 0,
        };
        self.told.insert((name, vehicle), (now.saturating_add(self.every), 0));
        let detail = match silenced {
            0 => detail(),
            more => format!("{} ({more} more since the last report)", detail()),
        };
        out.event(now, Severity::Warning, vehicle, name, &detail);
    }
}
