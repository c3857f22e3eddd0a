//! The controller in a loop with a simulated vehicle.

use proptest::prelude::*;
use quantity::{Body, Rotation, Span, Vector, World, math};
use schemas::{
    CommandMode, FlightMode, GoalKind, ManeuverPhase, Tracking, VehicleCommand, VehicleGoal, VehicleState,
    VehicleTelemetry,
};
use service_core::{Core, Event, Outbox, Seed, Start};

use crate::testing::{Loop, START, arena as settings};
use crate::{HoverController, Input, Output, Tuning};

const PLACE: Vector<World> = Vector::new(0.0, 0.0, 4.0);

fn modes(arena: &Loop) -> Vec<CommandMode> {
    let mut modes: Vec<CommandMode> = arena.commands.iter().map(|(_, command)| command.mode).collect();
    modes.dedup();
    modes
}

#[test]
fn a_flight_from_floor_to_floor() {
    let mut arena = Loop::new(Vector::new(0.3, -0.2, 0.04));
    arena.run(1.0);
    assert_eq!(modes(&arena), [CommandMode::Disarmed]);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(10.0);
    let from = arena.track.len();
    arena.run(60.0);
    let errors = arena.track[from..].iter().map(|(_, k)| (k.position_m - PLACE).norm());
    let (mut square, mut peak) = (0.0, 0.0f64);
    for error in errors {
        square += error * error;
        peak = peak.max(error);
    }
    let rms = math::sqrt(square / (arena.track.len() - from) as f64);
    assert!(rms < 0.015 && peak < 0.05, "rms {rms} m, peak {peak} m");
    arena.order(GoalKind::Land, Vector::new(1.0, 0.5, 0.0));
    arena.run(10.0);
    assert_eq!(arena.events, ["take-off", "landing", "landed"]);
    assert_eq!(modes(&arena), [CommandMode::Disarmed, CommandMode::Fly, CommandMode::Disarmed]);
    assert!((arena.position() - Vector::new(1.0, 0.5, 0.04)).norm() < 0.1, "{:?}", arena.position());
    assert!(arena.craft.touchdown_m_s < 0.6, "touched down at {} m/s", arena.craft.touchdown_m_s);
    assert!(!arena.craft.armed);
}

/// How a recovery went.
#[derive(Clone, Copy, Debug)]
struct Recovery {
    lowest_m: f64,
    farthest_m: f64,
    settled_s: f64,
}

fn recover(
    place: Vector<World>,
    turn: Vector<Body>,
    velocity: Vector<World>,
    rate: Vector<Body>,
) -> Recovery {
    let mut arena = Loop::hovering(place);
    arena.craft.truth.orientation = Rotation::from_rotation_vector(turn);
    arena.craft.truth.velocity_m_s = velocity;
    arena.craft.truth.rate_rad_s = rate;
    arena.order(GoalKind::Hover, PLACE);
    arena.run(8.0);
    let mut recovery = Recovery { lowest_m: f64::MAX, farthest_m: 0.0, settled_s: 0.0 };
    for (at, k) in &arena.track {
        recovery.lowest_m = recovery.lowest_m.min(k.position_m.z);
        recovery.farthest_m = recovery.farthest_m.max(k.position_m.x.abs()).max(k.position_m.y.abs());
        if (k.position_m - PLACE).norm() > 0.05 || k.velocity_m_s.norm() > 0.1 {
            recovery.settled_s = (*at - START).as_secs_f64();
        }
    }
    recovery
}

#[test]
fn good_flips_are_caught_within_two_seconds_and_bad_ones_inside_the_hall() {
    let pitch = |angle: f64| Vector::new(0.0, angle, 0.0);
    let good = recover(PLACE, pitch(0.15), Vector::new(-0.4, 0.05, -0.3), pitch(2.0));
    assert!(good.settled_s < 2.0, "{good:?}");
    for tilt in [-1.0, -0.7, 0.7, 1.0] {
        for rate in [-10.0, 0.0, 10.0] {
            // A triple's first end: two metres below its start, 4 m/s sideways, 2 m/s down.
            let low = Vector::new(0.0, 0.0, 2.0 + 1.5);
            let bad = recover(low, pitch(tilt), Vector::new(-4.0, 0.0, -2.0), pitch(rate));
            assert!(
                bad.lowest_m > 1.5 && bad.farthest_m < 4.5 && bad.settled_s < 6.0,
                "{tilt} {rate}: {bad:?}"
            );
        }
    }
}

