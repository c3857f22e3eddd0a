//! What is learned, on planar models that are wrong on purpose.

use maneuver::{Deviation, Discretisation, FinalError, deviate, solve};
use quantity::math;
use schemas::{FlipOutcome, LearnerVerdict};

use super::rig::{NO_NOISE, NOISE, Rig, arena};

/// The gyro, thrust and inertia errors of the vehicle behind the paper's figures, as far as a planar model
/// has them.
const PAPER: Deviation = Deviation { thrust: 0.92, inertia: 0.97, gyro: 1.045, ..Deviation::NONE };

/// After how many flips the error has fallen to a twentieth of the first and stays there.
fn flips_to_a_twentieth(norms: &[f64]) -> usize {
    norms.iter().rposition(|norm| *norm > 0.05 * norms[0]).map_or(0, |last| last + 1)
}

#[test]
fn the_figures_of_the_paper_converge_undistorted() {
    for (scenario, flips_max) in
        [("single-flip", 30), ("double-flip", 32), ("triple-flip", 31), ("rate-mismatch", 65)]
    {
        let mut rig = Rig::new(scenario, PAPER, NO_NOISE, 1);
        let norms = rig.learn(1000);
        let flips = flips_to_a_twentieth(&norms);
        assert!(flips <= flips_max, "{scenario}: {flips} flips");
        assert_eq!(norms.len(), arena(scenario).scenario.flip.unwrap().iterations as usize);
        assert_eq!(rig.word.verdict, LearnerVerdict::Finished);
        assert!(rig.events.is_empty(), "{scenario}: neither clamp nor check may act: {:?}", rig.events);
    }
}

#[test]
fn a_slow_vehicle_with_the_triples_parameters_learns_a_double() {
    let mut rig = Rig::new("rate-mismatch", PAPER, NO_NOISE, 1);
    rig.learn(1000);
    let case =
        deviate(&rig.model, &rig.design, &rig.flown(), Discretisation::Hold800, &rig.deviation).unwrap();
    assert!((case.error.theta_rad + core::f64::consts::TAU).abs() < 0.05, "one turn short of three");
}

#[test]
fn a_triple_is_learned_as_far_off_as_the_updates_limits() {
    let none = Deviation::NONE;
    for deviation in [
        Deviation { thrust: 0.75, ..none },
        Deviation { thrust: 1.4, ..none },
        Deviation { mass: 0.8, ..none },
        Deviation { mass: 1.3, ..none },
        Deviation { inertia: 0.6, ..none },
        Deviation { inertia: 1.3, ..none },
        Deviation { gyro: 0.94, ..none },
        Deviation { gyro: 1.08, ..none },
    ] {
        let mut settings = arena("triple-flip");
        settings.scenario.flip.as_mut().unwrap().iterations = 120;
        let mut rig = Rig::of(&settings, deviation, NO_NOISE, 1);
        let norms = rig.learn(120);
        assert!(flips_to_a_twentieth(&norms) <= 100, "{deviation:?}: {:?}", rig.word.reason);
    }
}

#[test]
fn noise_is_not_learned() {
    for seed in 0..5 {
        let mut rig = Rig::new("double-flip", PAPER, NOISE, seed);
        let norms = rig.learn(1000);
        let floor = norms[60..].iter().sum::<f64>() / (norms.len() - 60) as f64;
        let noise = math::sqrt(NOISE.iter().map(|sigma| sigma * sigma).sum());
        assert!(floor < 1.5 * noise, "seed {seed}: {floor} of {noise}");
    }
}

#[test]
fn the_first_step_is_that_of_the_paper() {
    let mut rig = Rig::new("double-flip", PAPER, NO_NOISE, 1);
    let solution = solve(&rig.model, &rig.design, Discretisation::Continuous).unwrap();
    let (before, error) = (rig.word.parameters, rig.fly());
    let before = [before.u1_m_s2, before.t1_s, before.t3_s, before.u5_m_s2, before.t5_s];
    assert_eq!(before, solution.parameters.to_array());
    // An error a whole turn further is the same error.
    rig.tell(
        FlipOutcome::Completed,
        FinalError { theta_rad: error.theta_rad + core::f64::consts::TAU, ..error },
    );
    let after = rig.word.parameters;
    let after = [after.u1_m_s2, after.t1_s, after.t3_s, after.u5_m_s2, after.t5_s];
    // J (P1 - P0) = -gamma E, with gamma 0.1.
    for (row, expected) in solution.jacobian.iter().zip(error.to_array()) {
        let moved: f64 = row.iter().zip(after.iter().zip(before)).map(|(j, (a, b))| j * (a - b)).sum();
        assert!((moved + 0.1 * expected).abs() < 1e-9, "{moved} {expected}");
    }
}

#[test]
fn same_results_same_words() {
    let run = || {
        let mut rig = Rig::new("triple-flip", PAPER, NOISE, 9);
        rig.learn(30);
        rig.said
    };
    assert!(run() == run());
}
