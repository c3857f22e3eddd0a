//! The failsafe ladder, rung by rung, each at its time.

use super::*;
use device::vehicle_link::StatusFlags;

/// Flying, the newest frame having come with the tick at the answered time.
fn cut_off_at(height_m: f64) -> (Bench, Time) {
    let mut bench = Bench::hovering_at(height_m);
    let before = bench.sent;
    while bench.sent == before {
        bench.tick();
    }
    bench.linked = false;
    let sent = bench.sent;
    (bench, sent)
}

#[test]
fn each_rung_comes_one_tick_after_its_age() {
    let (mut bench, sent) = cut_off_at(4.0);
    while bench.now <= sent + millis(60) {
        bench.tick();
        assert!(!bench.firmware.status(bench.now - TICK).flags.contains(StatusFlags::COMMAND_STALE));
    }
    bench.tick();
    assert!(bench.firmware.status(bench.now - TICK).flags.contains(StatusFlags::COMMAND_STALE));
    assert_eq!(bench.firmware.mode(), FlightMode::Flying, "stale, but flown");
    assert_eq!(bench.run_until(FlightMode::LevelHold, millis(200)), sent + millis(100) + TICK);
    assert_eq!(bench.run_until(FlightMode::Descend, millis(600)), sent + millis(500) + TICK);
}

#[test]
fn a_transmitter_repeating_itself_is_a_lost_link() {
    let (mut bench, sent) = cut_off_at(4.0);
    let repeated = bench.frame.encode(VEHICLE).unwrap();
    while bench.firmware.mode() == FlightMode::Flying {
        bench.firmware.receive_channels(bench.now, &repeated);
        bench.tick();
    }
    assert_eq!(bench.now - TICK, sent + millis(100) + TICK);
    assert!(bench.firmware.counters().commands_repeated > 50);
}

#[test]
fn level_hold_levels_and_hovers() {
    let mut bench = Bench::hovering_at(4.0);
    (bench.frame.roll_rad, bench.frame.pitch_rad) = (0.05, -0.025);
    bench.run(millis(400));
    bench.linked = false;
    bench.run_until(FlightMode::LevelHold, millis(200));
    let thrusts = bench.firmware.commanded_thrusts_n(bench.now, &bench.imu).unwrap();
    let [front, back, left, right] = thrusts;
    assert!(right > left, "rolls right, back from a left-up tilt");
    assert!(back > front, "pitches forward, back from a nose-up tilt");
    let mean_n: f64 = thrusts.iter().sum::<f64>() / 4.0;
    // Over the cosine of the tilt, and over what was learned of the motors' 200 steps.
    assert!((mean_n / (0.468 * GRAVITY_M_S2 / 4.0) - 1.0).abs() < 0.015, "{mean_n}");
}

#[test]
fn a_link_that_comes_back_is_flown_at_once_from_level_hold_and_after_three_frames_from_a_descent() {
    let (mut bench, _) = cut_off_at(4.0);
    bench.run_until(FlightMode::LevelHold, millis(200));
    bench.linked = true;
    bench.tick();
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);

    let (mut bench, _) = cut_off_at(4.0);
    bench.run_until(FlightMode::Descend, millis(600));
    bench.linked = true;
    let mut frames = 0;
    while bench.firmware.mode() == FlightMode::Descend {
        let before = bench.sent;
        bench.tick();
        frames += i32::from(bench.sent != before);
    }
    assert_eq!((frames, bench.firmware.mode()), (3, FlightMode::Flying));

    // Single frames now and then are no link.
    let (mut bench, _) = cut_off_at(4.0);
    bench.run_until(FlightMode::Descend, millis(600));
    for _ in 0..5 {
        bench.send_frame();
        bench.run(millis(300));
        assert_eq!(bench.firmware.mode(), FlightMode::Descend);
    }
}

