//! Small stand-ins for vehicles and the data link's radio: enough of the protocol to answer, none of the
//! flying.

use super::*;
use std::collections::BTreeMap;

/// Least delay of the data link, each way.
const DELAY: Span = Span::from_millis(8);

/// Vehicle clocks are off by this, and drift.
const BOOT: Span = Span::from_millis(-41_234);
const DRIFT_RATIO: f64 = 30e-6;

/// A vehicle that keeps a parameter store and a status.
pub(super) struct FakeVehicle {
    id: u8,
    pub(super) address: u16,
    boot: Time,
    pub(super) command_delay: Span,
    pub(super) deaf_to_starts: bool,
    pub(super) deaf_to_commands: bool,
    pub(super) starts_heard: u32,
    pub(super) aborts_heard: u32,
    pub(super) start_arrivals: Vec<Time>,
    pub(super) began: Option<Time>,
    started: Vec<u16>,
    active: Option<(u16, u64)>,
    staging: Option<(u16, u64, u32, [f32; FLIP_SET_LEN])>,
    command: Option<(u8, Time)>,
    next_status: Time,
}

impl FakeVehicle {
    fn new(id: u8, address: u16) -> Self {
        Self {
            id,
            address,
            boot: Time::ZERO + BOOT,
            command_delay: Span::from_millis(18),
            deaf_to_starts: false,
            deaf_to_commands: false,
            starts_heard: 0,
            aborts_heard: 0,
            start_arrivals: Vec::new(),
            began: None,
            started: Vec::new(),
            active: None,
            staging: None,
            command: None,
            next_status: ms(3 + i64::from(id)),
        }
    }

    pub(super) fn active(&self) -> Option<(u16, u64)> {
        self.active
    }

    pub(super) fn started(&self) -> &[u16] {
        &self.started
    }

    pub(super) fn reboot(&mut self, now: Time) {
        *self = Self { boot: now, next_status: now, ..Self::new(self.id, self.address) };
    }

    fn uptime_us(&self, at: Time) -> u64 {
        ((at - self.boot).as_secs_f64() * (1.0 + DRIFT_RATIO) * 1e6) as u64
    }

    fn status(&self, now: Time) -> Status {
        let (counter, received) = self.command.unwrap_or((0, self.boot));
        Status {
            uptime_us: self.uptime_us(now),
            mode: if self.began.is_some() { LinkMode::Maneuver } else { LinkMode::Disarmed },
            battery_mv: 11_500,
            set_id: self.active.map_or(0, |set| set.0),
            set_digest: self.active.map_or(0, |set| set.1),
            maneuver_id: self.started.last().copied().unwrap_or(0),
            maneuver_phase: if self.began.is_some() { LinkPhase::Running } else { LinkPhase::None },
            began_us: self.began.map_or(0, |at| self.uptime_us(at)),
            command_counter: counter,
            command_received_us: self.command.map_or(0, |_| self.uptime_us(received)),
            ..Status::default()
        }
    }

    fn hear(&mut self, now: Time, message: Uplink) -> Option<Downlink> {
        match message {
            Uplink::Begin { set_id, digest, .. } => {
                let known = self.staging.is_some_and(|set| (set.0, set.1) == (set_id, digest));
                if !known && self.active != Some((set_id, digest)) {
                    self.staging = Some((set_id, digest, 0, [0.0; FLIP_SET_LEN]));
                }
                Some(self.reply(set_id))
            }
            Uplink::Items(items) => {
                if let Some(set) = self.staging.as_mut().filter(|set| set.0 == items.set_id) {
                    for (value, index) in items.values().iter().zip(usize::from(items.first_index)..) {
                        set.3[index] = *value;
                        set.2 |= 1 << index;
                    }
                }
                Some(self.reply(items.set_id))
            }
            Uplink::Commit { set_id, digest } => {
                let whole = self.staging.is_some_and(|set| {
                    (set.0, set.1, set.2) == (set_id, digest, 0x3FF) && digest_of(&set.3) == digest
                });
                if whole {
                    self.active = Some((set_id, digest));
                    self.staging = None;
                }
                Some(self.reply(set_id))
            }
            Uplink::Start { maneuver_id, .. } => {
                self.starts_heard += 1;
                self.start_arrivals.push(now);
                if !self.deaf_to_starts && !self.started.contains(&maneuver_id) {
                    self.started.push(maneuver_id);
                    self.began = Some(now);
                    self.next_status = now;
                }
                None
            }
            Uplink::Abort { .. } => {
                self.aborts_heard += 1;
                None
            }
            Uplink::Ping { token } => {
                Some(Downlink::Pong { token, received_us: self.uptime_us(now), turnaround_us: 0 })
            }
            Uplink::Stop | Uplink::Rearm => None,
        }
    }

