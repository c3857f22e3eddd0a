//! A learning experiment in virtual time: the whole arena, from the first take-off to the last landing.

use std::collections::BTreeMap;

use quantity::{Span, Time};
use reflect::Message;
use schemas::{
    FlipPhase, FlipStatus, LearnerVerdict, ManeuverParameters, ManeuverResult, NodeEvent, PlantManeuver, Topic, topics,
};
use service_core::{AnyNode, Core, Identity, Node};
use settings::{Arena, ConfigError};
use virtual_arena::{Heard, VirtualArena};
use wire::Secret;

use crate::director::Director;
use crate::report::{FlipReport, LearnReport, VehicleReport};

/// The most virtual time one flip may take, from one start to the next, before an experiment is given up as stuck.
const FLIP_TIME_MAX: Span = Span::from_secs(60);
/// How long a round of stepping lasts between two looks at whether all is done.
const ROUND: Span = Span::from_millis(500);

/// What an experiment tells while it runs.
pub trait Observer {
    /// A vehicle's flip was flown and measured.
    fn flip(&mut self, _vehicle: u8, _flip: &FlipReport) {}
    /// A service reported something.
    fn event(&mut self, _event: &NodeEvent) {}
    /// Some virtual time has passed.
    fn progress(&mut self, _elapsed: Span) {}
    /// A datagram was sent.
    fn heard(&mut self, _heard: &Heard<'_>) {}
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

/// Flies a whole learning experiment in virtual time.
///
/// # Errors
/// A setting some service cannot work with.
pub fn learn(arena: &Arena, seed: u64, observer: &mut dyn Observer) -> Result<LearnReport, ConfigError> {
    let factory = node;
    let mut flying = VirtualArena::new(arena, seed, &services(), &factory)?;
    let start = flying.now();
    let mut log = Log::new(arena, start);
    let limit = FLIP_TIME_MAX * i64::from(arena.scenario.flip.iterations + 2);
    while !log.all_done() && flying.elapsed() < limit {
        flying.run_for(ROUND, &mut |heard| log.hear(&heard, observer));
        observer.progress(flying.elapsed());
    }
    Ok(LearnReport {
        scenario: arena.name.clone(),
        seed,
        digest: flying.digest(),
        virtual_s: flying.elapsed().as_secs_f64(),
        wall_s: 0.0,
        vehicles: log.into_vehicles(),
    })
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
    done: bool,
}

struct Log {
    start: Time,
    vehicles: BTreeMap<u8, VehicleLog>,
}

impl Log {
    fn new(arena: &Arena, start: Time) -> Self {
        let vehicles = arena
            .fleet
            .iter()
            .map(|member| {
                let id = member.vehicle.id;
                let report = VehicleReport { id, iterations: Vec::new(), stopped: None };
                (id, VehicleLog { report, truths: Vec::new(), done: false })
            })
            .collect();
        Self { start, vehicles }
    }

    fn all_done(&self) -> bool {
        self.vehicles.values().all(|vehicle| vehicle.done)
    }

    fn into_vehicles(self) -> Vec<VehicleReport> {
        self.vehicles.into_values().map(|vehicle| vehicle.report).collect()
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
                vehicle.done = status.phase == FlipPhase::Done;
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
