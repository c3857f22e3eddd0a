//! The course of the work, and each way it can be left.

use quantity::{Span, Time, Vector};
use schemas::{
    ArenaOrder, FlightMode, FlipOutcome, FlipPhase, GoalKind, LearnerVerdict, LoggerStatus, ManeuverPhase,
    ManeuverResult, OrderKind,
};
use service_core::{Core, Seed, Start};

use super::rig::{FLIP_S, Faults, Rig, arena};
use crate::{FlipManager, Output, Tuning};

fn results(rig: &Rig) -> Vec<(Time, ManeuverResult)> {
    rig.all(|output| match output {
        Output::Result(result) => Some(*result),
        _ => None,
    })
}

fn goals(rig: &Rig) -> Vec<(Time, GoalKind)> {
    rig.all(|output| match output {
        Output::Goal(goal) if goal.vehicle == 1 => Some(goal.kind),
        _ => None,
    })
}

fn order(rig: &mut Rig, kind: OrderKind) {
    rig.order = ArenaOrder { kind, given_at: rig.now };
    rig.hear(rig.order);
}

#[test]
fn flips_follow_each_other_in_the_order_of_the_phases() {
    let mut rig = Rig::new();
    rig.run(8.0);
    use FlipPhase::{Approach, Flip, Idle, Measure, Recover, Start, Upload};
    let round = [Approach, Upload, Start, Flip, Measure, Recover];
    let expected: Vec<_> = [Idle].into_iter().chain(round).chain(round).chain([Approach]).collect();
    assert_eq!(rig.phases()[..expected.len()], expected);
    let results = results(&rig);
    assert!(results.len() >= 2);
    for (index, (_, result)) in results.iter().enumerate() {
        assert_eq!((result.iteration, result.outcome), (index as u32, FlipOutcome::Completed));
        let error = result.error;
        let size = [error.x_m, error.z_m, error.vx_m_s, error.vz_m_s, error.theta_rad];
        assert!(size.iter().all(|part| part.abs() < 1e-9), "it hung still: {error:?}");
        assert!((result.battery_v - 12.3).abs() < 0.3);
        assert!((result.parameters.t3_s - (0.28 + 0.001 * index as f64)).abs() < 1e-6);
    }
    assert!(rig.starts.windows(2).all(|pair| pair[1].1.maneuver_id >= pair[0].1.maneuver_id));
    assert!(rig.events.is_empty(), "{:?}", rig.events);
}

#[test]
fn goals_are_repeated_at_ten_hertz() {
    let mut rig = Rig::new();
    rig.run(20.0);
    let goals = goals(&rig);
    assert!(goals.windows(2).all(|pair| pair[1].0 - pair[0].0 <= Span::from_millis(105)));
    assert!(goals.len() < 20 * 10 + 2 * rig.phases().len());
}

#[test]
fn nothing_rises_without_an_order_or_without_a_learner() {
    let mut rig = Rig::new();
    rig.faults.nobody_orders = true;
    rig.run(5.0);
    assert_eq!(rig.phases(), [FlipPhase::Idle]);
    assert!(goals(&rig).iter().all(|(_, kind)| *kind == GoalKind::Ground));
}

#[test]
fn an_order_to_hover_is_not_an_order_to_flip() {
    let mut rig = Rig::new();
    order(&mut rig, OrderKind::Hover);
    rig.run(90.0);
    assert_eq!(rig.phases(), [FlipPhase::Idle, FlipPhase::Approach]);
    assert!(rig.starts.is_empty());
    order(&mut rig, OrderKind::Fly);
    rig.run_until(FlipPhase::Flip, 5.0);
}

