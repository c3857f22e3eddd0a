//! How fast the simulated arena runs: ticks of 800 Hz a second, next to the same physics written plainly.
//!
//! `plain` is the yardstick: rigid body, four lags, drag, inflow, rate loop, noise, quantiser and battery
//! over bare arrays, two Runge-Kutta substeps a tick, nothing else. `airframe` is this crate's physics,
//! `arena` all of it: physics, sensors, the vehicle's firmware, cameras, links and the bytes they make.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use device::sbus;
use device::vehicle_link::{CommandFrame, CommandMode};
use plant::airframe::Airframe;
use plant::random::{Purpose, Stream};
use plant::{Motion, Plant};
use quantity::{Span, Time, Vector, math};
use settings::{Arena, Ports};

const TICKS: u64 = 8_000;

fn arena(name: &str) -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), name)
        .expect("the shipped settings load")
}

/// The yardstick: 18 numbers of state, one function.
struct Plain {
    /// Position, velocity, quaternion w x y z, rate, thrusts.
    state: [f64; 17],
    charge: f64,
    strain: f64,
    integral: [f64; 2],
    random: Stream,
}

impl Plain {
    fn new() -> Self {
        let mut state = [0.0; 17];
        state[2] = 5.0;
        state[6] = 1.0;
        state[13..].fill(1.148);
        Self { state, charge: 1.0, strain: 0.0, integral: [0.0; 2], random: Stream::new(1, Purpose::Gyro, 1) }
    }

    fn derivative(s: &[f64; 17], command: &[f64; 4]) -> [f64; 17] {
        let (mass, arm, inertia) = (0.468, 0.17, [0.00223, 0.00223, 0.00388]);
        let [w, x, y, z] = [s[6], s[7], s[8], s[9]];
        let [p, q, r] = [s[10], s[11], s[12]];
        let up = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
        let climb = up[0] * s[3] + up[1] * s[4] + up[2] * s[5];
        let axial = [climb - arm * q, climb + arm * q, climb + arm * p, climb - arm * p];
        let mut thrust = [0.0; 4];
        for i in 0..4 {
            thrust[i] = s[13 + i] * (1.0 - 0.04 * axial[i]);
        }
        let sum = (thrust[0] + thrust[1] + thrust[2] + thrust[3]) / mass;
        let torque = [
            arm * (thrust[2] - thrust[3]) - 2e-5 * p * p.abs(),
            arm * (thrust[1] - thrust[0]) - 2e-5 * q * q.abs(),
            0.0244 * (s[13] + s[14] - s[15] - s[16]) - 2e-5 * r * r.abs(),
        ];
        let mut d = [0.0; 17];
        for i in 0..3 {
            d[i] = s[3 + i];
            d[3 + i] = up[i] * sum - 0.3 * s[3 + i];
        }
        d[5] -= 9.81;
        d[6] = -0.5 * (x * p + y * q + z * r);
        d[7] = 0.5 * (w * p + y * r - z * q);
        d[8] = 0.5 * (w * q - x * r + z * p);
        d[9] = 0.5 * (w * r + x * q - y * p);
        d[10] = (torque[0] - (inertia[2] - inertia[1]) * q * r) / inertia[0];
        d[11] = (torque[1] - (inertia[0] - inertia[2]) * p * r) / inertia[1];
        d[12] = (torque[2] - (inertia[1] - inertia[0]) * p * q) / inertia[2];
        for i in 0..4 {
            let gain = if command[i] >= s[13 + i] { 50.0 } else { 25.0 };
            d[13 + i] = gain * (command[i] - s[13 + i]);
        }
        d
    }

    fn moved(s: &[f64; 17], d: &[f64; 17], by: f64) -> [f64; 17] {
        let mut out = *s;
        for i in 0..17 {
            out[i] += d[i] * by;
        }
        out
    }

