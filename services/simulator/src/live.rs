//! Real time: the simulation's clock, sockets and place on the bus.
//!
//! The simulation is woken on an absolute schedule and then lets all the time pass that has passed, so
//! lateness never adds up. After a pause it catches up in slices, reading its sockets in between, as hardware
//! would have gone on.

use std::future::poll_fn;
use std::io;
use std::task::{Context, Poll};

use plant::PlantError;
use quantity::{Span, Time};
use reflect::{Message, Text};
use schemas::{NodeEvent, NodeHealth, Severity, Topic, topics};
use service_core::Publisher;
use service_shell::{
    BusSender, During, Options, QUEUE_AGE_MAX, Setup, ShellError, Stop, StopReason, Timer, block_on, clock,
    echo_event, program_digest,
};
use settings::ConfigError;
use tracing::{Instrument, info, info_span, warn};
use wire::Domain;

use crate::cables::Cables;
use crate::{NAME, Said, Simulation};

/// How often definitions and health are announced.
const ANNOUNCE_PERIOD: Span = Span::from_secs(1);
/// Time made up for between two looks at the sockets.
const SLICE: Span = Span::from_millis(50);
/// Later than this, the cameras' frames come noticeably irregular.
const LATENESS_MAX: Span = Span::from_millis(5);

/// The topics this program writes.
static TOPICS: &[&Topic] =
    &[&topics::PLANT_TRUTH, &topics::PLANT_MANEUVER, &topics::NODE_EVENT, &topics::NODE_HEALTH];

pub(crate) fn run(options: &Options, seed: u64) -> Result<(), ShellError> {
    let setup = Setup::load(NAME, options)?;
    refuse_other_domains(setup.identity.domain)?;
    block_on(
        async {
            let mut stop = Stop::new(setup.supervised)?;
            let mut live = Live::open(&setup, seed)?;
            let (vehicles, run) = (setup.arena.fleet.len(), format!("{:016x}", setup.identity.run));
            info!(scenario = setup.arena.name, vehicles, seed, run, "started");
            let reason = live.serve(&mut stop).await?;
            info!(overruns = live.overruns, stale = live.stale, "ended: {}", reason.name());
            Ok(())
        }
        .instrument(info_span!("node", name = NAME)),
    )
}

/// A simulator on the live bus could only do harm.
fn refuse_other_domains(domain: Domain) -> Result<(), ShellError> {
    match domain {
        Domain::Sim => Ok(()),
        found => Err(ShellError::Domain { service: NAME, found: found.name(), allowed: Domain::Sim.name() }),
    }
}

/// Settings that no plant can be made of are wrong settings.
fn config_error(scenario: &str, error: &PlantError) -> ConfigError {
    ConfigError::Malformed { file: format!("scenarios/{scenario}.toml"), reason: error.to_string() }
}

struct Live {
    simulation: Simulation,
    cables: Cables,
    timer: Timer,
    voice: Voice,
    announce_at: Time,
    started_at: Time,
    steps: u64,
    overruns: u64,
    stale: u64,
}

/// The simulator's place on the bus.
struct Voice {
    publisher: Publisher,
    bus: BusSender,
}

impl Voice {
    fn say<M: Message>(&mut self, topic: &'static Topic, message: &M) {
        let bus = &mut self.bus;
        let said = self.publisher.publish(clock::now(), topic, message, &mut |published| {
            bus.send(published.datagram);
            echo_event(&published);
        });
        if let Err(error) = said {
            warn!(topic = topic.name, %error, "a message that cannot be said");
        }
    }

    fn announce(&mut self) {
        let bus = &mut self.bus;
        self.publisher.announce(clock::now(), TOPICS, &mut |published| bus.send(published.datagram));
    }
}

