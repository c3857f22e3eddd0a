//! The estimator in a loop with a simulated vehicle.

use core::f64::consts::PI;

use quantity::{Span, Time, Vector};
use schemas::{Kinematics, ManeuverPhase, MocapBody, MocapFrame, Tracking, VehicleState};
use service_core::{Core, Event, Outbox, Seed, Start};

use crate::testing::{Departures, Dice, Flown, Loop, arena, circle, hover, turned};
use crate::{Estimator, Input, Output, Tuning};

/// Greatest and root-mean-square error of a run of predictions.
#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    position_m_max: f64,
    position_m_rms: f64,
    velocity_m_s_max: f64,
    velocity_m_s_rms: f64,
    attitude_rad_rms: f64,
    rate_rad_s_rms: f64,
}

/// How far predictions of states after `from` were off.
fn errors(arena: &Loop, from: Time) -> Errors {
    let mut errors = Errors::default();
    let mut n = 0.0;
    for state in arena.states.iter().filter(|state| state.estimated_for >= from) {
        let Some(truth) = arena.truth_at(state.predicted_for) else {
            continue;
        };
        let p = (state.prediction.position_m - truth.position_m).norm();
        let v = (state.prediction.velocity_m_s - truth.velocity_m_s).norm();
        let a = state.prediction.orientation.angle_to(truth.orientation);
        let w = (state.prediction.rate_rad_s - truth.rate_rad_s).norm();
        errors.position_m_max = errors.position_m_max.max(p);
        errors.velocity_m_s_max = errors.velocity_m_s_max.max(v);
        errors.position_m_rms += p * p;
        errors.velocity_m_s_rms += v * v;
        errors.attitude_rad_rms += a * a;
        errors.rate_rad_s_rms += w * w;
        n += 1.0;
    }
    for sum in [
        &mut errors.position_m_rms,
        &mut errors.velocity_m_s_rms,
        &mut errors.attitude_rad_rms,
        &mut errors.rate_rad_s_rms,
    ] {
        *sum = quantity::math::sqrt(*sum / n);
    }
    errors
}

fn on_the_circle(tuning: Tuning, departures: Departures, delays_ms: (i64, i64)) -> Errors {
    let mut arena = Loop::new(tuning, departures, delays_ms.0, delays_ms.1);
    arena.fly(30.0, circle);
    errors(&arena, arena.now - Span::from_secs(20))
}

#[test]
fn prediction_at_two_metres_per_second() {
    let off = || Tuning { prediction: false, ..Tuning::default() };
    for delays_ms in [(10, 20), (10, 40)] {
        let with = on_the_circle(Tuning::default(), Departures::USUAL, delays_ms);
        let without = on_the_circle(off(), Departures::USUAL, delays_ms);
        assert!(with.position_m_max < 0.005, "{with:?}");
        assert!(with.velocity_m_s_rms < 0.014, "{with:?}");
        assert!(without.position_m_rms > 10.0 * with.position_m_rms, "{without:?}");
        assert!(without.position_m_max > 10.0 * with.position_m_max, "{without:?}");
        // In still air no prediction is ever off by more than 20 mm/s.
        let calm =
            on_the_circle(Tuning::default(), Departures { gust_m_s2: 0.0, ..Departures::USUAL }, delays_ms);
        assert!(calm.velocity_m_s_max < 0.020, "{calm:?}");
    }
}

#[test]
fn hover_is_known_to_the_noise_floor() {
    let mut arena = Loop::new(Tuning::default(), Departures::USUAL, 10, 18);
    arena.fly(20.0, hover);
    let errors = errors(&arena, arena.now - Span::from_secs(15));
    assert!(errors.position_m_rms < 0.001 && errors.attitude_rad_rms < 0.003, "{errors:?}");
    assert_eq!(arena.events, ["reacquired"]);
    let state = arena.states.last().expect("states were published");
    assert!((state.disturbance_m_s2.z + 0.08 * 9.81 / 0.92).abs() < 0.3, "thrust error is a disturbance");
}