    fn substep(&mut self, command: &[f64; 4], h: f64) {
        let s = self.state;
        let k1 = Self::derivative(&s, command);
        let k2 = Self::derivative(&Self::moved(&s, &k1, 0.5 * h), command);
        let k3 = Self::derivative(&Self::moved(&s, &k2, 0.5 * h), command);
        let k4 = Self::derivative(&Self::moved(&s, &k3, h), command);
        for i in 0..17 {
            self.state[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
        let norm = math::sqrt(self.state[6..10].iter().map(|c| c * c).sum::<f64>());
        for c in &mut self.state[6..10] {
            *c /= norm;
        }
    }

    fn tick(&mut self) {
        let mut wanted = [0.0; 2];
        for (axis, wanted) in wanted.iter_mut().enumerate() {
            let reading = (1.045 * self.state[10 + axis] + 0.05 * self.random.gaussian()).clamp(-34.9, 34.9);
            self.integral[axis] = (self.integral[axis] - reading / 800.0).clamp(-1.0, 1.0);
            *wanted = 0.0023 / 0.34 * (60.0 * self.integral[axis] - 40.0 * reading);
        }
        let limit = 2.8 * (1.0 - 0.08 * self.strain - 0.03 * (1.0 - self.charge));
        let mut command = [1.2 - wanted[1], 1.2 + wanted[1], 1.2 + wanted[0], 1.2 - wanted[0]];
        for thrust in &mut command {
            let steps = math::round(200.0 * math::sqrt(thrust.clamp(0.08, 2.8) / 2.8)) / 200.0;
            *thrust = (2.8 * steps * steps).min(limit) * 0.92;
        }
        self.substep(&command, 1.25e-3 / 2.0);
        self.substep(&command, 1.25e-3 / 2.0);
        let power = self.state[13..].iter().map(|f| f * math::sqrt(*f)).sum::<f64>() / 18.74;
        self.charge = (self.charge - power * 1.25e-3 / 473.0).max(0.0);
        self.strain += (power - self.strain) * 3.12e-3;
    }
}

/// An arena with its vehicles in the air and commanded to hover.
struct Flying {
    plant: Plant,
    vehicles: Vec<u8>,
    slot_at: Time,
    counter: u8,
    bytes: usize,
}

impl Flying {
    fn new(name: &str) -> Self {
        let plant = Plant::new(&arena(name), 1, Time::ZERO).expect("the shipped settings fly");
        let vehicles: Vec<u8> = plant.vehicles().collect();
        let mut flying = Self { plant, vehicles, slot_at: Time::ZERO, counter: 0, bytes: 0 };
        flying.run(CommandMode::Disarmed, 5);
        flying.run(CommandMode::Fly, 5);
        flying.lift();
        flying
    }

    fn lift(&mut self) {
        for id in &self.vehicles {
            self.plant.place(*id, Motion::at_rest(Vector::new(0.0, 0.0, 8.0), 0.0));
        }
    }

    fn run(&mut self, mode: CommandMode, slots: usize) {
        for _ in 0..slots {
            let bytes = &mut self.bytes;
            self.plant.advance(self.slot_at, &mut |output| *bytes += output.bytes.len());
            self.counter = CommandFrame::next_counter(self.counter);
            for id in &self.vehicles {
                let frame = CommandFrame {
                    mode,
                    counter: self.counter,
                    collective_m_s2: if mode == CommandMode::Fly { 10.7 } else { 0.0 },
                    rate_rad_s: Vector::ZERO,
                    attitude_valid: true,
                    height_valid: true,
                    roll_rad: 0.0,
                    pitch_rad: 0.0,
                    height_m: 5.0,
                    vertical_speed_m_s: 0.0,
                    epoch_low: 0,
                };
                let channels = frame.encode(*id).expect("a valid frame");
                self.plant.receive(
                    self.slot_at,
                    Ports::command_link(*id),
                    &sbus::Frame::new(channels).encode(),
                );
            }
            self.slot_at += Span::from_millis(20);
        }
    }
}

fn benches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ticks");
    group.throughput(Throughput::Elements(TICKS));
    let mut plain = Plain::new();
    group.bench_function("plain", |bencher| {
        bencher.iter(|| (0..TICKS).for_each(|_| black_box(&mut plain).tick()));
    });
    let member = arena("double-flip").fleet.remove(0);
    let mut airframe = Airframe::new(&member, 1, 1.25e-3, &mut Stream::new(1, Purpose::Build, 1));
    airframe.place(Motion::at_rest(Vector::new(0.0, 0.0, 5.0), 0.0), [1.148; 4]);
    group.bench_function("airframe", |bencher| {
        bencher.iter(|| {
            airframe.place(Motion::at_rest(Vector::new(0.0, 0.0, 5.0), 0.0), [1.148; 4]);
            for tick in 0..TICKS {
                airframe.command(black_box([134, 134, 133, 133 + (tick & 1) as u8]));
                airframe.step();
            }
        });
    });
    for (label, scenario) in [("arena, one vehicle", "double-flip"), ("arena, three vehicles", "fleet")] {
        let mut flying = Flying::new(scenario);
        let vehicles = flying.vehicles.len() as u64;
        group.throughput(Throughput::Elements(800 * vehicles));
        group.bench_function(label, |bencher| {
            bencher.iter(|| {
                flying.lift();
                flying.run(CommandMode::Fly, 50);
            });
        });
        assert!(flying.bytes > 0);
    }
    let mut standing = Flying::new("double-flip");
    standing.plant =
        Plant::new(&arena("double-flip"), 1, standing.slot_at).expect("the shipped settings fly");
    group.throughput(Throughput::Elements(800));
    group.bench_function("arena, one vehicle standing", |bencher| {
        bencher.iter(|| standing.run(CommandMode::Disarmed, 50));
    });
    group.finish();
}

criterion_group!(arena_benches, benches);
criterion_main!(arena_benches);
