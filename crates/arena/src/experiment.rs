//! A learning experiment in virtual time: the whole arena, from the first take-off to the last landing.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use plant::{ManeuverTruth, Trajectory};
use quantity::{Span, Time, Vector, World, math};
use reflect::Message;
use schemas::{
    FlipPhase, FlipStatus, LearnerVerdict, ManeuverParameters, ManeuverResult, NodeEvent, PlantManeuver,
    PlantTruth, Topic, topics,
};
use serde::Serialize;
use service_core::{AnyCore, AnyNode, Core, Identity, Node, Start, Stepper};
use settings::{Arena, ConfigError};
use virtual_arena::{Heard, VirtualArena};
use wire::Secret;

use crate::director::Director;
use crate::pictures::{SidePoint, SideView};
use crate::report::{FlipReport, LearnReport, VehicleReport};

/// The most virtual time one flip may take, from one start to the next, before an experiment is given up as stuck.
const FLIP_TIME_MAX: Span = Span::from_secs(60);
/// How long a round of stepping lasts between two looks at whether all is done.
const ROUND: Span = Span::from_millis(500);

/// What an experiment tells while it runs.
pub trait Observer {
    /// The arena stands, and nothing in it has happened yet.
    fn begin(&mut self, _flying: &VirtualArena<'_>) {}
    /// A vehicle's flip was flown and measured.
    fn flip(&mut self, _vehicle: u8, _flip: &FlipReport) {}
    /// A service reported something.
    fn event(&mut self, _event: &NodeEvent) {}
    /// Some virtual time has passed.
    fn progress(&mut self, _elapsed: Span) {}
    /// A datagram was sent.
    fn heard(&mut self, _heard: &Heard<'_>) {}
}

/// How far the vehicles reached between their first flip and their landing, over the whole fleet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extremes {
    /// Greatest distance from the middle of the hall along x.
    pub x_m_max: f64,
    /// Greatest distance from the middle of the hall along y.
    pub y_m_max: f64,
    /// Least height.
    pub z_m_min: f64,
    /// Greatest height.
    pub z_m_max: f64,
}

impl Default for Extremes {
    fn default() -> Self {
        Self { x_m_max: 0.0, y_m_max: 0.0, z_m_min: f64::INFINITY, z_m_max: 0.0 }
    }
}

impl Extremes {
    fn reach(&mut self, at: Vector<World>) {
        self.x_m_max = self.x_m_max.max(at.x.abs());
        self.y_m_max = self.y_m_max.max(at.y.abs());
        self.z_m_min = self.z_m_min.min(at.z);
        self.z_m_max = self.z_m_max.max(at.z);
    }
}

/// A flown experiment: the report, and what only a simulation can tell besides.
#[derive(Clone, Debug)]
pub struct Flown {
    /// What `arena learn` prints and writes.
    pub report: LearnReport,
    /// Side views of each vehicle's first and last flip.
    pub side_views: Vec<(u8, Vec<SideView>)>,
    /// How far the vehicles reached.
    pub extremes: Extremes,
    /// Turns each flip of the first vehicle truly made.
    pub turns: Vec<f64>,
}

/// An observer that wants to know nothing.
impl Observer for () {}

/// Every service of the arena in the order they are started, the front door's director included.
#[must_use]
pub fn services() -> Vec<&'static str> {
    let mut names = roster::SERVICES.to_vec();
    names.push(Director::NAME);
    names
}

/// Builds any node of the arena: the roster's, or the front door's own.
///
/// # Errors
/// An unknown name, or a setting the service cannot work with.
pub fn node(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    if name == Director::NAME {
        return Ok(Box::new(Node::<Director>::new(arena, secret, identity, now)?));
    }
    roster::node(name, arena, secret, identity, now)
}

/// Builds any core of the arena, to execute it again: the roster's, or the front door's own.
///
/// # Errors
/// As of [`node`].
pub fn core(name: &str, arena: &Arena, start: Start) -> Result<Box<dyn AnyCore>, ConfigError> {
    if name == Director::NAME {
        return Ok(Box::new(Stepper::<Director>::new(arena, start)?));
    }
    roster::core(name, arena, start)
}

/// Flies a whole learning experiment in virtual time.
///
/// # Errors
/// A setting some service cannot work with.
pub fn learn(arena: &Arena, seed: u64, observer: &mut dyn Observer) -> Result<Flown, ConfigError> {
    let factory = node;
    let mut flying = VirtualArena::new(arena, seed, &services(), &factory)?;
    observer.begin(&flying);
    let start = flying.now();
    flying.plant_mut().record_trajectories(true);
    let mut log = Log::new(arena, start);
    let flips = arena.scenario.flip.as_ref().map_or(0, |flip| flip.iterations);
    let limit = FLIP_TIME_MAX * i64::from(flips + 2);
    while !log.all_done() && flying.elapsed() < limit {
        flying.run_for(ROUND, &mut |heard| log.hear(&heard, observer));
        log.maneuvers.append(&mut flying.take_maneuvers());
        log.trajectories.append(&mut flying.plant_mut().trajectories());
        observer.progress(flying.elapsed());
    }
    let report = LearnReport {
        scenario: arena.name.clone(),
        seed,
        digest: flying.digest(),
        virtual_s: flying.elapsed().as_secs_f64(),
        wall_s: 0.0,
        vehicles: log.vehicles.values().map(|vehicle| vehicle.report.clone()).collect(),
    };
    // Whoever records wants the journals whole; the experiment, and its digest, end before.
    flying.close(&mut |heard| observer.heard(&heard));
    Ok(Flown { side_views: log.side_views(), extremes: log.extremes, turns: log.turns(), report })
}

