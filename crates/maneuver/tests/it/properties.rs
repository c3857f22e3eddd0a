//! What must hold for any numbers: continuity, consistent durations, refusal instead of panic.

use maneuver::{
    Discretisation, Envelope, EnvelopeError, FlipDesign, LOOP_HZ, Model, Parameters, Primitive,
    PrimitiveError, Setpoint, final_error, solve,
};
use proptest::prelude::*;

use crate::design;

/// Any float at all: ordinary, huge, tiny, infinite, NaN.
fn any_number() -> impl Strategy<Value = f64> {
    let special = prop::sample::select(vec![f64::NAN, 0.0, f64::INFINITY]);
    prop_oneof![2 => any::<f64>(), 1 => -50.0..50.0, 1 => special]
}

fn any_parameters() -> impl Strategy<Value = Parameters> {
    prop::array::uniform5(any_number()).prop_map(Parameters::from)
}

/// Parameters near those of a flip, U1 and U5 up to all the thrust there is.
fn flyable_parameters() -> impl Strategy<Value = Parameters> {
    (12.0..23.9, 0.0..0.5, 0.0..1.0, 12.0..23.9, 0.0..0.5)
        .prop_map(|(u1, t1, t3, u5, t5)| Parameters::from([u1, t1, t3, u5, t5]))
}

fn primitive(parameters: &Parameters) -> Result<Primitive, PrimitiveError> {
    Primitive::new(&design(2, 1600.0, Envelope::MARGIN), Model::TABLE_I.alpha_l_m(), parameters)
}

