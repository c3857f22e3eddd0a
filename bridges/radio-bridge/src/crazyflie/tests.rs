//! The bridge, stepped directly, against a vehicle that answers each packet after a while.

use device::crtp::{LogOrder, LogRequest, LogType, Setpoint};
use quantity::{Rotation, Vector};
use schemas::{ManeuverStart, StopKind, StopOrder, VehicleCommand};
use service_core::{Core, Event, Seed, Start};

use super::*;
use crate::tests::arena;
use crate::{Input, RadioBridge};

const ID: u8 = 5;
/// From the bridge to the vehicle, and as long back.
const WAY: Span = Span::from_millis(7);

fn ms(milliseconds: i64) -> Time {
    Time::ZERO + Span::from_millis(milliseconds)
}

/// A bridge, the one vehicle of its arena, and all that was said.
struct Rig {
    bridge: RadioBridge,
    now: Time,
    answers: VecDeque<(Time, Vec<u8>)>,
    armed: bool,
    locked: bool,
    silent: bool,
    packets: Vec<(Time, Vec<u8>)>,
    telemetry: Vec<VehicleTelemetry>,
    sent: Vec<schemas::CommandSent>,
    events: Vec<String>,
}

impl Rig {
    fn new(tuning: Tuning) -> Self {
        let start = Start { at: ms(0), seed: Seed(7), incarnation: 1 };
        Self {
            bridge: RadioBridge::new(&arena("crazyflie-hover"), tuning, start).expect("a sound tuning"),
            now: ms(0),
            answers: VecDeque::new(),
            armed: false,
            locked: false,
            silent: false,
            packets: Vec::new(),
            telemetry: Vec::new(),
            sent: Vec::new(),
            events: Vec::new(),
        }
    }

    fn step(&mut self, event: Event<Input>) {
        let mut out = Outbox::default();
        self.bridge.step(self.now, event, &mut out);
        self.events.extend(out.events().iter().map(|event| event.name.as_str().to_owned()));
        for message in out.messages() {
            match message {
                Output::Transmit(bytes) => {
                    assert_eq!(bytes.port, Ports::command_link(ID));
                    self.packets.push((self.now, bytes.bytes.to_vec()));
                    self.vehicle(&bytes.bytes);
                }
                Output::Sent(report) => self.sent.push(*report),
                Output::Telemetry(report) => self.telemetry.push(*report),
            }
        }
    }

    /// What the vehicle makes of a packet.
    fn vehicle(&mut self, packet: &[u8]) {
        let mut out = [0; PACKET_BYTES_MAX];
        let done = |order, block| LogReply::Answer { order, block, error: 0 };
        let vbat = LogReply::Item { id: 0, kind: LogType::F32, group: b"pm", name: b"vbat" };
        let reply = match LogRequest::decode(packet).expect("a packet") {
            Some(LogRequest::Info) => LogReply::Info { count: 1, check: 0, blocks_max: 1, variables_max: 1 },
            Some(LogRequest::Item { .. }) => vbat,
            Some(LogRequest::Reset) => done(LogOrder::Reset, 0),
            Some(LogRequest::Create { block, .. }) => done(LogOrder::Create, block),
            Some(LogRequest::Start { block, .. }) => done(LogOrder::Start, block),
            Some(other) => panic!("{other:?}"),
            None => return self.answer(packet),
        };
        let length = reply.encode(&mut out).expect("fits");
        self.answers.push_back((self.now + WAY + WAY, out[..length].to_vec()));
    }

    fn answer(&mut self, packet: &[u8]) {
        let answer = match Packet::decode(packet).expect("a packet") {
            Packet::Echo(_) => packet.to_vec(),
            Packet::Supervisor(Supervisor::RequestState) => {
                let armed = if self.armed { SupervisorState::ARMED | SupervisorState::FLYING } else { 0 };
                let locked = if self.locked { SupervisorState::LOCKED } else { 0 };
                encoded(&Packet::Supervisor(Supervisor::State(SupervisorState(armed | locked))))
            }
            Packet::Supervisor(Supervisor::Arm(arm)) => {
                self.armed = arm && !self.locked;
                return;
            }
            Packet::Supervisor(Supervisor::Stop) => {
                (self.armed, self.locked) = (false, true);
                return;
            }
            _ => return,
        };
        self.answers.push_back((self.now + WAY + WAY, answer));
    }

    fn hear(&mut self, packet: &[u8]) {
        let bytes = packet.try_into().expect("fits");
        let received = DeviceBytes { port: Ports::command_link(ID), at: self.now, bytes };
        self.step(Event::Input(Input::Received(received)));
    }

