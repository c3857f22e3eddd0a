//! Whole vehicles in the simulated arena, spoken to by device bytes alone.

mod ground;
mod planar;

use device::vehicle_link::{FlightMode, FlipSet, ManeuverPhase};
use device::vicon::{Datagram, euler_to_rotation};
use ground::{Goal, Ground, arena, ideal_arena, rms};
use maneuver::{FlipDesign, Model, Parameters};
use plant::Fault;
use quantity::{GRAVITY_M_S2, Span, Time, Vector, math};

fn place() -> Vector<quantity::World> {
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

fn double_flip() -> FlipSet {
    set(&planar::design(), &planar::p0())
}

#[test]
fn it_takes_off_hovers_and_lands() {
    let mut ground = Ground::new(&arena(), 1);
    ground.run(0.5);
    assert_eq!(ground.status().mode, FlightMode::Disarmed);
    assert!(ground.plant.truth(1).unwrap().motors_off());
    ground.goal = Goal::Hover(Vector::new(0.0, 0.0, 1.5));
    ground.run(8.0);
    let motion = ground.motion();
    assert!((motion.position_m - Vector::new(0.0, 0.0, 1.5)).norm() < 0.15, "{motion:?}");
    assert_eq!(ground.status().mode, FlightMode::Flying);
    ground.goal = Goal::Descend;
    ground.run(5.0);
    let truth = ground.plant.truth(1).unwrap();
    let touchdown = truth.touchdown.expect("it touched down");
    assert!(truth.motors_off(), "{:?}", ground.status());
    assert!(touchdown.vertical_m_s < 1.5 && !touchdown.crashed, "{touchdown:?}");
    let battery = ground.status().battery_mv;
    assert!((12_000..12_600).contains(&battery), "{battery}");
}

#[test]
fn a_double_flip_agrees_with_the_plane_on_a_vehicle_without_departures() {
    let mut arena = ideal_arena();
    let vehicle = &mut arena.fleet[0].vehicle;
    vehicle.rate_loop.integral = settings::Integral::Literal;
    // Rotors of different speeds would turn it out of the plane, and the yaw loop would borrow the sides' thrust.
    vehicle.rotor.drag_torque_m = 1e-9;
    vehicle.rate_loop.yaw_p_1_s = 1e-12;
    let mut ground = Ground::new(&arena, 2);
    ground.hover_at(place());
    let truth = ground.flip(1, &double_flip());
    println!("{truth:#?}");
    let pitch = math::atan2(truth.start.orientation.z_axis().x, truth.start.orientation.z_axis().z);
    let v = truth.start.velocity_m_s;
    let hover = 0.468 * GRAVITY_M_S2 / 4.0;
    let start = [0.0, 0.0, v.x, v.z, pitch, truth.start.rate_rad_s.y, hover, hover, hover];
    let end = planar::fly(start, &planar::design(), &planar::p0());
    println!("{end:?}");
    println!("{:?}", planar::fly([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, hover, hover, hover], &planar::design(), &planar::p0()));
    panic!();
}

#[test]
fn bytes_are_the_same_for_the_same_seed_and_others_for_another() {
    let digest = |seed| {
        let mut ground = Ground::new(&arena(), seed);
        ground.hover_at(place());
        ground.flip(1, &double_flip());
        (ground.digest, ground.vicon.len())
    };
    let (first, again, other) = (digest(3), digest(3), digest(4));
    assert_eq!(first, again);
    assert_ne!(first.0, other.0);
}
