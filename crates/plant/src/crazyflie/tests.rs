//! A Crazyflie on its own: what it answers, and what it does without setpoints.

use device::crtp::SupervisorState;
use quantity::GRAVITY_M_S2;
use settings::Arena;

use super::*;

const RESTING: ImuSample = ImuSample {
    rate_rad_s: Vector::ZERO,
    acceleration_m_s2: Vector::new(0.0, 0.0, GRAVITY_M_S2),
    battery_v: 4.1,
};

struct Bench {
    crazyflie: Crazyflie,
    now: Time,
}

impl Bench {
    fn new() -> Self {
        let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let arena = Arena::load(&config, "crazyflie-hover").expect("the shipped settings load");
        let mut vehicle = arena.fleet[0].vehicle.clone();
        for link in [&mut vehicle.plant.command_link, &mut vehicle.plant.data_link] {
            *link = LinkSettings { delay_s: 0.0, jitter_s: 0.0, loss_ratio: 0.0, corruption_ratio: 0.0 };
        }
        let crazyflie = Crazyflie::new(&vehicle, 1).expect("flies");
        let mut bench = Self { crazyflie, now: Time::ZERO + Span::from_secs(9) };
        bench.run(&RESTING, Span::from_millis(10));
        bench
    }

    fn tell(&mut self, packet: &Packet<'_>) -> Vec<Vec<u8>> {
        let mut out = [0; PACKET_BYTES_MAX];
        let length = packet.encode(&mut out).expect("fits");
        self.crazyflie.feed(self.now, &out[..length], &Schedule::default());
        self.crazyflie.receive(self.now, |at| at);
        std::mem::take(&mut self.crazyflie.answers)
    }

    fn state(&mut self) -> SupervisorState {
        let answers = self.tell(&Packet::Supervisor(crtp::Supervisor::RequestState));
        match Packet::decode(&answers[0]) {
            Ok(Packet::Supervisor(crtp::Supervisor::State(state))) => state,
            other => panic!("{other:?}"),
        }
    }

    fn run(&mut self, imu: &ImuSample, span: Span) -> [u8; ROTORS] {
        let end = self.now + span;
        let mut commands = [0; ROTORS];
        while self.now < end {
            self.now += TICK;
            commands = self.crazyflie.tick(self.now, imu, false);
        }
        commands
    }

    fn fly(&mut self, thrust: u16) -> [u8; ROTORS] {
        self.tell(&Packet::Setpoint(Setpoint::rates(Vector::ZERO, thrust)));
        self.run(&RESTING, Span::from_millis(20))
    }
}

#[test]
fn it_answers_null_packets_and_echoes() {
    let mut bench = Bench::new();
    assert_eq!(bench.tell(&Packet::Null(&[])), [vec![0xFF]]);
    assert_eq!(bench.tell(&Packet::Echo(&[7, 8])), [vec![0xFC, 7, 8]]);
    assert!(bench.tell(&Packet::Other { port: 2, channel: 0, data: &[1] }).is_empty());
    assert_eq!(bench.crazyflie.unused(), 1);
}

#[test]
fn motors_turn_only_when_armed_and_thrust_is_linear_in_the_command() {
    let mut bench = Bench::new();
    assert_eq!(bench.fly(40_000), [0; 4]);
    bench.tell(&Packet::Supervisor(crtp::Supervisor::Arm(true)));
    // The mixer's command goes with the square root of the thrust.
    assert_eq!(bench.fly(u16::MAX), [200; 4]);
    assert_eq!(bench.fly(u16::MAX / 4), [100; 4]);
    assert!(bench.state().has(SupervisorState::ARMED | SupervisorState::FLYING));
    bench.tell(&Packet::Setpoint(Setpoint::Stop));
    assert_eq!(bench.run(&RESTING, Span::from_millis(2)), [0; 4]);
}

#[test]
fn without_setpoints_it_levels_after_half_a_second_and_stops_after_two() {
    let mut bench = Bench::new();
    bench.tell(&Packet::Supervisor(crtp::Supervisor::Arm(true)));
    bench.fly(30_000);
    // It has rolled by a fifth of a radian meanwhile, and goes on as told until it levels.
    let rolled =
        ImuSample { rate_rad_s: Vector::new(1.0, 0.0, 0.0), acceleration_m_s2: Vector::ZERO, ..RESTING };
    bench.run(&rolled, Span::from_millis(200));
    let still = ImuSample { acceleration_m_s2: Vector::ZERO, ..RESTING };
    let push = |[_, _, left, right]: [u8; ROTORS]| i32::from(right) - i32::from(left);
    let told = push(bench.run(&still, Span::from_millis(250)));
    let levelling = push(bench.run(&still, Span::from_millis(100)));
    assert!(levelling > told + 10, "it rolls back: {told}, {levelling}");
    assert_ne!(bench.run(&still, Span::from_millis(1400)), [0; 4]);
    assert_eq!(bench.run(&still, Span::from_millis(100)), [0; 4]);
    assert!(!bench.state().has(SupervisorState::ARMED));
    assert_eq!(bench.fly(30_000), [0; 4], "it must be armed anew");
}

#[test]
fn either_emergency_stop_locks_it() {
    for stop in [Packet::OldEmergencyStop, Packet::Supervisor(crtp::Supervisor::Stop)] {
        let mut bench = Bench::new();
        bench.tell(&Packet::Supervisor(crtp::Supervisor::Arm(true)));
        assert_ne!(bench.fly(30_000), [0; 4]);
        bench.tell(&stop);
        assert_eq!(bench.fly(30_000), [0; 4]);
        let answers = bench.tell(&Packet::Supervisor(crtp::Supervisor::Arm(true)));
        let refused = crtp::Supervisor::Answer { command: 1, done: false, holds: false };
        assert_eq!(Packet::decode(&answers[0]), Ok(Packet::Supervisor(refused)));
        assert!(bench.state().has(SupervisorState::LOCKED));
    }
}

#[test]
fn a_radio_that_loses_everything_loses_it_both_ways() {
    let mut bench = Bench::new();
    let mut faults = Schedule::default();
    let vehicle = bench.crazyflie.vehicle;
    faults.add(Fault::CommandLoss { vehicle, loss_ratio: 1.0 }, Time::ZERO, Time::FAR_FUTURE);
    bench.crazyflie.feed(bench.now, &[0xFF], &faults);
    assert_eq!((bench.crazyflie.next_at(), bench.crazyflie.counts().lost), (None, 1));
    bench.crazyflie.answers.push(vec![0xFF]);
    let mut outputs = Outputs::new();
    bench.crazyflie.send(bench.now, &faults, &mut outputs);
    assert_eq!(outputs.next_at(), None);
}