#[test]
fn landing_is_granted_in_every_phase() {
    use FlipPhase::{Approach, Flip, Gate, Idle, Measure, Recover, Start, Upload};
    for phase in [Approach, Gate, Upload, Start, Flip, Measure, Recover] {
        let mut rig = Rig::new();
        if phase == Gate {
            rig.parameters.height_loss_m = 4.0;
        }
        rig.faults.deaf_to_starts = phase == Start;
        rig.run_until(phase, 10.0);
        order(&mut rig, OrderKind::Land);
        let ordered_at = rig.now;
        rig.run_until(Idle, 5.0);
        let begun_before = matches!(phase, Flip | Measure | Recover);
        assert_eq!(results(&rig).len(), usize::from(begun_before), "{phase:?}: a flip ends first");
        assert!(rig.starts.iter().all(|(at, _)| *at <= ordered_at), "{phase:?}");
        rig.run(5.0);
        assert_eq!(rig.phase(), Idle, "{phase:?}");
        rig.faults = Faults::default();
        rig.parameters.height_loss_m = 1.0;
        order(&mut rig, OrderKind::Fly);
        rig.run_until(Flip, 5.0);
    }
}

#[test]
fn a_front_door_that_is_gone_lands_the_vehicle_until_a_new_order() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.faults.nobody_orders = true;
    rig.run_until(FlipPhase::Done, 15.0);
    assert!(rig.events.contains(&"order-missing".to_owned()));
    rig.faults.nobody_orders = false;
    rig.run(5.0);
    assert_eq!(rig.phase(), FlipPhase::Done, "the old order does not make it rise");
    order(&mut rig, OrderKind::Fly);
    rig.run_until(FlipPhase::Flip, 5.0);
}

#[test]
fn an_upload_without_echo_is_repeated_and_then_given_up() {
    let mut rig = Rig::new();
    rig.faults.deaf_to_uploads = true;
    rig.run_until(FlipPhase::Done, 30.0);
    let uploads = rig.all(|output| match output {
        Output::Upload(upload) => Some(*upload),
        _ => None,
    });
    assert_eq!(uploads.len(), 10);
    assert!(uploads.windows(2).all(|pair| pair[0].1 == pair[1].1), "the same set under the same identity");
    assert!(rig.starts.is_empty());
    assert!(rig.events.contains(&"upload-failed".to_owned()));
}

#[test]
fn a_vehicle_that_reports_another_set_is_not_started() {
    let mut rig = Rig::new();
    rig.faults.wrong_set = true;
    rig.run(20.0);
    assert!(rig.starts.is_empty());
}

#[test]
fn a_start_without_answer_is_repeated_for_half_a_second_under_one_identity() {
    let mut rig = Rig::new();
    rig.faults.deaf_to_starts = true;
    rig.run_until(FlipPhase::Start, 5.0);
    rig.run_until(FlipPhase::Approach, 2.0);
    let starts = rig.starts.clone();
    assert!((9..=11).contains(&starts.len()), "{}", starts.len());
    for (at, start) in &starts {
        assert_eq!(start.maneuver_id, starts[0].1.maneuver_id);
        assert_eq!(start.valid_until - *at, Span::from_millis(150));
        assert!(*at - starts[0].0 < Span::from_millis(500));
    }
    assert!(results(&rig).is_empty(), "nothing was flown");
    rig.faults.deaf_to_starts = false;
    rig.run_until(FlipPhase::Flip, 2.0);
    let second = rig.starts.last().unwrap().1;
    assert_eq!(second.maneuver_id, starts[0].1.maneuver_id + 1);
    assert_eq!(second.set_id, starts[0].1.set_id, "the vehicle had the set already");
}

#[test]
fn a_gate_that_closes_ends_the_repetition_of_the_start() {
    let mut rig = Rig::new();
    rig.faults.deaf_to_starts = true;
    rig.run_until(FlipPhase::Start, 5.0);
    rig.kinematics.velocity_m_s = Vector::new(0.25, 0.0, 0.0);
    let before = rig.starts.len();
    rig.run(1.0);
    assert_eq!(rig.starts.len(), before);
    assert_eq!(rig.phase(), FlipPhase::Approach);
}

