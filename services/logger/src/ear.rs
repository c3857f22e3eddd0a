//! From datagrams to the ring: checked, numbered, counted.

use std::collections::BTreeSet;

use quantity::{Span, Time};
use recording::{Definition, Loss};
use schemas::{LoggerOrder, LoggerOrderKind, topics};
use service_core::{Observed, Observer};
use service_shell::{BusReceiver, ShellError};
use wire::{Counters, Kind};

use crate::ring::{Putting, Ring};
use crate::voice::Voice;

/// Definitions known, at most; with more of them, some are asked for in vain.
const KNOWN_MAX: usize = 8192;
/// An order older than this is a leftover of an earlier time.
const ORDER_AGE_MAX: Span = Span::from_secs(10);

/// What is known of the bus.
pub(crate) struct Ear {
    observer: Observer,
    known: BTreeSet<u64>,
    /// Messages and definitions taken from the bus.
    accepted: u64,
    definitions: u64,
    dropped_full: u64,
    overflowed: u64,
    newest_order_at: Option<Time>,
    dumps: u32,
}

/// The definitions of the topic table. Whoever spoke before the logger listened has announced its own already; most
/// speak the table's, and their first messages need not wait for the next announcement.
pub(crate) fn table_definitions() -> impl Iterator<Item = Definition> {
    topics::ALL.iter().map(|topic| Definition {
        id: topic.schema_id(),
        name: topic.schema.name.to_owned(),
        text: topic.schema_text().to_owned(),
    })
}

impl Ear {
    pub(crate) fn new(observer: Observer) -> Self {
        Self {
            observer,
            known: table_definitions().map(|definition| definition.id).collect(),
            accepted: 0,
            definitions: 0,
            dropped_full: 0,
            overflowed: 0,
            newest_order_at: None,
            dumps: 0,
        }
    }

    /// Takes what the bus has brought, up to some hundred datagrams; whether there may be more.
    pub(crate) fn take(
        &mut self,
        now: Time,
        bus: &mut BusReceiver,
        ring: &Ring,
        voice: &mut Voice,
    ) -> Result<bool, ShellError> {
        const BATCHES_MAX: u32 = 64;
        for _ in 0..BATCHES_MAX {
            let count = bus.take_batch()?;
            if count > 0 {
                let mut putting = ring.put();
                for index in 0..count {
                    let datagram = bus.datagram(index);
                    self.hear(now, datagram.at, datagram.bytes, &mut putting, voice);
                }
            }
            if !bus.has_backlog() {
                self.overflowed += bus.take_overflowed();
                return Ok(false);
            }
        }
        self.overflowed += bus.take_overflowed();
        Ok(true)
    }

    /// Takes a datagram. What is refused, the observer has counted.
    pub(crate) fn hear(
        &mut self,
        now: Time,
        at: Time,
        datagram: &[u8],
        putting: &mut Putting<'_>,
        voice: &mut Voice,
    ) {
        let Ok(observed) = self.observer.observe(datagram) else { return };
        match observed.header.kind {
            Kind::SchemaRequest => return,
            Kind::Schema => {
                let Some(announced) = observed.definition() else { return };
                voice.found(announced.id);
                if self.known.len() < KNOWN_MAX {
                    self.known.insert(announced.id);
                }
                self.definitions += 1;
            }
            Kind::Data | Kind::Journal => {
                if !self.known.contains(&observed.header.schema_id) {
                    voice.miss(now, &observed);
                }
                self.take_order(now, &observed);
            }
        }
        self.accepted += 1;
        let is_message = observed.header.kind != Kind::Schema;
        if !putting.datagram(at, &observed, datagram) && is_message {
            self.dropped_full += 1;
        }
    }

    /// An order repeated with the instant it was first given is one order.
    fn take_order(&mut self, now: Time, observed: &Observed<'_>) {
        let topic = &topics::LOGGER_ORDER;
        let is_order = observed.verified
            && observed.header.kind == Kind::Data
            && observed.topic.name() == topic.name
            && observed.header.schema_id == topic.schema_id();
        if !is_order {
            return;
        }
        let Ok(LoggerOrder { kind: LoggerOrderKind::Dump, given_at }) = wire::decode(observed.body) else {
            return;
        };
        let is_new = self.newest_order_at.is_none_or(|newest| given_at > newest);
        if is_new && (now - given_at).abs() < ORDER_AGE_MAX {
            self.newest_order_at = Some(given_at);
            self.dumps += 1;
        }
    }

    /// Orders to write what is kept in memory, since the last call.
    pub(crate) fn take_dumps(&mut self) -> u32 {
        std::mem::take(&mut self.dumps)
    }

    pub(crate) fn counters(&self) -> &Counters {
        self.observer.counters()
    }

    /// Messages and definitions taken from the bus.
    pub(crate) fn accepted(&self) -> u64 {
        self.accepted
    }

    /// Definitions among them.
    pub(crate) fn definitions(&self) -> u64 {
        self.definitions
    }

    /// Messages that found no room in the ring.
    pub(crate) fn dropped_full(&self) -> u64 {
        self.dropped_full
    }

    /// Datagrams that the kernel dropped.
    pub(crate) fn overflowed(&self) -> u64 {
        self.overflowed
    }

    /// Sequence numbers that never came.
    pub(crate) fn lost(&self) -> u64 {
        self.observer.lost_total()
    }

    /// What the sequence numbers of each stream told.
    pub(crate) fn losses(&self) -> Vec<Loss> {
        self.observer
            .sequences()
            .map(|(topic, (source, _, kind), counts)| Loss { topic: topic.to_owned(), kind, source, counts })
            .collect()
    }
}
