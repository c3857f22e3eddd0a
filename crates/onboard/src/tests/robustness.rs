//! Whatever comes in: no panic, commands in range, no thrust outside its limits.

use super::*;
use device::vehicle_link::{ManeuverPhase, StatusFlags};
use proptest::prelude::*;

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -40.0..40.0f64, 1 => any::<f64>(), 1 => Just(f64::NAN)]
}

fn any_vector() -> impl Strategy<Value = Vector<quantity::Body>> {
    (any_number(), any_number(), any_number()).prop_map(|(x, y, z)| Vector::new(x, y, z))
}

#[derive(Clone, Debug)]
enum Event {
    Tick { rate: Vector<quantity::Body>, acceleration: Vector<quantity::Body>, battery_v: f64, count: u16 },
    Frame(CommandFrame),
    Channels([u16; 16]),
    Payload(Vec<u8>),
    Uplink(Uplink),
    Upload(FlipSet, u16),
    Later(i64),
    Poll,
}

fn any_mode() -> impl Strategy<Value = CommandMode> {
    prop_oneof![
        2 => Just(CommandMode::Disarmed),
        8 => Just(CommandMode::Fly),
        1 => Just(CommandMode::Descend),
        1 => Just(CommandMode::Stop),
    ]
}

fn any_frame() -> impl Strategy<Value = CommandFrame> {
    let numbers = prop::array::uniform8(-30.0..30.0f64);
    (any_mode(), 0u8..32, any::<bool>(), numbers).prop_map(|(mode, counter, hints_valid, n)| CommandFrame {
        mode,
        counter,
        collective_m_s2: if mode == CommandMode::Disarmed { 0.0 } else { n[0].abs() },
        rate_rad_s: Vector::new(n[1], n[2], n[3]),
        attitude_valid: hints_valid,
        height_valid: hints_valid,
        roll_rad: n[4] * 0.01,
        pitch_rad: n[5] * 0.01,
        height_m: n[6],
        vertical_speed_m_s: n[7] * 0.01,
        epoch_low: 0,
    })
}

fn any_order() -> impl Strategy<Value = Uplink> {
    prop_oneof![
        4 => (0u16..5, 0u16..3).prop_map(|(maneuver_id, set_id)| Uplink::Start {
            maneuver_id,
            set_id,
            digest: DOUBLE.digest()
        }),
        1 => (0u16..5).prop_map(|maneuver_id| Uplink::Abort { maneuver_id }),
        1 => any::<u16>().prop_map(|token| Uplink::Ping { token }),
        1 => Just(Uplink::Stop),
        3 => Just(Uplink::Rearm),
    ]
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        8 => (any_vector(), any_vector(), any_number(), 1u16..80).prop_map(
            |(rate, acceleration, battery_v, count)| Event::Tick { rate, acceleration, battery_v, count }
        ),
        8 => any_frame().prop_map(Event::Frame),
        1 => any::<[u16; 16]>().prop_map(Event::Channels),
        1 => prop::collection::vec(any::<u8>(), 0..110).prop_map(Event::Payload),
        3 => any_order().prop_map(Event::Uplink),
        1 => (any_number(), 0u16..3).prop_map(|(t1, id)| {
            Event::Upload(FlipSet { t1_s: (0.16 + t1 * 0.001) as f32, ..DOUBLE }, id)
        }),
        1 => (0u16..3).prop_map(|id| Event::Upload(DOUBLE, id)),
        1 => prop_oneof![0..2_000_000_000i64, Just(-1_000_000_000i64)].prop_map(Event::Later),
        1 => Just(Event::Poll),
    ]
}