#[test]
fn errors_are_as_large_as_the_filter_says() {
    let mut arena = Loop::new(Tuning::default(), Departures::USUAL, 10, 18);
    arena.fly(15.0, circle);
    let mut squares = [0.0; 4];
    let samples = 1500;
    for _ in 0..samples {
        arena.fly(0.02, circle);
        let state = arena.states.last().expect("states are published").estimate;
        let at = arena.states.last().expect("states are published").estimated_for;
        let truth = *arena.truth_at(at).expect("an instant of the past");
        let sigmas = arena.estimator.vehicles[0].1.sigmas().expect("it is tracked");
        let turn = (truth.orientation.inverse() * state.orientation).rotation_vector();
        let rate = state.rate_rad_s - truth.rate_rad_s;
        // Per axis: three of position and velocity, two of attitude and rate (yaw is slower).
        let errors = [
            (state.position_m - truth.position_m).norm() / quantity::math::sqrt(3.0),
            (state.velocity_m_s - truth.velocity_m_s).norm() / quantity::math::sqrt(3.0),
            Vector::<quantity::Body>::new(turn.x, turn.y, 0.0).norm() / quantity::math::sqrt(2.0),
            Vector::<quantity::Body>::new(rate.x, rate.y, 0.0).norm() / quantity::math::sqrt(2.0),
        ];
        for ((square, error), sigma) in squares.iter_mut().zip(errors).zip(sigmas) {
            *square += (error / sigma) * (error / sigma) / f64::from(samples);
        }
    }
    // Mean squares of normalised errors: one for a perfectly honest filter.
    for (what, square) in ["position", "velocity", "attitude", "rate"].iter().zip(squares) {
        println!("{what} {square}");
        assert!((0.4..1.6).contains(&square), "{what}: {square}");
    }
}

/// A jerky pilot: steps of rate and collective.
fn jerky(seconds: f64, truth: &Kinematics) -> Flown {
    let mut flown = hover(seconds, truth);
    let phase = (seconds * 2.5) as i64 % 4;
    flown.rate_rad_s.y += [4.0, -4.0, 0.0, 0.0][phase as usize];
    flown.rate_rad_s.x += [0.0, 2.0, -2.0, 0.0][phase as usize];
    flown.collective_m_s2 += [4.0, 0.0, -3.0, 0.0][phase as usize];
    flown
}

#[test]
fn rate_steps_are_predicted() {
    let mut arena = Loop::new(Tuning::default(), Departures::USUAL, 10, 18);
    arena.fly(12.0, jerky);
    let errors = errors(&arena, arena.now - Span::from_secs(8));
    assert!(errors.attitude_rad_rms < 0.012 && errors.rate_rad_s_rms < 0.25, "{errors:?}");
    assert!(errors.position_m_max < 0.01 && errors.velocity_m_s_rms < 0.03, "{errors:?}");
}

/// Two turns at 1535 deg/s, flown without the command link.
fn flip(arena: &mut Loop, report: bool) -> (Time, Time) {
    arena.obeying = false;
    let began_at = arena.now;
    let step = |arena: &mut Loop, seconds: f64, collective_m_s2: f64, rate: f64| {
        arena.flown = Flown { collective_m_s2, rate_rad_s: Vector::new(0.0, rate, 0.0) };
        arena.fly(seconds, hover);
    };
    step(arena, 0.02, 20.0, 0.0);
    if report {
        arena.report(ManeuverPhase::Running, began_at, Time::ZERO);
    }
    step(arena, 0.14, 20.0, 0.0);
    step(arena, 0.469, 10.0, 28.0);
    step(arena, 0.1, 10.0, 0.0);
    step(arena, 0.2, 20.0, 0.0);
    arena.obeying = true;
    (began_at, arena.now)
}

