//! A minute of hovering, held against the truth.

use quantity::{Span, Vector, math};

use crate::common::Flight;

#[test]
fn a_minute_of_hover_stays_within_1_5_cm_rms_and_5_cm_peak() {
    for seed in [1, 2, 3] {
        let mut flight = Flight::hovering("double-flip", seed);
        let part = flight.settings.fleet[0].part.clone();
        let place = Vector::new(part.place_x_m, part.place_y_m, part.place_z_m);
        let (mut sum, mut peak, mut count) = (0.0, 0.0_f64, 0_u32);
        for _ in 0..12_000 {
            flight.run(Span::from_millis(5));
            let error = (flight.position_m(1) - place).norm();
            sum += error * error;
            peak = peak.max(error);
            count += 1;
        }
        let rms = math::sqrt(sum / f64::from(count));
        println!("seed {seed}: hover RMS {:.2} cm, peak {:.2} cm", rms * 100.0, peak * 100.0);
        assert!(rms <= 0.015, "seed {seed}: RMS {rms} m");
        assert!(peak <= 0.05, "seed {seed}: peak {peak} m");
    }
}

#[test]
fn a_fleet_hovers_without_coming_near_each_other() {
    let mut flight = Flight::hovering("fleet", 4);
    for _ in 0..200 {
        flight.run(Span::from_millis(50));
        for (one, other) in [(1, 2), (1, 3), (2, 3)] {
            let distance = (flight.position_m(one) - flight.position_m(other)).norm();
            assert!(distance > 2.5, "vehicles {one} and {other} at {distance} m");
        }
    }
}
