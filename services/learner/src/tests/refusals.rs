//! What the learner does not do: fly what may not be flown, go on where something is wrong, learn a flip
//! twice.

use maneuver::{Deviation, FinalError};
use proptest::prelude::*;
use quantity::{Span, Time};
use schemas::{FlipError, FlipOutcome, FlipParameters, LearnerVerdict, ManeuverParameters, ManeuverResult};
use service_core::{Core, Event, Seed, Start};
use settings::{Arena, ConfigError};

use super::rig::{NO_NOISE, Rig, arena};
use crate::{Input, Learner, Output, Tuning};

fn rig() -> Rig {
    Rig::new("double-flip", Deviation::NONE, NO_NOISE, 1)
}

fn built(arena: &Arena) -> Result<Learner, ConfigError> {
    Learner::new(arena, Tuning::default(), Start { at: Time::ZERO, seed: Seed(1), incarnation: 1 })
}

#[test]
fn the_word_is_repeated_at_two_hertz_and_told_at_once_after_a_result() {
    let mut rig = rig();
    assert_eq!(rig.said.len(), 1);
    for _ in 0..20 {
        rig.now = rig.core.deadline().unwrap();
        rig.drive(Event::Deadline);
    }
    assert_eq!(rig.now, Time::ZERO + Span::from_secs(10));
    assert_eq!(rig.said.len(), 21);
    let error = rig.fly();
    rig.tell(FlipOutcome::Completed, error);
    assert_eq!((rig.said.len(), rig.word.iteration), (22, 1));
}

#[test]
fn a_driver_that_is_late_makes_one_word_of_many() {
    let mut rig = rig();
    rig.now = Time::ZERO + Span::from_millis(7_300);
    rig.drive(Event::Deadline);
    assert_eq!(rig.said.len(), 2);
    assert_eq!(rig.core.deadline(), Some(Time::ZERO + Span::from_millis(7_500)));
}

#[test]
fn vehicles_of_one_kind_get_the_same_parameters() {
    let rig = Rig::new("fleet", Deviation::NONE, NO_NOISE, 1);
    let words: Vec<ManeuverParameters> =
        rig.said.iter().map(|Output::Parameters(word)| word.clone()).collect();
    assert_eq!(words.iter().map(|word| word.vehicle).collect::<Vec<_>>(), [1, 2, 3]);
    assert!(words.windows(2).all(|pair| pair[0].parameters == pair[1].parameters));
}

#[test]
fn a_repeated_result_is_learned_once() {
    let mut rig = rig();
    let error = FinalError { x_m: 0.5, ..FinalError::default() };
    rig.tell(FlipOutcome::Completed, error);
    let word = rig.word.clone();
    let parameters = word.parameters;
    let again = ManeuverResult {
        vehicle: 1,
        iteration: 0,
        parameters,
        error: FlipError { x_m: 0.5, ..FlipError::default() },
        ..ManeuverResult::default()
    };
    rig.drive(Event::Input(Input::Result(again)));
    rig.drive(Event::Input(Input::Result(ManeuverResult { vehicle: 9, iteration: 7, ..again })));
    assert_eq!(rig.word, word);
    assert_eq!(rig.said.len(), 2, "nothing new to say");
}

#[test]
fn a_restarted_learner_goes_on_from_what_was_flown() {
    let mut before = Rig::new("double-flip", Deviation { thrust: 0.9, ..Deviation::NONE }, NO_NOISE, 1);
    before.learn(20);
    let error = before.fly();
    let mut after = Rig::new("double-flip", before.deviation, NO_NOISE, 1);
    // The flip manager repeats the last result until somebody answers it.
    after.word = before.word.clone();
    after.tell(FlipOutcome::Completed, error);
    before.tell(FlipOutcome::Completed, error);
    assert_eq!(after.word.iteration, 21);
    assert!(after.events.contains(&"parameters-adopted".to_owned()));
    let (one, other) = (before.flown().to_array(), after.flown().to_array());
    assert!(one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-5 * a.abs()));
}

