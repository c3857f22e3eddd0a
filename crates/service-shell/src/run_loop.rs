//! The run loop: what turns sockets and deadlines into a node's calls, one at a time.
//!
//! ```text
//! loop {
//!     wake the node if its deadline has come          // looked at between any two datagrams
//!     hand it what its devices sent, a batch of each
//!     hand it what the bus brought, a batch
//!     set the alarm to its deadline
//!     wait for a socket, the alarm, or a signal
//! }
//! ```

use std::future::poll_fn;
use std::io;
use std::task::{Context, Poll};

use quantity::{Span, Time};
use reflect::Seq;
use schemas::{DeviceBytes, Topic, topics};
use service_core::{AnyNode, Core, Identity, Node, Published, QUEUE_AGE_MAX};
use settings::ConfigError;
use tracing::{Instrument, info, info_span, warn};
use wire::Domain;

use crate::bus::{BusReceiver, BusSender};
use crate::devices::{self, Endpoint, Receiver, Transmitters};
use crate::error::During;
use crate::filter::Listen;
use crate::latency::{Latencies, Passage};
use crate::logging::echo_event;
use crate::stop::{Stop, StopReason};
use crate::timer::Timer;
use crate::{Options, Setup, ShellError, clock, program_digest, replay};

/// A node that was not stepped for this long past its deadline was stopped or starved.
const PAUSE_SPAN: Span = Span::from_millis(100);
/// How often to look whether the supervisor lives.
const SUPERVISOR_PERIOD: Span = Span::from_secs(1);

/// Makes a node of this identity at the instant at which it begins.
pub type NodeFactory<'f> = dyn Fn(Identity, Time) -> Result<Box<dyn AnyNode>, ConfigError> + 'f;

/// Runs a service until it is told to end.
///
/// # Errors
/// Settings that cannot be used, or a socket that cannot be opened.
pub fn run_with<C: Core + 'static>(options: &Options) -> Result<(), ShellError> {
    let setup = Setup::load(C::NAME, options)?;
    serve(&setup, &|identity, now| Ok(Box::new(Node::<C>::new(&setup.arena, &setup.secret, identity, now)?)))
}

/// Makes a service's node and runs it until the process is told to end: by the host's clock, or in the replay domain
/// by playback's, where no device is ever opened. Not to be called within a tokio runtime.
///
/// # Errors
/// A setting the service cannot work with, or a socket that cannot be opened or read.
pub fn serve(setup: &Setup, factory: &NodeFactory<'_>) -> Result<(), ShellError> {
    match setup.identity.domain {
        Domain::Live | Domain::Sim => drive(setup, factory(setup.identity, clock::now())?.as_mut()),
        Domain::Replay => replay::drive(setup, factory),
    }
}

/// Runs a node by the host's clock until the process is told to end. Not to be called within a tokio runtime.
///
/// # Errors
/// The replay domain, which has a time of its own; a socket that cannot be opened or read.
pub fn drive(setup: &Setup, node: &mut dyn AnyNode) -> Result<(), ShellError> {
    if setup.identity.domain == Domain::Replay {
        let found = Domain::Replay.name();
        return Err(ShellError::Domain { service: node.name(), found, allowed: "live or sim" });
    }
    let span = info_span!("node", name = node.name());
    block_on(
        async {
            let mut stop = Stop::new(setup.supervised)?;
            node.identify_program(program_digest());
            let mut shell = Shell::open(setup, node, devices::endpoints(node.name(), &setup.arena)?)?;
            let (domain, run) = (setup.identity.domain.name(), setup.identity.run);
            info!(domain, run = format!("{run:016x}"), incarnation = setup.identity.incarnation, "started");
            let reason = shell.serve(node, &mut stop).await?;
            node.close(clock::now(), &mut |published| shell.outlet.put(&published));
            info!(steps = node.steps(), "ended: {}", reason.name());
            Ok(())
        }
        .instrument(span),
    )
}

/// Runs a future on a single-threaded tokio runtime of its own.
///
/// # Errors
/// Its own, or no runtime can be made.
pub fn block_on<T>(future: impl Future<Output = Result<T, ShellError>>) -> Result<T, ShellError> {
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .during(|| "starting the runtime".to_owned())?
        .block_on(future)
}

/// A node's clock, sockets and devices.
struct Shell {
    bus: BusReceiver,
    devices: Vec<Receiver>,
    outlet: Outlet,
    timer: Timer,
    latencies: Latencies,
    opened_at: Time,
    overflowed: u64,
}

/// Where a node's datagrams go.
struct Outlet {
    bus: BusSender,
    transmitters: Transmitters,
}

impl Outlet {
    fn put(&mut self, published: &Published<'_>) {
        // The device first: the recording can wait.
        self.transmitters.transmit(published);
        self.bus.send(published.datagram);
        echo_event(published);
    }
}

impl Shell {
    fn open(setup: &Setup, node: &dyn AnyNode, endpoints: Vec<Endpoint>) -> Result<Self, ShellError> {
        let (network, domain) = (&setup.arena.network, setup.identity.domain);
        // A bridge's device topics come from its device, not from the bus, where they are its own echo.
        let topics: Vec<&'static Topic> =
            node.topics_in().iter().copied().filter(|topic| topic.writer != node.name()).collect();
        let (transmitters, devices) = devices::open(endpoints)?;
        Ok(Self {
            bus: BusReceiver::join(network, domain, Listen::Topics(&topics))?,
            devices,
            outlet: Outlet { bus: BusSender::open(network, domain)?, transmitters },
            timer: Timer::new().during(|| "making a timer".to_owned())?,
            latencies: Latencies::new(clock::now()),
            opened_at: clock::now(),
            overflowed: 0,
        })
    }

