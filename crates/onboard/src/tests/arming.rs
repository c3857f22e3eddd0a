//! When motors may start, and what stops them.

use super::*;
use device::sbus;
use device::vehicle_link::StatusFlags;

fn grounded() -> Bench {
    Bench::new(FirmwareSettings::table_i(VEHICLE))
}

#[test]
fn motors_wait_for_a_resting_command_first() {
    let mut bench = grounded();
    bench.fly(5.0);
    bench.run(millis(200));
    assert_eq!(bench.firmware.mode(), FlightMode::Disarmed);

    bench.frame.mode = CommandMode::Disarmed;
    bench.run(millis(100));
    bench.fly(5.0);
    bench.run(millis(100));
    assert_eq!(bench.firmware.mode(), FlightMode::Disarmed, "the stick was not at rest");

    (bench.frame.mode, bench.frame.collective_m_s2) = (CommandMode::Disarmed, 0.0);
    bench.run(millis(40));
    assert_eq!(bench.tick(), [0; 4]);
    bench.fly(5.0);
    bench.run(millis(40));
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);
    assert!(bench.tick().iter().all(|command| *command > 0));
}

#[test]
fn a_resting_command_does_not_last() {
    let mut bench = grounded();
    bench.run(millis(100));
    bench.linked = false;
    bench.run(millis(600));
    bench.linked = true;
    bench.fly(5.0);
    bench.run(millis(100));
    assert_eq!(bench.firmware.mode(), FlightMode::Disarmed);
}

#[test]
fn disarming_low_stops_and_high_descends() {
    let mut low = Bench::hovering_at(0.2);
    low.frame.mode = CommandMode::Disarmed;
    low.run(millis(40));
    assert_eq!(low.firmware.mode(), FlightMode::Disarmed);
    assert_eq!(low.tick(), [0; 4]);

    let mut high = Bench::hovering_at(4.0);
    high.frame.mode = CommandMode::Disarmed;
    high.run(millis(40));
    assert_eq!(high.firmware.mode(), FlightMode::Descend);
    high.run_until(FlightMode::Disarmed, Span::from_secs(6));
    // The vehicle knows its height to the 8 mm of the hints' steps.
    assert!(high.height_m < 0.51 && high.speed_m_s > -1.5, "{} m, {} m/s", high.height_m, high.speed_m_s);
    assert!(!high.status().flags.contains(StatusFlags::LATCHED), "the ground stayed with it");
}

#[test]
fn an_emergency_stop_on_either_link_is_immediate_and_latched() {
    for by_data_link in [false, true] {
        let mut bench = Bench::hovering_at(4.0);
        if by_data_link {
            bench.uplink(&Uplink::Stop);
        } else {
            bench.frame.mode = CommandMode::Stop;
            bench.send_frame();
            bench.frame.mode = CommandMode::Fly;
        }
        assert_eq!(bench.tick(), [0; 4]);
        let flags = bench.status().flags;
        assert!(flags.contains(StatusFlags::LATCHED.with(StatusFlags::EMERGENCY_STOP)));
        for mode in [CommandMode::Fly, CommandMode::Disarmed, CommandMode::Fly, CommandMode::Descend] {
            bench.frame.mode = mode;
            bench.run(millis(100));
            assert_eq!(bench.firmware.mode(), FlightMode::Stopped);
            assert_eq!(bench.tick(), [0; 4]);
        }
        // Released by a person, it still wants a resting command before it flies.
        bench.frame.mode = CommandMode::Fly;
        bench.uplink(&Uplink::Rearm);
        bench.run(millis(100));
        assert_eq!(bench.firmware.mode(), FlightMode::Disarmed);
        assert_eq!(bench.status().flags.bits() & 3, 0);
        (bench.frame.mode, bench.frame.collective_m_s2) = (CommandMode::Disarmed, 0.0);
        bench.run(millis(40));
        bench.fly(5.0);
        bench.run(millis(40));
        assert_eq!(bench.firmware.mode(), FlightMode::Flying);
    }
}