    /// Runs until then, giving this command at 200 Hz.
    fn run(&mut self, until: Time, command: Option<VehicleCommand>) {
        let voltage = LogReply::Data { block: 1, time_ms: 0, values: &4.0f32.to_le_bytes() };
        let mut out = [0; PACKET_BYTES_MAX];
        let length = voltage.encode(&mut out).expect("fits");
        while self.now < until {
            self.now += Span::from_millis(1);
            while self.answers.front().is_some_and(|(at, _)| *at <= self.now) {
                let answer = self.answers.pop_front().map(|(_, answer)| answer).unwrap_or_default();
                if !self.silent {
                    self.hear(&answer);
                }
            }
            let tick = (self.now - Time::ZERO).as_nanos() / 1_000_000;
            if tick % 100 == 50 && !self.silent {
                self.hear(&out[..length]);
            }
            if let Some(command) = command.filter(|_| tick % 5 == 0) {
                let valid_until = self.now + Span::from_millis(60);
                self.step(Event::Input(Input::Command(VehicleCommand { valid_until, ..command })));
            }
            while self.bridge.deadline().is_some_and(|at| at <= self.now) {
                self.step(Event::Deadline);
            }
        }
    }

    /// Commands it to stay off for a while, and then to fly until then.
    fn take_off(&mut self, until: Time) {
        self.run(self.now + Span::from_millis(200), Some(command(CommandMode::Disarmed, 0.0)));
        self.run(until, Some(command(CommandMode::Fly, 1.0)));
    }

    /// How many packets since then are this one.
    fn count(&self, since: Time, wanted: &Packet<'_>) -> usize {
        let bytes = encoded(wanted);
        self.packets.iter().filter(|(at, packet)| *at >= since && *packet == bytes).count()
    }

    fn setpoints(&self, since: Time) -> usize {
        let setpoint = |packet: &[u8]| matches!(Packet::decode(packet), Ok(Packet::Setpoint(_)));
        self.packets.iter().filter(|(at, packet)| *at >= since && setpoint(packet)).count()
    }

    fn mode(&self) -> FlightMode {
        self.telemetry.last().expect("reported").mode
    }
}

fn encoded(packet: &Packet<'_>) -> Vec<u8> {
    let mut out = [0; PACKET_BYTES_MAX];
    let length = packet.encode(&mut out).expect("fits");
    out[..length].to_vec()
}

fn command(mode: CommandMode, height_m: f64) -> VehicleCommand {
    VehicleCommand {
        vehicle: ID,
        mode,
        lease_epoch: 1,
        collective_m_s2: 9.81,
        rate_rad_s: Vector::new(0.1, 0.2, 0.3),
        orientation: Rotation::IDENTITY,
        height_m,
        ..VehicleCommand::default()
    }
}

#[test]
fn it_reports_state_battery_and_the_delay_of_the_link() {
    let mut rig = Rig::new(Tuning::default());
    rig.run(ms(5000), None);
    let last = rig.telemetry.last().expect("reported");
    assert_eq!((last.vehicle, last.mode, last.battery_v), (ID, FlightMode::Disarmed, 4.0));
    // Half of the round trip, and half a tick.
    assert!((last.link_delay_s - 0.007_625).abs() < 1e-9, "{}", last.link_delay_s);
    let late: Vec<_> = rig.telemetry.iter().filter(|report| report.received_at > ms(4000)).collect();
    assert_eq!(late.len(), 20, "twenty times a second");
    assert_eq!(rig.setpoints(ms(0)), 0, "nobody commands it");
    assert_eq!(rig.bridge.counters().payloads_damaged, 0);
}

#[test]
fn it_is_armed_to_fly_and_disarmed_on_the_floor() {
    let mut rig = Rig::new(Tuning::default());
    rig.run(ms(1000), Some(command(CommandMode::Disarmed, 0.0)));
    assert!(!rig.armed && rig.count(ms(0), &Packet::Supervisor(Supervisor::Arm(true))) == 0);
    rig.run(ms(2000), Some(command(CommandMode::Fly, 1.0)));
    assert!(rig.armed && rig.mode() == FlightMode::Flying);
    assert!(rig.count(ms(0), &Packet::Supervisor(Supervisor::Arm(true))) <= 3, "no more once it says so");
    rig.run(ms(3000), Some(command(CommandMode::Disarmed, 0.0)));
    assert!(!rig.armed && rig.mode() == FlightMode::Disarmed);
}

#[test]
fn one_that_stopped_by_itself_is_not_started_again_in_mid_air() {
    let mut rig = Rig::new(Tuning::default());
    rig.take_off(ms(1000));
    assert!(rig.armed);
    rig.armed = false;
    rig.run(ms(3000), Some(command(CommandMode::Fly, 1.0)));
    assert!(!rig.armed && rig.mode() == FlightMode::Disarmed);
    rig.take_off(ms(4000));
    assert!(rig.armed, "it rested");
    // A bridge that starts below a flying vehicle has nothing to arm.
    let mut rig = Rig { armed: true, ..Rig::new(Tuning::default()) };
    rig.run(ms(1000), Some(command(CommandMode::Fly, 1.0)));
    assert!(rig.armed && rig.count(ms(0), &Packet::Supervisor(Supervisor::Arm(true))) == 0);
}

