//! The bus loses, doubles, delays and bends datagrams: a loopback never does, a lab network may.

use quantity::Span;
use wire::DropReason;

use crate::common::Flight;

fn still_hovers(flight: &Flight, why: &str) {
    let part = &flight.settings.fleet[0].part;
    let at = flight.position_m(1);
    let off = quantity::Vector::new(part.place_x_m, part.place_y_m, part.place_z_m) - at;
    assert!(off.norm() < 0.15, "{why}: {} m from its place", off.norm());
}

#[test]
fn five_percent_loss_is_not_felt() {
    let mut flight = Flight::hovering("double-flip", 21);
    flight.arena.network_mut().loss_ratio = 0.05;
    flight.run(Span::from_secs(20));
    still_hovers(&flight, "5 % loss");
}

#[test]
fn doubled_datagrams_are_dropped_and_counted() {
    let mut flight = Flight::hovering("double-flip", 22);
    flight.arena.network_mut().duplicate_ratio = 0.5;
    flight.run(Span::from_secs(10));
    still_hovers(&flight, "50 % doubled");
    assert!(flight.dropped(DropReason::Replayed) > 1000);
}

#[test]
fn bent_datagrams_are_dropped_and_counted() {
    let mut flight = Flight::hovering("double-flip", 23);
    flight.arena.network_mut().corruption_ratio = 0.05;
    flight.run(Span::from_secs(10));
    still_hovers(&flight, "5 % bent");
    let refused = flight.dropped(DropReason::Unauthentic) + flight.dropped(DropReason::Malformed);
    assert!(refused > 100, "{refused}");
}

#[test]
fn a_cut_between_estimator_and_controller_ends_in_a_landing_not_in_a_crash() {
    let mut flight = Flight::hovering("double-flip", 24);
    flight.arena.network_mut().partitions.insert(("estimator".to_owned(), "hover-controller".to_owned()));
    flight.run(Span::from_secs(25));
    let truth = flight.arena.plant().truth(1).unwrap();
    assert!(truth.motors_off(), "{truth:?}");
}