/// Decodes a message for an observer; what does not decode is not of that topic.
#[must_use]
pub fn message<M: Message>(heard: &Heard<'_>, topic: &Topic) -> Option<M> {
    (heard.published.is_data() && heard.published.topic == topic)
        .then(|| wire::decode(heard.published.body).ok())
        .flatten()
}

struct VehicleLog {
    report: VehicleReport,
    truths: Vec<PlantManeuver>,
    phase: FlipPhase,
}

struct Log {
    start: Time,
    vehicles: BTreeMap<u8, VehicleLog>,
    maneuvers: Vec<ManeuverTruth>,
    trajectories: Vec<Trajectory>,
    extremes: Extremes,
}

impl Log {
    fn new(arena: &Arena, start: Time) -> Self {
        let vehicles = arena
            .fleet
            .iter()
            .map(|member| {
                let id = member.vehicle.id;
                let report = VehicleReport { id, iterations: Vec::new(), stopped: None };
                (id, VehicleLog { report, truths: Vec::new(), phase: FlipPhase::Idle })
            })
            .collect();
        Self {
            start,
            vehicles,
            maneuvers: Vec::new(),
            trajectories: Vec::new(),
            extremes: Extremes::default(),
        }
    }

    fn all_done(&self) -> bool {
        self.vehicles.values().all(|vehicle| vehicle.phase == FlipPhase::Done)
    }

    /// The first and the last flip of each vehicle, as the paper's Fig. 2 shows them.
    fn side_views(&self) -> Vec<(u8, Vec<SideView>)> {
        let of_vehicle = |id: u8| {
            let flown: Vec<_> = self.trajectories.iter().filter(|flown| flown.vehicle == id).collect();
            let mut views: Vec<SideView> = flown
                .first()
                .map(|first| side_view("b) the first flip".to_owned(), first))
                .into_iter()
                .collect();
            if flown.len() > 1 {
                let label = format!("c) flip {}", flown.len() - 1);
                views.extend(flown.last().map(|last| side_view(label, last)));
            }
            views
        };
        self.vehicles.keys().map(|id| (*id, of_vehicle(*id))).collect()
    }

    fn turns(&self) -> Vec<f64> {
        let first = self.vehicles.keys().next().copied().unwrap_or_default();
        let of_first = self.maneuvers.iter().filter(|maneuver| maneuver.vehicle == first);
        of_first.map(|maneuver| maneuver.turned_rad / TAU).collect()
    }

    fn hear(&mut self, heard: &Heard<'_>, observer: &mut dyn Observer) {
        observer.heard(heard);
        if let Some(truth) = message::<PlantManeuver>(heard, &topics::PLANT_MANEUVER) {
            if let Some(vehicle) = self.vehicles.get_mut(&truth.vehicle) {
                vehicle.truths.push(truth);
            }
        } else if let Some(result) = message::<ManeuverResult>(heard, &topics::MANEUVER_RESULT) {
            self.note_result(&result, observer);
        } else if let Some(next) = message::<ManeuverParameters>(heard, &topics::MANEUVER_PARAMETERS) {
            if next.verdict == LearnerVerdict::Stopped
                && let Some(vehicle) = self.vehicles.get_mut(&next.vehicle)
            {
                vehicle.report.stopped = Some(next.reason.to_string());
            }
        } else if let Some(status) = message::<FlipStatus>(heard, &topics::FLIP_STATUS) {
            if let Some(vehicle) = self.vehicles.get_mut(&status.vehicle) {
                vehicle.phase = status.phase;
            }
        } else if let Some(truth) = message::<PlantTruth>(heard, &topics::PLANT_TRUTH) {
            // Before the first flip and while landing, being near the floor is as it should be.
            let flying = self.vehicles.get(&truth.vehicle).is_some_and(|vehicle| {
                !vehicle.truths.is_empty() && !matches!(vehicle.phase, FlipPhase::Landing | FlipPhase::Done)
            });
            if flying {
                self.extremes.reach(truth.truth.position_m);
            }
        } else if let Some(event) = message::<NodeEvent>(heard, &topics::NODE_EVENT) {
            observer.event(&event);
        }
    }

    fn note_result(&mut self, result: &ManeuverResult, observer: &mut dyn Observer) {
        let Some(vehicle) = self.vehicles.get_mut(&result.vehicle) else { return };
        // The flip manager repeats a result until the learner has answered it.
        if vehicle.report.iterations.last().is_some_and(|last| last.index >= result.iteration) {
            return;
        }
        let truth = vehicle.truths.iter().rev().find(|truth| truth.maneuver_id == result.maneuver_id);
        let flip = FlipReport::new(result, truth, self.start);
        vehicle.report.iterations.push(flip);
        observer.flip(result.vehicle, &flip);
    }
}

fn side_view(label: String, flown: &Trajectory) -> SideView {
    let (sin, cos) = math::sin_cos(flown.heading_rad);
    let of_maneuver =
        || flown.samples.iter().filter(|sample| (0.0..=flown.duration_s).contains(&sample.after_s));
    let start = of_maneuver().next().map_or(Vector::ZERO, |sample| sample.position_m);
    let points = of_maneuver()
        .map(|sample| {
            let moved = sample.position_m - start;
            SidePoint {
                t_s: sample.after_s,
                x_m: cos * moved.x + sin * moved.y,
                z_m: moved.z,
                theta_rad: sample.pitch_rad,
            }
        })
        .collect();
    SideView { label, points }
}