#[test]
fn a_reported_flip_is_followed_and_left() {
    let mut arena = Loop::new(Tuning::default(), Departures::USUAL, 10, 18);
    arena.fly(6.0, hover);
    let (began_at, ended_at) = flip(&mut arena, true);
    arena.fly(0.02, hover);
    arena.report(ManeuverPhase::Completed, began_at, ended_at);
    arena.fly(1.0, hover);
    assert_eq!(arena.events, ["reacquired"], "no pose of the flip was refused");
    let flip: Vec<&VehicleState> =
        arena.states.iter().filter(|state| state.tracking == Tracking::Ballistic).collect();
    assert!(flip.len() > 150);
    let mut worst = (0.0f64, 0.0f64, 0.0f64);
    for state in flip {
        let truth = arena.truth_at(state.estimated_for).expect("an instant of the past");
        worst.0 = worst.0.max((state.estimate.position_m - truth.position_m).norm());
        worst.1 = worst.1.max((state.estimate.velocity_m_s - truth.velocity_m_s).norm());
        worst.2 = worst.2.max(state.estimate.orientation.angle_to(truth.orientation));
    }
    assert!(worst.0 < 0.005 && worst.1 < 0.5 && worst.2 < 0.06, "{worst:?}");
    let first = errors(&arena, ended_at + Span::from_millis(30));
    let later = errors(&arena, ended_at + Span::from_millis(300));
    assert!(first.position_m_max < 0.02 && first.attitude_rad_rms < 0.06, "{first:?}");
    assert!(later.position_m_max < 0.01 && later.attitude_rad_rms < 0.012, "{later:?}");
}

#[test]
fn an_unreported_flip_does_not_lose_the_vehicle() {
    let mut arena = Loop::new(Tuning::default(), Departures::USUAL, 10, 18);
    arena.fly(6.0, hover);
    flip(&mut arena, false);
    arena.fly(1.5, hover);
    let state = arena.states.last().expect("states were published");
    assert_eq!(state.tracking, Tracking::Tracking);
    let truth = arena.truth_at(state.estimated_for).expect("an instant of the past");
    assert!((state.estimate.position_m - truth.position_m).norm() < 0.01);
    assert!(!arena.events.iter().any(|name| name == "filter-unsound"));
}

/// Hovers, hides the vehicle from `from_s` for `for_s`, and returns the loop 1.5 s later.
fn occluded(
    for_s: f64,
    mut change: impl FnMut(MocapBody) -> Option<MocapBody> + 'static,
) -> (Loop, Time, Time) {
    let mut arena = Loop::new(Tuning::default(), Departures { dropout: 0.0, ..Departures::USUAL }, 10, 18);
    arena.fly(4.0, hover);
    let from = arena.now;
    let to = from + Span::from_secs_f64(for_s);
    arena.see = Box::new(move |at, body| if at >= from && at < to { change(body) } else { Some(body) });
    arena.states.clear();
    arena.fly(for_s + 1.5, hover);
    (arena, from, to)
}

#[test]
fn states_coast_then_end() {
    let (arena, from, _) = occluded(0.3, |_| None);
    // The last pose was exposed 5 ms before `from`, and arrived 10 ms later.
    let last_arrival = from + Span::from_millis(5);
    let first = |tracking| arena.states.iter().position(|state| state.tracking == tracking);
    let coasting = &arena.states[first(Tracking::Coasting).expect("it coasts")];
    assert!((coasting.estimated_for - (last_arrival + Span::from_millis(25))).abs() <= Span::from_millis(5));
    let invalid = first(Tracking::Invalid).expect("it becomes invalid");
    let before = &arena.states[invalid - 1];
    assert_eq!(before.valid_until, last_arrival + Span::from_millis(100));
    assert!(before.estimated_for > last_arrival + Span::from_millis(94));
    // Never silent for more than the period, and 5 mm lost while blind.
    let truth = arena.truth_at(before.estimated_for).expect("an instant of the past");
    assert!((before.estimate.position_m - truth.position_m).norm() < 0.005);
    for pair in arena.states[..invalid].windows(2) {
        assert!(pair[1].estimated_for - pair[0].estimated_for <= Span::from_micros(17_500), "{pair:?}");
    }
    assert_eq!(arena.events, ["reacquired", "tracking-lost"], "seen again within the gate");
    let after: Vec<u16> = arena.states[invalid..]
        .iter()
        .skip_while(|s| s.tracking == Tracking::Invalid)
        .map(|s| s.accepted_frames)
        .collect();
    assert_eq!(after[..3], [1, 2, 3], "frames are counted from the loss");
}