#[test]
fn a_descent_nobody_ordered_lands_gently_and_stays_down() {
    for height_m in [0.6, 2.0, 4.0, 7.5] {
        let (mut bench, _) = cut_off_at(height_m);
        let began = bench.run_until(FlightMode::Descend, millis(600));
        let mut impact_m_s: f64 = 0.0;
        while bench.firmware.mode() == FlightMode::Descend {
            let speed = bench.speed_m_s;
            bench.tick();
            if bench.height_m == 0.0 {
                impact_m_s = impact_m_s.max(-speed);
            }
        }
        assert_eq!(bench.firmware.mode(), FlightMode::Landed);
        assert_eq!(bench.height_m, 0.0, "felt, not timed out, from {height_m} m");
        assert!((0.3..1.1).contains(&impact_m_s), "touched down with {impact_m_s} m/s");
        assert!(bench.now - began < Span::from_secs_f64(height_m + 2.0), "before the timer");
        bench.linked = true;
        (bench.frame.mode, bench.frame.collective_m_s2) = (CommandMode::Disarmed, 0.0);
        bench.run(millis(100));
        bench.fly(GRAVITY_M_S2);
        bench.run(millis(100));
        assert_eq!(bench.firmware.mode(), FlightMode::Landed);
        assert!(bench.status().flags.contains(StatusFlags::LATCHED));
        bench.uplink(&Uplink::Rearm);
        bench.tick();
        assert_eq!(bench.firmware.mode(), FlightMode::Disarmed);
    }
}

#[test]
fn without_a_floor_to_feel_the_land_timer_stops_the_motors() {
    for (height_m, timer_s) in [(3.0, 5.0), (9.0, 10.0)] {
        let (mut bench, _) = cut_off_at(height_m);
        bench.floor = false;
        let began = bench.run_until(FlightMode::Descend, millis(600));
        let height_then_m = bench.height_m;
        let landed = bench.run_until(FlightMode::Landed, Span::from_secs(11));
        let timer = (landed - began).as_secs_f64();
        // The command's height is quantised to 8 mm, and the vehicle's own lies between it and the truth.
        let expected = if timer_s < 10.0 { height_then_m + 2.0 } else { 10.0 };
        assert!((timer - expected).abs() < 0.01, "{timer} s for {height_m} m");
    }
}

#[test]
fn a_vehicle_that_knows_nothing_of_itself_keeps_rates_at_zero_and_times_out() {
    let mut bench = Bench::new(FirmwareSettings::table_i(VEHICLE));
    (bench.frame.attitude_valid, bench.frame.height_valid) = (false, false);
    bench.floor = false;
    let mut bench = bench.brought_to(4.0);
    bench.linked = false;
    bench.run_until(FlightMode::LevelHold, millis(200));
    bench.imu.rate_rad_s = Vector::new(0.5, 0.0, 0.0);
    let [_, _, left, right] = bench.firmware.commanded_thrusts_n(bench.now, &bench.imu).unwrap();
    assert!(right > left, "a rate is stopped");
    bench.imu.rate_rad_s = Vector::ZERO;
    let began = bench.run_until(FlightMode::Descend, millis(600));
    let thrusts = bench.firmware.commanded_thrusts_n(bench.now, &bench.imu).unwrap();
    assert!(thrusts.iter().sum::<f64>() < 0.468 * GRAVITY_M_S2 * 0.98, "below hover");
    let landed = bench.run_until(FlightMode::Landed, Span::from_secs(11));
    assert_eq!(landed, began + Span::from_secs(10));
}

#[test]
fn an_ordered_descent_ends_disarmed_and_an_abandoned_one_latched() {
    let mut bench = Bench::hovering_at(3.0);
    bench.frame.mode = CommandMode::Descend;
    bench.run_until(FlightMode::Descend, millis(40));
    bench.run_until(FlightMode::Disarmed, Span::from_secs(6));
    assert_eq!(bench.height_m, 0.0);
    assert!(!bench.status().flags.contains(StatusFlags::LATCHED));

    let mut bench = Bench::hovering_at(3.0);
    bench.frame.mode = CommandMode::Descend;
    bench.run(millis(500));
    bench.linked = false;
    bench.run_until(FlightMode::Landed, Span::from_secs(6));
    assert_eq!(bench.height_m, 0.0);
}

#[test]
fn an_ordered_descent_is_left_when_the_ground_says_fly() {
    let mut bench = Bench::hovering_at(3.0);
    bench.frame.mode = CommandMode::Descend;
    bench.run(millis(500));
    bench.fly(GRAVITY_M_S2);
    bench.run(millis(40));
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);
}

#[test]
fn an_ordered_descent_from_higher_than_the_timer_reaches_is_not_cut_short() {
    let mut bench = Bench::hovering_at(12.0);
    bench.frame.mode = CommandMode::Descend;
    bench.run_until(FlightMode::Descend, millis(40));
    bench.run_until(FlightMode::Disarmed, Span::from_secs(15));
    assert_eq!(bench.height_m, 0.0);
}