#[test]
fn a_refusal_is_told_as_an_aborted_flip() {
    let mut rig = Rig::new();
    rig.faults.refuses = true;
    rig.run_until(FlipPhase::Recover, 5.0);
    let (_, result) = results(&rig)[0];
    assert_eq!((result.outcome, result.iteration), (FlipOutcome::Aborted, 0));
    assert!(rig.events.contains(&"flip-refused".to_owned()));
}

#[test]
fn a_flip_without_end_is_unmeasured_one_second_after_its_plan() {
    let mut rig = Rig::new();
    rig.faults.endless = true;
    rig.run_until(FlipPhase::Flip, 5.0);
    let began_at = rig.now;
    rig.run_until(FlipPhase::Recover, 5.0);
    let (at, result) = results(&rig)[0];
    assert_eq!(result.outcome, FlipOutcome::Unmeasured);
    let late_s = (at - began_at).as_secs_f64() - FLIP_S - 1.0;
    assert!((-0.05..0.05).contains(&late_s), "{late_s}");
}

#[test]
fn a_vehicle_mute_through_its_flip_is_measured_once_it_speaks() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.faults.mute = true;
    rig.run(1.5);
    rig.faults.mute = false;
    rig.run_until(FlipPhase::Recover, 1.0);
    assert_eq!(results(&rig)[0].1.outcome, FlipOutcome::Completed);
}

#[test]
fn an_end_the_cameras_missed_is_unmeasured() {
    let mut rig = Rig::new();
    rig.faults.endless = true;
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.run(0.9);
    rig.faults = Faults { dark: true, ..Faults::default() };
    rig.run_until(FlipPhase::Recover, 2.0);
    assert_eq!(results(&rig)[0].1.outcome, FlipOutcome::Unmeasured);
    assert!(rig.events.contains(&"flip-unmeasured".to_owned()));
}

#[test]
fn a_flip_that_sinks_is_ended_and_told_as_aborted() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.kinematics.position_m = Vector::new(0.0, 0.0, 0.9);
    rig.kinematics.velocity_m_s = Vector::new(0.0, 0.0, -1.0);
    rig.run_until(FlipPhase::Measure, 1.0);
    rig.run(1.0);
    let aborts = rig.all(|output| matches!(output, Output::Abort(_)).then_some(()));
    assert!(!aborts.is_empty());
    assert_eq!(results(&rig)[0].1.outcome, FlipOutcome::Aborted);
    assert!(rig.events.contains(&"flip-aborted".to_owned()));
}

#[test]
fn a_result_is_repeated_until_the_learner_answers() {
    let mut rig = Rig::new();
    rig.faults.learner_silent = true;
    rig.run_until(FlipPhase::Recover, 5.0);
    rig.run(5.0);
    assert!((5..=6).contains(&results(&rig).len()), "{}", results(&rig).len());
    assert_eq!(
        rig.starts.iter().map(|(_, start)| start.maneuver_id).max(),
        Some(rig.starts[0].1.maneuver_id)
    );
    assert_eq!(rig.phase(), FlipPhase::Gate, "old parameters are not flown again");
    rig.parameters.iteration = 1;
    rig.run(1.0);
    let told = |rig: &Rig| results(rig).iter().filter(|(_, result)| result.iteration == 0).count();
    let told_before = told(&rig);
    rig.run(3.0);
    assert_eq!(told(&rig), told_before);
}

#[test]
fn the_learners_verdict_lands_the_vehicle() {
    for (verdict, event) in
        [(LearnerVerdict::Finished, "learning-finished"), (LearnerVerdict::Stopped, "learning-stopped")]
    {
        let mut rig = Rig::new();
        rig.run_until(FlipPhase::Flip, 5.0);
        rig.parameters.verdict = verdict;
        rig.run_until(FlipPhase::Done, 10.0);
        assert!(rig.events.contains(&event.to_owned()), "{:?}", rig.events);
        assert_eq!(results(&rig).len(), 1);
        order(&mut rig, OrderKind::Fly);
        rig.run(5.0);
        assert_eq!(rig.phase(), FlipPhase::Done, "nothing left to fly: it does not rise");
    }
}

