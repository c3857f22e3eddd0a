//! Seals and numbers what one sender says.

use quantity::Time;
use reflect::Message;
use schemas::{Topic, topic_hash, topics};
use wire::{EncodeError, Header, Keyring, Kind, Role, Secret, TopicName};

use crate::{Identity, Outbound, Published};

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
    /// not sent, and the error says what was wrong.
    ///
    /// # Errors
    /// What the codec refuses.
    pub fn publish<M: Message>(
        &mut self,
        now: Time,
        topic: &'static Topic,
        message: &M,
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<(), EncodeError> {
        self.body.clear();
        wire::encode(message, &mut self.body)?;
        self.seal(now, topic, Kind::Data, sink);
        Ok(())
    }

    /// Publishes one of a core's outputs.
    ///
    /// # Errors
    /// What the codec refuses.
    pub(crate) fn publish_output<O: Outbound>(
        &mut self,
        now: Time,
        output: &O,
        sink: &mut dyn FnMut(Published<'_>),
    ) -> Result<(), EncodeError> {
        self.body.clear();
        output.encode(&mut self.body)?;
        self.seal(now, output.topic(), Kind::Data, sink);
        Ok(())
    }

    /// Publishes a body that is already encoded.
    pub(crate) fn publish_body(
        &mut self,
        now: Time,
        topic: &'static Topic,
        body: &[u8],
        sink: &mut dyn FnMut(Published<'_>),
    ) {
        self.body.clear();
        self.body.extend_from_slice(body);
        self.seal(now, topic, Kind::Data, sink);
    }

    /// Announces the definitions of some topics: name, NUL, text.
    pub fn announce(&mut self, now: Time, topics: &[&'static Topic], sink: &mut dyn FnMut(Published<'_>)) {
        for topic in topics {
            self.body.clear();
            self.body.extend_from_slice(topic.schema.name.as_bytes());
            self.body.push(0);
            self.body.extend_from_slice(topic.schema_text().as_bytes());
            self.seal(now, topic, Kind::Schema, sink);
        }
    }

    fn seal(&mut self, now: Time, topic: &'static Topic, kind: Kind, sink: &mut dyn FnMut(Published<'_>)) {
        let sequence = self.next_sequence(topic.hash, kind);
        let header = Header {
            kind,
            domain: self.identity.domain,
            latched: false,
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
        if wire::seal(&header, name, &self.body, key, &mut self.datagram).is_err() {
            // Foreign key and negative time cannot be: identity and clock are this node's own. A definition that is
            // too long stays unannounced; the message's own limit was checked by the codec.
            return;
        }
        self.published += 1;
        sink(Published { topic, kind, datagram: &self.datagram, body: &self.body });
    }

    fn next_sequence(&mut self, hash: u32, kind: Kind) -> u64 {
        // A node writes a handful of topics: a scan of a short list beats any map.
        match self.sequences.iter_mut().find(|(h, k, _)| *h == hash && *k == kind) {
            Some((_, _, sequence)) => {
                *sequence += 1;
                *sequence
            }
            None => {
                self.sequences.push((hash, kind, 1));
                1
            }
        }
    }
}

/// The source number of a service's only instance.
#[must_use]
pub fn source_of(service: &str) -> u32 {
    topic_hash(service)
}

/// The topics every node writes besides its own.
pub(crate) static COMMON_TOPICS: &[&Topic] = &[&topics::NODE_EVENT, &topics::NODE_HEALTH];
