//! For tests: the repository's settings, and a small vehicle with cameras and a command link around it.
//!
//! The vehicle is written down anew rather than taken from [`crate::model`], so that a mistake there shows.

use std::collections::VecDeque;
use std::path::Path;

use quantity::{Body, Rotation, Span, Time, Vector, World, math};
use schemas::{
    CommandMode, CommandSent, FlightMode, Kinematics, ManeuverPhase, MocapBody, MocapFrame, VehicleState,
    VehicleTelemetry,
};
use service_core::{Core, Event, Outbox, Seed, Start};
use settings::{Arena, Vehicle};

use crate::{Estimator, Input, Output, Tuning};

/// The double-flip arena for one vehicle, the fleet's for more.
pub(crate) fn arena(vehicles: usize) -> Arena {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let name = if vehicles == 1 { "double-flip" } else { "fleet" };
    let mut arena = Arena::load(&folder, name).expect("the repository's settings load");
    arena.fleet.truncate(vehicles);
    arena
}

/// The first vehicle of that arena.
pub(crate) fn vehicle() -> Vehicle {
    arena(1).fleet.remove(0).vehicle
}

/// Uniform and normal numbers from a seed.
pub(crate) struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let radius = math::sqrt(-2.0 * math::ln(1.0 - self.uniform()));
        radius * math::cos(core::f64::consts::TAU * self.uniform())
    }

    pub fn vector<F: quantity::Frame>(&mut self, sigma: f64) -> Vector<F> {
        Vector::new(self.normal() * sigma, self.normal() * sigma, self.normal() * sigma)
    }
}

/// A command as the vehicle flies it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flown {
    pub collective_m_s2: f64,
    pub rate_rad_s: Vector<Body>,
}

/// How the truth departs from what the estimator believes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Departures {
    pub thrust_ratio: f64,
    pub drag_1_s: f64,
    pub gyro_scale: f64,
    pub gust_m_s2: f64,
    pub position_noise_m: f64,
    pub attitude_noise_rad: f64,
    pub dropout: f64,
}

impl Departures {
    /// Those of the repository's vehicle.
    pub const USUAL: Self = Self {
        thrust_ratio: 0.92,
        drag_1_s: 0.3,
        gyro_scale: 1.045,
        gust_m_s2: 0.1,
        position_noise_m: 0.0005,
        attitude_noise_rad: 0.003,
        dropout: 0.001,
    };
}

/// Simulation tick.
const TICK: Span = Span::from_micros(250);

/// The estimator in a loop with one true vehicle.
pub(crate) struct Loop {
    pub now: Time,
    pub truth: Kinematics,
    pub estimator: Estimator,
    pub states: Vec<VehicleState>,
    pub events: Vec<String>,
    pub dice: Dice,
    /// Changes what the cameras report; `None` for an occluded vehicle.
    pub see: Box<dyn FnMut(Time, MocapBody) -> Option<MocapBody>>,
    thrust_n: [f64; 4],
    gust: Vector<World>,
    departures: Departures,
    mocap_latency: Span,
    command_delay: Span,
    frames: VecDeque<(Time, MocapFrame)>,
    queue: VecDeque<(Time, Flown)>,
    /// What the vehicle flies just now; a test may put a maneuver's commands here and take the queue away.
    pub flown: Flown,
    pub radio: bool,
    /// Added to the frames' stamps.
    pub stamp_error: Span,
    pub obeying: bool,
    pub history: Vec<(Time, Kinematics)>,
}

impl Loop {
    /// A hovering vehicle at 4 m; total delay as given.
    pub fn new(tuning: Tuning, departures: Departures, mocap_latency_ms: i64, command_delay_ms: i64) -> Self {
        let mut arena = arena(1);
        let links = &mut arena.fleet[0].vehicle.links;
        links.mocap_latency_s = mocap_latency_ms as f64 * 1e-3;
        links.command_delay_s = command_delay_ms as f64 * 1e-3;
        let now = Time::from_nanos(1_000_000_000);
        let start = Start { at: now, seed: Seed(1), incarnation: 1 };
        let truth = Kinematics { position_m: Vector::new(0.0, 0.0, 4.0), ..Kinematics::default() };
        let hover = Flown { collective_m_s2: 9.81 / departures.thrust_ratio, rate_rad_s: Vector::ZERO };
        Self {
            now,
            truth,
            estimator: Estimator::new(&arena, tuning, start).expect("the default tuning is sound"),
            states: Vec::new(),
            events: Vec::new(),
            dice: Dice::new(5),
            see: Box::new(|_, body| Some(body)),
            thrust_n: [0.468 * hover.collective_m_s2 / 4.0; 4],
            gust: Vector::ZERO,
            departures,
            mocap_latency: Span::from_millis(mocap_latency_ms),
            command_delay: Span::from_millis(command_delay_ms),
            frames: VecDeque::new(),
            queue: VecDeque::new(),
            flown: hover,
            radio: true,
            stamp_error: Span::ZERO,
            obeying: true,
            history: Vec::new(),
        }
    }