#[test]
fn a_stop_works_with_any_counter_and_while_it_goes_on_nothing_releases_it() {
    let mut bench = Bench::hovering_at(4.0);
    bench.linked = false;
    let repeated = CommandFrame { mode: CommandMode::Stop, ..bench.frame };
    bench.firmware.receive_channels(bench.now, &repeated.encode(VEHICLE).unwrap());
    assert_eq!(bench.tick(), [0; 4]);
    bench.uplink(&Uplink::Rearm);
    bench.frame.mode = CommandMode::Stop;
    bench.linked = true;
    bench.run(millis(40));
    assert_eq!(bench.firmware.mode(), FlightMode::Stopped);
}

#[test]
fn rearming_in_the_air_does_nothing() {
    let mut bench = Bench::hovering_at(4.0);
    bench.uplink(&Uplink::Rearm);
    bench.run(millis(100));
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);
}

#[test]
fn another_vehicles_messages_are_not_obeyed() {
    let mut bench = Bench::hovering_at(4.0);
    let stop = CommandFrame { mode: CommandMode::Stop, ..bench.frame };
    bench.firmware.receive_channels(bench.now, &stop.encode(VEHICLE + 1).unwrap());
    let mut payload = [0; PAYLOAD_BYTES_MAX];
    let length = Uplink::Stop.encode(VEHICLE + 1, &mut payload).unwrap();
    bench.firmware.receive_payload(bench.now, &payload[..length]);
    bench.tick();
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);
    assert_eq!(bench.firmware.counters().misaddressed, 2);
}

#[test]
fn damaged_and_made_up_frames_are_not_obeyed() {
    let mut bench = Bench::hovering_at(4.0);
    let stop = CommandFrame { mode: CommandMode::Stop, ..bench.frame }.encode(VEHICLE).unwrap();
    for channel in 0..16 {
        for bit in 0..11 {
            let mut damaged = stop;
            damaged[channel] ^= 1 << bit;
            bench.firmware.receive_channels(bench.now, &damaged);
        }
    }
    bench.firmware.receive_sbus(bench.now, &sbus::Frame { failsafe: true, ..sbus::Frame::new(stop) });
    bench.firmware.receive_sbus(bench.now, &sbus::Frame { frame_lost: true, ..sbus::Frame::new(stop) });
    let (received_us, sent) = (bench.status().command_received_us, bench.sent);
    bench.tick();
    assert_eq!(bench.firmware.mode(), FlightMode::Flying);
    assert_eq!(bench.firmware.counters().commands_damaged, 176);
    assert_eq!(received_us, crate::telemetry::micros(sent), "none made the command younger");
    bench.firmware.receive_sbus(bench.now, &sbus::Frame::new(stop));
    assert_eq!(bench.firmware.mode(), FlightMode::Stopped);
}

#[test]
fn a_lost_gyro_stops_the_motors_after_half_a_second() {
    let mut bench = Bench::hovering_at(4.0);
    bench.imu.rate_rad_s = Vector::new(f64::NAN, 0.0, 0.0);
    let lost = bench.now;
    let stopped = bench.run_until(FlightMode::Stopped, Span::from_secs(1));
    assert_eq!(stopped, lost + millis(500) + TICK);
    let flags = bench.status().flags;
    assert!(flags.contains(StatusFlags::LATCHED.with(StatusFlags::SENSOR_FAULT)));
    assert!(!flags.contains(StatusFlags::EMERGENCY_STOP));

    let mut brief = Bench::hovering_at(4.0);
    brief.imu.rate_rad_s = Vector::new(0.0, f64::INFINITY, 0.0);
    brief.run(millis(400));
    brief.imu.rate_rad_s = Vector::ZERO;
    brief.run(millis(400));
    assert_eq!(brief.firmware.mode(), FlightMode::Flying);
}
