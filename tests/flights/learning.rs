//! The experiments of the paper, on the 3D plant, through the real bytes, the estimator and the links.
//!
//! These are the short versions: a few seeds each. `arena learn SCENARIO --seeds 20` reports the distributions.

use front_door::campaign::Summary;
use front_door::experiment::{Flown, learn};
use front_door::report::{FlipReport, Outcome};
use quantity::math;

use crate::common::arena;

fn fly(scenario: &str, seed: u64, iterations: Option<u32>) -> Flown {
    let mut settings = arena(scenario);
    if let Some(iterations) = iterations {
        settings.scenario.flip.as_mut().unwrap().iterations = iterations;
    }
    learn(&settings, seed, &mut ()).unwrap()
}

fn flips(flown: &Flown) -> &[FlipReport] {
    &flown.report.vehicles[0].iterations
}

fn assert_inside(flown: &Flown, hall: &settings::Hall) {
    let extremes = &flown.extremes;
    assert!(extremes.z_m_min > 0.3, "a flip came down to {} m", extremes.z_m_min);
    assert!(extremes.z_m_max < hall.height_m, "a flip rose to {} m", extremes.z_m_max);
    assert!(extremes.x_m_max < 0.5 * hall.width_m, "a flip reached x = {} m", extremes.x_m_max);
    assert!(extremes.y_m_max < 0.5 * hall.depth_m, "a flip reached y = {} m", extremes.y_m_max);
}

#[test]
fn a_double_flip_settles_within_50_flips_and_worsens_as_the_battery_fades() {
    let flown = fly("double-flip", 1, None);
    let summary = Summary::of(&flown);
    println!("{summary:?}");
    assert_eq!(flips(&flown).len(), 129);
    assert!(summary.settled_at.is_some_and(|flip| flip <= 50), "{summary:?}");
    assert!(summary.last_norm > summary.steady_norm, "{summary:?}");
    assert_inside(&flown, &arena("double-flip").hall);
}

#[test]
fn a_triple_flip_starts_near_minus_4_and_minus_2_m_s_and_gets_better() {
    let flown = fly("triple-flip", 1, Some(60));
    let first = flips(&flown)[0].true_error;
    println!("first triple: {first:?}");
    assert!((first.vx_m_s + 4.0).abs() < 1.0, "{first:?}");
    assert!((first.vz_m_s + 2.0).abs() < 1.0, "{first:?}");
    assert!(first.norm() > 4.0 * Summary::of(&flown).floor_norm);
    assert_inside(&flown, &arena("triple-flip").hall);
}

#[test]
fn a_vehicle_that_turns_slower_ends_with_a_double() {
    let flown = fly("rate-mismatch", 1, None);
    let summary = Summary::of(&flown);
    println!("{summary:?}");
    assert!(summary.floor_norm < 0.5, "{summary:?}");
    assert!((flown.turns.last().copied().unwrap_or(0.0) - 2.0).abs() < 0.1, "{:?}", flown.turns.last());
    assert_inside(&flown, &arena("rate-mismatch").hall);
}

#[test]
fn every_vehicle_of_a_fleet_learns() {
    let flown = fly("fleet", 1, Some(20));
    assert_eq!(flown.report.vehicles.len(), 3);
    for vehicle in &flown.report.vehicles {
        let norms: Vec<f64> = vehicle.iterations.iter().map(|flip| flip.true_error.norm()).collect();
        assert_eq!(norms.len(), 20, "vehicle {}: {:?}", vehicle.id, vehicle.stopped);
        assert!(norms[19] < 0.5 * norms[0], "vehicle {}: {norms:?}", vehicle.id);
    }
}

#[test]
fn measured_ends_lie_within_2_cm_5_cm_s_and_2_deg_of_the_truth() {
    let (mut place, mut speed, mut angle) = (Vec::new(), Vec::new(), Vec::new());
    for (scenario, count) in [("double-flip", 40), ("triple-flip", 20)] {
        let flown = fly(scenario, 2, Some(count));
        for flip in flips(&flown).iter().filter(|flip| flip.outcome == Outcome::Completed) {
            let (m, t) = (flip.error, flip.true_error);
            place.push(math::sqrt((m.x_m - t.x_m) * (m.x_m - t.x_m) + (m.z_m - t.z_m) * (m.z_m - t.z_m)));
            let (dvx, dvz) = (m.vx_m_s - t.vx_m_s, m.vz_m_s - t.vz_m_s);
            speed.push(math::sqrt(dvx * dvx + dvz * dvz));
            angle.push(math::wrap_pi(m.theta_rad - t.theta_rad).abs());
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (place_m, speed_m_s, angle_rad) = (median(&mut place), median(&mut speed), median(&mut angle));
    println!("medians: {place_m:.4} m, {speed_m_s:.4} m/s, {:.2} deg", angle_rad.to_degrees());
    assert!(place_m <= 0.02 && speed_m_s <= 0.05 && angle_rad.to_degrees() <= 2.0);
}

#[test]
fn the_same_seed_says_the_same_bytes_and_another_seed_others() {
    let digest = |seed| fly("double-flip", seed, Some(2)).report.digest;
    assert_eq!(digest(1), digest(1));
    assert_ne!(digest(1), digest(2));
}
