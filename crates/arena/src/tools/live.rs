//! A live bus, heard with the definitions that are announced on it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::future::poll_fn;
use std::ops::ControlFlow;
use std::task::Poll;

use quantity::{Span, Time};
use reflect::Definition;
use service_core::{Observed, Observer};
use service_shell::{BusReceiver, BusSender, During, Listen, Setup, Stop, Timer, block_on, clock};
use wire::{Header, Kind};

use super::requests::Requests;
use super::{Heard, ToolError};

/// A message waits at most this long for its definition: each is announced every second.
const DEFINITION_SPAN: Span = Span::from_millis(1500);
/// Messages that wait for a definition, at most, and their bytes.
const HELD_MAX: usize = 4096;
const HELD_BYTES_MAX: usize = 16 << 20;
/// Definitions remembered at most.
const DEFINITIONS_MAX: usize = 4096;
/// How often time is looked at though nothing came.
const TICK: Span = Span::from_millis(100);

/// An ear on a live bus.
pub struct Ear {
    observer: Observer,
    definitions: BTreeMap<u64, (String, Option<Definition>)>,
    /// Definitions that did not come in time: their messages are given without.
    given_up: BTreeSet<u64>,
    held: VecDeque<Held>,
    held_bytes: usize,
    overflowed: u64,
    wants: Box<dyn Fn(&str) -> bool>,
}

/// A message that waits for its definition.
struct Held {
    header: Header,
    topic: String,
    body: Vec<u8>,
    verified: bool,
    at: Time,
}