#[test]
fn a_long_loss_ends_with_a_new_start() {
    let (arena, _, to) = occluded(2.0, |_| None);
    assert_eq!(arena.events, ["reacquired", "tracking-lost", "reacquired"]);
    let back = arena
        .states
        .iter()
        .find(|state| state.tracking == Tracking::Tracking && state.estimated_for >= to)
        .expect("it is tracked again");
    assert_eq!(back.accepted_frames, 10);
    assert_eq!(back.estimated_for, to + Span::from_millis(45));
    let invalid = arena.states.iter().filter(|state| state.tracking == Tracking::Invalid).count();
    assert!((18..=22).contains(&invalid), "ten times a second, not {invalid} in 2 s");
}

#[test]
fn faults_of_the_cameras_are_dropouts() {
    let frozen = {
        let mut first = None;
        move |body: MocapBody| Some(first.get_or_insert(body).clone())
    };
    let faults: Vec<Box<dyn FnMut(MocapBody) -> Option<MocapBody>>> = vec![
        Box::new(|body| Some(MocapBody { position_m: Vector::ZERO, ..body })),
        Box::new(|body| Some(MocapBody { position_m: body.position_m * 0.001, ..body })),
        Box::new(|body| Some(MocapBody { position_m: Vector::new(f64::NAN, 0.0, 4.0), ..body })),
        Box::new(|mut body| {
            body.orientation.w = f64::NAN;
            Some(body)
        }),
        Box::new(|body| Some(turned(body, Vector::new(PI, 0.0, 0.0)))),
        Box::new(|body| Some(turned(body, Vector::new(0.0, 0.0, 2.0 * PI / 3.0)))),
        Box::new(|body| Some(turned(body, Vector::new(0.0, PI / 2.0, 0.0)))),
        Box::new(frozen),
    ];
    for (index, fault) in faults.into_iter().enumerate() {
        let (arena, from, to) = occluded(0.4, fault);
        let invalid = arena.states.iter().position(|state| state.tracking == Tracking::Invalid);
        assert!(invalid.is_some(), "fault {index}");
        for state in &arena.states {
            if state.tracking == Tracking::Invalid {
                continue;
            }
            let truth = arena.truth_at(state.estimated_for).expect("an instant of the past");
            let off_m = (state.estimate.position_m - truth.position_m).norm();
            let off_rad = state.estimate.orientation.angle_to(truth.orientation);
            assert!(off_m < 0.01 && off_rad < 0.05, "fault {index}: {off_m} m, {off_rad} rad");
        }
        let coasts =
            arena.states.iter().find(|state| state.tracking == Tracking::Coasting).expect("it coasts");
        assert!(coasts.estimated_for - from < Span::from_millis(50), "fault {index} is seen within 50 ms");
        let last = arena.states.last().expect("states were published");
        assert!(last.tracking == Tracking::Tracking && last.estimated_for > to, "fault {index} passes");
    }
}

/// A reported maneuver of 0.7 s, of whose end the cameras miss `blind_ms`, and all that follows.
fn blind_at_the_end_of_a_flip(blind_ms: i64) -> (Loop, Time) {
    let mut arena = Loop::new(Tuning::default(), Departures { dropout: 0.0, ..Departures::USUAL }, 10, 18);
    arena.fly(4.0, hover);
    let began_at = arena.now;
    let ended_at = began_at + Span::from_millis(700);
    arena.report(ManeuverPhase::Running, began_at, Time::ZERO);
    arena.see = Box::new(move |at, body| (at < ended_at - Span::from_millis(blind_ms)).then_some(body));
    arena.states.clear();
    arena.fly(0.7, hover);
    assert!(arena.states.iter().all(|state| state.tracking == Tracking::Ballistic));
    arena.report(ManeuverPhase::Completed, began_at, ended_at);
    arena.states.clear();
    arena.fly(0.5, hover);
    (arena, ended_at)
}

