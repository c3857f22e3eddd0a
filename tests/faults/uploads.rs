//! Uploads over a data link at its worst, and starts of every kind after each: a vehicle begins nothing but the very
//! set that was ordered, whole.
//!
//! The vehicle hovers, real but for its flip manager. In that one's place an [`Orderer`] uploads one set after another
//! and orders starts, right and wrong ones; what begins is ended at once.

use std::collections::BTreeMap;
use std::thread;

use device::vehicle_link::{FLIP_SET_LEN, FlipSet, ManeuverPhase as LinkPhase, digest_of};
use front_door::experiment::{message, node};
use plant::faults::Fault;
use plant::random::{Purpose, Stream};
use quantity::{Span, Time, Vector};
use schemas::{
    GoalKind, ManeuverAbort, ManeuverPhase, ManeuverStart, ManeuverUpload, VehicleGoal, VehicleTelemetry,
    topics,
};
use serde::Deserialize;
use service_core::{Core, Event, Node, Outbox, Start};
use settings::{Arena, ConfigError};
use virtual_arena::{Heard, VirtualArena};

use crate::common::arena;

const SERVICES: [&str; 5] = ["vicon-bridge", "estimator", "hover-controller", "flip-manager", "radio-bridge"];
const PLACE_M: Vector<quantity::World> = Vector::new(0.0, 0.0, 4.0);
/// An upload is published again after this, as a flip manager does after longer: a restarted bridge knows of none.
const REPEAT: Span = Span::from_millis(250);
/// How long an order to begin counts, and is waited for.
const VALIDITY: Span = Span::from_millis(200);
const PATIENCE: Span = Span::from_millis(350);
const STEP: Span = Span::from_millis(10);

service_core::inputs! {
    /// It hears what the vehicle says of itself.
    enum Input {
        /// Which set is active, what became of the last order.
        Telemetry(VehicleTelemetry) = topics::VEHICLE_TELEMETRY,
    }
}

service_core::outputs! {
    /// What it says in the flip manager's place.
    enum Output {
        /// Hover.
        Goal(VehicleGoal) = topics::VEHICLE_GOAL,
        /// Have this set.
        Upload(ManeuverUpload) = topics::MANEUVER_UPLOAD,
        /// Begin.
        Start(ManeuverStart) = topics::MANEUVER_START,
        /// End.
        Abort(ManeuverAbort) = topics::MANEUVER_ABORT,
    }
}

#[derive(Debug, Default, Deserialize)]
struct Tuning {}

/// What is wrong with an order to begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// Nothing, and its set is confirmed.
    Right,
    /// Nothing, but its set has only just been given to the bridge.
    Hasty,
    /// A digest that no set has.
    WrongDigest,
    /// The set before.
    Older,
    /// The identity of the newest set, the digest of the one before.
    OlderDigest,
    /// The identity of the set before, the digest of the newest.
    OlderIdentity,
}

/// What the orderer is at.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    Resting { until: Time },
    Uploading { repeat_at: Time },
    Waiting { until: Time },
}

/// Uploads and orders without end.
#[derive(Debug)]
struct Orderer {
    random: Stream,
    next_at: Time,
    doing: Doing,
    set_id: u16,
    maneuver_id: u16,
    newest: Option<ManeuverUpload>,
    before: Option<ManeuverUpload>,
}

impl Core for Orderer {
    const NAME: &'static str = "flip-manager";
    type Tuning = Tuning;
    type Input = Input;
    type Output = Output;

    fn new(_arena: &Arena, _tuning: Tuning, start: Start) -> Result<Self, ConfigError> {
        let doing = Doing::Resting { until: start.at };
        let random = Stream::new(start.seed.0, Purpose::World, 1);
        let (newest, before) = (None, None);
        Ok(Self { random, next_at: start.at, doing, set_id: 0, maneuver_id: 0, newest, before })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, out: &mut Outbox<Output>) {
        match event {
            Event::Input(Input::Telemetry(report)) => self.hear(now, &report, out),
            Event::Deadline => {
                self.next_at = now + STEP;
                let goal = VehicleGoal {
                    vehicle: 1,
                    kind: GoalKind::Hover,
                    position_m: PLACE_M,
                    ..Default::default()
                };
                out.publish(goal);
                self.go_on(now, out);
            }
        }
    }
}

