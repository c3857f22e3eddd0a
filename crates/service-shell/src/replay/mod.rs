//! A service in a replay: it lives by the time that playback says, and no device is ever opened.
//!
//! [`driver`] is all of it without a socket: playback's word in, the node's calls out. [`drive`] gives it the bus.

mod driver;

use std::future::poll_fn;
use std::task::Poll;

use quantity::Span;
use schemas::{Topic, topics};
use service_core::Published;
use tracing::{Instrument, info, info_span, warn};

use self::driver::Driver;
use crate::bus::{BusReceiver, BusSender};
use crate::error::During;
use crate::filter::Listen;
use crate::logging::echo_event;
use crate::run_loop::{NodeFactory, block_on};
use crate::stop::{Stop, StopReason};
use crate::{Setup, ShellError, clock};

/// While it plays, playback says the time at least this often, on the host's clock.
pub const TICK_SPAN: Span = Span::from_millis(5);
/// While it plays, playback says the time at least this often, on the replay's clock.
pub const REPLAY_STEP_MAX: Span = Span::from_millis(10);
/// How often to look whether the supervisor lives.
const SUPERVISOR_PERIOD: Span = Span::from_secs(1);

/// Runs a service in a replay until the process is told to end. Not to be called within a tokio runtime.
pub(crate) fn drive(setup: &Setup, factory: &NodeFactory<'_>) -> Result<(), ShellError> {
    let mut driver = Driver::new(&setup.secret, setup.identity, factory)?;
    let span = info_span!("node", name = driver.name());
    block_on(
        async {
            let mut stop = Stop::new(setup.supervised)?;
            let mut shell = Shell::open(setup, &driver)?;
            let run = setup.identity.run;
            info!(domain = "replay", run = format!("{run:016x}"), "started, waiting for playback");
            let reason = shell.serve(&mut driver, &mut stop).await?;
            info!(steps = driver.steps(), "ended: {}", reason.name());
            Ok(())
        }
        .instrument(span),
    )
}

/// The bus of the replay domain, and nothing else: neither clock nor devices.
struct Shell {
    bus: BusReceiver,
    outlet: BusSender,
    overflowed: u64,
}

impl Shell {
    fn open(setup: &Setup, driver: &Driver<'_>) -> Result<Self, ShellError> {
        let (network, domain) = (&setup.arena.network, setup.identity.domain);
        let listen: Vec<&'static Topic> =
            driver.topics_in().iter().copied().chain([&topics::REPLAY_CLOCK]).collect();
        Ok(Self {
            bus: BusReceiver::join(network, domain, Listen::Topics(&listen))?,
            outlet: BusSender::open(network, domain)?,
            overflowed: 0,
        })
    }

    async fn serve(&mut self, driver: &mut Driver<'_>, stop: &mut Stop) -> Result<StopReason, ShellError> {
        let mut ticks = tokio::time::interval(std::time::Duration::from_nanos(
            SUPERVISOR_PERIOD.as_nanos().unsigned_abs(),
        ));
        loop {
            self.take_bus(driver)?;
            let woken = poll_fn(|cx| {
                if let Poll::Ready(reason) = stop.poll_signal(cx) {
                    return Poll::Ready(Ok(Some(reason)));
                }
                if ticks.poll_tick(cx).is_ready() {
                    return Poll::Ready(Ok(stop.check_supervisor(clock::now())));
                }
                self.bus.poll_readable(cx).map_ok(|()| None)
            })
            .await
            .during(|| "waiting for the bus".to_owned())?;
            if let Some(reason) = woken {
                let outlet = &mut self.outlet;
                driver.close(&mut |published| put(outlet, &published));
                return Ok(reason);
            }
        }
    }

    fn take_bus(&mut self, driver: &mut Driver<'_>) -> Result<(), ShellError> {
        let count = self.bus.take_batch()?;
        for index in 0..count {
            let Self { bus, outlet, .. } = self;
            // How long it waited in the queue means nothing: its time is that of the replay.
            driver.take(bus.datagram(index).bytes, &mut |published| put(outlet, &published))?;
        }
        let overflowed = self.bus.take_overflowed();
        if overflowed > 0 {
            let before = self.overflowed;
            self.overflowed += overflowed;
            driver.overflowed(overflowed);
            // Whenever the count doubles: a stall of seconds is a few lines.
            if before.checked_ilog2() != self.overflowed.checked_ilog2() {
                warn!(datagrams = self.overflowed, "too slow: datagrams were dropped");
            }
        }
        Ok(())
    }
}

fn put(outlet: &mut BusSender, published: &Published<'_>) {
    outlet.send(published.datagram);
    echo_event(published);
}

#[cfg(test)]
mod tests;
