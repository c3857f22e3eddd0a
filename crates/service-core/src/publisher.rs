//! Seals and numbers what one sender says.

use quantity::Time;
use reflect::Message;
use schemas::{NodeJournal, Topic, topic_hash, topics};
use thiserror::Error;
use wire::{EncodeError, Header, Keyring, Kind, Role, SealError, Secret, TopicName};

use crate::{Identity, Published};

/// Why something cannot be said; a bug of whoever wants to say it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SayError {
    /// It has no body.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// No datagram can be made of its body.
    #[error(transparent)]
    Seal(#[from] SealError),
}

/// The sending half of a node; also what a program without a core (simulator, tools) speaks through.
#[derive(Debug)]
pub struct Publisher {
    identity: Identity,
    keyring: Keyring,
    sequences: Vec<(u32, Kind, u64)>,
    body: Vec<u8>,
    datagram: Vec<u8>,
    published: u64,
}

impl Publisher {
    /// A sender that signs as `role`, a service's name.
    #[must_use]
    pub fn new(role: &'static str, secret: &Secret, identity: Identity) -> Self {
        Self {
            identity,
            keyring: Keyring::new(secret, identity.domain, identity.run, Role(role), []),
            sequences: Vec::new(),
            body: Vec::with_capacity(1024),
            datagram: Vec::with_capacity(1500),
            published: 0,
        }
    }

    /// Datagrams published so far.
    #[must_use]
    pub fn published(&self) -> u64 {
        self.published
    }

    /// Who this is.
    #[must_use]
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// Publishes a message of `topic`'s type.
    ///
    /// A message that cannot be encoded (a number that is not finite, a body too long) is a bug of its maker: it is
    /// not sent, takes no sequence number, and the error says what was wrong.
    ///
    /// # Errors
    /// What codec or seal refuse.
    pub fn publish<M: Message>(
        &mut self,
        now: Time,
        topic: &'static Topic,
        message: &M,
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<(), SayError> {
        self.encode_and_seal(now, topic, Kind::Data, message, sink)
    }

    /// Publishes a batch of a node's journal.
    ///
    /// # Errors
    /// What codec or seal refuse.
    pub(crate) fn publish_journal(
        &mut self,
        now: Time,
        batch: &NodeJournal,
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<(), SayError> {
        self.encode_and_seal(now, &topics::NODE_JOURNAL, Kind::Journal, batch, sink)
    }

    /// Publishes a body that is already encoded, and says under which sequence number.
    ///
    /// # Errors
    /// What the seal refuses.
    pub(crate) fn publish_body(
        &mut self,
        now: Time,
        topic: &'static Topic,
        body: &[u8],
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<u64, SayError> {
        self.seal(now, topic, Kind::Data, body, sink)
    }

    /// Announces the definitions of some topics: name, NUL, text.
    pub fn announce(&mut self, now: Time, topics: &[&'static Topic], sink: &mut dyn FnMut(Published<'_>)) {
        let mut body = std::mem::take(&mut self.body);
        for topic in topics {
            body.clear();
            body.extend_from_slice(topic.schema.name.as_bytes());
            body.push(0);
            body.extend_from_slice(topic.schema_text().as_bytes());
            // A test holds every definition of the table to the length of a body. With a clock before its zero nothing
            // can be said, and whatever else the node publishes says so.
            let _ = self.seal(now, topic, Kind::Schema, &body, sink);
        }
        self.body = body;
    }

    fn encode_and_seal<M: Message>(
        &mut self,
        now: Time,
        topic: &'static Topic,
        kind: Kind,
        message: &M,
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<(), SayError> {
        // Taken and put back, it keeps its memory.
        let mut body = std::mem::take(&mut self.body);
        body.clear();
        let said = wire::encode(message, &mut body)
            .map_err(SayError::from)
            .and_then(|()| self.seal(now, topic, kind, &body, sink));
        self.body = body;
        said.map(|_| ())
    }

    fn seal(
        &mut self,
        now: Time,
        topic: &'static Topic,
        kind: Kind,
        body: &[u8],
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<u64, SayError> {
        let place = self.place_of(topic.hash, kind);
        let sequence = self.sequences[place].2 + 1;
        let header = Header {
            kind,
            domain: self.identity.domain,
            latched: topic.latched && kind == Kind::Data,
            source: self.identity.source,
            schema_id: topic.schema_id(),
            run: self.identity.run,
            incarnation: self.identity.incarnation,
            sequence,
            published_at: now,
        };
        let by_every_node = kind != Kind::Data || topic.writer == "*";
        let key = if by_every_node { self.keyring.node() } else { self.keyring.own() };
        let name = TopicName::new(topic.name).expect("the topic table's test holds names to 1 to 255 bytes");
        wire::seal(&header, name, body, key, &mut self.datagram)?;
        // Only what is sent takes a number: to those who listen, a number that never comes is a loss.
        self.sequences[place].2 = sequence;
        self.published += 1;
        sink(Published { topic, kind, datagram: &self.datagram, body });
        Ok(sequence)
    }

    /// Where the newest sequence number of a topic and kind is kept: receivers keep a window for each of them.
    fn place_of(&mut self, hash: u32, kind: Kind) -> usize {
        // A node writes a handful of topics: a scan of a short list beats any map.
        let found = self.sequences.iter().position(|(h, k, _)| *h == hash && *k == kind);
        found.unwrap_or_else(|| {
            self.sequences.push((hash, kind, 0));
            self.sequences.len() - 1
        })
    }
}

/// The source number of a service's only instance.
#[must_use]
pub fn source_of(service: &str) -> u32 {
    topic_hash(service)
}

#[cfg(test)]
mod tests;
