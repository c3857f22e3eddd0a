//! The gate, threshold by threshold.

use proptest::prelude::*;
use quantity::{Rotation, Span, Time, Vector};
use schemas::{FlightMode, FlipPhase, Kinematics, ManeuverPhase, Tracking, VehicleState, VehicleTelemetry};
use settings::Hall;

use super::rig::{Rig, arena};
use crate::gate::{Situation, Unmet};
use crate::tuning::GateTuning;

const HALL: Hall = Hall { width_m: 10.0, depth_m: 10.0, height_m: 10.0, margin_m: 0.5 };
const NOW: Time = Time::from_nanos(1_000_000_000_000);

/// A situation in which everything holds, and what can be changed about it.
#[derive(Clone, Copy)]
struct Case {
    state: VehicleState,
    telemetry: VehicleTelemetry,
    place_m: Vector<quantity::World>,
    heading_rad: f64,
    nearest_m: f64,
    rest_v: Option<f64>,
    height_loss_m: Option<f64>,
}

impl Case {
    fn good() -> Self {
        Self::at(Vector::new(0.0, 0.0, 5.0))
    }

    fn at(place_m: Vector<quantity::World>) -> Self {
        Self {
            state: VehicleState {
                tracking: Tracking::Tracking,
                estimated_for: NOW - Span::from_millis(12),
                estimate: Kinematics { position_m: place_m, ..Kinematics::default() },
                valid_until: NOW + Span::from_millis(88),
                ..VehicleState::default()
            },
            telemetry: VehicleTelemetry {
                mode: FlightMode::Flying,
                received_at: NOW - Span::from_millis(30),
                ..VehicleTelemetry::default()
            },
            place_m,
            heading_rad: 0.0,
            nearest_m: f64::INFINITY,
            rest_v: Some(11.0),
            height_loss_m: Some(2.0),
        }
    }

    fn unmet(&self) -> u16 {
        let situation = Situation {
            now: NOW,
            state: Some(&self.state),
            telemetry: Some(&self.telemetry),
            place_m: self.place_m,
            heading_rad: self.heading_rad,
            hall: &HALL,
            nearest_m: self.nearest_m,
            rest_v: self.rest_v,
            flip_v_min: 10.2,
            height_loss_m: self.height_loss_m,
        };
        GateTuning::default().unmet(&situation).0
    }
}

type Change = fn(&mut Case);

#[test]
fn each_threshold_holds_on_one_side_only() {
    assert_eq!(Case::good().unmet(), 0);
    let table: [(u16, Change, Change); 16] = [
        (
            Unmet::PLACE,
            |c| c.state.estimate.position_m.y = 0.0999,
            |c| c.state.estimate.position_m.y = 0.1001,
        ),
        (
            Unmet::SPEED,
            |c| c.state.estimate.velocity_m_s.z = 0.1999,
            |c| c.state.estimate.velocity_m_s.z = 0.2,
        ),
        (Unmet::TILT, |c| tilt(c, 4.99), |c| tilt(c, 5.01)),
        (Unmet::TILT, |c| c.state.estimate.rate_rad_s.y = -0.49, |c| c.state.estimate.rate_rad_s.y = -0.5),
        (Unmet::AGE, |c| age(c, 24_999), |c| age(c, 25_000)),
        (Unmet::AGE, |c| c.state.valid_until = NOW, |c| c.state.valid_until = NOW - Span::from_nanos(1)),
        (Unmet::AGE, |_| (), |c| c.state.tracking = Tracking::Coasting),
        (Unmet::BATTERY, |c| c.rest_v = Some(10.21), |c| c.rest_v = Some(10.2)),
        (Unmet::BATTERY, |_| (), |c| c.rest_v = None),
        (Unmet::CLEARANCE, |c| c.nearest_m = 3.0, |c| c.nearest_m = 2.999),
        (Unmet::TELEMETRY, |c| report(c, 499), |c| report(c, 500)),
        (Unmet::TELEMETRY, |_| (), |c| c.telemetry.mode = FlightMode::LevelHold),
        (
            Unmet::TELEMETRY,
            |c| c.telemetry.maneuver_phase = ManeuverPhase::Completed,
            |c| c.telemetry.maneuver_phase = ManeuverPhase::Running,
        ),
        (Unmet::LOSS, |c| c.height_loss_m = Some(3.5), |c| c.height_loss_m = Some(3.501)),
        (Unmet::LOSS, |_| (), |c| c.height_loss_m = None),
        (
            Unmet::HEIGHT,
            |c| *c = Case::at(Vector::new(0.0, 0.0, 4.0)),
            |c| *c = Case::at(Vector::new(0.0, 0.0, 3.99)),
        ),
    ];
    for (row, (bit, inside, outside)) in table.into_iter().enumerate() {
        let mut case = Case::good();
        inside(&mut case);
        assert_eq!(case.unmet(), 0, "row {row}");
        let mut case = Case::good();
        outside(&mut case);
        assert_eq!(case.unmet(), bit, "row {row}");
    }
}

