//! `arena fly`: the standing order for an arena that others keep running.
//!
//! `arena up` starts the services and gives the orders; where something else keeps the services running (containers,
//! units of the init system), this command gives the orders alone. Told to end, it lands first.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use front_door::supervisor::{Console, Screen};
use quantity::{Span, Time};
use schemas::{
    FlightMode, FlipPhase, NodeEvent, OrderKind, Severity, StopKind, StopOrder, Topic, VehicleTelemetry,
    topics,
};
use service_core::{AnyNode, Identity, Node, Observer, Published, Publisher, source_of};
use service_shell::{
    BusReceiver, BusSender, DomainOption, Listen, Options, Setup, ShellError, Stop, clock, program_digest,
};
use tokio::time::MissedTickBehavior;

use super::Failure;

/// How often the order is looked after and lines are renewed.
const TICK: Duration = Duration::from_millis(100);
/// The services have heard an order after this long; what they say of themselves before tells nothing of it.
const HEARD_SPAN: Span = Span::from_secs(2);
/// An order is given again no more often than this.
const AGAIN_SPAN: Span = Span::from_secs(5);
/// How long a landing may take. What puts an end to this program must wait longer.
const LANDING_MAX: Span = Span::from_secs(40);

/// Options of `arena fly`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Hover at the scenario's places, without flipping
    #[arg(long)]
    hover: bool,
    /// Give the order again where vehicles came down before their work was done, and release those that landed because
    /// nobody commanded them: for a simulated arena, in which nobody stands beside the net. An emergency stop holds
    #[arg(long)]
    again: bool,
    #[command(flatten)]
    options: Options,
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    Finished,
    Landed,
    Stopped,
}

