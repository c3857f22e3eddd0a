//! Asking on the bus for definitions that were not heard yet.

use std::collections::BTreeMap;

use quantity::{Span, Time};
use service_core::source_of;
use service_shell::{BusSender, Setup};
use wire::{Header, Kind, Role, SigningKey, TopicName};

/// The same definition is asked for at most so often; whoever writes the topic announces it each second
/// anyway.
const REQUEST_PERIOD: Span = Span::from_secs(1);
/// Definitions asked for at most.
const ASKED_MAX: usize = 1024;

/// Asks for definitions. All tools share one source number, so that nodes keep one window for all of them.
pub(super) struct Requests {
    bus: BusSender,
    key: SigningKey,
    header: Header,
    sequences: BTreeMap<u32, u64>,
    asked: BTreeMap<u64, Time>,
    datagram: Vec<u8>,
}

impl Requests {
    pub(super) fn new(setup: &Setup, bus: BusSender) -> Self {
        let identity = setup.identity;
        let header = Header {
            kind: Kind::SchemaRequest,
            domain: identity.domain,
            latched: false,
            source: source_of("tool"),
            schema_id: 0,
            run: identity.run,
            incarnation: identity.incarnation,
            sequence: 0,
            published_at: Time::ZERO,
        };
        let key = SigningKey::derive(&setup.secret, identity.domain, identity.run, Role::NODE);
        Self { bus, key, header, sequences: BTreeMap::new(), asked: BTreeMap::new(), datagram: Vec::new() }
    }

    /// Asks the writers of a topic for the definition of that id, unless it was asked for a moment ago.
    pub(super) fn ask(&mut self, now: Time, topic: TopicName<'_>, schema_id: u64) {
        let asked_at = self.asked.get(&schema_id);
        let full = asked_at.is_none() && self.asked.len() >= ASKED_MAX;
        if full || asked_at.is_some_and(|at| now - *at < REQUEST_PERIOD) {
            return;
        }
        self.asked.insert(schema_id, now);
        let sequence = self.sequences.entry(topic.hash()).or_default();
        *sequence += 1;
        let header = Header { schema_id, sequence: *sequence, published_at: now, ..self.header };
        if wire::seal(&header, topic, &[], &self.key, &mut self.datagram).is_ok() {
            self.bus.send(&self.datagram);
        }
    }
}
