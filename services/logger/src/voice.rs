//! What the logger says on the bus.

use std::collections::BTreeMap;

use quantity::{Span, Time};
use recording::Notice;
use reflect::{Message, Text};
use schemas::{LoggerStatus, NodeEvent, NodeHealth, Severity, Topic, topics};
use service_core::{Observed, Publisher};
use service_shell::{BusSender, Setup, ShellError, echo_event, program_digest};
use tracing::warn;
use wire::{DropReason, Header, Keyring, Kind, Role, TopicName};

use crate::NAME;
use crate::ear::Ear;

/// The topics the logger writes.
static TOPICS: &[&Topic] = &[&topics::LOGGER_STATUS, &topics::NODE_EVENT, &topics::NODE_HEALTH];
/// A definition that was asked for is asked for again after so long.
const ASK_PERIOD: Span = Span::from_secs(1);
/// Definitions missed at once, at most; others are recorded without.
const MISSING_MAX: usize = 256;
/// So many of them at most may be of senders that anybody can pretend to be.
const UNVERIFIED_MAX: usize = 64;
/// Requests sent at once.
const ASK_BATCH: usize = 16;

/// The logger's place on the bus.
pub(crate) struct Voice {
    publisher: Publisher,
    bus: BusSender,
    asker: Asker,
    started_at: Time,
}

/// Asks for the definitions of topics whose messages are not understood.
struct Asker {
    keyring: Keyring,
    source: u32,
    incarnation: u32,
    missing: BTreeMap<u64, Missing>,
    /// Numbers of the requests sent so far, by topic.
    sequences: BTreeMap<u32, u64>,
    datagram: Vec<u8>,
}

struct Missing {
    topic: String,
    ask_at: Time,
}

impl Voice {
    pub(crate) fn open(setup: &Setup) -> Result<Self, ShellError> {
        let identity = setup.identity;
        Ok(Self {
            publisher: Publisher::new(NAME, &setup.secret, identity),
            bus: BusSender::open(&setup.arena.network, identity.domain)?,
            asker: Asker {
                keyring: Keyring::new(&setup.secret, identity.domain, identity.run, Role(NAME), []),
                source: identity.source,
                incarnation: identity.incarnation,
                missing: BTreeMap::new(),
                sequences: BTreeMap::new(),
                datagram: Vec::new(),
            },
            started_at: setup.started_at,
        })
    }

    fn say<M: Message>(&mut self, now: Time, topic: &'static Topic, message: &M) {
        let bus = &mut self.bus;
        let said = self.publisher.publish(now, topic, message, &mut |published| {
            bus.send(published.datagram);
            echo_event(&published);
        });
        if let Err(error) = said {
            warn!(topic = topic.name, %error, "a message that cannot be said");
        }
    }

    /// Says how the recording fares.
    pub(crate) fn status(&mut self, now: Time, status: &LoggerStatus) {
        self.say(now, &topics::LOGGER_STATUS, status);
    }

    /// Tells of something that happened.
    pub(crate) fn notice(&mut self, now: Time, notice: &Notice) {
        let event = NodeEvent {
            severity: notice.severity,
            vehicle: 0,
            at: now,
            node: Text::truncated(NAME),
            name: Text::truncated(notice.name),
            detail: Text::truncated(&notice.detail),
        };
        self.say(now, &topics::NODE_EVENT, &event);
    }

    /// Announces the logger's definitions, and how its writer and its bus fare.
    pub(crate) fn announce(&mut self, now: Time, turns: u64, ear: &Ear) {
        let counters = ear.counters();
        let bus = &mut self.bus;
        self.publisher.announce(now, TOPICS, &mut |published| bus.send(published.datagram));
        let health = NodeHealth {
            node: Text::truncated(NAME),
            started_at: self.started_at,
            program_digest: program_digest(),
            steps: turns,
            published: self.publisher.published(),
            accepted: counters.accepted,
            dropped_malformed: counters.dropped(DropReason::Malformed),
            dropped_unauthentic: counters.dropped(DropReason::Unauthentic),
            dropped_domain: counters.dropped(DropReason::Domain),
            dropped_run: counters.dropped(DropReason::Run),
            dropped_replayed: counters.dropped(DropReason::Replayed),
            dropped_undecodable: counters.dropped(DropReason::Undecodable),
            lost: ear.lost(),
            overflowed: ear.overflowed(),
        };
        self.say(now, &topics::NODE_HEALTH, &health);
    }

    /// Takes note that a definition is missing; it is asked for with the next [`Voice::ask`].
    pub(crate) fn miss(&mut self, now: Time, observed: &Observed<'_>) {
        let missing = &mut self.asker.missing;
        let schema_id = observed.header.schema_id;
        let limit = if observed.verified { MISSING_MAX } else { UNVERIFIED_MAX };
        if missing.len() < limit && !missing.contains_key(&schema_id) {
            let topic = observed.topic.name().to_owned();
            missing.insert(schema_id, Missing { topic, ask_at: now });
        }
    }

    /// Takes note that a definition has come.
    pub(crate) fn found(&mut self, schema_id: u64) {
        self.asker.missing.remove(&schema_id);
    }

    /// Asks for the definitions that are missing and due.
    pub(crate) fn ask(&mut self, now: Time) {
        let Self { asker, bus, .. } = self;
        let Asker { keyring, source, incarnation, missing, sequences, datagram } = asker;
        let due = missing.iter_mut().filter(|(_, missing)| missing.ask_at <= now).take(ASK_BATCH);
        for (schema_id, Missing { topic, ask_at }) in due {
            *ask_at = now + ASK_PERIOD;
            let Some(name) = TopicName::new(topic) else { continue };
            let sequence = sequences.entry(name.hash()).or_insert(0);
            let header = Header {
                kind: Kind::SchemaRequest,
                domain: keyring.node().domain(),
                latched: false,
                source: *source,
                schema_id: *schema_id,
                run: keyring.node().run(),
                incarnation: *incarnation,
                sequence: *sequence + 1,
                published_at: now,
            };
            // An empty body, and a time of the host's clock: nothing in it can be refused.
            if wire::seal(&header, name, &[], keyring.node(), datagram).is_ok() {
                *sequence += 1;
                bus.send(datagram);
            }
        }
    }
}

/// Something worth knowing, and no fault.
pub(crate) fn info(name: &'static str, detail: String) -> Notice {
    Notice { severity: Severity::Info, name, detail }
}