/// Every command is off, or within what the thrust range corresponds to.
fn check_commands(commands: [u8; 4], on: bool) {
    for command in commands {
        let thrust_n = 2.8 * (f64::from(command) / 200.0) * (f64::from(command) / 200.0);
        let expected = if on { (0.08..=2.8).contains(&thrust_n) } else { command == 0 };
        assert!(expected, "command {command}, motors on: {on}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]
    #[test]
    fn nothing_that_comes_in_breaks_what_goes_out(
        events in prop::collection::vec(any_event(), 0..60), hovering: bool,
    ) {
        let settings = FirmwareSettings::table_i(VEHICLE);
        let mut bench = Bench::new(settings);
        if hovering {
            bench = bench.brought_to(5.0);
        }
        for event in events {
            match event {
                Event::Tick { rate, acceleration, battery_v, count } => {
                    let imu = ImuSample { rate_rad_s: rate, acceleration_m_s2: acceleration, battery_v };
                    for _ in 0..count {
                        let latched = bench.status().flags.contains(StatusFlags::LATCHED);
                        let commands = bench.firmware.tick(bench.now, &imu);
                        let mode = bench.firmware.mode();
                        let on = !matches!(
                            mode,
                            FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped
                        );
                        check_commands(commands, on);
                        prop_assert!(!(latched && on), "a tick released a latch");
                        let exact = bench.firmware.clone().commanded_thrusts_n(bench.now, &imu);
                        for thrust_n in exact.into_iter().flatten() {
                            prop_assert!((0.08..=2.8).contains(&thrust_n));
                        }
                        bench.now += TICK;
                    }
                }
                Event::Frame(frame) => {
                    let latched = matches!(bench.firmware.mode(), FlightMode::Landed | FlightMode::Stopped);
                    bench.firmware.receive_channels(bench.now, &frame.encode(VEHICLE).unwrap());
                    if latched || frame.mode == CommandMode::Stop {
                        bench.firmware.tick(bench.now, &bench.imu);
                        prop_assert!(bench.status().flags.contains(StatusFlags::LATCHED));
                    }
                }
                Event::Channels(channels) => bench.firmware.receive_channels(bench.now, &channels),
                Event::Payload(payload) => bench.firmware.receive_payload(bench.now, &payload),
                Event::Uplink(message) => bench.uplink(&message),
                Event::Upload(set, id) => bench.upload(id, &set),
                Event::Later(nanos) => bench.now += Span::from_nanos(nanos),
                Event::Poll => {
                    bench.downlink();
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn nothing_the_sensors_say_in_a_flip_breaks_what_goes_out(
        samples in prop::collection::vec((any_vector(), any_vector(), any_number()), 100..300),
    ) {
        let mut bench = Bench::hovering_at(5.0);
        bench.upload(1, &DOUBLE);
        bench.start(1, 1, &DOUBLE);
        let first = bench.tick();
        check_commands(first, true);
        prop_assert_eq!(bench.status().maneuver_phase, ManeuverPhase::Running);
        for (rate_rad_s, acceleration_m_s2, battery_v) in samples {
            bench.imu = ImuSample { rate_rad_s, acceleration_m_s2, battery_v };
            let thrusts = bench.firmware.clone().commanded_thrusts_n(bench.now, &bench.imu);
            for thrust_n in thrusts.into_iter().flatten() {
                prop_assert!((0.08..=2.8).contains(&thrust_n));
            }
            let commands = bench.firmware.tick(bench.now, &bench.imu);
            check_commands(commands, bench.firmware.mode() != FlightMode::Stopped);
            bench.now += TICK;
        }
    }
}

#[test]
fn time_at_the_ends_of_its_range_is_survived() {
    let mut bench = Bench::hovering_at(5.0);
    for now in [Time::from_nanos(i64::MIN), Time::FAR_FUTURE, Time::ZERO, Time::FAR_FUTURE] {
        bench.now = now;
        bench.frame.counter = CommandFrame::next_counter(bench.frame.counter);
        bench.firmware.receive_channels(now, &bench.frame.encode(VEHICLE).unwrap());
        bench.firmware.tick(now, &bench.imu);
        bench.downlink();
    }
}

#[test]
fn settings_nothing_can_fly_with_are_refused() {
    let mut settings = FirmwareSettings::table_i(VEHICLE);
    settings.rates.yaw_p_1_s = f64::NAN;
    assert_eq!(Firmware::new(settings).unwrap_err().field, "rates.yaw_p_1_s");
}