/// What the ear gives: messages, and now and then the time.
pub enum Tick<'a> {
    /// A message.
    Heard(Heard<'a>),
    /// Nothing but that time goes on, and what the numbers told so far.
    Now(Time, &'a Observer),
}

type Each<'e> = &'e mut dyn FnMut(Tick<'_>) -> Result<ControlFlow<()>, ToolError>;

impl Ear {
    /// An ear for the topics that `wants` says yes to.
    #[must_use]
    pub fn new(setup: &Setup, wants: impl Fn(&str) -> bool + 'static) -> Self {
        let identity = setup.identity;
        Self {
            observer: Observer::new(&setup.secret, identity.domain, identity.run),
            definitions: BTreeMap::new(),
            given_up: BTreeSet::new(),
            held: VecDeque::new(),
            held_bytes: 0,
            overflowed: 0,
            wants: Box::new(wants),
        }
    }

    /// Listens until `each` breaks off, it is `until`, or the process is told to end. Whoever waits for its definition then
    /// is given without.
    ///
    /// # Errors
    /// A bus that cannot be heard, or whatever `each` says.
    pub fn listen(&mut self, setup: &Setup, until: Time, each: Each<'_>) -> Result<(), ToolError> {
        block_on(async { Ok(self.hear(setup, until, each).await) })?
    }

    async fn hear(&mut self, setup: &Setup, until: Time, each: Each<'_>) -> Result<(), ToolError> {
        let (network, domain) = (&setup.arena.network, setup.identity.domain);
        let mut bus = BusReceiver::join(network, domain, Listen::Everything)?;
        let mut requests = Requests::new(setup, BusSender::open(network, domain)?);
        let mut stop = Stop::new(false)?;
        let mut timer = Timer::new().during(timing)?;
        loop {
            timer.set(Some(clock::now() + TICK)).during(timing)?;
            let stopped = poll_fn(|cx| {
                if stop.poll_signal(cx).is_ready() {
                    return Poll::Ready(true);
                }
                let due = timer.poll_elapsed(cx).is_ready();
                if due || bus.poll_readable(cx).is_ready() { Poll::Ready(false) } else { Poll::Pending }
            })
            .await;
            let broken = self.take(&mut bus, &mut requests, each)?.is_break();
            if broken {
                return Ok(());
            }
            if stopped || clock::now() >= until {
                return self.release(Time::FAR_FUTURE, each).map(|_| ());
            }
        }
    }

    fn take(
        &mut self,
        bus: &mut BusReceiver,
        requests: &mut Requests,
        each: Each<'_>,
    ) -> Result<ControlFlow<()>, ToolError> {
        let count = bus.take_batch()?;
        self.overflowed += bus.take_overflowed();
        for index in 0..count {
            let datagram = bus.datagram(index);
            if self.datagram(datagram.at, datagram.bytes, requests, each)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        let now = clock::now();
        if self.release(now, each)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        each(Tick::Now(now, &self.observer))
    }

    fn datagram(
        &mut self,
        at: Time,
        datagram: &[u8],
        requests: &mut Requests,
        each: Each<'_>,
    ) -> Result<ControlFlow<()>, ToolError> {
        // What nobody wants is not worth its tag's check.
        let wanted = |opened: &wire::Unverified<'_>| {
            opened.claimed().kind == Kind::Schema || (self.wants)(opened.topic().name())
        };
        if !wire::open(datagram).is_ok_and(|opened| wanted(&opened)) {
            return Ok(ControlFlow::Continue(()));
        }
        let Ok(observed) = self.observer.observe(datagram) else { return Ok(ControlFlow::Continue(())) };
        match observed.header.kind {
            Kind::Schema => self.learn(&observed, each),
            Kind::SchemaRequest => Ok(ControlFlow::Continue(())),
            Kind::Data | Kind::Journal => self.message(at, &observed, requests, each),
        }
    }

    fn message(
        &mut self,
        at: Time,
        observed: &Observed<'_>,
        requests: &mut Requests,
        each: Each<'_>,
    ) -> Result<ControlFlow<()>, ToolError> {
        let Observed { header, topic, body, verified } = *observed;
        let id = header.schema_id;
        let known = self.definitions.contains_key(&id) || self.given_up.contains(&id);
        let room = self.held.len() < HELD_MAX && self.held_bytes + body.len() <= HELD_BYTES_MAX;
        if !known {
            requests.ask(at, topic, id);
            if room {
                self.held_bytes += body.len();
                let (topic, body) = (topic.name().to_owned(), body.to_vec());
                self.held.push_back(Held { header, topic, body, verified, at });
                return Ok(ControlFlow::Continue(()));
            }
        }
        each(Tick::Heard(heard(&self.definitions, &header, topic.name(), body, verified, at)))
    }

    /// Learns a definition, and gives the messages that waited for it.
    fn learn(&mut self, observed: &Observed<'_>, each: Each<'_>) -> Result<ControlFlow<()>, ToolError> {
        let Some(announced) = observed.definition() else { return Ok(ControlFlow::Continue(())) };
        let id = announced.id;
        if self.definitions.contains_key(&id) || self.definitions.len() >= DEFINITIONS_MAX {
            return Ok(ControlFlow::Continue(()));
        }
        let definition = Definition::parse(announced.name, announced.text)
            .inspect_err(|error| tracing::warn!("definition of {}: {error}", announced.name))
            .ok();
        self.definitions.insert(id, (announced.name.to_owned(), definition));
        self.give(each, |held| held.header.schema_id == id)
    }

    /// Gives the messages that have waited too long for a definition, without it.
    fn release(&mut self, now: Time, each: Each<'_>) -> Result<ControlFlow<()>, ToolError> {
        let late = |held: &Held| held.at.saturating_add(DEFINITION_SPAN) <= now;
        let ids: BTreeSet<u64> =
            self.held.iter().filter(|held| late(held)).map(|held| held.header.schema_id).collect();
        if ids.is_empty() {
            return Ok(ControlFlow::Continue(()));
        }
        if self.given_up.len() < DEFINITIONS_MAX {
            self.given_up.extend(&ids);
        }
        self.give(each, |held| ids.contains(&held.header.schema_id))
    }

    fn give(&mut self, each: Each<'_>, due: impl Fn(&Held) -> bool) -> Result<ControlFlow<()>, ToolError> {
        let (given, kept): (VecDeque<Held>, VecDeque<Held>) =
            std::mem::take(&mut self.held).into_iter().partition(|held| due(held));
        self.held = kept;
        self.held_bytes = self.held.iter().map(|held| held.body.len()).sum();
        for Held { header, topic, body, verified, at } in &given {
            let heard = heard(&self.definitions, header, topic, body, *verified, *at);
            if each(Tick::Heard(heard))?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// What was accepted, and what the numbers told.
    #[must_use]
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// Datagrams that the kernel dropped because this program was slow.
    #[must_use]
    pub fn overflowed(&self) -> u64 {
        self.overflowed
    }
}

fn timing() -> String {
    "making a timer".to_owned()
}

fn heard<'a>(
    definitions: &'a BTreeMap<u64, (String, Option<Definition>)>,
    header: &Header,
    topic: &'a str,
    body: &'a [u8],
    verified: bool,
    at: Time,
) -> Heard<'a> {
    let known = definitions.get(&header.schema_id);
    Heard {
        topic,
        kind: header.kind,
        source: Some(header.source),
        incarnation: Some(header.incarnation),
        sequence: header.sequence,
        at,
        published_at: header.published_at,
        verified: Some(verified),
        body,
        type_name: known.map(|(name, _)| name.as_str()),
        definition: known.and_then(|(_, definition)| definition.as_ref()),
    }
}
