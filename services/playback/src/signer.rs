//! Seals recorded messages for the replay domain: the same body, topic, definition and publish time, under the keys of
//! the replay.

use std::collections::BTreeMap;

use quantity::Time;
use recording::Stream;
use schemas::topics;
use service_core::source_of;
use wire::{Domain, Header, Kind, Role, SealError, Secret, SigningKey, TopicName};

use crate::NAME;
use crate::source::{Channel, Message};

/// What is played of one channel, and how.
#[derive(Clone, Debug)]
struct Voice {
    topic: String,
    key: Role,
    group: usize,
    header: Header,
    /// Who said it first: a change begins a new incarnation.
    original: u32,
    sequence: Option<u64>,
}

/// What the bodies of a topic mean, to be announced.
#[derive(Clone, Debug)]
struct Announcement {
    topic: String,
    header: Header,
    /// Name, NUL, text.
    body: Vec<u8>,
}

/// What receivers keep one window for: a sender, a topic, a kind.
#[derive(Clone, Debug)]
struct Group {
    incarnation: u32,
    /// Which stretch of which original incarnation was sealed last.
    last: Option<(u64, u32)>,
}

/// Seals for the replay domain, and has no key of any other.
#[derive(Debug)]
pub struct Signer {
    keys: BTreeMap<Role, SigningKey>,
    voices: Vec<Option<Voice>>,
    announcements: Vec<Announcement>,
    groups: Vec<Group>,
    /// Rises with each beginning and each set of latched messages: numbers do not go on from one to the next.
    stretch: u64,
    datagram: Vec<u8>,
}

impl Signer {
    /// A signer for channels, each under the topic it is played as, in one run of the replay domain.
    ///
    /// There is no way to have it sign for another domain.
    #[must_use]
    pub fn new(
        secret: &Secret,
        run: u64,
        incarnation: u32,
        channels: &[Channel],
        topics: &[Option<String>],
    ) -> Self {
        let mut keys = BTreeMap::new();
        let mut places: BTreeMap<(u32, String, Kind), usize> = BTreeMap::new();
        let (mut groups, mut announcements) = (Vec::new(), Vec::new());
        let voices = channels.iter().zip(topics).map(|(channel, topic)| {
            let (stream, topic) = (&channel.stream, topic.clone()?);
            let (key, source) = (role(stream, &topic), source(stream, &topic));
            for role in [key, Role::NODE] {
                keys.entry(role).or_insert_with(|| SigningKey::derive(secret, Domain::Replay, run, role));
            }
            let group = *places.entry((source, topic.clone(), stream.kind)).or_insert_with(|| {
                groups.push(Group { incarnation, last: None });
                groups.len() - 1
            });
            let header = Header {
                kind: stream.kind,
                domain: Domain::Replay,
                latched: stream.latched,
                source,
                schema_id: stream.schema_id,
                run,
                incarnation,
                sequence: 0,
                published_at: Time::ZERO,
            };
            announce(&mut announcements, channel, &topic, &header);
            Some(Voice { topic, key, group, header, original: stream.incarnation, sequence: None })
        });
        let voices = voices.collect();
        Self { keys, voices, announcements, groups, stretch: 0, datagram: Vec::with_capacity(1500) }
    }

    /// Which channels are played.
    #[must_use]
    pub fn played(&self) -> Vec<bool> {
        self.voices.iter().map(Option::is_some).collect()
    }

    /// What follows does not follow on what was sealed so far: after a jump, and after messages out of their order.
    pub fn break_off(&mut self) {
        self.stretch += 1;
        for voice in self.voices.iter_mut().flatten() {
            voice.sequence = None;
        }
    }

    /// The topic a channel is played as.
    #[must_use]
    pub fn topic(&self, channel: usize) -> Option<&str> {
        self.voices.get(channel)?.as_ref().map(|voice| voice.topic.as_str())
    }

    /// The datagram of a message; `None` if its channel is not played.
    ///
    /// # Errors
    /// A body too long for the bus, or a publish time before any clock's zero.
    pub fn seal(&mut self, message: Message<'_>) -> Result<Option<&[u8]>, SealError> {
        let Some(voice) = self.voices.get_mut(message.channel).and_then(Option::as_mut) else {
            return Ok(None);
        };
        let group = &mut self.groups[voice.group];
        let now = (self.stretch, voice.original);
        if group.last.is_some_and(|last| last != now) {
            group.incarnation = group.incarnation.saturating_add(1);
        }
        group.last = Some(now);
        voice.header.incarnation = group.incarnation;
        voice.header.sequence = unfolded(voice.sequence, message.sequence);
        voice.sequence = Some(voice.header.sequence);
        voice.header.published_at = message.published_at;
        seal(&self.keys, voice.key, &voice.header, &voice.topic, message.body, &mut self.datagram)?;
        Ok(Some(&self.datagram))
    }