impl Orderer {
    fn hear(&mut self, now: Time, report: &VehicleTelemetry, out: &mut Outbox<Output>) {
        if report.maneuver_phase == ManeuverPhase::Running {
            out.publish(ManeuverAbort { vehicle: 1, maneuver_id: report.maneuver_id });
        }
        let flying = report.mode == schemas::FlightMode::Flying;
        match self.doing {
            Doing::Resting { until } if flying && now >= until => self.upload(now, out),
            Doing::Uploading { .. } => {
                let confirmed = self.newest.is_some_and(|newest| {
                    (newest.set_id, newest.digest) == (report.set_id, report.set_digest)
                });
                if confirmed && flying {
                    let kinds =
                        [Kind::Right, Kind::WrongDigest, Kind::Older, Kind::OlderDigest, Kind::OlderIdentity];
                    let kind = kinds[self.random.below(5) as usize];
                    self.order(now, kind, out);
                    self.doing = Doing::Waiting { until: now + PATIENCE };
                }
            }
            _ => {}
        }
    }

    fn go_on(&mut self, now: Time, out: &mut Outbox<Output>) {
        match self.doing {
            Doing::Waiting { until } if now >= until => {
                let rest = Span::from_millis(i64::from(self.random.below(60)));
                self.doing = Doing::Resting { until: now + rest };
            }
            Doing::Uploading { repeat_at } if now >= repeat_at => {
                self.newest.into_iter().for_each(|upload| out.publish(upload));
                self.doing = Doing::Uploading { repeat_at: now + REPEAT };
            }
            _ => {}
        }
    }

    fn upload(&mut self, now: Time, out: &mut Outbox<Output>) {
        // Now and then another set under the identity of the last: a flip manager that was started anew.
        if self.newest.is_none() || !self.random.chance(0.1) {
            self.set_id = self.set_id.wrapping_add(1).max(1);
        }
        let mut items = ITEMS;
        for item in &mut items[..5] {
            *item *= 1.0 + 0.05 * self.random.symmetric() as f32;
        }
        let upload = message_of(self.set_id, &items);
        self.before = self.newest.replace(upload);
        out.publish(upload);
        self.doing = Doing::Uploading { repeat_at: now + REPEAT };
        if self.random.chance(0.3) {
            self.order(now, Kind::Hasty, out);
        }
    }

    fn order(&mut self, now: Time, kind: Kind, out: &mut Outbox<Output>) {
        let Some(newest) = self.newest else { return };
        let before = self.before.unwrap_or(newest);
        let (set_id, digest) = match kind {
            Kind::Right | Kind::Hasty => (newest.set_id, newest.digest),
            Kind::WrongDigest => (newest.set_id, newest.digest ^ (1 << self.random.below(64))),
            Kind::Older => (before.set_id, before.digest),
            Kind::OlderDigest => (newest.set_id, before.digest),
            Kind::OlderIdentity => (before.set_id, newest.digest),
        };
        self.maneuver_id = self.maneuver_id.wrapping_add(1).max(1);
        let valid_until = now + VALIDITY;
        out.publish(ManeuverStart { vehicle: 1, maneuver_id: self.maneuver_id, set_id, digest, valid_until });
    }
}

/// A double flip.
const ITEMS: [f32; FLIP_SET_LEN] = [20.0, 0.161, 0.278, 20.0, 0.183, 27.925, 3.59, 21.026, 0.0578, 2.0];

fn message_of(set_id: u16, items: &[f32; FLIP_SET_LEN]) -> ManeuverUpload {
    let set = FlipSet::from_items(items);
    ManeuverUpload {
        vehicle: 1,
        flips: set.flips as u8,
        set_id,
        digest: digest_of(items),
        u1_m_s2: set.u1_m_s2,
        t1_s: set.t1_s,
        t3_s: set.t3_s,
        u5_m_s2: set.u5_m_s2,
        t5_s: set.t5_s,
        rate_rad_s_max: set.rate_rad_s_max,
        envelope_low_m_s2: set.envelope_low_m_s2,
        envelope_high_m_s2: set.envelope_high_m_s2,
        lever_m: set.lever_m,
    }
}

fn items_of(upload: &ManeuverUpload) -> [f32; FLIP_SET_LEN] {
    [
        upload.u1_m_s2,
        upload.t1_s,
        upload.t3_s,
        upload.u5_m_s2,
        upload.t5_s,
        upload.rate_rad_s_max,
        upload.envelope_low_m_s2,
        upload.envelope_high_m_s2,
        upload.lever_m,
        f32::from(upload.flips),
    ]
}

/// How bad the link is.
#[derive(Clone, Copy, Debug)]
struct Weather {
    loss_ratio: f64,
    /// Besides: bent frames, doubled ones, ones that overtake each other, and a bridge that dies now and then.
    rough: bool,
}

