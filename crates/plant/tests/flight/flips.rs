//! Flips, flown by the firmware from uploaded parameters.

use device::vehicle_link::{FlipSet, ManeuverPhase, Reason, Uplink};
use maneuver::{FlipDesign, Model, Parameters};
use plant::{FlipError, ManeuverTruth};
use quantity::{GRAVITY_M_S2, Vector, World, math};
use settings::{Arena, Vehicle};

use crate::ground::{Ground, arena, ideal_arena};
use crate::planar;

pub fn place() -> Vector<World> {
    Vector::new(0.3, -0.2, 5.0)
}

fn set(design: &FlipDesign, p: &Parameters) -> FlipSet {
    FlipSet {
        u1_m_s2: p.u1_m_s2 as f32,
        t1_s: p.t1_s as f32,
        t3_s: p.t3_s as f32,
        u5_m_s2: p.u5_m_s2 as f32,
        t5_s: p.t5_s as f32,
        rate_rad_s_max: design.rate_rad_s_max as f32,
        envelope_low_m_s2: design.envelope.low_m_s2 as f32,
        envelope_high_m_s2: design.envelope.high_m_s2 as f32,
        lever_m: Model::TABLE_I.alpha_l_m() as f32,
        flips: f32::from(design.flips),
    }
}

pub fn double_flip() -> FlipSet {
    set(&planar::design(), &planar::p0())
}

fn literal(mut arena: Arena, change: impl FnOnce(&mut Vehicle)) -> Arena {
    let vehicle = &mut arena.fleet[0].vehicle;
    vehicle.rate_loop.integral = settings::Integral::Literal;
    change(vehicle);
    arena
}

/// Rotors of different speeds turn a vehicle out of the plane, and its yaw loop borrows the sides' thrust.
fn without_yaw(vehicle: &mut Vehicle) {
    vehicle.rotor.drag_torque_m = 1e-9;
    vehicle.rate_loop.yaw_p_1_s = 1e-12;
}

fn flown(arena: &Arena, seed: u64) -> ManeuverTruth {
    let mut ground = Ground::new(arena, seed);
    ground.hover_at(place());
    ground.flip(1, &double_flip())
}

fn norm(error: &FlipError) -> f64 {
    let FlipError { x_m, z_m, vx_m_s, vz_m_s, theta_rad } = *error;
    math::sqrt([x_m, z_m, vx_m_s, vz_m_s, theta_rad].map(|part| part * part).iter().sum())
}

fn difference(one: &FlipError, other: &FlipError) -> f64 {
    norm(&FlipError {
        x_m: one.x_m - other.x_m,
        z_m: one.z_m - other.z_m,
        vx_m_s: one.vx_m_s - other.vx_m_s,
        vz_m_s: one.vz_m_s - other.vz_m_s,
        theta_rad: one.theta_rad - other.theta_rad,
    })
}

#[test]
fn a_vehicle_without_departures_flies_a_double_flip_to_nearly_no_error() {
    let truth = flown(&literal(ideal_arena(), without_yaw), 2);
    assert!(truth.completed);
    // What is left are the steps of the motor commands, the sides' own lag, and the hover it began from.
    assert!(norm(&truth.error) < 0.2, "{:?}", truth.error);
    assert!((truth.turned_rad - 4.0 * core::f64::consts::PI).abs() < 0.02);
    assert!((truth.extremes.height_m_max - truth.start.position_m.z - 0.568).abs() < 0.03);
    let duration = (truth.ended_at - truth.began_at).as_secs_f64();
    let primitive =
        maneuver::Primitive::new(&planar::design(), Model::TABLE_I.alpha_l_m(), &planar::p0()).unwrap();
    assert!((duration - primitive.duration_s()).abs() < 2e-6, "{duration}");
}

#[test]
fn the_same_flip_written_down_in_two_dimensions_ends_in_the_same_place() {
    let truth = flown(&literal(ideal_arena(), without_yaw), 2);
    let up = truth.start.orientation.z_axis();
    let hover = 0.468 * GRAVITY_M_S2 / 4.0;
    let v = truth.start.velocity_m_s;
    let start = [0.0, 0.0, v.x, v.z, math::atan2(up.x, up.z), truth.start.rate_rad_s.y, hover, hover, hover];
    let end = planar::fly(start, &planar::design(), &planar::p0());
    let expected = FlipError {
        x_m: end[0],
        z_m: end[1],
        vx_m_s: end[2],
        vz_m_s: end[3],
        theta_rad: math::wrap_pi(end[4]),
    };
    // The vehicle began within a few thousandths of a hover; those are not in the plane's start.
    assert!(difference(&truth.error, &expected) < 0.006, "{:?} {expected:?}", truth.error);
    assert!((truth.end.rate_rad_s.y - end[5]).abs() < 0.005, "{} {}", truth.end.rate_rad_s.y, end[5]);
}