#[test]
fn every_slot_carries_the_newest_command_and_none_is_repeated() {
    let mut rig = Rig::new(Tuning::default());
    rig.take_off(ms(1000));
    assert_eq!((rig.setpoints(ms(0)), rig.sent.len()), (50, 50));
    let rates = rig.sent[19].rate_rad_s - Vector::new(0.1, 0.2, 0.3);
    assert!(rates.norm() < 1e-6 && (rig.sent[19].collective_m_s2 - 9.81).abs() < 2e-4);
    rig.run(ms(3000), None);
    assert!(rig.setpoints(ms(1061)) == 0 && rig.setpoints(ms(1000)) <= 4);
    assert!(rig.events.iter().any(|name| name == "command-silent"));
    assert!(rig.armed, "silence disarms nobody in flight");
}

#[test]
fn an_emergency_stop_goes_out_in_both_forms_and_holds() {
    let mut rig = Rig::new(Tuning::default());
    rig.take_off(ms(1000));
    let stop = StopOrder { kind: StopKind::Stop, vehicle: 0, given_at: ms(1000) };
    rig.step(Event::Input(Input::Stop(stop)));
    rig.run(ms(5000), Some(command(CommandMode::Fly, 1.0)));
    for form in [Packet::Supervisor(Supervisor::Stop), Packet::OldEmergencyStop] {
        assert_eq!(rig.count(ms(1000), &form), 51, "{form:?}");
    }
    assert_eq!(rig.setpoints(ms(1001)), rig.count(ms(1001), &Packet::Setpoint(Setpoint::Stop)));
    assert!(!rig.armed && rig.mode() == FlightMode::Stopped);
    assert!(rig.events.iter().any(|name| name == "crazyflie-locked"));
    // A release frees the bridge; the vehicle is locked until it is restarted.
    let release = StopOrder { kind: StopKind::Release, vehicle: ID, given_at: ms(5000) };
    rig.step(Event::Input(Input::Stop(release)));
    rig.run(ms(6000), Some(command(CommandMode::Fly, 1.0)));
    assert!(rig.mode() == FlightMode::Stopped && !rig.armed);
    assert_eq!(rig.count(ms(5000), &Packet::Supervisor(Supervisor::Arm(true))), 0, "it would not obey");
    rig.locked = false;
    rig.take_off(ms(7000));
    assert!(rig.armed && rig.mode() == FlightMode::Flying);
}

#[test]
fn silence_is_told_once_and_so_is_its_end() {
    let mut rig = Rig::new(Tuning::default());
    rig.run(ms(2000), None);
    rig.silent = true;
    rig.run(ms(6000), None);
    rig.silent = false;
    rig.run(ms(8000), None);
    for name in ["telemetry-lost", "telemetry-back"] {
        assert_eq!(rig.events.iter().filter(|event| *event == name).count(), 1, "{name}");
    }
    assert!(rig.telemetry.last().is_some_and(|report| report.received_at > ms(7900)));
}

#[test]
fn the_watchdog_is_begun_only_where_the_settings_say_so() {
    for (crazyflie_watchdog, count) in [(false, 0), (true, 5)] {
        let mut rig = Rig::new(Tuning { crazyflie_watchdog, ..Tuning::default() });
        rig.run(ms(999), None);
        assert_eq!(rig.count(ms(0), &Packet::Supervisor(Supervisor::Watchdog)), count);
        assert_eq!(rig.count(ms(0), &Packet::OldWatchdog), count);
    }
}

#[test]
fn a_flip_is_refused_by_name_and_bytes_of_no_sense_are_counted() {
    let mut rig = Rig::new(Tuning::default());
    let start =
        ManeuverStart { vehicle: ID, maneuver_id: 1, valid_until: ms(100), ..ManeuverStart::default() };
    rig.step(Event::Input(Input::Start(start)));
    assert_eq!(rig.events, ["flips-not"]);
    for bytes in [&[][..], &[0; 40], &[0x9C, 0x8C, 1]] {
        rig.hear(bytes);
    }
    assert_eq!(rig.bridge.counters().payloads_damaged, 3);
}

#[test]
fn what_the_supervisor_says_is_a_mode_of_the_arena() {
    let of = |bits| mode(SupervisorState(bits));
    let (armed, flying) = (SupervisorState::ARMED, SupervisorState::FLYING);
    let alone = SupervisorState::ARMS_ITSELF;
    assert_eq!(of(0), FlightMode::Disarmed);
    assert_eq!(of(flying), FlightMode::Disarmed, "its motors stand still: it only flew lately");
    assert_eq!(of(armed), FlightMode::Flying);
    assert_eq!(of(armed | alone), FlightMode::Disarmed);
    assert_eq!(of(armed | alone | flying), FlightMode::Flying);
    assert_eq!(of(armed | flying | SupervisorState::TUMBLED), FlightMode::Landed);
    assert_eq!(of(SupervisorState::CRASHED | SupervisorState::LOCKED), FlightMode::Stopped);
}