    pub fn seconds(&self) -> f64 {
        (self.now - Time::from_nanos(1_000_000_000)).as_secs_f64()
    }

    /// Steps the estimator with a message.
    pub fn hear(&mut self, input: impl Into<Input>) {
        let mut out = Outbox::default();
        self.estimator.step(self.now, Event::Input(input.into()), &mut out);
        self.drain(&mut out);
    }

    fn drain(&mut self, out: &mut Outbox<Output>) {
        self.events.extend(out.take_events().map(|event| event.name.to_string()));
        self.states.extend(out.take_messages().map(|Output::State(state)| state));
    }

    /// Tells the estimator of a maneuver.
    pub fn report(&mut self, phase: ManeuverPhase, began_at: Time, ended_at: Time) {
        self.hear(VehicleTelemetry {
            vehicle: 1,
            mode: if phase == ManeuverPhase::Running { FlightMode::Maneuver } else { FlightMode::Flying },
            maneuver_phase: phase,
            maneuver_id: 1,
            began_at,
            ended_at,
            received_at: self.now,
            ..VehicleTelemetry::default()
        });
    }

    /// Lets `seconds` pass; `pilot` says in each radio slot what to send.
    pub fn fly(&mut self, seconds: f64, mut pilot: impl FnMut(f64, &Kinematics) -> Flown) {
        let end = self.now + Span::from_secs_f64(seconds);
        while self.now < end {
            let nanos = self.now.as_nanos();
            if nanos % 20_000_000 == 0 && self.radio {
                let flown = pilot(self.seconds(), &self.truth);
                self.queue.push_back((self.now + self.command_delay, flown));
                let sent = CommandSent {
                    vehicle: 1,
                    mode: CommandMode::Fly,
                    sent_at: self.now,
                    next_slot_at: self.now + Span::from_millis(20),
                    link_delay_s: self.command_delay.as_secs_f64(),
                    collective_m_s2: flown.collective_m_s2,
                    rate_rad_s: flown.rate_rad_s,
                    ..CommandSent::default()
                };
                self.hear(sent);
            }
            if nanos % 5_000_000 == 0 {
                self.expose();
            }
            while self.frames.front().is_some_and(|(at, _)| *at <= self.now) {
                let (_, frame) = self.frames.pop_front().expect("just seen");
                self.hear(frame);
            }
            if self.estimator.deadline().is_some_and(|at| at <= self.now) {
                let mut out = Outbox::default();
                self.estimator.step(self.now, Event::Deadline, &mut out);
                self.drain(&mut out);
            }
            self.history.push((self.now, self.truth));
            self.tick();
        }
    }

    fn expose(&mut self) {
        let noise = self.departures;
        let turn = self.dice.vector(noise.attitude_noise_rad);
        let body = MocapBody {
            vehicle: 1,
            position_m: self.truth.position_m + self.dice.vector(noise.position_noise_m),
            orientation: self.truth.orientation.turned(turn),
            ..MocapBody::default()
        };
        let dropped = self.dice.uniform() < noise.dropout;
        let body = if dropped { None } else { (self.see)(self.now, body) };
        let arrives_at = self.now + self.mocap_latency;
        let bodies: Vec<MocapBody> = body.into_iter().collect();
        let frame = MocapFrame {
            frame: 0,
            exposed_at: self.now + self.stamp_error,
            received_at: arrives_at,
            latency_s: self.mocap_latency.as_secs_f64(),
            bodies: bodies.try_into().expect("one body fits"),
        };
        self.frames.push_back((arrives_at, frame));
    }