#[test]
fn departures_move_the_end_by_about_what_plant_md_says() {
    // Each figure of the ablation table is from another simulator: the order of the effects is what must
    // agree.
    let shipped = |change: fn(&mut Vehicle)| flown(&literal(arena(), change), 7).error;
    let base = shipped(|_| ());
    let moved = |change: fn(&mut Vehicle)| difference(&shipped(change), &base);
    let inflow = moved(|vehicle| vehicle.plant.rotor.inflow_loss_s_m = 0.0);
    let lag = moved(|vehicle| {
        vehicle.plant.rotor.gain_up_1_s = 200.0;
        vehicle.plant.rotor.gain_down_1_s = 200.0;
    });
    let inertia = moved(|vehicle| vehicle.plant.body.inertia_ratio *= 1.1);
    let mass = moved(|vehicle| vehicle.plant.body.mass_ratio = 1.02);
    assert!((1.0..5.0).contains(&inflow), "{inflow}");
    assert!((1.0..4.0).contains(&lag), "{lag}");
    assert!((0.3..2.0).contains(&inertia), "{inertia}");
    assert!(mass < 0.4, "{mass}");
    assert!(norm(&base) > 0.5, "{base:?}");
}

#[test]
fn flips_differ_by_chance_and_little() {
    let arena = literal(arena(), |_| ());
    let (one, other) = (flown(&arena, 1).error, flown(&arena, 2).error);
    let off = difference(&one, &other);
    assert!((0.01..0.8).contains(&off), "{off}");
}

#[test]
fn an_aborted_flip_is_told_as_such() {
    let mut ground = Ground::new(&literal(arena(), |_| ()), 3);
    ground.hover_at(Vector::new(0.0, 0.0, 6.0));
    let set = double_flip();
    for _ in 0..3 {
        for message in Uplink::upload(4, &set) {
            ground.send(&message);
            ground.run(0.02);
        }
    }
    ground.run(0.1);
    ground.send(&Uplink::Start { maneuver_id: 9, set_id: 4, digest: set.digest() });
    ground.run(0.4);
    for _ in 0..3 {
        ground.send(&Uplink::Abort { maneuver_id: 9 });
        ground.run(0.02);
    }
    ground.run(2.0);
    let truths = ground.plant.maneuver_truths();
    let [truth] = &truths[..] else { panic!("{truths:?}") };
    assert!(!truth.completed && truth.maneuver_id == 9);
    let duration = (truth.ended_at - truth.began_at).as_secs_f64();
    assert!((0.3..0.5).contains(&duration), "{duration}");
    let status = ground.status();
    assert_eq!((status.maneuver_phase, status.reason), (ManeuverPhase::Aborted, Reason::AbortOrdered));
    assert!(ground.plant.maneuver_truths().is_empty(), "told once");
}

#[test]
fn trajectories_show_the_flip_with_what_comes_before_and_after() {
    let mut ground = Ground::new(&arena(), 4);
    ground.plant.record_trajectories(true);
    ground.hover_at(place());
    let truth = ground.flip(6, &double_flip());
    let trajectories = ground.plant.trajectories();
    let [trajectory] = &trajectories[..] else { panic!("{}", trajectories.len()) };
    assert_eq!((trajectory.vehicle, trajectory.maneuver_id), (1, 6));
    assert!((trajectory.duration_s - (truth.ended_at - truth.began_at).as_secs_f64()).abs() < 1e-9);
    let at = |after_s: f64| {
        let near = |a: &&plant::TrajectorySample, b: &&plant::TrajectorySample| {
            (a.after_s - after_s).abs().total_cmp(&(b.after_s - after_s).abs())
        };
        trajectory.samples.iter().min_by(near).unwrap()
    };
    assert!((at(0.0).position_m - truth.start.position_m).norm() < 0.002);
    let end = at(trajectory.duration_s);
    assert!((end.position_m - truth.end.position_m).norm() < 0.03);
    assert!((end.pitch_rad - truth.turned_rad).abs() < 0.05, "{} {}", end.pitch_rad, truth.turned_rad);
    assert!(at(0.5).pitch_rad > 3.0 && at(-0.1).pitch_rad.abs() < 0.1);
}