#[test]
fn any_attitude_is_recovered() {
    let axes = [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::new(0.6, -0.8, 0.0)];
    for axis in axes {
        for angle in [0.8, 1.6, 2.4, 3.1, core::f64::consts::PI] {
            for rate in [-8.0, 0.0, 8.0] {
                let recovery = recover(PLACE, axis * angle, Vector::ZERO, axis * rate);
                assert!(
                    recovery.lowest_m > 1.0 && recovery.farthest_m < 4.0 && recovery.settled_s < 6.0,
                    "{angle} about {axis:?} at {rate} rad/s: {recovery:?}"
                );
            }
        }
    }
}

#[test]
fn a_moving_goal_is_followed() {
    let mut arena = Loop::hovering(Vector::new(1.5, 0.0, 4.0));
    let omega = 2.0 / 1.5;
    let mut worst = 0.0f64;
    for k in 0..150 {
        let (sin, cos) = math::sin_cos(omega * 0.1 * f64::from(k));
        arena.goal = Some(VehicleGoal {
            vehicle: 1,
            kind: GoalKind::Hover,
            position_m: Vector::new(1.5 * cos, 1.5 * sin, 4.0),
            velocity_m_s: Vector::new(-2.0 * sin, 2.0 * cos, 0.0),
            acceleration_m_s2: Vector::new(cos, sin, 0.0) * (-1.5 * omega * omega),
            heading_rad: 0.0,
        });
        if k > 40 {
            worst = worst.max((arena.position() - arena.goal.expect("just set").position_m).norm());
        }
        arena.run(0.1);
    }
    assert!(worst < 0.15, "{worst} m behind");
}

#[test]
fn states_that_stop_are_answered_by_level_then_descent() {
    let mut arena = Loop::hovering(PLACE);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(1.0);
    arena.commands.clear();
    arena.states = false;
    let last_state = arena.now - Span::from_millis(5);
    arena.run(0.5);
    let since = |index: usize| arena.commands[index].0 - last_state;
    let descend =
        arena.commands.iter().position(|(_, c)| c.mode == CommandMode::Descend).expect("it descends");
    assert!((since(0) - Span::from_millis(60)).abs() <= Span::from_millis(1), "{}", since(0));
    assert!((since(descend) - Span::from_millis(300)).abs() <= Span::from_millis(10), "{}", since(descend));
    for (_, level) in &arena.commands[..descend] {
        assert_eq!(level.mode, CommandMode::Fly);
        assert!((level.collective_m_s2 - 9.81 / 0.92).abs() < 1.0, "thrust is held: {level:?}");
        assert_eq!(level.rate_rad_s.z, 0.0);
    }
    for pair in arena.commands.windows(2) {
        assert!(pair[1].0 - pair[0].0 <= Span::from_millis(20), "no radio slot goes without a command");
    }
    assert!(arena.craft.truth.orientation.tilt_rad() < 0.15);
    assert_eq!(arena.events, ["levelling", "descending"]);
    // Nine frames are too few, ten are enough.
    arena.accepted_frames = 9;
    arena.states = true;
    arena.run(0.1);
    assert_eq!(arena.commands.last().expect("commands flow").1.mode, CommandMode::Descend);
    arena.accepted_frames = 10;
    arena.run(0.1);
    assert_eq!(arena.commands.last().expect("commands flow").1.mode, CommandMode::Fly);
    arena.run(6.0);
    assert!((arena.position() - PLACE).norm() < 0.05, "{:?}", arena.position());
}