    fn tick(&mut self) {
        let h = TICK.as_secs_f64();
        self.now += TICK;
        while self.queue.front().is_some_and(|(at, _)| *at <= self.now) {
            let (_, flown) = self.queue.pop_front().expect("just seen");
            if self.obeying {
                self.flown = flown;
            }
        }
        let d = self.departures;
        let (mass, arm, inertia, drag_torque) = (0.468, 0.17, [0.0023, 0.0023, 0.004], 0.0244);
        let error = self.flown.rate_rad_s - self.truth.rate_rad_s * d.gyro_scale;
        let each = mass * self.flown.collective_m_s2 / 4.0;
        let roll = inertia[0] * 40.0 * error.x / (2.0 * arm);
        let pitch = inertia[1] * 40.0 * error.y / (2.0 * arm);
        let yaw = inertia[2] * 8.0 * error.z / (4.0 * drag_torque);
        let yaw = yaw.clamp(-0.2, 0.2);
        let wanted = [each - pitch + yaw, each + pitch + yaw, each + roll - yaw, each - roll - yaw];
        for (thrust, wanted) in self.thrust_n.iter_mut().zip(wanted) {
            let wanted = wanted.clamp(0.08, 2.8);
            *thrust += h * if wanted > *thrust { 50.0 } else { 25.0 } * (wanted - *thrust);
        }
        let [front, back, left, right] = self.thrust_n.map(|thrust| thrust * d.thrust_ratio);
        let t = &mut self.truth;
        let angular = Vector::new(
            arm * (left - right) / inertia[0],
            arm * (back - front) / inertia[1],
            drag_torque * (front + back - left - right) / inertia[2],
        );
        t.rate_rad_s += angular * h;
        t.orientation = t.orientation.turned(t.rate_rad_s * h);
        self.gust = self.gust * (1.0 - h) + self.dice.vector(d.gust_m_s2 * math::sqrt(2.0 * h));
        let specific = (front + back + left + right) / mass;
        let acceleration =
            t.orientation.z_axis() * specific - Vector::Z * 9.81 - t.velocity_m_s * d.drag_1_s + self.gust;
        t.position_m += t.velocity_m_s * h;
        t.velocity_m_s += acceleration * h;
    }

    /// The truth at an instant of the past.
    pub fn truth_at(&self, at: Time) -> Option<&Kinematics> {
        let index = self.history.partition_point(|(known, _)| *known < at);
        self.history.get(index).filter(|(known, _)| (*known - at).abs() < TICK).map(|(_, truth)| truth)
    }
}

/// A pilot that sees the truth and follows a moving point.
pub(crate) fn follow(
    truth: &Kinematics,
    position: Vector<World>,
    velocity: Vector<World>,
    acceleration: Vector<World>,
) -> Flown {
    let wanted = acceleration
        + (position - truth.position_m) * 4.0
        + (velocity - truth.velocity_m_s) * 3.0
        + Vector::Z * 9.81 * (1.0 / 0.92)
        + truth.velocity_m_s * 0.3;
    let axis = truth.orientation.inverse() * wanted.direction().unwrap_or(Vector::Z);
    let yaw = truth.orientation.yaw_rad();
    Flown {
        collective_m_s2: wanted.dot(truth.orientation.z_axis()).clamp(1.0, 22.0),
        rate_rad_s: Vector::new(-axis.y * 6.0, axis.x * 6.0, -yaw),
    }
}

/// Hover at 4 m over the origin.
pub(crate) fn hover(_: f64, truth: &Kinematics) -> Flown {
    follow(truth, Vector::new(0.0, 0.0, 4.0), Vector::ZERO, Vector::ZERO)
}

/// 2 m/s on a circle of 1.5 m radius.
pub(crate) fn circle(seconds: f64, truth: &Kinematics) -> Flown {
    let omega = 2.0 / 1.5;
    let (sin, cos) = math::sin_cos(omega * seconds);
    let position = Vector::new(1.5 * cos, 1.5 * sin, 4.0);
    let velocity = Vector::new(-2.0 * sin, 2.0 * cos, 0.0);
    follow(truth, position, velocity, Vector::new(cos, sin, 0.0) * (-1.5 * omega * omega))
}

/// A turned copy of a body: a symmetry of the marker triangle.
pub(crate) fn turned(mut body: MocapBody, turn: Vector<Body>) -> MocapBody {
    body.orientation = body.orientation * Rotation::from_rotation_vector(turn);
    body
}