#[test]
fn a_low_battery_ends_the_work_on_the_ground_and_in_the_air() {
    let mut rig = Rig::new();
    rig.telemetry.battery_v = 9.62;
    rig.run(3.0);
    assert_eq!((rig.phase(), rig.starts.len()), (FlipPhase::Done, 0));
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.telemetry.battery_v = 9.32;
    rig.run_until(FlipPhase::Done, 20.0);
    assert!(rig.events.contains(&"battery-low".to_owned()));
    assert!(results(&rig).iter().all(|(_, result)| result.battery_v > 9.72));
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.telemetry.battery_v = 9.47;
    rig.run(6.0);
    assert!(results(&rig).len() > 1, "9.77 V at rest: the sag of the hover is not the battery's");
}

#[test]
fn a_gate_that_never_opens_lands_the_vehicle() {
    let mut rig = Rig::new();
    rig.parameters.height_loss_m = 4.0;
    rig.run_until(FlipPhase::Done, 70.0);
    assert!(rig.phases().contains(&FlipPhase::Gate));
    assert!(rig.events.contains(&"gate-unmet".to_owned()));
    assert!(rig.starts.is_empty());
}

#[test]
fn a_silent_vehicle_lands_and_so_does_one_that_is_never_caught() {
    let mut rig = Rig::new();
    order(&mut rig, OrderKind::Hover);
    rig.run(1.0);
    rig.faults.mute = true;
    rig.run(11.0);
    assert_eq!(rig.phase(), FlipPhase::Landing);
    assert!(rig.events.contains(&"telemetry-lost".to_owned()));
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Recover, 5.0);
    rig.kinematics.velocity_m_s = Vector::new(0.0, 1.0, 0.0);
    rig.run(59.0);
    assert_eq!(rig.phase(), FlipPhase::Recover);
    rig.run_until(FlipPhase::Done, 2.0);
}

#[test]
fn a_vehicle_that_stopped_by_itself_is_done() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Recover, 5.0);
    rig.telemetry.mode = FlightMode::Stopped;
    rig.run(0.1);
    assert_eq!(rig.phase(), FlipPhase::Done);
    assert!(rig.events.contains(&"vehicle-down".to_owned()));
}

#[test]
fn a_restart_below_a_flying_vehicle_neither_drops_it_nor_repeats_identities() {
    let mut before = Rig::new();
    before.run_until(FlipPhase::Recover, 5.0);
    let mut rig = Rig::with(arena("double-flip"), 4);
    rig.telemetry = before.telemetry;
    rig.kinematics = before.kinematics;
    rig.faults.nobody_orders = true;
    rig.run(1.0);
    assert!(goals(&rig).is_empty(), "it says nothing before it knows the order");
    rig.faults.nobody_orders = false;
    rig.run_until(FlipPhase::Flip, 5.0);
    assert!(goals(&rig).iter().all(|(_, kind)| *kind == GoalKind::Hover));
    assert!(rig.starts[0].1.maneuver_id > before.starts.last().unwrap().1.maneuver_id);
    let mut orphan = Rig::with(arena("double-flip"), 4);
    (orphan.telemetry, orphan.kinematics) = (before.telemetry, before.kinematics);
    orphan.faults.nobody_orders = true;
    orphan.run(4.0);
    assert!(orphan.phases().contains(&FlipPhase::Landing), "nobody gives an order: it lands");
}

