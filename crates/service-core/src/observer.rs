//! The ear of a program that is no service: it hears every topic, also those that no table knows.

use std::collections::BTreeMap;

use schemas::topics;
use wire::{
    Counters, Domain, DropReason, Freshness, Header, Kind, Role, Secret, SequenceCounts, Stream, TopicName,
    VerifyKey, Windows,
};

/// Names of topics remembered at most, to say whose numbers were lost. An arena has some dozens.
const NAMES_MAX: usize = 4096;

/// A datagram that was heard.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'d> {
    /// Its header.
    pub header: Header,
    /// Its topic.
    pub topic: TopicName<'d>,
    /// Its body.
    pub body: &'d [u8],
    /// Whether its tag was checked. A topic that is not in the table has no known writer and so no known key: such a
    /// datagram may be looked at and recorded, and nobody acts on it.
    pub verified: bool,
}

/// A definition as it is announced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Announced<'d> {
    /// FNV-1a-64 of name, NUL and text.
    pub id: u64,
    /// `package/Type`.
    pub name: &'d str,
    /// `ros1msg` text.
    pub text: &'d str,
}

impl<'d> Observed<'d> {
    /// The definition that this datagram announces: `None` if it announces none, or not the one its id says.
    #[must_use]
    pub fn definition(&self) -> Option<Announced<'d>> {
        if self.header.kind != Kind::Schema {
            return None;
        }
        let (name, text) = std::str::from_utf8(self.body).ok()?.split_once('\0')?;
        let id = self.header.schema_id;
        (reflect::fnv1a_64(&[self.body]) == id).then_some(Announced { id, name, text })
    }
}

/// Authenticates whatever the bus carries, and counts what never came.
#[derive(Debug)]
pub struct Observer {
    domain: Domain,
    run: u64,
    node: VerifyKey,
    writers: BTreeMap<&'static str, VerifyKey>,
    windows: Windows,
    /// Numbers of unverified datagrams, apart, so that nobody without a key can move those of others.
    unverified: Windows,
    names: BTreeMap<u32, String>,
    counters: Counters,
}

impl Observer {
    /// An ear for one domain and run. It can verify, and not sign.
    #[must_use]
    pub fn new(secret: &Secret, domain: Domain, run: u64) -> Self {
        let key = |role| VerifyKey::derive(secret, domain, run, role);
        Self {
            domain,
            run,
            node: key(Role::NODE),
            writers: topics::ALL
                .iter()
                .map(|topic| (topic.writer, key(Role::of(Kind::Data, topic.writer))))
                .collect(),
            windows: Windows::new(),
            unverified: Windows::new(),
            names: BTreeMap::new(),
            counters: Counters::default(),
        }
    }

    /// Takes a datagram from the bus.
    ///
    /// # Errors
    /// Why it was dropped; it has been counted.
    pub fn observe<'d>(&mut self, datagram: &'d [u8]) -> Result<Observed<'d>, DropReason> {
        let observed = self.take(datagram);
        match &observed {
            Ok(_) => self.counters.accepted += 1,
            Err(reason) => self.counters.count(*reason),
        }
        observed
    }

    fn take<'d>(&mut self, datagram: &'d [u8]) -> Result<Observed<'d>, DropReason> {
        let opened = wire::open(datagram)?;
        let (header, topic, body) = (*opened.claimed(), opened.topic(), opened.body_unverified());
        let known = topics::by_name(topic.name());
        let key = match (header.kind, known) {
            (Kind::Data, Some(topic)) => self.writers.get(topic.writer),
            (Kind::Data, None) => None,
            (Kind::Schema | Kind::SchemaRequest | Kind::Journal, _) => Some(&self.node),
        };
        let verified = match key {
            Some(key) => {
                opened.verify(key)?.fresh(&mut self.windows)?;
                true
            }
            None => {
                self.take_unverified(&header, topic)?;
                false
            }
        };
        if self.names.len() < NAMES_MAX && !self.names.contains_key(&topic.hash()) {
            self.names.insert(topic.hash(), topic.name().to_owned());
        }
        Ok(Observed { header, topic, body, verified })
    }

    fn take_unverified(&mut self, header: &Header, topic: TopicName<'_>) -> Result<(), DropReason> {
        if header.domain != self.domain {
            return Err(DropReason::Domain);
        }
        if header.run != self.run {
            return Err(DropReason::Run);
        }
        let stream = (header.source, topic.hash(), header.kind);
        match self.unverified.accept(stream, header.incarnation, header.sequence) {
            Freshness::Fresh => Ok(()),
            Freshness::Duplicate | Freshness::TooOld | Freshness::OldIncarnation | Freshness::NoRoom => {
                Err(DropReason::Replayed)
            }
        }
    }

    /// What was accepted and dropped so far.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// What the numbers of each stream told, with the name of its topic.
    pub fn sequences(&self) -> impl Iterator<Item = (&str, Stream, SequenceCounts)> {
        self.windows
            .counts()
            .chain(self.unverified.counts())
            .filter_map(|(stream, counts)| Some((self.names.get(&stream.1)?.as_str(), stream, counts)))
    }

    /// Sequence numbers that never came, over all streams.
    #[must_use]
    pub fn lost_total(&self) -> u64 {
        self.windows.lost_total().saturating_add(self.unverified.lost_total())
    }
}

#[cfg(test)]
mod tests;