/// Runs the command: exit code 0 where everything landed, 1 where it gave up in the air.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging(&arguments.options.log);
    if arguments.again && arguments.options.domain == DomainOption::Live {
        let reason = "--again: whether a real vehicle flies again after a fault, a person decides";
        return Err(Failure::Usage(reason.to_owned()));
    }
    let setup = Setup::load("arena", &arguments.options.joining())?;
    let order = if arguments.hover { OrderKind::Hover } else { OrderKind::Fly };
    let mut screen = Screen::default();
    let ending = service_shell::block_on(async {
        let mut stop = Stop::new(setup.supervised)?;
        Flight::begin(&setup, order, arguments.again)?.attend(&mut stop, &mut screen).await
    })?;
    screen.say(match ending {
        Ending::Finished => "every vehicle is done and down",
        Ending::Landed => "landed",
        Ending::Stopped => "stopped before everything was down",
    });
    Ok(if ending == Ending::Stopped { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The order that stands, and what the arena makes of it.
struct Flight {
    node: Node<Console>,
    receiver: BusReceiver,
    sender: BusSender,
    order: OrderKind,
    ordered_at: Time,
    again: bool,
    observer: Observer,
    work: Work,
    landed: Landed,
    releases: Publisher,
}

impl Flight {
    fn begin(setup: &Setup, order: OrderKind, again: bool) -> Result<Self, ShellError> {
        let (network, domain, now) = (&setup.arena.network, setup.identity.domain, clock::now());
        let mut node = Node::<Console>::new(&setup.arena, &setup.secret, setup.identity, now)?;
        node.identify_program(program_digest());
        let topics: Vec<&'static Topic> =
            node.topics_in().iter().copied().chain([&topics::VEHICLE_TELEMETRY]).collect();
        let receiver = BusReceiver::join(network, domain, Listen::Topics(&topics))?;
        let sender = BusSender::open(network, domain)?;
        let observer = Observer::new(&setup.secret, domain, setup.identity.run);
        // A source of its own: the node numbers its own messages.
        let identity = Identity { source: source_of("arena fly"), ..setup.identity };
        let releases = Publisher::new("arena", &setup.secret, identity);
        let (work, landed) = (Work::default(), Landed::default());
        let mut flight =
            Self { node, receiver, sender, order, ordered_at: now, again, observer, work, landed, releases };
        flight.give(order);
        Ok(flight)
    }

    fn give(&mut self, order: OrderKind) {
        (self.order, self.ordered_at) = (order, clock::now());
        self.node.core_mut().order(self.ordered_at, order);
    }

    async fn attend(&mut self, stop: &mut Stop, screen: &mut Screen) -> Result<Ending, ShellError> {
        let mut ticks = tokio::time::interval(TICK);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                batch = self.receiver.next_batch() => self.take(batch?),
                _ = ticks.tick() => {
                    if let Some(ending) = self.tick(screen) {
                        return Ok(ending);
                    }
                }
                _ = std::future::poll_fn(|cx| stop.poll_signal(cx)) => {
                    if self.order == OrderKind::Land {
                        return Ok(Ending::Stopped);
                    }
                    screen.say("landing first; once more stops at once");
                    self.give(OrderKind::Land);
                }
            }
        }
    }

    fn take(&mut self, count: usize) {
        let Self { node, receiver, sender, observer, work, landed, .. } = self;
        let mut say = |published: Published<'_>| sender.send(published.datagram);
        for index in 0..count {
            let datagram = receiver.datagram(index).bytes;
            // What is dropped, the node counts.
            let _ = node.receive(clock::now(), datagram, &mut say);
            let Ok(observed) = observer.observe(datagram) else { continue };
            if !observed.verified {
                continue;
            }
            let name = observed.topic.name();
            if name == topics::NODE_EVENT.name
                && let Ok(event) = service_core::decode(observed.body)
            {
                work.note(&event);
            } else if name == topics::VEHICLE_TELEMETRY.name
                && let Ok(report) = service_core::decode(observed.body)
            {
                landed.note(&report);
            }
        }
    }

    fn tick(&mut self, screen: &mut Screen) -> Option<Ending> {
        let now = clock::now();
        let Self { node, sender, .. } = self;
        if node.deadline().is_some_and(|at| at <= now) {
            node.wake(now, &mut |published: Published<'_>| sender.send(published.datagram));
        }
        screen.show(now, node.core_mut(), &[]);
        if self.again && self.order != OrderKind::Land {
            self.release(now);
        }
        let since_order = now - self.ordered_at;
        if self.order == OrderKind::Land {
            let landed = since_order > HEARD_SPAN && self.node.core().all_down();
            return match landed {
                true => Some(Ending::Landed),
                false => (since_order > LANDING_MAX).then_some(Ending::Stopped),
            };
        }
        if since_order <= HEARD_SPAN {
            return None;
        }
        let console = self.node.core();
        let unfinished = console
            .vehicles()
            .iter()
            .any(|(vehicle, view)| view.status.phase == FlipPhase::Done && !self.work.is_over(*vehicle));
        if self.again && unfinished {
            if since_order > AGAIN_SPAN {
                screen.say("vehicles came down before their work was done; the order is given again");
                self.give(self.order);
            }
            return None;
        }
        console.all_done().then_some(Ending::Finished)
    }

    /// Releases whoever landed by itself; the bridge repeats it, and so does the next tick.
    fn release(&mut self, now: Time) {
        let Self { sender, landed, releases, .. } = self;
        for order in landed.releases() {
            // Numbers and a time of this clock: there is nothing in it that could not be said.
            let _ = releases.publish(now, &topics::STOP_ORDER, &order, &mut |published| {
                sender.send(published.datagram);
            });
        }
    }
}

/// Which vehicles keep their motors off since a landing that nobody ordered, and when each first said so.
#[derive(Debug, Default)]
struct Landed(BTreeMap<u8, Time>);

impl Landed {
    fn note(&mut self, report: &VehicleTelemetry) {
        if report.mode == FlightMode::Landed {
            self.0.entry(report.vehicle).or_insert(report.received_at);
        } else {
            self.0.remove(&report.vehicle);
        }
    }

    /// As old as the report that they answer: an emergency stop that a person gave since is the later order, and holds.
    fn releases(&self) -> impl Iterator<Item = StopOrder> {
        self.0.iter().map(|(vehicle, given_at)| StopOrder {
            kind: StopKind::Release,
            vehicle: *vehicle,
            given_at: *given_at,
        })
    }
}

/// Why the flip manager lets a vehicle rest for good: no order changes that.
const ENDS_OF_WORK: [&str; 3] = ["learning-finished", "learning-stopped", "battery-low"];

/// Whose work is over, as the flip manager's last word on each vehicle tells.
#[derive(Debug, Default)]
struct Work(BTreeMap<u8, bool>);

impl Work {
    fn note(&mut self, event: &NodeEvent) {
        if event.node.as_str() != "flip-manager" {
            return;
        }
        let over = ENDS_OF_WORK.contains(&event.name.as_str());
        if over || event.severity != Severity::Info {
            self.0.insert(event.vehicle, over);
        }
    }

    fn is_over(&self, vehicle: u8) -> bool {
        self.0.get(&vehicle).copied().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use reflect::Text;

    use super::*;

    #[test]
    fn who_landed_unordered_is_released_by_an_order_older_than_any_stop_since() {
        let mut landed = Landed::default();
        let mut report = |vehicle, mode, millis| {
            let received_at = Time::ZERO + Span::from_millis(millis);
            landed.note(&VehicleTelemetry { vehicle, mode, received_at, ..VehicleTelemetry::default() });
            landed.releases().map(|order| (order.kind, order.vehicle, order.given_at)).collect::<Vec<_>>()
        };
        assert!(report(1, FlightMode::Descend, 10).is_empty());
        let release = (StopKind::Release, 1, Time::ZERO + Span::from_millis(20));
        assert_eq!(report(1, FlightMode::Landed, 20), [release]);
        assert_eq!(report(1, FlightMode::Landed, 30), [release], "one landing, one order");
        assert_eq!(
            report(2, FlightMode::Stopped, 40),
            [release],
            "an emergency stop is a person's to release"
        );
        assert!(report(1, FlightMode::Disarmed, 50).is_empty());
    }

    #[test]
    fn work_is_over_when_the_flip_managers_last_word_says_so() {
        let mut work = Work::default();
        let mut say = |node, severity, name| {
            let (node, name) = (Text::truncated(node), Text::truncated(name));
            work.note(&NodeEvent { severity, vehicle: 1, node, name, ..NodeEvent::default() });
            (work.is_over(1), work.is_over(2))
        };
        assert_eq!(say("flip-manager", Severity::Fault, "vehicle-down"), (false, false));
        assert_eq!(say("flip-manager", Severity::Warning, "battery-low"), (true, false));
        assert_eq!(say("estimator", Severity::Warning, "frame-mistimed"), (true, false));
        assert_eq!(say("flip-manager", Severity::Fault, "telemetry-lost"), (false, false));
        assert_eq!(say("flip-manager", Severity::Info, "learning-finished"), (true, false));
    }
}