    async fn serve(&mut self, node: &mut dyn AnyNode, stop: &mut Stop) -> Result<StopReason, ShellError> {
        let mut look_after_supervisor_at = clock::now();
        loop {
            self.wake_if_due(node);
            self.take_devices(node)?;
            self.take_bus(node)?;
            self.timer.set(node.deadline()).during(|| "setting the timer".to_owned())?;
            if let Some(reason) = self.wait(stop).await? {
                return Ok(reason);
            }
            let now = clock::now();
            if let Some(account) = self.latencies.take(now, node.name()) {
                node.publish_latency(now, &account, &mut |published| self.outlet.put(&published));
            }
            if now >= look_after_supervisor_at {
                look_after_supervisor_at = now + SUPERVISOR_PERIOD;
                if let Some(reason) = stop.check_supervisor(now) {
                    return Ok(reason);
                }
            }
        }
    }

    /// Waits for something to do; a reason to end, if that is it.
    async fn wait(&mut self, stop: &mut Stop) -> Result<Option<StopReason>, ShellError> {
        poll_fn(|cx| match stop.poll_signal(cx) {
            Poll::Ready(reason) => Poll::Ready(Ok(Some(reason))),
            Poll::Pending => self.poll_work(cx).map_ok(|()| None),
        })
        .await
        .during(|| "waiting for sockets".to_owned())
    }

    fn poll_work(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut polled = self.timer.poll_elapsed(cx);
        for device in &self.devices {
            if polled.is_pending() {
                polled = device.poll_readable(cx);
            }
        }
        if polled.is_pending() { self.bus.poll_readable(cx) } else { polled }
    }

    /// Does what is due; called between any two datagrams, so that a flood cannot delay a radio slot.
    fn wake_if_due(&mut self, node: &mut dyn AnyNode) -> Time {
        let now = clock::now();
        if let Some(deadline) = node.deadline()
            && deadline <= now
        {
            let late = now - deadline.max(self.opened_at);
            if late > PAUSE_SPAN {
                warn!("was not running for {late}");
            }
            let steps = node.steps();
            node.wake(now, &mut |published| self.outlet.put(&published));
            // What a node is woken for besides, nobody waits for.
            if node.steps() > steps {
                self.latencies.note_deadline(deadline, now, clock::now());
            }
        }
        now
    }

    fn take_devices(&mut self, node: &mut dyn AnyNode) -> Result<(), ShellError> {
        for device in 0..self.devices.len() {
            let count = self.devices[device].take_batch()?;
            for index in 0..count {
                let now = self.wake_if_due(node);
                let receiver = &self.devices[device];
                let piece = receiver.piece(index);
                if is_old(now, piece.at) {
                    self.note_overflow(node, 1);
                    continue;
                }
                let Ok(bytes) = Seq::try_from(piece.bytes.to_vec()) else {
                    warn!(bytes = piece.bytes.len(), "a device's datagram is too long, and dropped");
                    continue;
                };
                let message = DeviceBytes { port: receiver.port, at: piece.at, bytes };
                let (topic, arrived_at) = (receiver.topic, piece.at);
                node.inject(now, topic, message, &mut |published| self.outlet.put(&published));
                let done_at = clock::now();
                let passage = Passage { published_at: arrived_at, arrived_at, begun_at: now, done_at };
                self.latencies.note(topic, passage);
            }
            let overflowed = self.devices[device].take_overflowed();
            self.note_overflow(node, overflowed);
        }
        Ok(())
    }

    fn take_bus(&mut self, node: &mut dyn AnyNode) -> Result<(), ShellError> {
        let count = self.bus.take_batch()?;
        for index in 0..count {
            let now = self.wake_if_due(node);
            let datagram = self.bus.datagram(index);
            if is_old(now, datagram.at) {
                self.note_overflow(node, 1);
                continue;
            }
            let (steps, arrived_at) = (node.steps(), datagram.at);
            // The node has counted what it drops; its health says so.
            let outlet = &mut self.outlet;
            let _ = node.receive(now, datagram.bytes, &mut |published| outlet.put(&published));
            if node.steps() > steps
                && let Ok(taken) = wire::open(datagram.bytes)
                && let Some(topic) = topics::by_name(taken.topic().name())
            {
                let published_at = taken.claimed().published_at;
                let done_at = clock::now();
                let passage = Passage { published_at, arrived_at, begun_at: now, done_at };
                self.latencies.note(topic, passage);
            }
        }
        let overflowed = self.bus.take_overflowed();
        self.note_overflow(node, overflowed);
        Ok(())
    }

    fn note_overflow(&mut self, node: &mut dyn AnyNode, datagrams: u64) {
        if datagrams == 0 {
            return;
        }
        let before = self.overflowed;
        self.overflowed += datagrams;
        node.overflowed(datagrams);
        // Whenever the count doubles: a stall of seconds is a few lines.
        if before.checked_ilog2() != self.overflowed.checked_ilog2() {
            warn!(datagrams = self.overflowed, "too slow: datagrams were dropped or too old when read");
        }
    }
}

fn is_old(now: Time, arrived_at: Time) -> bool {
    now - arrived_at > QUEUE_AGE_MAX
}

#[cfg(test)]
mod tests;