impl Live {
    fn open(setup: &Setup, seed: u64) -> Result<Self, ShellError> {
        let voice = Voice {
            publisher: Publisher::new(NAME, &setup.secret, setup.identity),
            bus: BusSender::open(&setup.arena.network, setup.identity.domain)?,
        };
        let cables = Cables::open(&setup.arena)?;
        let timer = Timer::new().during(|| "making a timer".to_owned())?;
        let now = clock::now();
        let simulation = Simulation::new(&setup.arena, seed, now)
            .map_err(|error| config_error(&setup.arena.name, &error))?;
        Ok(Self {
            simulation,
            cables,
            timer,
            voice,
            announce_at: now,
            started_at: now,
            steps: 0,
            overruns: 0,
            stale: 0,
        })
    }

    async fn serve(&mut self, stop: &mut Stop) -> Result<StopReason, ShellError> {
        loop {
            self.cables.take(&mut self.simulation)?;
            let now = clock::now();
            self.note_lateness(now);
            let until = now.min(self.simulation.now() + SLICE);
            self.pass_time(now, until);
            if self.announce_at <= now {
                self.announce_at = now + ANNOUNCE_PERIOD;
                self.announce();
                if let Some(reason) = stop.check_supervisor(now) {
                    return Ok(reason);
                }
            }
            let next = if until < now { now } else { self.simulation.next_event().min(self.announce_at) };
            self.timer.set(Some(next)).during(|| "setting the timer".to_owned())?;
            if let Some(reason) = self.wait(stop).await? {
                return Ok(reason);
            }
        }
    }

    async fn wait(&mut self, stop: &mut Stop) -> Result<Option<StopReason>, ShellError> {
        poll_fn(|cx| match stop.poll_signal(cx) {
            Poll::Ready(reason) => Poll::Ready(Ok(Some(reason))),
            Poll::Pending => self.poll_work(cx).map_ok(|()| None),
        })
        .await
        .during(|| "waiting for sockets".to_owned())
    }

    fn poll_work(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.timer.poll_elapsed(cx) {
            Poll::Pending => self.cables.poll_readable(cx),
            elapsed => elapsed,
        }
    }

    fn pass_time(&mut self, now: Time, until: Time) {
        self.steps += 1;
        let Self { simulation, cables, voice, stale, .. } = self;
        let earliest = now - QUEUE_AGE_MAX;
        simulation.advance(until, &mut |said| match said {
            // What should have been sent long ago would only be a burst of the past.
            Said::Device(output) if output.at < earliest => *stale += 1,
            Said::Truth(truth) if truth.at < earliest => *stale += 1,
            Said::Device(output) => cables.send(output),
            Said::Truth(truth) => voice.say(&topics::PLANT_TRUTH, &truth),
            Said::Maneuver(maneuver) => voice.say(&topics::PLANT_MANEUVER, &maneuver),
        });
    }

    fn note_lateness(&mut self, now: Time) {
        let lateness = now - self.simulation.next_event();
        if lateness <= LATENESS_MAX {
            return;
        }
        self.overruns += 1;
        // Powers of two: a slow machine is reported at once and then ever more rarely.
        if self.overruns.is_power_of_two() {
            let detail =
                format!("{} ms late; {} times so far", lateness.as_nanos() / 1_000_000, self.overruns);
            let event = NodeEvent {
                severity: Severity::Warning,
                vehicle: 0,
                at: now,
                node: Text::truncated(NAME),
                name: Text::truncated("simulator-late"),
                detail: Text::truncated(detail),
            };
            self.voice.say(&topics::NODE_EVENT, &event);
        }
    }

    fn announce(&mut self) {
        self.voice.announce();
        let health = NodeHealth {
            node: Text::truncated(NAME),
            started_at: self.started_at,
            program_digest: program_digest(),
            steps: self.steps,
            published: self.voice.publisher.published(),
            ..NodeHealth::default()
        };
        self.voice.say(&topics::NODE_HEALTH, &health);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_simulator_refuses_any_domain_but_its_own() {
        assert!(refuse_other_domains(Domain::Sim).is_ok());
        for domain in [Domain::Live, Domain::Replay] {
            let error = refuse_other_domains(domain).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(domain.name()) && text.contains("sim only"), "{text}");
            assert_eq!(error.exit_code(), std::process::ExitCode::from(2));
        }
    }
}