#[test]
fn parameters_that_may_not_be_flown_are_not_adopted() {
    for wrong in [f64::NAN, -0.1, 3.9, 1e300] {
        let mut rig = rig();
        let own = rig.word.parameters;
        rig.word.iteration = 12;
        rig.word.parameters.t3_s = wrong;
        rig.tell(FlipOutcome::Unmeasured, FinalError::default());
        assert_eq!((rig.word.iteration, rig.word.parameters), (13, own), "{wrong}");
    }
}

#[test]
fn flips_without_a_measured_end_are_flown_again_and_five_stop() {
    for outcome in [FlipOutcome::Aborted, FlipOutcome::Unmeasured] {
        let mut rig = rig();
        let parameters = rig.word.parameters;
        for flip in 1..5 {
            rig.tell(outcome, FinalError { x_m: 3.0, ..FinalError::default() });
            assert_eq!((rig.word.iteration, rig.word.verdict), (flip, LearnerVerdict::Fly));
            assert_eq!(rig.word.parameters, parameters);
        }
        rig.tell(outcome, FinalError::default());
        assert_eq!((rig.word.iteration, rig.word.verdict), (5, LearnerVerdict::Stopped));
        assert!(rig.word.reason.contains("5"), "{:?}", rig.word.reason);
        assert_eq!(rig.events, ["learning-stopped"]);
        let word = rig.word.clone();
        rig.tell(FlipOutcome::Completed, FinalError::default());
        assert_eq!(rig.word, word, "stopped is stopped");
    }
}

#[test]
fn a_flip_that_runs_away_is_stopped() {
    // Turned so far off at the start that every correction makes it worse.
    let mut rig = Rig::new("rate-mismatch", Deviation { gyro: 0.95, ..Deviation::NONE }, NO_NOISE, 1);
    let norms = rig.learn(1000);
    assert_eq!(rig.word.verdict, LearnerVerdict::Stopped);
    assert!((5..30).contains(&norms.len()), "{}", norms.len());
    assert!(!rig.word.reason.is_empty());
}

#[test]
fn the_papers_first_triple_flip_does_not_stop_the_learning() {
    let mut rig = Rig::new("triple-flip", Deviation::NONE, NO_NOISE, 1);
    for _ in 0..6 {
        let error = FinalError { x_m: -1.0, z_m: -2.0, vx_m_s: -4.0, vz_m_s: -2.0, theta_rad: -1.0 };
        rig.tell(FlipOutcome::Completed, error);
        assert_eq!(rig.word.verdict, LearnerVerdict::Fly);
    }
    assert!(rig.events.is_empty(), "{:?}", rig.events);
}

#[test]
fn a_flip_the_model_cannot_fly_is_a_wrong_setting() {
    let mut settings = arena("single-flip");
    settings.scenario.flip.as_mut().unwrap().design_rate_rad_s = 1600f64.to_radians();
    settings.scenario.flip.as_mut().unwrap().flown_rate_rad_s = 1600f64.to_radians();
    settings.fleet[0].vehicle.rate_loop.integral = settings::Integral::Literal;
    let error = built(&settings).unwrap_err();
    assert!(matches!(error, ConfigError::Contradiction { .. }));
    assert!(error.to_string().contains("least residual 0.2"), "{error}");
    let mut settings = arena("double-flip");
    settings.scenario.flip.as_mut().unwrap().flown_rate_rad_s = 1801f64.to_radians();
    assert!(matches!(built(&settings).unwrap_err(), ConfigError::OutOfRange { .. }));
}

#[test]
fn a_wrong_setting_is_refused_by_its_name() {
    let settings = arena("double-flip");
    let start = Start { at: Time::ZERO, seed: Seed(1), incarnation: 1 };
    let mut tuning: Tuning = settings.section("learner").unwrap();
    assert_eq!(tuning, Tuning::default());
    tuning.check.spread_ratio = f64::NAN;
    let error = Learner::new(&settings, tuning, start).unwrap_err().to_string();
    assert!(error.contains("[learner] check.spread_ratio"), "{error}");
}