    /// How many definitions there are to announce.
    #[must_use]
    pub fn definition_count(&self) -> usize {
        self.announcements.len()
    }

    /// The datagram that announces a definition, by its number.
    pub fn definition(&mut self, number: usize, at: Time) -> Option<&[u8]> {
        let announcement = self.announcements.get_mut(number)?;
        announcement.header.sequence += 1;
        announcement.header.published_at = at;
        let Announcement { topic, header, body } = announcement;
        seal(&self.keys, Role::NODE, header, topic, body, &mut self.datagram).ok()?;
        Some(&self.datagram)
    }
}

/// Takes note of a channel's definition, once for each topic.
fn announce(announcements: &mut Vec<Announcement>, channel: &Channel, topic: &str, header: &Header) {
    let Some(definition) = &channel.definition else { return };
    let same = |other: &Announcement| other.topic == topic && other.header.schema_id == header.schema_id;
    if announcements.iter().any(same) {
        return;
    }
    // Two definitions of one topic each have their own numbers, so their own sender.
    let source = source_of(NAME) ^ (header.schema_id as u32);
    announcements.push(Announcement {
        topic: topic.to_owned(),
        header: Header { kind: Kind::Schema, latched: false, source, ..*header },
        body: [definition.name.as_str(), "\0", definition.text.as_str()].concat().into_bytes(),
    });
}

fn seal(
    keys: &BTreeMap<Role, SigningKey>,
    role: Role,
    header: &Header,
    topic: &str,
    body: &[u8],
    datagram: &mut Vec<u8>,
) -> Result<(), SealError> {
    let name = TopicName::new(topic).expect("recordings and selections hold names to 1 to 255 bytes");
    wire::seal(header, name, body, &keys[&role], datagram)
}

/// Who signs: the topic's writer. What nobody is known to write, or nobody has checked, playback signs as itself: it can
/// be looked at, and no service believes it.
fn role(stream: &Stream, topic: &str) -> Role {
    match topics::by_name(topic) {
        Some(topic) if stream.verified => Role::of(stream.kind, topic.writer),
        _ if stream.kind != Kind::Data && stream.verified => Role::NODE,
        _ => Role(NAME),
    }
}

/// A number of playback's own for each sender: a service that runs in the replay has its own window.
fn source(stream: &Stream, topic: &str) -> u32 {
    let own = stream.source ^ source_of(NAME);
    // Two topics of one sender may be played as one.
    if stream.topic == topic { own } else { own ^ source_of(&stream.topic) }
}

