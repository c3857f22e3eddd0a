//! What the bridge counts, and how often it speaks of it.

use std::collections::BTreeMap;

use quantity::{Span, Time};
use schemas::Severity;
use service_core::Outbox;

use crate::Output;

/// What went out and came in since the start, and what was left out of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames sent on the command links.
    pub commands_sent: u64,
    /// Emergency stops sent on the command links.
    pub stops_sent: u64,
    /// Slots left out because the driver came too late.
    pub slots_missed: u64,
    /// Commands refused for their lease epoch.
    pub commands_refused: u64,
    /// Payloads sent on the data link.
    pub payloads_sent: u64,
    /// Payloads the radio says it could not deliver.
    pub payloads_undelivered: u64,
    /// Payloads received and used.
    pub payloads_received: u64,
    /// Payloads whose check does not come out, or that say what stands for nothing.
    pub payloads_damaged: u64,
    /// Payloads from an address, or of a vehicle, they should not be of.
    pub payloads_misaddressed: u64,
    /// Payloads that a later one has overtaken, or whose time stamp cannot be.
    pub payloads_untimely: u64,
    /// Bytes of the radio's serial line that belong to no frame.
    pub bytes_skipped: u64,
    /// Messages of another device endpoint, or for no vehicle of this arena.
    pub foreign: u64,
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