#[test]
fn a_state_called_invalid_is_not_flown() {
    let mut arena = Loop::hovering(PLACE);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(1.0);
    let mut state = arena.state();
    state.tracking = Tracking::Invalid;
    state.prediction.position_m = Vector::new(3.0, 3.0, 9.0);
    arena.states = false;
    arena.hear(state);
    let (at, command) = *arena.commands.last().expect("it is answered");
    assert_eq!((at, command.mode), (arena.now, CommandMode::Fly));
    assert!(command.rate_rad_s.norm() < 1.0 && (command.collective_m_s2 - 10.66).abs() < 1.0, "{command:?}");
    assert_eq!(arena.events, ["levelling"]);
}

#[test]
fn commands_expire_with_the_state_or_after_60_ms() {
    let mut arena = Loop::hovering(PLACE);
    let mut state = arena.state();
    arena.hear(state);
    assert_eq!(arena.commands[0].1.valid_until, arena.now + Span::from_millis(60));
    state.valid_until = arena.now + Span::from_millis(30);
    arena.hear(state);
    assert_eq!(arena.commands[1].1.valid_until, state.valid_until);
    assert_eq!(arena.commands[1].1.lease_epoch, 7, "the incarnation is the lease's epoch");
}

#[test]
fn an_unseen_vehicle_is_told_nothing() {
    let mut arena = Loop::hovering(PLACE);
    arena.states = false;
    arena.order(GoalKind::Hover, PLACE);
    arena.run(1.0);
    assert!(arena.commands.is_empty());
    arena.accepted_frames = 3;
    arena.states = true;
    arena.run(0.1);
    assert!(arena.commands.is_empty(), "three frames are no history");
}

#[test]
fn a_restart_in_the_air_holds_then_lands() {
    let mut arena = Loop::hovering(Vector::new(1.0, 1.0, 3.0));
    arena.run(1.9);
    assert!((arena.position() - Vector::new(1.0, 1.0, 3.0)).norm() < 0.06, "{:?}", arena.position());
    arena.run(8.0);
    assert_eq!(arena.events, ["landing", "landed"]);
    assert!(!arena.craft.armed);
}

#[test]
fn goals_that_stop_bring_it_down() {
    let mut arena = Loop::hovering(PLACE);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(1.0);
    arena.goal = None;
    arena.run(2.8);
    assert!(arena.events.is_empty());
    arena.run(9.0);
    assert_eq!(arena.events, ["landing", "landed"]);
}

#[test]
fn a_low_battery_lands_and_stays_down() {
    let mut arena = Loop::hovering(PLACE);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(2.0);
    let limits = settings().fleet[0].vehicle.battery.clone();
    arena.battery_v = limits.land_v_min - limits.hover_sag_v - 0.2;
    arena.run(15.0);
    assert_eq!(arena.events, ["battery-low", "landing", "landed"]);
    assert_eq!(arena.commands.last().expect("commands flow").1.mode, CommandMode::Disarmed);
}

#[test]
fn motors_that_do_not_start_are_not_insisted_on() {
    let mut arena = Loop::new(Vector::new(0.0, 0.0, 0.04));
    arena.craft.thrust_ratio = 0.3;
    arena.order(GoalKind::Hover, PLACE);
    arena.run(2.5);
    assert_eq!(arena.events, ["take-off", "take-off-failed"]);
    assert_eq!(arena.commands.last().expect("commands flow").1.mode, CommandMode::Disarmed);
}

#[test]
fn a_latched_vehicle_is_left_alone() {
    let mut arena = Loop::new(Vector::new(0.0, 0.0, 0.04));
    arena.telemetry = false;
    arena.order(GoalKind::Hover, PLACE);
    for _ in 0..20 {
        arena.hear(VehicleTelemetry { vehicle: 1, mode: FlightMode::Stopped, ..VehicleTelemetry::default() });
        arena.run(0.1);
    }
    assert_eq!(modes(&arena), [CommandMode::Disarmed]);
}