fn tilt(case: &mut Case, degrees: f64) {
    case.state.estimate.orientation = Rotation::from_yaw_pitch_roll(1.0, 0.0, f64::to_radians(degrees));
}

fn age(case: &mut Case, micros: i64) {
    case.state.estimated_for = NOW - Span::from_micros(micros);
}

fn report(case: &mut Case, millis: i64) {
    case.telemetry.received_at = NOW - Span::from_millis(millis);
}

#[test]
fn clearance_is_measured_in_the_plane_of_the_flip() {
    // Two metres from a wall: too near along the flip's plane, far enough across it.
    for (x, y, heading_rad, open) in [
        (2.0, 0.0, 0.0, true),
        (2.01, 0.0, 0.0, false),
        (-2.01, 0.0, 0.0, false),
        (3.5, 0.0, core::f64::consts::FRAC_PI_2, true),
        (3.51, 0.0, core::f64::consts::FRAC_PI_2, false),
        (0.0, 3.5, 0.0, true),
        (0.0, -3.51, 0.0, false),
        (0.0, 3.1, core::f64::consts::PI, true),
        (2.5, 2.5, core::f64::consts::FRAC_PI_4, true),
        (2.9, 2.9, core::f64::consts::FRAC_PI_4, false),
    ] {
        let case = Case { heading_rad, ..Case::at(Vector::new(x, y, 5.0)) };
        let expected = if open { 0 } else { Unmet::CLEARANCE };
        assert_eq!(case.unmet(), expected, "{x} {y} {heading_rad}");
    }
    assert_eq!(Case::at(Vector::new(0.0, 0.0, 8.01)).unmet(), Unmet::CLEARANCE, "too near to the net above");
}

#[test]
fn another_vehicle_within_three_metres_closes_the_gate() {
    let other = |rig: &Rig, y_m: f64| VehicleState {
        vehicle: 2,
        estimate: Kinematics { position_m: Vector::new(0.0, y_m, 1.0), ..Kinematics::default() },
        ..rig.state()
    };
    for (y_m, starts) in [(0.05, true), (-0.15, false)] {
        let mut rig = Rig::with(arena("fleet"), 1);
        // Vehicle 1 flips at y = -3.1.
        rig.hear(other(&rig, y_m));
        rig.run(5.0);
        assert_eq!(!rig.starts.is_empty(), starts, "{y_m}");
    }
}

#[test]
fn another_vehicle_that_flies_unseen_closes_the_gate() {
    let mut rig = Rig::with(arena("fleet"), 1);
    rig.hear(VehicleTelemetry {
        vehicle: 2,
        mode: FlightMode::Flying,
        received_at: rig.now,
        battery_v: 12.0,
        ..VehicleTelemetry::default()
    });
    rig.run(5.0);
    assert!(rig.starts.is_empty());
    assert_eq!(rig.phase(), FlipPhase::Gate);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// However the vehicle hovers, each start was sent inside the gate, half a second after it was last
    /// outside.
    #[test]
    fn no_start_outside_the_gate(
        hover in proptest::collection::vec((-0.12..0.12f64, -0.12..0.12f64, -0.22..0.22f64, 1..150u32), 30),
        battery_v in 9.2..12.0f64,
        loss_m in 0.0..5.0f64,
    ) {
        let mut rig = Rig::new();
        rig.telemetry.battery_v = battery_v;
        rig.parameters.height_loss_m = loss_m;
        let mut outside_at = rig.now;
        for (x, z, speed, frames) in hover {
            for _ in 0..frames {
                let before = rig.starts.len();
                rig.kinematics.position_m = Vector::new(x, 0.0, 5.0 + z);
                rig.kinematics.velocity_m_s = Vector::new(0.0, speed, 0.0);
                let inside = x * x + z * z <= 0.01 && speed.abs() < 0.2;
                rig.frame();
                if !inside {
                    outside_at = rig.now;
                }
                if rig.starts.len() > before {
                    prop_assert!(rig.now - outside_at >= Span::from_millis(500));
                    prop_assert!(5.0 + z - loss_m >= 1.5);
                    prop_assert!(battery_v + 0.3 > 9.72);
                }
            }
        }
    }
}