/// What was seen.
#[derive(Debug, Default)]
struct Seen {
    /// From an upload's first word on the bus to the vehicle's report of it.
    took: Vec<Span>,
    /// Of each kind of order: given, begun.
    orders: BTreeMap<Kind, (u64, u64)>,
    restarts: u64,
    bent: u64,
}

impl Seen {
    fn add(&mut self, other: Self) {
        self.took.extend(other.took);
        for (kind, (given, begun)) in other.orders {
            let (all_given, all_begun) = self.orders.entry(kind).or_default();
            (*all_given, *all_begun) = (*all_given + given, *all_begun + begun);
        }
        self.restarts += other.restarts;
        self.bent += other.bent;
    }
}

/// Who watches.
#[derive(Default)]
struct Watch {
    /// Every set that was ever given to the bridge, with the bits of its items.
    uploaded: BTreeMap<(u16, u64), [u32; FLIP_SET_LEN]>,
    /// The newest, since when, until it is reported.
    open: Option<(u16, u64, Time)>,
    newest: (u16, u64),
    before: (u16, u64),
    orders: BTreeMap<u16, (Kind, u16, u64)>,
    judged: u16,
    seen: Seen,
}

impl Watch {
    fn hear(&mut self, heard: &Heard<'_>) {
        if let Some(upload) = message::<ManeuverUpload>(heard, &topics::MANEUVER_UPLOAD) {
            let pair = (upload.set_id, upload.digest);
            if self.uploaded.insert(pair, items_of(&upload).map(f32::to_bits)).is_none() {
                self.before = std::mem::replace(&mut self.newest, pair);
                self.open = Some((pair.0, pair.1, heard.at));
            }
        }
        if let Some(start) = message::<ManeuverStart>(heard, &topics::MANEUVER_START) {
            let kind = self.kind(start.set_id, start.digest);
            self.orders.insert(start.maneuver_id, (kind, start.set_id, start.digest));
            self.seen.orders.entry(kind).or_default().0 += 1;
        }
        if let Some(report) = message::<VehicleTelemetry>(heard, &topics::VEHICLE_TELEMETRY) {
            let reported = (report.set_id, report.set_digest);
            if let Some((.., since)) = self.open.take_if(|(id, digest, _)| (*id, *digest) == reported) {
                self.seen.took.push(heard.at - since);
            }
        }
    }

    /// What is wrong with an order, as it looks from here.
    fn kind(&self, set_id: u16, digest: u64) -> Kind {
        match ((set_id, digest) == self.newest, (set_id, digest) == self.before) {
            (true, _) if self.open.is_some() => Kind::Hasty,
            (true, _) => Kind::Right,
            (_, true) => Kind::Older,
            _ if digest == self.before.1 => Kind::OlderDigest,
            _ if digest == self.newest.1 => Kind::OlderIdentity,
            _ => Kind::WrongDigest,
        }
    }

    /// Holds what the vehicle truly does against what was ordered.
    fn judge(&mut self, flying: &VirtualArena<'_>) {
        let firmware = flying.plant().firmware(1).unwrap();
        let status = firmware.status(flying.now());
        let active = (status.set_id, status.set_digest);
        if let Some((id, items)) = firmware.active_set() {
            let uploaded = self.uploaded.get(&active).expect("an active set was uploaded once");
            let bits = items.iter().map(|item| item.to_bits());
            assert!(id == active.0 && bits.eq(*uploaded), "{active:?} stands for {items:?}");
        }
        let begun = !matches!(status.maneuver_phase, LinkPhase::None | LinkPhase::Refused);
        if !begun || status.maneuver_id == self.judged {
            return;
        }
        self.judged = status.maneuver_id;
        let (kind, set_id, digest) = self.orders[&status.maneuver_id];
        assert_eq!(active, (set_id, digest), "{kind:?}: begun with a set that was not ordered");
        let allowed = matches!(kind, Kind::Right | Kind::Hasty);
        assert!(allowed, "{kind:?}: begun with set {set_id} {digest:016x}");
        self.seen.orders.entry(kind).or_default().1 += 1;
    }
}

