//! Tests of the whole firmware, on a bench that knows just enough physics.

mod arming;
mod closed_loop;
mod failsafe;
mod maneuvers;
mod robustness;

use device::vehicle_link::{
    CommandFrame, CommandMode, Downlink, FlightMode, FlipSet, PAYLOAD_BYTES_MAX, Status, Uplink, UploadReply,
};
use quantity::{GRAVITY_M_S2, Span, Time, Vector};
use std::vec::Vec;

use crate::{Firmware, FirmwareSettings, ImuSample, TICK};

/// The double flip of the model at 1600 deg/s.
pub const DOUBLE: FlipSet = FlipSet {
    u1_m_s2: 20.39544,
    t1_s: 0.16092,
    t3_s: 0.27833,
    u5_m_s2: 20.30911,
    t5_s: 0.18268,
    rate_rad_s_max: 27.925_268,
    envelope_low_m_s2: 3.589_744,
    envelope_high_m_s2: 21.025_64,
    lever_m: 0.057_818,
    flips: 2.0,
};

pub const VEHICLE: u8 = 3;

/// A firmware on a vehicle that moves up and down, over a floor if it has one.
pub struct Bench {
    pub firmware: Firmware,
    pub now: Time,
    pub imu: ImuSample,
    /// What the ground sends, with hints filled in from the truth.
    pub frame: CommandFrame,
    /// Whether the ground sends.
    pub linked: bool,
    pub floor: bool,
    pub height_m: f64,
    pub speed_m_s: f64,
    /// When the newest frame was sent.
    pub sent: Time,
    next_frame: Time,
}

impl Bench {
    pub fn new(settings: FirmwareSettings) -> Self {
        let rest = Vector::new(0.0, 0.0, GRAVITY_M_S2);
        Self {
            firmware: Firmware::new(FirmwareSettings { vehicle: VEHICLE, ..settings }).unwrap(),
            now: Time::ZERO + Span::from_secs(1),
            imu: ImuSample { rate_rad_s: Vector::ZERO, acceleration_m_s2: rest, battery_v: 11.5 },
            frame: CommandFrame { attitude_valid: true, height_valid: true, ..CommandFrame::default() },
            linked: true,
            floor: true,
            height_m: 0.0,
            speed_m_s: 0.0,
            sent: Time::ZERO,
            next_frame: Time::ZERO,
        }
    }

    /// Armed and hovering at this height, as if it had always been there.
    pub fn hovering_at(height_m: f64) -> Self {
        Self::new(FirmwareSettings::table_i(VEHICLE)).brought_to(height_m)
    }

    pub fn brought_to(mut self, height_m: f64) -> Self {
        self.run(Span::from_millis(100));
        (self.height_m, self.speed_m_s) = (height_m, 0.0);
        self.fly(GRAVITY_M_S2);
        self.run(Span::from_millis(400));
        assert_eq!(self.firmware.mode(), FlightMode::Flying);
        self
    }

    /// From the next frame on the ground commands this collective.
    pub fn fly(&mut self, collective_m_s2: f64) {
        (self.frame.mode, self.frame.collective_m_s2) = (CommandMode::Fly, collective_m_s2);
    }

    pub fn send_frame(&mut self) {
        self.frame.counter = CommandFrame::next_counter(self.frame.counter);
        (self.frame.height_m, self.frame.vertical_speed_m_s) = (self.height_m, self.speed_m_s);
        self.firmware.receive_channels(self.now, &self.frame.encode(VEHICLE).unwrap());
        self.sent = self.now;
    }

    pub fn uplink(&mut self, message: &Uplink) {
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let length = message.encode(VEHICLE, &mut payload).unwrap();
        self.firmware.receive_payload(self.now, &payload[..length]);
    }

    pub fn upload(&mut self, set_id: u16, set: &FlipSet) {
        for message in Uplink::upload(set_id, set) {
            self.uplink(&message);
        }
    }

    pub fn start(&mut self, maneuver_id: u16, set_id: u16, set: &FlipSet) {
        self.uplink(&Uplink::Start { maneuver_id, set_id, digest: set.digest() });
    }

    pub fn downlink(&mut self) -> Vec<Downlink> {
        let mut messages = Vec::new();
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        while let Some(length) = self.firmware.poll_transmit(self.now, &mut payload) {
            let (vehicle, message) = Downlink::decode(&payload[..length]).unwrap();
            assert_eq!(vehicle, VEHICLE);
            messages.push(message);
        }
        messages
    }

    pub fn upload_reply(&mut self) -> UploadReply {
        let mut replies = self.downlink().into_iter().filter_map(|message| match message {
            Downlink::UploadReply(reply) => Some(reply),
            _ => None,
        });
        replies.next_back().unwrap()
    }

    pub fn status(&self) -> Status {
        self.firmware.status(self.now)
    }

    /// One tick; the ground's frame first, if one is due. No test flies for a minute: one that waits for what
    /// does not come ends here.
    pub fn tick(&mut self) -> [u8; 4] {
        assert!(self.now < Time::ZERO + Span::from_secs(60), "still {:?}", self.firmware.mode());
        if self.linked && self.now >= self.next_frame {
            self.send_frame();
            self.next_frame = self.now + Span::from_millis(20);
        }
        let commands = self.firmware.tick(self.now, &self.imu);
        self.move_by(commands);
        self.now += TICK;
        commands
    }

    /// Full thrust at once and no drag; on the floor what it carries, and the blow of arriving.
    fn move_by(&mut self, commands: [u8; 4]) {
        let dt = TICK.as_secs_f64();
        let thrust_n: f64 = commands
            .iter()
            .map(|command| f64::from(*command) / 200.0)
            .map(|speed_ratio| 2.8 * speed_ratio * speed_ratio)
            .sum();
        let mut force = thrust_n / 0.468;
        let speed = self.speed_m_s + (force - GRAVITY_M_S2) * dt;
        if self.floor && self.height_m + speed * dt <= 0.0 {
            force -= speed / dt;
            (self.height_m, self.speed_m_s) = (0.0, 0.0);
        } else {
            self.speed_m_s = speed;
            self.height_m += speed * dt;
        }
        self.imu.acceleration_m_s2 = Vector::new(0.0, 0.0, force.min(150.0));
    }

    pub fn run(&mut self, span: Span) {
        let until = self.now + span;
        while self.now < until {
            self.tick();
        }
    }

    /// Ticks until this mode, and answers the time of the tick that brought it.
    pub fn run_until(&mut self, mode: FlightMode, at_most: Span) -> Time {
        let until = self.now + at_most;
        loop {
            let at = self.now;
            self.tick();
            if self.firmware.mode() == mode {
                return at;
            }
            assert!(self.now < until, "not {mode:?} but {:?}", self.firmware.mode());
        }
    }
}

pub const fn millis(millis: i64) -> Span {
    Span::from_millis(millis)
}