#[test]
fn the_end_of_a_flip_is_coasted_through() {
    let (arena, ended_at) = blind_at_the_end_of_a_flip(50);
    let lost = arena.states.iter().find(|state| state.tracking == Tracking::Invalid).expect("it is lost");
    assert_eq!(lost.valid_until, ended_at + Span::from_millis(200));
}

#[test]
fn a_flip_nobody_saw_the_end_of_leaves_no_state() {
    let (arena, _) = blind_at_the_end_of_a_flip(300);
    assert!(arena.states.iter().all(|state| state.tracking == Tracking::Invalid));
}

#[test]
fn frames_twice_late_or_disordered_change_nothing() {
    let body = |k: i64| MocapBody {
        vehicle: 1,
        position_m: Vector::new(0.001 * k as f64, 0.0, 3.0 + 0.0001 * (k % 7) as f64),
        ..MocapBody::default()
    };
    let frame = |k: i64| MocapFrame {
        frame: k as u64,
        exposed_at: Time::from_nanos(1_000_000_000 + 5_000_000 * k),
        received_at: Time::from_nanos(1_010_000_000 + 5_000_000 * k),
        latency_s: 0.01,
        bodies: vec![body(k)].try_into().expect("one body fits"),
    };
    let run = |order: &[i64]| -> Vec<VehicleState> {
        let start = Start { at: Time::from_nanos(1_000_000_000), seed: Seed(1), incarnation: 1 };
        let mut estimator = Estimator::new(&arena(1), Tuning::default(), start).expect("sound");
        let mut newest = 0;
        let mut states = Vec::new();
        for &k in order {
            newest = newest.max(k);
            let mut out = Outbox::default();
            let now = frame(newest).exposed_at + Span::from_millis(10);
            estimator.step(now, Event::Input(Input::Mocap(frame(k))), &mut out);
            states.extend(out.take_messages().map(|Output::State(state)| state));
        }
        states
    };
    let in_order: Vec<i64> = (0..60).collect();
    let mixed: Vec<i64> = (0..60).flat_map(|k| [k, k, (k - 3).max(0)]).collect();
    let plain = run(&in_order);
    assert!(plain.len() > 45);
    assert_eq!(plain, run(&mixed));
}

#[test]
fn swapped_markers_mislead_nobody() {
    let arena = arena(2);
    let start = Start { at: Time::from_nanos(1_000_000_000), seed: Seed(1), incarnation: 1 };
    for (separation, for_frames) in [(0.3, 1), (0.3, 200), (1.0, 30), (3.0, 400)] {
        let mut estimator = Estimator::new(&arena, Tuning::default(), start).expect("sound");
        let mut dice = Dice::new(3);
        let place = |id: u8| Vector::new(0.0, if id == 1 { 0.0 } else { separation }, 4.0);
        let mut tracked = 0;
        for k in 0..700i64 {
            let swapped = (100..100 + for_frames).contains(&k);
            let exposed_at = Time::from_nanos(1_000_000_000 + 5_000_000 * k);
            let bodies: Vec<MocapBody> = [1u8, 2]
                .iter()
                .map(|&id| MocapBody {
                    vehicle: id,
                    position_m: place(if swapped { 3 - id } else { id }) + dice.vector(0.0005),
                    ..MocapBody::default()
                })
                .collect();
            let bodies = bodies.try_into().expect("two bodies fit");
            let frame = MocapFrame {
                exposed_at,
                received_at: exposed_at + Span::from_millis(10),
                latency_s: 0.01,
                bodies,
                ..MocapFrame::default()
            };
            let now = exposed_at + Span::from_millis(10);
            let mut out = Outbox::default();
            estimator.step(now, Event::Input(Input::Mocap(frame)), &mut out);
            for Output::State(state) in out.take_messages() {
                let near = (state.estimate.position_m - place(state.vehicle)).norm() < 0.05;
                assert!(near || state.tracking == Tracking::Invalid, "frame {k}, {separation} m: {state:?}");
                if k == 699 {
                    tracked += 1;
                    assert_eq!(
                        state.tracking,
                        Tracking::Tracking,
                        "{separation} m, vehicle {}",
                        state.vehicle
                    );
                }
            }
        }
        assert_eq!(tracked, 2, "{separation} m");
    }
}