#[test]
fn commands_go_on_through_a_maneuver() {
    let mut arena = Loop::hovering(PLACE);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(1.0);
    arena.maneuver = ManeuverPhase::Running;
    arena.goal = None;
    let from = arena.commands.len();
    arena.run(3.5);
    assert!(arena.commands[from..].iter().all(|(_, command)| command.mode == CommandMode::Fly));
    assert!(arena.commands[from..].windows(2).all(|pair| pair[1].0 - pair[0].0 <= Span::from_millis(20)));
    assert!(arena.events.is_empty(), "no landing is begun in a maneuver: {:?}", arena.events);
    arena.maneuver = ManeuverPhase::Completed;
    arena.run(0.2);
    assert_eq!(arena.events, ["landing"]);
}

#[test]
fn foolish_settings_are_refused() {
    let mut tuning = Tuning::default();
    tuning.safety.state_s_max = f64::NAN;
    let start = Start { at: START, seed: Seed(1), incarnation: 7 };
    let error = HoverController::new(&settings(), tuning, start).expect_err("not a number");
    assert!(error.to_string().contains("safety.state_s_max"), "{error}");
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -20.0..20.0f64, 1 => prop::num::f64::ANY]
}

fn vector<F: quantity::Frame>() -> impl Strategy<Value = Vector<F>> {
    (number(), number(), number()).prop_map(|(x, y, z)| Vector::new(x, y, z))
}

proptest! {
    #[test]
    fn whatever_comes_commands_are_finite_and_bounded(
        positions in prop::collection::vec(vector::<World>(), 1..12),
        velocity in vector::<World>(), turn in prop::array::uniform3(-3.1..3.1f64), rate in vector::<Body>(),
        disturbance in vector::<World>(), goal in vector::<World>(), goal_velocity in vector::<World>(),
        kind in 0u8..3, tracking in 0u8..4, valid_ms in -50i64..200, battery_v in number(),
    ) {
        let start = Start { at: START, seed: Seed(1), incarnation: 7 };
        let mut controller = HoverController::new(&settings(), Tuning::default(), start).expect("sound");
        let mut out = Outbox::default();
        let kind = [GoalKind::Ground, GoalKind::Hover, GoalKind::Land][usize::from(kind)];
        let tracking = [Tracking::Invalid, Tracking::Tracking, Tracking::Coasting, Tracking::Ballistic]
            [usize::from(tracking)];
        let goal = VehicleGoal {
            vehicle: 1, kind, position_m: goal, velocity_m_s: goal_velocity, ..VehicleGoal::default()
        };
        controller.step(START, Event::Input(Input::Goal(goal)), &mut out);
        let report = VehicleTelemetry { vehicle: 1, battery_v, ..VehicleTelemetry::default() };
        controller.step(START, Event::Input(Input::Telemetry(report)), &mut out);
        let mut now = START;
        for position_m in positions {
            now += Span::from_millis(47);
            let mut state = VehicleState {
                vehicle: 1, tracking, accepted_frames: 20, estimated_for: now, predicted_for: now,
                disturbance_m_s2: disturbance, valid_until: now + Span::from_millis(valid_ms),
                ..VehicleState::default()
            };
            state.prediction.position_m = position_m;
            state.prediction.velocity_m_s = velocity;
            let turn = Vector::new(turn[0], turn[1], turn[2]);
            state.prediction.orientation = Rotation::from_rotation_vector(turn);
            state.prediction.rate_rad_s = rate;
            controller.step(now, Event::Input(Input::State(state)), &mut out);
            while let Some(at) = controller.deadline().filter(|at| *at <= now) {
                controller.step(now, Event::Deadline, &mut out);
                prop_assert!(controller.deadline().is_none_or(|next| next > at));
            }
        }
        for Output::Command(command) in out.messages() {
            check(command)?;
        }
    }
}

fn check(command: &VehicleCommand) -> Result<(), TestCaseError> {
    prop_assert!((0.0..=20.0).contains(&command.collective_m_s2), "{command:?}");
    prop_assert!(command.rate_rad_s.is_finite() && command.rate_rad_s.horizontal().norm() <= 10.0 + 1e-9);
    prop_assert!(command.rate_rad_s.z.abs() <= 3.0 && command.orientation.is_finite());
    prop_assert!(command.height_m.is_finite() && command.vertical_speed_m_s.is_finite());
    Ok(())
}