#[test]
fn a_vehicle_that_is_carried_does_not_start() {
    let mut rig = Rig::new();
    rig.kinematics.position_m = Vector::new(0.0, 0.0, 1.2);
    rig.faults.carried = true;
    rig.run(5.0);
    assert_eq!(rig.phases(), [FlipPhase::Idle]);
    assert!(goals(&rig).iter().all(|(_, kind)| *kind == GoalKind::Ground));
}

#[test]
fn a_vehicle_that_stops_in_its_flip_is_told_as_aborted() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.telemetry.mode = FlightMode::Stopped;
    rig.run(0.1);
    assert_eq!(rig.phase(), FlipPhase::Done);
    assert_eq!(results(&rig)[0].1.outcome, FlipOutcome::Aborted);
}

#[test]
fn an_impossible_report_of_the_end_is_not_waited_for() {
    let mut rig = Rig::new();
    rig.run_until(FlipPhase::Flip, 5.0);
    rig.telemetry.maneuver_phase = ManeuverPhase::Completed;
    rig.telemetry.ended_at = Time::from_nanos(4_000_000_000_000_000_000);
    rig.run_until(FlipPhase::Recover, 0.5);
    assert_eq!(results(&rig)[0].1.outcome, FlipOutcome::Unmeasured);
}

#[test]
fn a_maneuver_that_runs_from_before_a_restart_is_left_alone() {
    let mut rig = Rig::new();
    rig.faults.endless = true;
    rig.telemetry.mode = FlightMode::Maneuver;
    rig.telemetry.maneuver_id = 77;
    rig.telemetry.maneuver_phase = ManeuverPhase::Running;
    rig.kinematics.position_m = Vector::new(0.0, 0.0, 5.0);
    rig.run(5.0);
    assert!(rig.starts.is_empty());
}

#[test]
fn same_inputs_same_outputs() {
    let run = || {
        let mut rig = Rig::new();
        rig.run(10.0);
        rig.said
    };
    assert!(run() == run());
}

#[test]
fn a_wrong_setting_is_refused_by_its_name() {
    let settings = arena("double-flip");
    let start = Start { at: Time::ZERO, seed: Seed(1), incarnation: 1 };
    let mut tuning: Tuning = settings.section("flip-manager").unwrap();
    assert_eq!(tuning, Tuning::default());
    tuning.gate.speed_m_s_max = f64::NAN;
    let error = FlipManager::new(&settings, tuning, start).unwrap_err().to_string();
    assert!(error.contains("[flip-manager.gate] speed_m_s_max"), "{error}");
}

#[test]
fn nobody_takes_off_onto_a_disk_that_is_about_to_fill_and_whoever_flies_flies_on() {
    let nearly_full = LoggerStatus { free_bytes: 1 << 30, ..LoggerStatus::default() };
    let mut rig = Rig::new();
    for _ in 0..6 {
        rig.hear(nearly_full.clone());
        rig.run(2.0);
    }
    assert_eq!(rig.phases(), [FlipPhase::Idle]);
    assert_eq!(rig.events, ["take-off-refused", "take-off-refused"], "at once, and after ten seconds");
    // The logger is gone, or has room: nothing holds the vehicle any more.
    rig.run(4.0);
    assert!(rig.phases().contains(&FlipPhase::Approach));
    rig.hear(nearly_full);
    rig.run(2.0);
    assert!(rig.phases().contains(&FlipPhase::Flip), "{:?}", rig.phases());
}

#[test]
fn nobody_takes_off_without_a_second_of_unbroken_tracking() {
    let mut rig = Rig::new();
    for _ in 0..10 {
        rig.faults.dark = true;
        rig.run(0.3);
        rig.faults.dark = false;
        rig.run(0.7);
    }
    assert_eq!(rig.phases(), [FlipPhase::Idle]);
    assert_eq!(rig.events, ["take-off-refused"], "once the usual start is over");
    rig.run(0.9);
    assert!(rig.phases().contains(&FlipPhase::Approach), "1.6 s without a break");
}
