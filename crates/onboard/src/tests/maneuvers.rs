//! Uploads, starts, aborts, and what happens to commands meanwhile.

use super::*;
use device::vehicle_link::{ManeuverPhase, Reason, UploadState};

/// Hovering at 5 m with the double as set 7 in the store.
fn ready() -> Bench {
    let mut bench = Bench::hovering_at(5.0);
    bench.upload(7, &DOUBLE);
    assert_eq!(bench.upload_reply().state, UploadState::Committed);
    bench
}

/// The rate the flip asks for now, so that the guard is content.
fn follow(bench: &mut Bench) {
    let status = bench.status();
    if status.maneuver_phase == ManeuverPhase::Running {
        let settings = *bench.firmware.settings();
        let primitive = crate::command_generator::admit(&DOUBLE.to_items(), &settings).unwrap();
        let at = (bench.now - Time::from_nanos(status.began_us as i64 * 1_000)).as_secs_f64();
        bench.imu.rate_rad_s = Vector::new(0.0, primitive.sample(at).rate_rad_s, 0.0);
    } else {
        bench.imu.rate_rad_s = Vector::ZERO;
    }
}

fn outcome(bench: &Bench) -> (u16, ManeuverPhase, Reason) {
    let status = bench.status();
    (status.maneuver_id, status.maneuver_phase, status.reason)
}

fn flip_to_the_end(bench: &mut Bench) {
    for _ in 0..1_600 {
        follow(bench);
        bench.tick();
        if bench.firmware.mode() != FlightMode::Maneuver {
            return;
        }
    }
    panic!("still {:?}", bench.firmware.mode());
}

#[test]
fn a_start_is_flown_once_and_reported() {
    let mut bench = ready();
    bench.start(1, 7, &DOUBLE);
    let began = bench.now;
    bench.tick();
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Running, Reason::None));
    assert_eq!(bench.status().began_us, (began.as_nanos() / 1_000) as u64);
    for _ in 0..100 {
        bench.start(1, 7, &DOUBLE);
        bench.start(2, 7, &DOUBLE);
        follow(&mut bench);
        bench.tick();
    }
    flip_to_the_end(&mut bench);
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Completed, Reason::None));
    let status = bench.status();
    assert!(((status.ended_us - status.began_us) as f64 * 1e-6 - 1.0190).abs() < 1e-4);
    assert_eq!(bench.firmware.mode(), FlightMode::Flying, "the ground's commands are flown again");
    bench.imu.rate_rad_s = Vector::ZERO;
    bench.start(1, 7, &DOUBLE);
    bench.run(millis(100));
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Completed, Reason::None));
}

#[test]
fn what_is_commanded_meanwhile_is_received_and_not_flown() {
    let mut bench = ready();
    bench.start(1, 7, &DOUBLE);
    bench.fly(2.0);
    bench.tick();
    let mut least_n = f64::INFINITY;
    for _ in 0..80 {
        follow(&mut bench);
        let thrusts = bench.firmware.clone().commanded_thrusts_n(bench.now, &bench.imu).unwrap();
        least_n = least_n.min(thrusts.iter().sum());
        bench.tick();
        assert!(bench.status().command_age_ms <= 20);
    }
    assert!(least_n > 0.468 * 19.0, "flies the first step of the flip");
}

#[test]
fn each_condition_of_the_gate_refuses_and_uses_up_the_identity() {
    type Spoil = fn(&mut Bench);
    let cases: [(Reason, Spoil); 10] = [
        (Reason::NotFlying, |bench| {
            bench.frame.mode = CommandMode::Descend;
            bench.run(millis(40));
        }),
        (Reason::NotFlying, |bench| {
            bench.linked = false;
            bench.run(millis(120));
        }),
        (Reason::CommandStale, |bench| {
            bench.linked = false;
            bench.run(millis(65));
        }),
        (Reason::BatteryLow, |bench| {
            bench.imu.battery_v = 10.4;
            bench.run(Span::from_secs(4));
        }),
        (Reason::Height, |bench| {
            bench.height_m = 3.9;
            bench.run(millis(400));
        }),
        (Reason::Tilt, |bench| {
            bench.frame.pitch_rad = 0.1;
            bench.run(millis(400));
        }),
        (Reason::VerticalSpeed, |bench| {
            bench.speed_m_s = -0.25;
            bench.run(millis(400));
        }),
        (Reason::SensorFault, |bench| bench.imu.rate_rad_s = Vector::new(0.0, f64::NAN, 0.0)),
        (Reason::WrongSet, |bench| {
            let other = FlipSet { t1_s: 0.17, ..DOUBLE };
            bench.upload(7, &other);
            assert_eq!(bench.upload_reply().state, UploadState::Committed);
        }),
        (Reason::WrongSet, |bench| bench.upload(8, &DOUBLE)),
    ];
    for (index, (reason, spoil)) in cases.into_iter().enumerate() {
        let mut bench = ready();
        spoil(&mut bench);
        bench.start(1, 7, &DOUBLE);
        bench.tick();
        assert_eq!(outcome(&bench), (1, ManeuverPhase::Refused, reason), "case {index}");
        assert_ne!(bench.firmware.mode(), FlightMode::Maneuver);
    }
}

