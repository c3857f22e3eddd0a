//! Out of any attitude, and flips in any direction.

use front_door::experiment::learn;
use plant::Motion;
use quantity::{Span, Vector, math};

use crate::common::{Flight, arena};

/// A blow that turns the vehicle faster than its rate loop can stop at once: it tumbles, up to upside down, and its
/// own gyros and the cameras see it happen. (Turned without a motion, it would rightly be taken for a pose flip.)
#[test]
fn a_vehicle_struck_into_a_tumble_comes_back_to_its_place() {
    let blows_rad_s = [
        Vector::new(30.0, 0.0, 0.0),
        Vector::new(0.0, 30.0, 0.0),
        Vector::new(0.0, -30.0, 0.0),
        Vector::new(15.0, 15.0, 5.0),
        Vector::new(-20.0, 20.0, -5.0),
        Vector::new(-8.0, -12.0, 3.0),
    ];
    for (seed, rate_rad_s) in blows_rad_s.into_iter().enumerate() {
        let mut flight = Flight::hovering("double-flip", 40 + seed as u64);
        let motion = flight.arena.plant().truth(1).unwrap().motion;
        let velocity_m_s = Vector::new(1.0, -1.0, -1.0);
        flight.arena.plant_mut().place(1, Motion { velocity_m_s, rate_rad_s, ..motion });
        let (mut least_height_m, mut most_tilt_rad) = (f64::INFINITY, 0.0_f64);
        for _ in 0..1600 {
            flight.run(Span::from_millis(5));
            let now = flight.arena.plant().truth(1).unwrap().motion;
            least_height_m = least_height_m.min(now.position_m.z);
            most_tilt_rad = most_tilt_rad.max(now.orientation.tilt_rad());
        }
        let part = &flight.settings.fleet[0].part;
        let off = flight.position_m(1) - Vector::new(part.place_x_m, part.place_y_m, part.place_z_m);
        println!(
            "struck to {rate_rad_s:?}: tilted {most_tilt_rad:.2} rad, fell to {least_height_m:.2} m, {:.3} m off after 8 s",
            off.norm()
        );
        assert!(most_tilt_rad > 0.5, "{rate_rad_s:?}: the blow was none: {most_tilt_rad} rad");
        // Upside down there is no thrust to hold height with: what counts is that the floor is never near.
        assert!(least_height_m > 0.5, "{rate_rad_s:?}: fell to {least_height_m} m");
        assert!(off.norm() < 0.1, "{rate_rad_s:?}: {} m off after 8 s", off.norm());
    }
}

#[test]
fn a_flip_lies_in_the_vertical_plane_of_any_heading() {
    for heading_rad in [0.7, -2.2, 1.6] {
        let mut settings = arena("double-flip");
        settings.fleet[0].part.heading_rad = heading_rad;
        settings.scenario.flip.as_mut().unwrap().iterations = 25;
        let flown = learn(&settings, 5, &mut ()).unwrap();
        let norms: Vec<f64> =
            flown.report.vehicles[0].iterations.iter().map(|flip| flip.true_error.norm()).collect();
        assert_eq!(norms.len(), 25, "{heading_rad}: {:?}", flown.report.vehicles[0].stopped);
        assert!(norms[24] < 0.35 * norms[0], "{heading_rad}: {norms:?}");
        // The first flip ends at some 2.5 m/s along the heading and is caught within two metres, in that plane.
        let (sin, cos) = math::sin_cos(heading_rad);
        let extremes = flown.extremes;
        let along = math::sqrt(extremes.x_m_max * extremes.x_m_max + extremes.y_m_max * extremes.y_m_max);
        println!(
            "heading {heading_rad}: reached {:.2} m in x, {:.2} m in y",
            extremes.x_m_max, extremes.y_m_max
        );
        assert!(along < 3.0, "{heading_rad}: {extremes:?}");
        assert!(
            extremes.x_m_max < 0.75 + 2.5 * cos.abs() && extremes.y_m_max < 0.75 + 2.5 * sin.abs(),
            "{extremes:?}"
        );
    }
}