    fn reply(&self, set_id: u16) -> Downlink {
        let reply = UploadReply { set_id, ..UploadReply::default() };
        Downlink::UploadReply(match (self.active, self.staging) {
            (Some((active, digest)), _) if active == set_id => {
                UploadReply { state: UploadState::Committed, digest, received_mask: 0x3FF, ..reply }
            }
            (_, Some((staged, digest, received_mask, _))) if staged == set_id => {
                UploadReply { state: UploadState::Staging, digest, received_mask, ..reply }
            }
            _ => UploadReply { state: UploadState::Refused, reason: Reason::NotBegun, ..reply },
        })
    }
}

/// What is on its way.
enum Flight {
    Up(u16, Vec<u8>),
    Down(Vec<u8>),
    Command(u8, [u16; 16]),
}

/// The bridge, its radio, and vehicles.
pub(super) struct Hall {
    pub(super) bridge: RadioBridge,
    pub(super) vehicles: Vec<FakeVehicle>,
    pub(super) loss_ratio: f64,
    /// Vehicle, instant and channels of each frame on a command link.
    pub(super) frames: Vec<(u8, Time, [u16; 16])>,
    pub(super) sent: Vec<CommandSent>,
    pub(super) telemetry: Vec<VehicleTelemetry>,
    /// All bytes to the radios.
    pub(super) transcript: Vec<DeviceBytes>,
    events: Vec<(String, Time)>,
    out: Outbox<Output>,
    flying: BTreeMap<(Time, u64), Flight>,
    flown: u64,
    radio: Decoder,
    noise: u64,
    now: Time,
    next_input: Time,
}

impl Hall {
    pub(super) fn new(scenario: &str, loss_ratio: f64) -> Self {
        Self::seeded(scenario, loss_ratio, 1)
    }

    pub(super) fn seeded(scenario: &str, loss_ratio: f64, seed: u64) -> Self {
        let vehicles = arena(scenario).fleet;
        Self {
            bridge: bridge(scenario),
            vehicles: vehicles
                .iter()
                .map(|member| FakeVehicle::new(member.vehicle.id, member.vehicle.links.data_address))
                .collect(),
            loss_ratio,
            frames: Vec::new(),
            sent: Vec::new(),
            telemetry: Vec::new(),
            transcript: Vec::new(),
            events: Vec::new(),
            out: Outbox::default(),
            flying: BTreeMap::new(),
            flown: 0,
            radio: Decoder::new(ApiMode::Escaped),
            noise: seed,
            now: ms(0),
            next_input: ms(0),
        }
    }

    /// Runs until just before `until`, with `each` every 5 ms.
    pub(super) fn run(&mut self, until: Time, mut each: impl FnMut(&mut Self, Time)) {
        loop {
            let deadline = self.bridge.deadline().unwrap_or(Time::FAR_FUTURE);
            let flight = self.flying.keys().next().map_or(Time::FAR_FUTURE, |key| key.0);
            let status =
                self.vehicles.iter().map(|vehicle| vehicle.next_status).min().unwrap_or(Time::FAR_FUTURE);
            let next = self.next_input.min(flight).min(status).min(deadline);
            if next >= until {
                break;
            }
            self.now = next.max(self.now);
            if next == self.next_input {
                self.next_input = next + Span::from_millis(5);
                each(self, next);
            } else if next == flight {
                self.land();
            } else if next == status {
                self.report(next);
            } else {
                self.bridge.step(next, Event::Deadline, &mut self.out);
                self.collect(next);
                assert!(self.bridge.deadline() > Some(next), "a deadline kept must move");
            }
        }
        self.now = until;
    }

    pub(super) fn give(&mut self, now: Time, command: VehicleCommand) {
        self.input(now, Input::Command(command));
    }

    pub(super) fn input(&mut self, now: Time, input: Input) {
        self.bridge.step(now, Event::Input(input), &mut self.out);
        self.collect(now);
    }