#[test]
fn wrongly_stamped_frames_are_not_fused() {
    let mut arena = Loop::new(Tuning::default(), Departures { dropout: 0.0, ..Departures::USUAL }, 10, 18);
    arena.fly(4.0, circle);
    // As of a bridge that lost the rhythm of the frame numbers, for fewer frames than make a habit.
    for off_ms in [-9, 9, 45] {
        arena.stamp_error = Span::from_millis(off_ms);
        arena.states.clear();
        arena.fly(0.04, circle);
        arena.stamp_error = Span::ZERO;
        arena.fly(0.5, circle);
        for state in &arena.states {
            let truth = arena.truth_at(state.estimated_for).expect("an instant of the past");
            let off = (state.estimate.position_m - truth.position_m).norm();
            assert!(off < 0.005, "{off_ms} ms: {off} m");
        }
    }
    arena.events.dedup();
    assert_eq!(arena.events, ["reacquired", "frame-mistimed"]);
}

#[test]
fn a_parked_vehicle_is_tracked_and_winds_nothing_up() {
    let start = Start { at: Time::from_nanos(1_000_000_000), seed: Seed(1), incarnation: 1 };
    let mut estimator = Estimator::new(&arena(1), Tuning::default(), start).expect("sound");
    let mut last = None;
    for k in 0..2000i64 {
        let exposed_at = Time::from_nanos(1_000_000_000 + 5_000_000 * k);
        // Bit for bit the same, as of an ideal camera.
        let body = MocapBody { vehicle: 1, position_m: Vector::new(0.5, 0.2, 0.04), ..MocapBody::default() };
        let frame = MocapFrame {
            exposed_at,
            received_at: exposed_at + Span::from_millis(10),
            latency_s: 0.01,
            bodies: vec![body].try_into().expect("one body fits"),
            ..MocapFrame::default()
        };
        let mut out = Outbox::default();
        estimator.step(exposed_at + Span::from_millis(10), Event::Input(Input::Mocap(frame)), &mut out);
        if let Some(Output::State(state)) = out.messages().last() {
            last = Some(*state);
        }
    }
    let state = last.expect("a state");
    assert_eq!((state.tracking, state.accepted_frames > 1900), (Tracking::Tracking, true));
    assert!(state.disturbance_m_s2.norm() < 1e-3 && state.prediction.velocity_m_s.norm() < 1e-3, "{state:?}");
}

#[test]
fn nothing_is_said_of_vehicles_never_seen_but_that() {
    let start = Start { at: Time::from_nanos(1_000_000_000), seed: Seed(1), incarnation: 1 };
    let mut estimator = Estimator::new(&arena(1), Tuning::default(), start).expect("sound");
    let mut states = 0;
    for _ in 0..20 {
        let now = estimator.deadline().expect("it wants to speak");
        let mut out = Outbox::default();
        estimator.step(now, Event::Deadline, &mut out);
        assert!(estimator.deadline().expect("again") > now);
        for Output::State(state) in out.take_messages() {
            assert_eq!((state.tracking, state.valid_until), (Tracking::Invalid, Time::ZERO));
            states += 1;
        }
    }
    assert_eq!(states, 20);
}

#[test]
fn foolish_settings_are_refused() {
    let mut tuning = Tuning::default();
    tuning.noise.position_m = f64::NAN;
    let start = Start { at: Time::ZERO, seed: Seed(1), incarnation: 1 };
    let error = Estimator::new(&arena(1), tuning, start).expect_err("not a number");
    assert!(error.to_string().contains("noise.position_m"), "{error}");
}