#[test]
fn a_refused_start_does_not_happen_later() {
    let mut bench = ready();
    bench.imu.battery_v = 10.0;
    bench.run(Span::from_secs(4));
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Refused, Reason::BatteryLow));
    bench.imu.battery_v = 12.0;
    (bench.height_m, bench.speed_m_s) = (5.0, 0.0);
    bench.run(Span::from_secs(4));
    (bench.height_m, bench.speed_m_s) = (5.0, 0.0);
    bench.run(millis(400));
    bench.start(1, 7, &DOUBLE);
    bench.run(millis(40));
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Refused, Reason::BatteryLow));
    bench.start(2, 7, &DOUBLE);
    bench.tick();
    assert_eq!(outcome(&bench), (2, ManeuverPhase::Running, Reason::None));
}

#[test]
fn a_vehicle_that_does_not_know_its_state_does_not_flip() {
    let mut bench = Bench::new(FirmwareSettings::table_i(VEHICLE));
    (bench.frame.attitude_valid, bench.frame.height_valid) = (false, false);
    let mut bench = bench.brought_to(5.0);
    bench.upload(7, &DOUBLE);
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Refused, Reason::StateUnknown));
}

#[test]
fn sets_outside_the_limits_are_never_active_and_a_swap_waits_for_the_end_of_a_maneuver() {
    let mut bench = ready();
    bench.upload(8, &FlipSet { u1_m_s2: 24.5, ..DOUBLE });
    let reply = bench.upload_reply();
    assert_eq!((reply.state, reply.reason), (UploadState::Refused, Reason::OutsideLimits));
    assert_eq!((bench.status().set_id, bench.status().set_digest), (7, DOUBLE.digest()));

    let next = FlipSet { t5_s: 0.2, ..DOUBLE };
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    bench.upload(9, &next);
    let reply = bench.upload_reply();
    assert_eq!((reply.state, reply.reason, reply.received_mask), (UploadState::Staging, Reason::Busy, 0x3FF));
    flip_to_the_end(&mut bench);
    bench.uplink(&Uplink::Commit { set_id: 9, digest: next.digest() });
    assert_eq!(bench.upload_reply().state, UploadState::Committed);
    assert_eq!((bench.status().set_id, bench.status().set_digest), (9, next.digest()));
}

#[test]
fn an_abort_ends_it_levels_the_vehicle_and_then_flies_commands_again() {
    let mut bench = ready();
    bench.start(5, 7, &DOUBLE);
    for _ in 0..200 {
        follow(&mut bench);
        bench.tick();
    }
    bench.uplink(&Uplink::Abort { maneuver_id: 4 });
    assert_eq!(bench.firmware.mode(), FlightMode::Maneuver, "another maneuver's abort");
    bench.uplink(&Uplink::Abort { maneuver_id: 5 });
    bench.imu.rate_rad_s = Vector::ZERO;
    bench.run(millis(40));
    // A hint has said level: the vehicle on the bench never turned.
    assert_eq!(outcome(&bench), (5, ManeuverPhase::Aborted, Reason::AbortOrdered));
    assert_eq!(bench.firmware.mode(), FlightMode::Flying, "level by the ground's hint");

    let mut bench = ready();
    bench.start(5, 7, &DOUBLE);
    for _ in 0..300 {
        follow(&mut bench);
        bench.tick();
    }
    (bench.frame.attitude_valid, bench.frame.height_valid) = (false, false);
    bench.uplink(&Uplink::Abort { maneuver_id: 5 });
    bench.imu.rate_rad_s = Vector::ZERO;
    let aborted = bench.now;
    bench.run(millis(400));
    assert_eq!(bench.firmware.mode(), FlightMode::LevelHold, "levels itself first");
    let flying = bench.run_until(FlightMode::Flying, Span::from_secs(1));
    assert_eq!(flying, aborted + millis(800), "but not for ever");
}