#[test]
fn a_place_too_low_for_the_first_flip_is_told_and_not_flown() {
    let mut settings = arena("triple-flip");
    settings.fleet[0].part.place_z_m = 3.0;
    let rig = Rig::of(&settings, Deviation::NONE, NO_NOISE, 1);
    assert_eq!(rig.word.verdict, LearnerVerdict::Stopped);
    assert!(rig.word.reason.contains("might sink"), "{:?}", rig.word.reason);
    assert_eq!(rig.events, ["learning-stopped"]);
}

/// What a vehicle's limits and the room at its place allow, checked apart from the learner's own code.
fn flyable(word: &ManeuverParameters) -> bool {
    let FlipParameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s } = word.parameters;
    let (low, high) = (word.envelope_low_m_s2, word.envelope_high_m_s2);
    let a1 = -(high - u1_m_s2) / word.lever_m;
    let a2 = (high - low) / (2.0 * word.lever_m);
    let a5 = (high - u5_m_s2) / word.lever_m;
    let t2_s = (word.rate_rad_s_max - a1 * t1_s) / a2;
    let t4_s = (word.rate_rad_s_max + a5 * t5_s) / a2;
    let rates = [a1 * t1_s, word.rate_rad_s_max, -a5 * t5_s];
    [u1_m_s2, low, high, u5_m_s2].iter().all(|u| (0.68..=23.9).contains(u))
        && [t1_s, t2_s, t3_s, t4_s, t5_s].iter().all(|t| *t > 0.004)
        && t1_s + t2_s + t3_s + t4_s + t5_s <= 4.0
        && (t1_s + t2_s + t3_s + t4_s + t5_s - word.duration_s).abs() < 1e-9
        && rates.iter().all(|rate| rate.abs() <= 1800f64.to_radians() + 1e-4)
        && word.height_loss_m <= 5.0 - 1.5
}

fn any_error() -> impl Strategy<Value = [f64; 5]> {
    let part = || {
        prop_oneof![
            4 => -10.0..10.0f64,
            1 => -1e6..1e6f64,
            1 => proptest::sample::select(vec![0.0, 1e300, -1e300, f64::NAN, f64::INFINITY, 1e-310]),
        ]
    };
    [part(), part(), part(), part(), part()]
}

fn any_outcome() -> impl Strategy<Value = FlipOutcome> {
    proptest::sample::select(vec![
        FlipOutcome::Completed,
        FlipOutcome::Completed,
        FlipOutcome::Completed,
        FlipOutcome::Aborted,
        FlipOutcome::Unmeasured,
    ])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever it is told, what it orders may be flown.
    #[test]
    fn adversarial_results_never_leave_the_bounds(
        results in proptest::collection::vec((any_outcome(), any_error(), 0..3u32, -0.2..0.2f64), 1..25),
        step_size in 0.05..1.0f64,
    ) {
        let mut settings = arena("double-flip");
        settings.scenario.flip.as_mut().unwrap().step_size_ratio = step_size;
        let mut rig = Rig::of(&settings, Deviation::NONE, NO_NOISE, 1);
        for (outcome, error, ahead, wrong) in results {
            rig.word.iteration += ahead;
            if ahead == 2 {
                rig.word.parameters.t3_s += wrong;
            }
            rig.tell(outcome, FinalError::from_array(error));
        }
        for Output::Parameters(word) in &rig.said {
            prop_assert!(flyable(word), "{:?}", word);
        }
    }

    /// An error that never changes drives the parameters until they may go no further.
    #[test]
    fn a_slow_drift_never_leaves_the_bounds(
        error in [-3.0..3.0f64, -3.0..3.0, -3.0..3.0, -3.0..3.0, -1.5..1.5],
    ) {
        let mut rig = rig();
        for _ in 0..40 {
            rig.tell(FlipOutcome::Completed, FinalError::from_array(error));
            prop_assert!(flyable(&rig.word));
        }
    }
}