proptest! {
    #[test]
    fn the_commanded_rate_is_continuous_and_zero_at_both_ends(parameters in flyable_parameters()) {
        let Ok(primitive) = primitive(&parameters) else { return Ok(()) };
        let steepest =
            primitive.steps().iter().map(|step| step.angular_acceleration_rad_s2.abs()).fold(0.0, f64::max);
        let interval_s = 1e-3;
        let mut before = primitive.sample(0.0);
        prop_assert_eq!(before.rate_rad_s, 0.0);
        for number in 1.. {
            let t_s = f64::from(number) * interval_s;
            let now = primitive.sample(t_s);
            let change_rad_s = (now.rate_rad_s - before.rate_rad_s).abs();
            prop_assert!(change_rad_s <= steepest * interval_s * 1.000_001 + 1e-9);
            before = now;
            if t_s > primitive.duration_s() + 0.01 {
                break;
            }
        }
        prop_assert!(before.rate_rad_s.abs() < 1e-9, "ends at {}", before.rate_rad_s);
        prop_assert_eq!(before.collective_m_s2, parameters.u5_m_s2);
    }

    #[test]
    fn durations_and_samples_are_consistent(parameters in flyable_parameters()) {
        let Ok(primitive) = primitive(&parameters) else { return Ok(()) };
        let steps = primitive.steps();
        let total: f64 = steps.iter().map(|step| step.duration_s).sum();
        prop_assert!((primitive.duration_s() - total).abs() < 1e-12);
        prop_assert_eq!([steps[0].duration_s, steps[2].duration_s], [parameters.t1_s, parameters.t3_s]);
        let mut begin_s = 0.0;
        for step in steps {
            let middle = primitive.sample(begin_s + 0.5 * step.duration_s);
            if step.duration_s > 0.0 {
                prop_assert_eq!(middle.collective_m_s2, step.collective_m_s2);
            }
            begin_s += step.duration_s;
        }
        // The middle steps reach the rate they were designed for.
        let coast = primitive.sample(steps[0].duration_s + steps[1].duration_s + 0.5 * steps[2].duration_s);
        if steps[2].duration_s > 0.0 {
            prop_assert!((coast.rate_rad_s - 1600f64.to_radians()).abs() < 1e-9);
        }
    }

    #[test]
    fn tick_means_add_up_to_the_whole(parameters in flyable_parameters()) {
        let Ok(primitive) = primitive(&parameters) else { return Ok(()) };
        let exact: f64 = primitive.steps().iter().map(|step| step.duration_s * step.collective_m_s2).sum();
        let mut sum = 0.0;
        let mut tick = 0;
        while f64::from(tick) / LOOP_HZ < primitive.duration_s() {
            let from_s = f64::from(tick) / LOOP_HZ;
            let until_s = (f64::from(tick + 1) / LOOP_HZ).min(primitive.duration_s());
            sum += primitive.mean_collective_m_s2(from_s, until_s) * (until_s - from_s);
            tick += 1;
        }
        prop_assert!((sum - exact).abs() < 1e-9, "{} {}", sum, exact);
    }

    #[test]
    fn arbitrary_numbers_are_flown_or_refused_and_never_panic(
        parameters in any_parameters(),
        rate_rad_s_max in any_number(),
        low_m_s2 in any_number(),
        high_m_s2 in any_number(),
        alpha_l_m in any_number(),
        flips in any::<u8>(),
        t_s in any_number(),
    ) {
        let envelope = Envelope { low_m_s2, high_m_s2 };
        let design = FlipDesign { flips, rate_rad_s_max, envelope };
        if let Ok(primitive) = Primitive::new(&design, alpha_l_m, &parameters) {
            prop_assert!(primitive.duration_s() <= Primitive::DURATION_S_MAX);
            let Setpoint { collective_m_s2, rate_rad_s } = primitive.sample(t_s);
            prop_assert!(collective_m_s2.is_finite() && rate_rad_s.is_finite());
            prop_assert!(primitive.mean_collective_m_s2(t_s, alpha_l_m).is_finite());
        }
        let _ = final_error(&Model::TABLE_I, &design, &parameters, Discretisation::Hold800);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn any_design_is_solved_or_refused(
        flips in 1u8..=4,
        rate_deg_s in 600.0..2400.0,
        margin in 0.0..0.35,
    ) {
        let design = design(flips, rate_deg_s, margin);
        if let Ok(solution) = solve(&Model::TABLE_I, &design, Discretisation::Continuous) {
            prop_assert!(solution.final_error.norm() < 1e-9);
            prop_assert!(solution.parameters.u5_m_s2 <= design.envelope.high_m_s2);
            prop_assert!(solution.condition.is_finite());
        }
    }
}

#[test]
fn what_is_impossible_is_named() {
    let good = [20.0, 0.16, 0.28, 20.0, 0.18];
    let with = |index: usize, value: f64| {
        let mut parameters = good;
        parameters[index] = value;
        primitive(&parameters.into())
    };
    assert!(primitive(&good.into()).is_ok());
    assert!(matches!(with(0, f64::NAN), Err(PrimitiveError::NotFinite { quantity: "U1", .. })));
    assert!(matches!(with(1, -0.1), Err(PrimitiveError::NegativeDuration { step: 1, .. })));
    assert!(matches!(with(2, -0.1), Err(PrimitiveError::NegativeDuration { step: 3, .. })));
    assert!(matches!(with(3, -1.0), Err(PrimitiveError::NegativeCollective { step: 5, .. })));
    // Far above the envelope U1 alone brings the rate beyond the maximum, U5 alone stops from beyond it.
    let mut fast = good;
    (fast[0], fast[1]) = (23.9, 1.0);
    assert!(matches!(primitive(&fast.into()), Err(PrimitiveError::NegativeDuration { step: 2, .. })));
    let mut slow = good;
    (slow[3], slow[4]) = (23.9, 1.0);
    assert!(matches!(primitive(&slow.into()), Err(PrimitiveError::NegativeDuration { step: 4, .. })));
    assert!(matches!(with(2, 10.0), Err(PrimitiveError::TooLong { .. })));
}

#[test]
fn impossible_designs_are_named() {
    let (good, parameters) = (design(2, 1600.0, 0.125), Parameters::from([20.0, 0.16, 0.28, 20.0, 0.18]));
    let lever_m = Model::TABLE_I.alpha_l_m();
    let refusal = |design: FlipDesign, lever_m: f64| {
        Primitive::new(&design, lever_m, &parameters).expect_err("impossible")
    };
    let still = FlipDesign { rate_rad_s_max: 0.0, ..good };
    assert_eq!(
        refusal(still, lever_m),
        PrimitiveError::NotPositive { quantity: "rate_rad_s_max", value: 0.0 }
    );
    assert_eq!(refusal(FlipDesign { flips: 0, ..good }, lever_m), PrimitiveError::NoFlips);
    assert!(matches!(refusal(good, f64::NAN), PrimitiveError::NotFinite { quantity: "alpha_l_m", .. }));
    let upside_down = Envelope { low_m_s2: 20.0, high_m_s2: 4.0 };
    assert!(matches!(
        refusal(FlipDesign { envelope: upside_down, ..good }, lever_m),
        PrimitiveError::Envelope(EnvelopeError::Bounds { .. })
    ));
}