#[test]
fn the_command_clock_stands_still_until_a_tenth_of_a_second_after_the_planned_end() {
    let mut bench = ready();
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    bench.linked = false;
    flip_to_the_end(&mut bench);
    let end = Time::from_nanos(bench.status().ended_us as i64 * 1_000);
    assert_eq!(bench.status().maneuver_phase, ManeuverPhase::Completed);
    assert_eq!(bench.firmware.mode(), FlightMode::LevelHold, "nothing fresh to fly");
    bench.imu.rate_rad_s = Vector::ZERO;
    let descends = bench.run_until(FlightMode::Descend, Span::from_secs(1));
    let after = (descends - end).as_secs_f64();
    assert!((after - 0.6).abs() <= 0.00125 + 1e-6, "{after}");
}

#[test]
fn a_stop_in_a_maneuver_stops() {
    for by_data_link in [false, true] {
        let mut bench = ready();
        bench.start(1, 7, &DOUBLE);
        bench.tick();
        if by_data_link {
            bench.uplink(&Uplink::Stop);
        } else {
            bench.frame.mode = CommandMode::Stop;
            bench.send_frame();
        }
        assert_eq!(bench.tick(), [0; 4]);
        assert_eq!(outcome(&bench), (1, ManeuverPhase::Aborted, Reason::Stopped));
        assert_eq!(bench.firmware.mode(), FlightMode::Stopped);
    }
}

#[test]
fn a_vehicle_that_does_not_follow_or_tumbles_ends_it_by_itself() {
    let cases = [
        (Vector::new(0.0, -20.0, 0.0), Reason::RateNotFollowed),
        (Vector::new(12.0, 0.0, 0.0), Reason::RateExceeded),
        (Vector::new(0.0, f64::NAN, 0.0), Reason::SensorFault),
    ];
    for (rate, reason) in cases {
        let mut bench = ready();
        bench.start(1, 7, &DOUBLE);
        bench.tick();
        bench.imu.rate_rad_s = rate;
        bench.run(millis(400));
        assert_eq!(outcome(&bench), (1, ManeuverPhase::Aborted, reason));
        assert_ne!(bench.firmware.mode(), FlightMode::Maneuver);
    }
}

#[test]
fn the_start_of_a_maneuver_is_reported_in_the_same_tick() {
    let mut bench = ready();
    bench.downlink();
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    let running = |message: &Downlink| match message {
        Downlink::Status(status) => status.maneuver_phase == ManeuverPhase::Running,
        _ => false,
    };
    assert!(bench.downlink().iter().any(running));
}

#[test]
fn a_ping_is_answered_with_both_times() {
    let mut bench = ready();
    bench.downlink();
    bench.uplink(&Uplink::Ping { token: 77 });
    let received_us = (bench.now.as_nanos() / 1_000) as u64;
    bench.run(millis(5));
    let pong = Downlink::Pong { token: 77, received_us, turnaround_us: 5_000 };
    assert!(bench.downlink().contains(&pong));
}

#[test]
fn one_bad_gyro_sample_does_not_end_a_maneuver() {
    let mut bench = ready();
    bench.start(1, 7, &DOUBLE);
    bench.tick();
    for tick in 0..400 {
        follow(&mut bench);
        if tick % 20 == 0 {
            bench.imu.rate_rad_s = Vector::new(f64::NAN, f64::NAN, f64::NAN);
        }
        bench.tick();
    }
    assert_eq!(outcome(&bench), (1, ManeuverPhase::Running, Reason::None));
}

#[test]
fn a_maneuver_begins_and_ends_with_the_integrals_at_zero() {
    let mut bench = ready();
    bench.imu.rate_rad_s = Vector::new(0.0, 0.05, 0.0);
    bench.run(Span::from_secs(1));
    bench.imu.rate_rad_s = Vector::ZERO;
    let pitched = |bench: &Bench| {
        let [front, back, ..] = bench.firmware.clone().commanded_thrusts_n(bench.now, &bench.imu).unwrap();
        back - front
    };
    assert!(pitched(&bench) < -0.1, "normal flight has integrated the error");
    bench.start(1, 7, &DOUBLE);
    assert_eq!(pitched(&bench), 0.0, "the maneuver's first tick has not");
    bench.tick();
    for _ in 0..800 {
        follow(&mut bench);
        bench.imu.rate_rad_s.y += 0.5;
        bench.tick();
    }
    while bench.firmware.mode() == FlightMode::Maneuver {
        bench.imu.rate_rad_s = Vector::ZERO;
        bench.tick();
    }
    assert_eq!(pitched(&bench), 0.0, "and nothing of it is left after");
}