/// Uploads so many sets in one flight.
fn campaign(weather: Weather, seed: u64, uploads: usize) -> Seen {
    let mut settings = arena("double-flip");
    let link = &mut settings.fleet[0].vehicle.plant.data_link;
    link.loss_ratio = weather.loss_ratio;
    if weather.rough {
        (link.corruption_ratio, link.jitter_s) = (0.05, 0.015);
    }
    let factory = |name: &str, arena: &Arena, secret: &wire::Secret, identity, now| {
        if name == "flip-manager" {
            let node = Node::<Orderer>::new(arena, secret, identity, now)?;
            return Ok(Box::new(node) as Box<dyn service_core::AnyNode>);
        }
        node(name, arena, secret, identity, now)
    };
    let mut flying = VirtualArena::new(&settings, seed, &SERVICES, &factory).unwrap();
    if weather.rough {
        let twice = Fault::DataDuplication { vehicle: 1, duplicate_ratio: 0.2 };
        flying.plant_mut().fault(twice, Time::ZERO, Time::FAR_FUTURE);
    }
    let (mut random, mut watch) = (Stream::new(seed, Purpose::World, 2), Watch::default());
    let patience = Span::from_secs(30 + 4 * uploads as i64);
    while watch.seen.took.len() < uploads {
        assert!(
            flying.elapsed() < patience,
            "only {} uploads in {}",
            watch.seen.took.len(),
            flying.elapsed()
        );
        flying.run_for(STEP, &mut |heard| watch.hear(&heard));
        watch.judge(&flying);
        // The battery is not what this is about.
        flying.plant_mut().set_battery_ratio(1, 0.9);
        if weather.rough && random.chance(0.001) {
            flying.kill("radio-bridge");
            flying.run_for(Span::from_millis(i64::from(random.below(40))), &mut |heard| watch.hear(&heard));
            flying.restart("radio-bridge").unwrap();
            watch.seen.restarts += 1;
        }
    }
    let extremes = flying.plant().extremes(1).unwrap();
    assert!(!extremes.crashed && !extremes.left_hall, "{extremes:?}");
    let (up, down) = flying.plant().data_link_counts(1).unwrap();
    watch.seen.bent = up.corrupted + down.corrupted;
    watch.seen
}

/// The same in several flights at once, and what came of it, in words.
fn campaigns(weather: Weather, seeds: std::ops::Range<u64>, uploads: usize) -> Seen {
    let mut all = Seen::default();
    thread::scope(|scope| {
        let flights: Vec<_> =
            seeds.map(|seed| scope.spawn(move || campaign(weather, seed, uploads))).collect();
        flights.into_iter().for_each(|flight| all.add(flight.join().unwrap()));
    });
    all.took.sort_unstable();
    let at = |ratio: f64| all.took[((all.took.len() - 1) as f64 * ratio) as usize];
    println!(
        "{} uploads, {weather:?}: median {}, p90 {}, p99 {}, p99.9 {}, longest {}; {} restarts, {} bent frames; \
         orders given and begun: {:?}",
        all.took.len(),
        at(0.5),
        at(0.9),
        at(0.99),
        at(0.999),
        at(1.0),
        all.restarts,
        all.bent,
        all.orders,
    );
    all
}

/// Four flights of so many are 10⁴ uploads, some ten seconds of two cores.
const UPLOADS_PER_FLIGHT: usize = 2_500;

#[test]
fn nothing_begins_but_the_very_set_that_was_ordered_and_whole() {
    let seen = campaigns(Weather { loss_ratio: 0.3, rough: true }, 1..5, UPLOADS_PER_FLIGHT);
    for kind in [Kind::WrongDigest, Kind::Older, Kind::OlderDigest, Kind::OlderIdentity] {
        assert!(seen.orders[&kind].0 > 1_000, "{kind:?}: {:?}", seen.orders);
    }
    // The worst of it is only shown where right orders are obeyed all the same.
    assert!(seen.orders[&Kind::Right].1 > 500 && seen.orders[&Kind::Hasty].1 > 20, "{:?}", seen.orders);
    assert!(seen.restarts > 300 && seen.bent > 10_000);
}

#[test]
fn at_ten_percent_loss_every_upload_takes_under_half_a_second() {
    let seen = campaigns(Weather { loss_ratio: 0.1, rough: false }, 11..15, UPLOADS_PER_FLIGHT);
    assert!(seen.took.last().is_some_and(|longest| *longest < Span::from_millis(500)));
}

#[test]
fn uploads_without_loss_and_with_much_take_what_they_take() {
    for loss_ratio in [0.0, 0.3] {
        let seen = campaigns(Weather { loss_ratio, rough: false }, 21..23, UPLOADS_PER_FLIGHT / 5);
        assert!(
            seen.took.last().is_some_and(|longest| *longest < Span::from_secs(2)),
            "a bridge gives up then"
        );
    }
}
