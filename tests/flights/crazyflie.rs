//! A Crazyflie, told by CRTP: it takes off, hovers at its place and lands.

use quantity::{Span, Time, Vector, math};
use schemas::{FlightMode, ManeuverParameters, VehicleTelemetry, topics};

use front_door::experiment::message;
use front_door::experiment::{node, services};

use crate::common::{Flight, LANDS_AFTER, arena};

const ID: u8 = 5;

fn place(flight: &Flight) -> Vector<quantity::World> {
    let part = &flight.settings.fleet[0].part;
    Vector::new(part.place_x_m, part.place_y_m, part.place_z_m)
}

#[test]
fn a_crazyflie_takes_off_hovers_within_2_cm_rms_and_lands() {
    for seed in [1, 2, 3] {
        let mut flight = Flight::to_hover_and_land(arena("crazyflie-hover"), seed);
        let place = place(&flight);
        flight.run(Span::from_secs(10));
        let (mut sum, mut peak, mut count) = (0.0, 0.0_f64, 0_u32);
        while flight.arena.now() < Time::ZERO + LANDS_AFTER {
            flight.run(Span::from_millis(5));
            let error = (flight.position_m(ID) - place).norm();
            sum += error * error;
            peak = peak.max(error);
            count += 1;
        }
        let rms = math::sqrt(sum / f64::from(count));
        println!("seed {seed}: a Crazyflie's hover RMS {:.2} cm, peak {:.2} cm", rms * 100.0, peak * 100.0);
        assert!(rms <= 0.02, "seed {seed}: RMS {rms} m");
        assert!(peak <= 0.06, "seed {seed}: peak {peak} m");
        flight.arena.kill("arena");
        flight.arena.restart("arena").unwrap();
        flight.run(Span::from_secs(10));
        let truth = flight.arena.plant().truth(ID).unwrap();
        assert!(truth.motors_off() && truth.motion.position_m.z < 0.02, "seed {seed}: {truth:?}");
        assert!(!flight.arena.plant().extremes(ID).unwrap().crashed);
        assert_eq!(flight.arena.plant().unused_packets(ID), Some(0), "the vehicle knows every packet");
    }
}

#[test]
fn ordered_to_fly_it_hovers_and_reports_mode_and_battery() {
    let mut flight = Flight::to_learn(arena("crazyflie-hover"), 4);
    let (mut modes, mut voltages, mut parameters) = (Vec::new(), Vec::new(), 0);
    let end = flight.arena.now() + Span::from_secs(12);
    flight.arena.run_until(end, &mut |heard| {
        if let Some(report) = message::<VehicleTelemetry>(&heard, &topics::VEHICLE_TELEMETRY) {
            modes.push(report.mode);
            voltages.push(report.battery_v);
        }
        parameters +=
            u32::from(message::<ManeuverParameters>(&heard, &topics::MANEUVER_PARAMETERS).is_some());
    });
    assert!((flight.position_m(ID) - place(&flight)).norm() < 0.06, "{:?}", flight.position_m(ID));
    assert_eq!((modes.first(), modes.last()), (Some(&FlightMode::Disarmed), Some(&FlightMode::Flying)));
    assert!(voltages.iter().all(|volts| (3.5..4.3).contains(volts)), "{voltages:?}");
    assert!(voltages.len() > 180, "{} reports", voltages.len());
    assert_eq!(parameters, 0, "there is nothing to learn");
}

#[test]
fn beside_a_vehicle_that_learns_it_hovers_and_neither_disturbs_the_other() {
    let mut settings = arena("single-flip");
    settings.scenario.flip.as_mut().unwrap().iterations = 2;
    let mut crazyflie = arena("crazyflie-hover").fleet.remove(0);
    (crazyflie.part.place_y_m, crazyflie.part.start_y_m) = (-4.0, -4.0);
    settings.scenario.vehicles.push(crazyflie.part.clone());
    settings.fleet.push(crazyflie);
    let mut flight = Flight::to_learn(settings, 1);
    let mut flips = 0;
    for _ in 0..60 {
        flight.run(Span::from_secs(1));
        flips += flight.arena.take_maneuvers().len();
    }
    assert_eq!(flips, 2);
    let at = flight.position_m(ID) - Vector::new(0.5, -4.0, 1.2);
    assert!(at.norm() < 0.06, "{at:?}");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let fly = || {
        let settings = arena("crazyflie-hover");
        let mut flying = virtual_arena::VirtualArena::new(&settings, 9, &services(), &node).unwrap();
        flying.run_for(Span::from_secs(5), &mut |_| {});
        flying.digest()
    };
    assert_eq!(fly(), fly());
}