/// The whole of a sequence number of which the recording holds the low half.
fn unfolded(last: Option<u64>, low: u32) -> u64 {
    let Some(last) = last else { return u64::from(low) };
    let step = low.wrapping_sub(last as u32) as i32;
    last.saturating_add_signed(i64::from(step))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use recording::Definition;
    use service_core::{Observed, Observer};
    use wire::DropReason;

    use super::*;
    use crate::testing::{at_ms, stream};

    const RUN: u64 = 4;

    fn secret() -> Secret {
        Secret::new([3; 32])
    }

    fn channels(streams: Vec<Stream>) -> Vec<Channel> {
        streams.into_iter().map(|stream| Channel { stream, definition: None }).collect()
    }

    fn signer(channels: &[Channel]) -> Signer {
        let topics: Vec<_> = channels.iter().map(|channel| Some(channel.stream.topic.clone())).collect();
        Signer::new(&secret(), RUN, 50, channels, &topics)
    }

    fn message(channel: usize, sequence: u32) -> Message<'static> {
        Message { channel, sequence, at: at_ms(1), published_at: at_ms(0), body: b"body" }
    }

    #[test]
    fn what_is_played_is_what_was_recorded_in_the_replay_domain() {
        let channels = channels(vec![Stream { latched: true, ..stream("vehicle/state", 8) }]);
        let mut signer = signer(&channels);
        let datagram = signer.seal(message(0, 7)).unwrap().unwrap().to_vec();
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        let Observed { header, topic, body, verified } = observer.observe(&datagram).unwrap();
        assert!(verified);
        assert_eq!((topic.name(), body), ("vehicle/state", b"body".as_slice()));
        let kept = (header.kind, header.schema_id, header.latched, header.published_at, header.sequence);
        assert_eq!(kept, (Kind::Data, 77, true, at_ms(0), 7));
        assert_eq!((header.domain, header.run, header.incarnation), (Domain::Replay, RUN, 50));
        for (domain, run) in [(Domain::Live, RUN), (Domain::Sim, RUN), (Domain::Replay, RUN + 1)] {
            assert!(Observer::new(&secret(), domain, run).observe(&datagram).is_err());
        }
    }

    #[test]
    fn every_topic_is_signed_for_its_writer_and_what_nobody_checked_for_nobody() {
        let mut streams: Vec<Stream> = topics::ALL.iter().map(|topic| stream(topic.name, 8)).collect();
        streams.push(Stream { kind: Kind::Journal, ..stream("node/journal", 8) });
        let known = streams.len();
        streams.push(stream("lab/wind", 8));
        streams.push(Stream { verified: false, ..stream("vehicle/command", 9) });
        let channels = channels(streams);
        let mut signer = signer(&channels);
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        for (channel, named) in channels.iter().enumerate() {
            let datagram = signer.seal(message(channel, 1)).unwrap().unwrap();
            let heard = observer.observe(datagram).map(|observed| observed.verified);
            let expected = match channel.cmp(&known) {
                std::cmp::Ordering::Less => Ok(true),
                std::cmp::Ordering::Equal => Ok(false),
                std::cmp::Ordering::Greater => Err(DropReason::Unauthentic),
            };
            assert_eq!(heard, expected, "{}", named.stream.topic);
        }
    }

    /// Plays messages to one listener; how many it believed, how many it missed.
    fn heard(observer: &mut Observer, signer: &mut Signer, messages: &[(usize, u32)]) -> (usize, u64) {
        let before = observer.lost_total();
        let believed = messages.iter().filter(|(channel, sequence)| {
            let datagram = signer.seal(message(*channel, *sequence)).unwrap().unwrap();
            observer.observe(datagram).is_ok()
        });
        (believed.count(), observer.lost_total() - before)
    }

    #[test]
    fn a_gap_stays_a_gap_and_a_jump_is_none() {
        let channels = channels(vec![stream("vehicle/state", 8)]);
        let mut signer = signer(&channels);
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        assert_eq!(heard(&mut observer, &mut signer, &[(0, 900), (0, 901), (0, 904), (0, 903)]), (4, 1));
        signer.break_off();
        assert_eq!(heard(&mut observer, &mut signer, &[(0, 10), (0, 11)]), (2, 0));
        signer.break_off();
        assert_eq!(heard(&mut observer, &mut signer, &[(0, 900), (0, 901)]), (2, 0));
    }

    #[test]
    fn a_restarted_sender_is_believed_anew_and_its_numbers_may_wrap() {
        let first = stream("vehicle/state", 8);
        let channels = channels(vec![first.clone(), Stream { incarnation: 4, ..first }]);
        let mut signer = signer(&channels);
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        let messages = [(0, u32::MAX - 1), (0, u32::MAX), (0, 0), (0, 1), (1, 1), (1, 2)];
        assert_eq!(heard(&mut observer, &mut signer, &messages), (6, 0));
        assert_eq!(unfolded(Some(u64::from(u32::MAX)), 0), 1 << 32);
    }

    #[test]
    fn two_topics_played_as_one_do_not_silence_each_other() {
        let channels = channels(vec![stream("vehicle/state", 8), stream("old/state", 8)]);
        let topics = vec![Some("vehicle/state".to_owned()); 2];
        let mut signer = Signer::new(&secret(), RUN, 50, &channels, &topics);
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        assert_eq!(heard(&mut observer, &mut signer, &[(0, 500), (1, 1), (0, 501), (1, 2)]), (4, 0));
    }

    #[test]
    fn definitions_are_announced_as_they_were() {
        let text = "uint8 state\n";
        let id = reflect::fnv1a_64(&[b"lab/Wind", b"\0", text.as_bytes()]);
        let definition = Definition { id, name: "lab/Wind".to_owned(), text: text.to_owned() };
        let stream = Stream { schema_id: id, ..stream("lab/wind", 8) };
        let channels = vec![Channel { stream, definition: Some(Arc::new(definition)) }];
        let mut signer = signer(&channels);
        let mut observer = Observer::new(&secret(), Domain::Replay, RUN);
        for _ in 0..2 {
            let datagram = signer.definition(0, at_ms(5)).unwrap();
            let observed = observer.observe(datagram).unwrap();
            let announced = observed.definition().unwrap();
            assert_eq!((announced.id, announced.name, announced.text), (id, "lab/Wind", text));
        }
    }
}
