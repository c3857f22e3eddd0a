//! What cannot be flown is said so, with the least residual and the bounds in the way, and never returned as
//! a P0.

use maneuver::{Discretisation, Envelope, Infeasible, Integral, Model, SolveError, final_error, solve};

use crate::{assert_prints, design};

fn infeasible(flips: u8, rate_deg_s: f64, margin: f64) -> Infeasible {
    let design = design(flips, rate_deg_s, margin);
    match solve(&Model::TABLE_I, &design, Discretisation::Continuous) {
        Err(SolveError::Infeasible(infeasible)) => infeasible,
        other => panic!("{flips} flips, {rate_deg_s} deg/s, margin {margin}: {other:?}"),
    }
}

#[test]
fn one_fast_flip_does_not_fit_and_the_least_residuals_are_the_published_ones() {
    assert_prints("1600 deg/s", &[infeasible(1, 1600.0, Envelope::MARGIN).least_residual], &[0.20], 2);
    assert_prints("1800 deg/s", &[infeasible(1, 1800.0, Envelope::MARGIN).least_residual], &[0.18], 2);
}

#[test]
fn the_reported_residual_is_that_of_the_reported_parameters() {
    let infeasible = infeasible(1, 1600.0, Envelope::MARGIN);
    let design = design(1, 1600.0, Envelope::MARGIN);
    let error = final_error(&Model::TABLE_I, &design, &infeasible.parameters, Discretisation::Continuous)
        .expect("a flip");
    assert_eq!(error.norm(), infeasible.least_residual);
    assert!(infeasible.parameters.u5_m_s2 <= design.envelope.high_m_s2);
}

#[test]
fn without_a_margin_u5_is_stopped_by_the_envelope() {
    for (flips, rate_deg_s, margin) in
        [(2, 1400.0, 0.0), (3, 1600.0, 0.0), (2, 1400.0, 0.05), (3, 1600.0, 0.05)]
    {
        let infeasible = infeasible(flips, rate_deg_s, margin);
        assert!(infeasible.limits.high(3), "{flips} {rate_deg_s} {margin}: {}", infeasible.limits);
        assert!(infeasible.least_residual > 1e-3);
        assert!(infeasible.to_string().contains("U5 at its upper bound"), "{infeasible}");
    }
}

#[test]
fn a_sampled_collective_is_refused() {
    let design = design(2, 1600.0, Envelope::MARGIN);
    let answer = solve(&Model::TABLE_I, &design, Discretisation::Hold800);
    assert_eq!(answer, Err(SolveError::Discontinuous));
}

#[test]
fn the_conditional_integral_solves_too_and_overshoots_less() {
    let literal = Model::TABLE_I;
    let conditional = Model { integral: Integral::Conditional, ..literal };
    for (flips, rate_deg_s) in [(1, 1000.0), (2, 1300.0), (2, 1600.0), (3, 1600.0), (3, 1800.0)] {
        let design = design(flips, rate_deg_s, Envelope::MARGIN);
        let peak = |model: &Model| {
            let solution = solve(model, &design, Discretisation::Continuous).expect("feasible");
            assert!(solution.final_error.norm() < 1e-9);
            let mut peak_rad_s: f64 = 0.0;
            maneuver::trajectory(
                model,
                &design,
                &solution.parameters,
                Discretisation::Continuous,
                |_, state| peak_rad_s = peak_rad_s.max(state.rate_rad_s),
            )
            .expect("a flip");
            peak_rad_s / design.rate_rad_s_max
        };
        let (literal, conditional) = (peak(&literal), peak(&conditional));
        assert!(literal > 1.17, "{flips} {rate_deg_s}: {literal}");
        assert!(conditional < 1.12, "{flips} {rate_deg_s}: {conditional}");
    }
}