    pub(super) fn bytes_from_radio(&mut self, now: Time, bytes: &[u8]) {
        let bytes = bytes.try_into().expect("fits");
        self.input(now, Input::Received(DeviceBytes { port: Ports::DATA_LINK, at: now, bytes }));
    }

    /// When events of that name were reported.
    pub(super) fn events_named(&self, name: &str) -> Vec<Time> {
        self.events.iter().filter(|event| event.0 == name).map(|event| event.1).collect()
    }

    fn uniform(&mut self) -> f64 {
        self.noise =
            self.noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.noise >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Exponentially distributed with a mean of one millisecond.
    fn jitter(&mut self) -> Span {
        Span::from_secs_f64(-1e-3 * quantity::math::ln(1.0 - self.uniform()))
    }

    fn collect(&mut self, now: Time) {
        let events: Vec<_> = self.out.take_events().map(|event| (event.name.to_string(), event.at)).collect();
        self.events.extend(events);
        let messages: Vec<Output> = self.out.take_messages().collect();
        for message in messages {
            match message {
                Output::Sent(report) => self.sent.push(report),
                Output::Telemetry(report) => self.telemetry.push(report),
                Output::Transmit(bytes) => {
                    assert_eq!(bytes.at, now);
                    self.take_off(now, &bytes);
                    self.transcript.push(bytes);
                }
            }
        }
    }

    fn take_off(&mut self, now: Time, bytes: &DeviceBytes) {
        if let Some(vehicle) = Ports::vehicle_of_command_link(bytes.port) {
            let frame = sbus::Frame::decode(bytes.bytes[..].try_into().expect("25 bytes")).expect("a frame");
            self.frames.push((vehicle, now, frame.channels));
            let delay =
                self.vehicles.iter().find(|v| v.id == vehicle).map_or(Span::ZERO, |v| v.command_delay);
            self.fly(now + delay, Flight::Command(vehicle, frame.channels));
            return;
        }
        let mut payloads = Vec::new();
        self.radio.receive(&bytes.bytes, |frame| match frame {
            Frame::Transmit16 { destination, data, .. } => payloads.push((destination, data.to_vec())),
            other => panic!("the bridge sent {other:?}"),
        });
        for (destination, data) in payloads {
            if self.uniform() >= self.loss_ratio {
                let at = now + DELAY + self.jitter();
                self.fly(at, Flight::Up(destination, data));
            }
        }
    }

    fn fly(&mut self, at: Time, flight: Flight) {
        self.flown += 1;
        self.flying.insert((at, self.flown), flight);
    }

    fn land(&mut self) {
        let Some(((at, _), flight)) = self.flying.pop_first() else {
            return;
        };
        match flight {
            Flight::Command(id, channels) => {
                let (_, frame) = CommandFrame::decode(&channels).expect("sealed");
                let vehicle =
                    self.vehicles.iter_mut().find(|vehicle| vehicle.id == id).expect("of the fleet");
                if !vehicle.deaf_to_commands {
                    vehicle.command = Some((frame.counter, at));
                }
            }
            Flight::Up(destination, data) => {
                let (to, message) = Uplink::decode(&data).expect("sealed");
                let Some(index) = self.vehicles.iter().position(|vehicle| vehicle.address == destination)
                else {
                    return;
                };
                if self.vehicles[index].id != to {
                    return;
                }
                if let Some(answer) = self.vehicles[index].hear(at, message) {
                    self.send_down(at, index, &answer);
                }
            }
            Flight::Down(line) => self.bytes_from_radio(at, &line),
        }
    }

    fn report(&mut self, now: Time) {
        for index in 0..self.vehicles.len() {
            if self.vehicles[index].next_status <= now {
                self.vehicles[index].next_status = now + Span::from_millis(50);
                let status = self.vehicles[index].status(now);
                self.send_down(now, index, &Downlink::Status(status));
            }
        }
    }

    fn send_down(&mut self, now: Time, index: usize, message: &Downlink) {
        let (mut payload, mut line) = ([0; 100], [0; 300]);
        let vehicle = &self.vehicles[index];
        let length = message.encode(vehicle.id, &mut payload).expect("fits");
        let frame =
            Frame::Receive16 { source: vehicle.address, rssi: 40, options: 0, data: &payload[..length] };
        let length = frame.encode(ApiMode::Escaped, &mut line).expect("fits");
        if self.uniform() >= self.loss_ratio {
            let at = now + DELAY + self.jitter();
            self.fly(at, Flight::Down(line[..length].to_vec()));
        }
    }
}
