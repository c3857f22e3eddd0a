//! A vehicle for the core to learn on: the planar model, wrong on purpose, with noise.

use maneuver::{
    Deviation, Discretisation, Envelope, FinalError, FlipDesign, Integral, Model, Parameters, deviate,
};
use quantity::{Span, Time};
use schemas::{FlipError, FlipOutcome, LearnerVerdict, ManeuverParameters, ManeuverResult};
use service_core::{Core, Event, Outbox, Seed, Start};
use settings::Arena;

use super::random::Random;
use crate::{Input, Learner, Output, Tuning};

/// One sigma of what differs from flip to flip, in the order x, z, vx, vz, theta: start, gusts, gyro and
/// measurement.
pub(crate) const NOISE: [f64; 5] = [0.03, 0.03, 0.08, 0.08, 0.03];
/// No flip like another but in its parameters.
pub(crate) const NO_NOISE: [f64; 5] = [0.0; 5];

/// A learner and its vehicle.
pub(crate) struct Rig {
    /// The scenario's first vehicle.
    pub(crate) vehicle: u8,
    pub(crate) core: Learner,
    pub(crate) now: Time,
    pub(crate) model: Model,
    pub(crate) design: FlipDesign,
    pub(crate) deviation: Deviation,
    pub(crate) noise: [f64; 5],
    pub(crate) random: Random,
    /// The learner's last word.
    pub(crate) word: ManeuverParameters,
    /// Names of the events reported.
    pub(crate) events: Vec<String>,
    /// Everything said.
    pub(crate) said: Vec<Output>,
}

/// A scenario of the repository.
pub(crate) fn arena(scenario: &str) -> Arena {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
    Arena::load(std::path::Path::new(folder), scenario).expect("the repository's own settings are good")
}

pub(crate) fn learner(arena: &Arena) -> Learner {
    let start = Start { at: Time::ZERO, seed: Seed(1), incarnation: 1 };
    Learner::new(arena, Tuning::default(), start).expect("the repository's own settings are good")
}

impl Rig {
    pub(crate) fn new(scenario: &str, deviation: Deviation, noise: [f64; 5], seed: u64) -> Self {
        Self::of(&arena(scenario), deviation, noise, seed)
    }

    pub(crate) fn of(arena: &Arena, deviation: Deviation, noise: [f64; 5], seed: u64) -> Self {
        let integral = match arena.fleet[0].vehicle.rate_loop.integral {
            settings::Integral::Literal => Integral::Literal,
            settings::Integral::Conditional => Integral::Conditional,
        };
        let model = Model { integral, ..Model::TABLE_I };
        let flip = arena.scenario.flip.as_ref().unwrap();
        let envelope = Envelope::with_margin(&model, flip.envelope_margin_ratio).expect("a good margin");
        let design = FlipDesign { flips: flip.flips, rate_rad_s_max: flip.flown_rate_rad_s, envelope };
        let mut rig = Self {
            vehicle: arena.fleet[0].vehicle.id,
            core: learner(arena),
            now: Time::ZERO,
            model,
            design,
            deviation,
            noise,
            random: Random::new(seed),
            word: ManeuverParameters::default(),
            events: Vec::new(),
            said: Vec::new(),
        };
        rig.drive(Event::Deadline);
        rig
    }

    pub(crate) fn drive(&mut self, event: Event<Input>) {
        let mut out = Outbox::default();
        self.core.step(self.now, event, &mut out);
        self.events.extend(out.take_events().map(|event| event.name.to_string()));
        for output in out.take_messages() {
            let Output::Parameters(word) = &output;
            if word.vehicle == self.vehicle {
                self.word = word.clone();
            }
            self.said.push(output);
        }
    }

    /// The parameters as the link carries them.
    pub(crate) fn flown(&self) -> Parameters {
        let flip = &self.word.parameters;
        let items = [flip.u1_m_s2, flip.t1_s, flip.t3_s, flip.u5_m_s2, flip.t5_s];
        Parameters::from_array(items.map(|item| f64::from(item as f32)))
    }

    /// Where the flip of the learner's word ends.
    pub(crate) fn fly(&mut self) -> FinalError {
        let parameters = self.flown();
        let case = deviate(&self.model, &self.design, &parameters, Discretisation::Hold800, &self.deviation)
            .expect("what the learner orders is a flip");
        let mut error = case.error.wrapped().to_array();
        for (part, sigma) in error.iter_mut().zip(self.noise) {
            *part += sigma * self.random.gaussian();
        }
        FinalError::from_array(error).wrapped()
    }

    /// Tells the learner how a flip ended.
    pub(crate) fn tell(&mut self, outcome: FlipOutcome, error: FinalError) {
        let [u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s] = self.flown().to_array();
        let FinalError { x_m, z_m, vx_m_s, vz_m_s, theta_rad } = error;
        self.now += Span::from_secs(6);
        self.drive(Event::Input(Input::Result(ManeuverResult {
            vehicle: self.vehicle,
            iteration: self.word.iteration,
            outcome,
            parameters: schemas::FlipParameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s },
            error: FlipError { x_m, z_m, vx_m_s, vz_m_s, theta_rad },
            ..ManeuverResult::default()
        })));
    }

    /// Flies and learns until the learner wants no more, at most that many flips; the norms of the errors.
    pub(crate) fn learn(&mut self, flips: usize) -> Vec<f64> {
        let mut norms = Vec::new();
        while norms.len() < flips && self.word.verdict == LearnerVerdict::Fly {
            let error = self.fly();
            norms.push(error.norm());
            self.tell(FlipOutcome::Completed, error);
        }
        norms
    }
}
