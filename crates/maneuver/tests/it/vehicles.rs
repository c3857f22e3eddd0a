//! Flips on vehicles that are not the model.

use maneuver::{
    Deviation, Discretisation, Envelope, FlipError, Model, Parameters, deviate, final_error, stress,
};

use crate::design;

const DOUBLE: Parameters =
    Parameters { u1_m_s2: 20.39544, t1_s: 0.16092, t3_s: 0.27833, u5_m_s2: 20.30911, t5_s: 0.18268 };

fn deviating(deviation: Deviation) -> maneuver::StressCase {
    let design = design(2, 1600.0, Envelope::MARGIN);
    deviate(&Model::TABLE_I, &design, &DOUBLE, Discretisation::Average800, &deviation).expect("a flip")
}

#[test]
fn no_deviation_is_the_model() {
    let design = design(2, 1600.0, Envelope::MARGIN);
    let model = final_error(&Model::TABLE_I, &design, &DOUBLE, Discretisation::Average800).expect("a flip");
    assert_eq!(deviating(Deviation::NONE).error, model);
}

#[test]
fn weak_heavy_or_misread_vehicles_err_as_they_should() {
    let nominal = deviating(Deviation::NONE);
    let weak = deviating(Deviation { thrust: 0.8, ..Deviation::NONE });
    let heavy = deviating(Deviation { mass: 1.2, ..Deviation::NONE });
    assert!(weak.error.z_m < -0.5 && weak.height_loss_m > 0.5, "{weak:?}");
    assert!(heavy.error.z_m < -0.5 && heavy.error.vz_m_s < -1.0, "{heavy:?}");
    let strong = deviating(Deviation { thrust: 1.2, ..Deviation::NONE });
    assert!(strong.error.z_m > 0.3 && strong.apex_m > nominal.apex_m, "{strong:?}");
    // A gyro that reads high makes the vehicle turn too slowly, by about its share of the whole turn.
    let misread = deviating(Deviation { gyro: 1.045, ..Deviation::NONE });
    let short_rad = nominal.error.theta_rad - misread.error.theta_rad;
    let share_rad = 4.0 * core::f64::consts::PI * (1.0 - 1.0 / 1.045);
    assert!((0.5 * share_rad..1.5 * share_rad).contains(&short_rad), "{short_rad} of {share_rad}");
}

#[test]
fn thrust_and_mass_together_change_nothing_but_the_inertia() {
    // Twice the thrust on twice the mass and inertia is the same vehicle, once it commands as if it were.
    let scaled = deviating(Deviation { thrust: 1.1, mass: 1.1, inertia: 1.1, ..Deviation::NONE });
    let nominal = deviating(Deviation::NONE);
    for (scaled, nominal) in scaled.error.to_array().iter().zip(nominal.error.to_array()) {
        assert!((scaled - nominal).abs() < 1e-9, "{scaled} {nominal}");
    }
}

#[test]
fn the_report_names_the_worst() {
    let design = design(2, 1600.0, Envelope::MARGIN);
    let discretisation = Discretisation::Average800;
    let report = stress(&Model::TABLE_I, &design, &DOUBLE, discretisation, 0.2).expect("a flip");
    assert_eq!(report.cases[0], deviating(Deviation::NONE));
    let deepest = report.deepest();
    assert!(report.cases.iter().all(|case| case.height_loss_m <= deepest.height_loss_m));
    assert!(deepest.deviation.thrust < 1.0 || deepest.deviation.mass > 1.0, "{deepest:?}");
    assert!(report.fastest().rate_rad_s_max >= report.cases[0].rate_rad_s_max);
    assert!(report.farthest().error.norm() >= deepest.error.norm());
    let most_turned = report.most_turned().error.theta_rad.abs();
    assert!(report.cases.iter().all(|case| case.error.theta_rad.abs() <= most_turned));
}

#[test]
fn impossible_deviations_are_named() {
    let design = design(2, 1600.0, Envelope::MARGIN);
    for spread in [1.0, f64::NAN] {
        let report = stress(&Model::TABLE_I, &design, &DOUBLE, Discretisation::Average800, spread);
        assert!(matches!(report, Err(FlipError::Deviation { field: "thrust", .. })), "{report:?}");
    }
}
