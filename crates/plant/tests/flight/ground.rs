//! A ground station for tests: it knows the truth, speaks only device bytes, and flies by simple means.

use std::path::Path;

use device::sbus;
use device::vehicle_link::{
    CommandFrame, CommandMode, Downlink, FlipSet, ManeuverPhase, Status, Uplink, roll_pitch_rad,
};
use device::xbee::{ApiMode, Decoder, Frame};
use plant::{Device, Motion, Plant};
use quantity::{Body, GRAVITY_M_S2, Rotation, Span, Time, Vector, World, math};
use settings::{Arena, Ports};

/// The shipped arena with the double flip.
pub fn arena() -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), "double-flip")
        .expect("the shipped settings load")
}

/// The same with vehicles that are what everybody believes.
pub fn ideal_arena() -> Arena {
    let mut arena = arena();
    for member in &mut arena.fleet {
        member.vehicle.plant.remove_departures(&member.vehicle.rotor);
    }
    arena
}

/// Where a vehicle is to be.
#[derive(Clone, Copy)]
pub enum Goal {
    /// Motors off.
    Rest,
    /// Hover there.
    Hover(Vector<World>),
    /// Descend by itself.
    Descend,
}

/// One vehicle's ground station.
pub struct Ground {
    pub plant: Plant,
    pub goal: Goal,
    pub statuses: Vec<(Time, Status)>,
    pub vicon: Vec<(Time, Vec<u8>)>,
    /// Every byte that came out, with its time.
    pub digest: u64,
    id: u8,
    address: u16,
    mass_to_hover: f64,
    counter: u8,
    decoder: Decoder,
    slot_at: Time,
    integral_m_s: f64,
}

const SLOT: Span = Span::from_millis(20);

impl Ground {
    pub fn new(arena: &Arena, seed: u64) -> Self {
        let start = Time::ZERO + Span::from_secs(100);
        let vehicle = &arena.fleet[0].vehicle;
        Self {
            plant: Plant::new(arena, seed, start).expect("the shipped settings fly"),
            goal: Goal::Rest,
            statuses: Vec::new(),
            vicon: Vec::new(),
            digest: 0xCBF2_9CE4_8422_2325,
            id: vehicle.id,
            address: vehicle.links.data_address,
            mass_to_hover: 1.0 / vehicle.plant.rotor.thrust_ratio * vehicle.plant.body.mass_ratio,
            counter: 0,
            decoder: Decoder::new(ApiMode::Escaped),
            slot_at: start,
            integral_m_s: 0.0,
        }
    }

    pub fn motion(&self) -> Motion {
        self.plant.truth(self.id).expect("the vehicle exists").motion
    }

    /// The last status heard.
    pub fn status(&self) -> Status {
        self.statuses.last().expect("a status was heard").1
    }

    /// Lets time pass, a command frame in every slot.
    pub fn run(&mut self, seconds: f64) {
        let until = self.plant.now() + Span::from_secs_f64(seconds);
        while self.slot_at <= until {
            let slot = self.slot_at;
            self.advance(slot);
            let channels = self.command().encode(self.id).expect("a valid frame");
            self.plant.receive(slot, Ports::command_link(self.id), &sbus::Frame::new(channels).encode());
            self.slot_at += SLOT;
        }
        self.advance(until);
    }

    fn advance(&mut self, until: Time) {
        let Self { plant, statuses, vicon, digest, decoder, id, .. } = self;
        // By its own events, as an event queue would.
        loop {
            let event = plant.next_event();
            let now = event.min(until);
            plant.advance(now, &mut |output| {
                let stamp = output.at.as_nanos().to_le_bytes();
                for byte in stamp.iter().chain(output.bytes) {
                    *digest = (*digest ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3);
                }
                match output.device {
                    Device::MotionCapture => vicon.push((output.at, output.bytes.to_vec())),
                    Device::DataLink => decoder.receive(output.bytes, |frame| {
                        if let Frame::Receive16 { data, .. } = frame
                            && let Ok((from, Downlink::Status(status))) = Downlink::decode(data)
                        {
                            assert_eq!(from, *id);
                            statuses.push((output.at, status));
                        }
                    }),
                    other => panic!("{other:?} has nothing to say in this arena"),
                }
            });
            if event > until {
                return;
            }
        }
    }

    fn command(&mut self) -> CommandFrame {
        self.counter = CommandFrame::next_counter(self.counter);
        let motion = self.motion();
        let (roll_rad, pitch_rad) = roll_pitch_rad(motion.orientation);
        let frame = CommandFrame {
            mode: CommandMode::Disarmed,
            counter: self.counter,
            collective_m_s2: 0.0,
            rate_rad_s: Vector::ZERO,
            attitude_valid: true,
            height_valid: true,
            roll_rad,
            pitch_rad,
            height_m: motion.position_m.z,
            vertical_speed_m_s: motion.velocity_m_s.z,
            epoch_low: 0,
        };
        match self.goal {
            Goal::Rest => frame,
            Goal::Descend => CommandFrame { mode: CommandMode::Descend, ..frame },
            Goal::Hover(place) => {
                let (collective_m_s2, rate_rad_s) = self.hover(&motion, place);
                CommandFrame { mode: CommandMode::Fly, collective_m_s2, rate_rad_s, ..frame }
            }
        }
    }

    /// Position to acceleration to attitude to rate, all proportional; good enough to hover with the truth.
    fn hover(&mut self, motion: &Motion, place: Vector<World>) -> (f64, Vector<Body>) {
        let away = (place - motion.position_m).limited(1.0);
        self.integral_m_s = (self.integral_m_s + away.z * SLOT.as_secs_f64()).clamp(-3.0, 3.0);
        let wanted = away * 4.0 - motion.velocity_m_s * 3.2
            + Vector::new(0.0, 0.0, GRAVITY_M_S2 * self.mass_to_hover + self.integral_m_s);
        let up = motion.orientation.z_axis();
        let tilt = up.cross(wanted.direction().unwrap_or(Vector::Z));
        let heading: Rotation<Body, World> = motion.orientation;
        let turn = heading.inverse() * tilt * 6.0;
        let rate = Vector::new(turn.x, turn.y, -1.5 * motion.orientation.yaw_rad()).limited(6.0);
        (wanted.dot(up).clamp(2.0, 18.0), rate)
    }

    /// Switches on, takes the vehicle to its place without flying there, and steadies it.
    pub fn hover_at(&mut self, place: Vector<World>) {
        self.run(0.3);
        self.goal = Goal::Hover(place);
        self.run(0.1);
        self.plant.place(self.id, Motion::at_rest(place, 0.0));
        self.run(4.0);
    }

    /// Sends a message by the data link.
    pub fn send(&mut self, message: &Uplink) {
        let (mut payload, mut serial) = ([0; 100], [0; 300]);
        let length = message.encode(self.id, &mut payload).expect("a payload's room");
        let frame = Frame::Transmit16 {
            frame_id: 1,
            destination: self.address,
            options: 0,
            data: &payload[..length],
        };
        let length = frame.encode(ApiMode::Escaped, &mut serial).expect("a frame's room");
        self.plant.receive(self.plant.now(), Ports::DATA_LINK, &serial[..length]);
    }

    /// Uploads a set and flies it; the frames are repeated, since links lose some.
    pub fn flip(&mut self, maneuver_id: u16, set: &FlipSet) -> plant::ManeuverTruth {
        for _ in 0..5 {
            for message in Uplink::upload(maneuver_id, set) {
                self.send(&message);
                self.run(0.02);
            }
            self.run(0.1);
        }
        assert_eq!(self.status().set_digest, set.digest(), "the upload arrived");
        for _ in 0..4 {
            self.send(&Uplink::Start { maneuver_id, set_id: maneuver_id, digest: set.digest() });
            self.run(0.03);
        }
        self.run(2.5);
        let status = self.status();
        assert_ne!(status.maneuver_phase, ManeuverPhase::Refused, "{:?}", status.reason);
        let truths = self.plant.maneuver_truths();
        assert_eq!(truths.len(), 1, "one maneuver was flown");
        truths[0]
    }
}

/// A root of the mean square.
pub fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    math::sqrt(values.map(|value| value * value).sum::<f64>() / count)
}
