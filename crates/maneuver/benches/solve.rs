//! From the rough guess to P0 and J of a triple flip at 1600 deg/s, against plain code doing the same amount
//! of work.
//!
//! The plain code flies 132 flips at 800 Hz with one Runge-Kutta step per tick, which is what a
//! straightforward solver needs on that grid. `solve` ends on a grid sixteen times finer. Run with `cargo
//! bench -p maneuver`; the last line gives the ratio.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group};
use maneuver::{Discretisation, Envelope, FlipDesign, Model, Parameters, Primitive, solve};

/// Flips the plain solver flies.
const PLAIN_FLIPS: u32 = 132;

/// Runs per side of the ratio; the fastest counts, being the least disturbed.
const RATIO_RUNS: u32 = 40;

fn triple() -> FlipDesign {
    let envelope = Envelope::with_margin(&Model::TABLE_I, Envelope::MARGIN).expect("the usual margin");
    FlipDesign { flips: 3, rate_rad_s_max: 1600f64.to_radians(), envelope }
}

/// The solution's parameters, so that both sides fly flips of the same length.
fn triple_parameters() -> Parameters {
    Parameters { u1_m_s2: 20.79507, t1_s: 0.25931, t3_s: 0.50143, u5_m_s2: 20.75617, t5_s: 0.27774 }
}

fn solve_triple() -> f64 {
    let solution = solve(&Model::TABLE_I, black_box(&triple()), Discretisation::Continuous);
    solution.expect("a triple at 1600 deg/s is feasible").condition
}

fn plain_flips() -> f64 {
    let model = Model::TABLE_I;
    let primitive = Primitive::new(&triple(), model.alpha_l_m(), &triple_parameters()).expect("a flip");
    (0..PLAIN_FLIPS).map(|_| plain_flip(&model, black_box(&primitive))).sum()
}

/// One flip as anybody would write it: nine states, textbook Runge-Kutta, commands held over each 800 Hz
/// tick.
fn plain_flip(model: &Model, primitive: &Primitive) -> f64 {
    let hover = model.hover_thrust_n();
    let mut state = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, hover, hover];
    let mut integral = 0.0;
    let ticks = (primitive.duration_s() * 800.0) as u32;
    let h = 1.0 / 800.0;
    for tick in 0..ticks {
        let setpoint = primitive.sample(f64::from(tick) * h);
        let error = setpoint.rate_rad_s - state[5];
        integral += error * h;
        let acceleration = model.rate_gain_p_1_s * error + model.rate_gain_i_1_s2 * integral;
        let share = model.mass_kg * setpoint.collective_m_s2 / 4.0;
        let difference = model.inertia_kg_m2 * acceleration / (2.0 * model.arm_m);
        let wanted = [share + difference, share - difference];
        let wanted = wanted.map(|thrust| thrust.clamp(model.thrust_n_min, model.thrust_n_max));
        let k1 = slope(model, &state, &wanted);
        let k2 = slope(model, &advanced(&state, &k1, h / 2.0), &wanted);
        let k3 = slope(model, &advanced(&state, &k2, h / 2.0), &wanted);
        let k4 = slope(model, &advanced(&state, &k3, h), &wanted);
        for index in 0..8 {
            state[index] += h / 6.0 * (k1[index] + 2.0 * k2[index] + 2.0 * k3[index] + k4[index]);
        }
    }
    state[0]
}

/// The platform's own sine, as plain code would use, is the faster choice here.
#[allow(clippy::disallowed_methods)]
fn slope(model: &Model, state: &[f64; 8], wanted: &[f64; 2]) -> [f64; 8] {
    let [_, _, vx, vz, theta, rate, a, b] = *state;
    let collective = 2.0 * (a + b) / model.mass_kg;
    let (sine, cosine) = theta.sin_cos();
    let lag = |wanted: f64, thrust: f64| {
        let gain = if wanted >= thrust { model.rotor_gain_up_1_s } else { model.rotor_gain_down_1_s };
        gain * (wanted - thrust)
    };
    [
        vx,
        vz,
        collective * sine,
        collective * cosine - 9.81,
        rate,
        model.arm_m * (a - b) / model.inertia_kg_m2,
        lag(wanted[0], a),
        lag(wanted[1], b),
    ]
}

fn advanced(state: &[f64; 8], slope: &[f64; 8], h: f64) -> [f64; 8] {
    std::array::from_fn(|index| state[index] + h * slope[index])
}

fn solving(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("triple 1600 deg/s");
    group.bench_function("solve: P0 and J, continuous model", |bencher| bencher.iter(solve_triple));
    group.bench_function("plain: 132 flips at 800 Hz", |bencher| bencher.iter(plain_flips));
    group.finish();
}

fn fastest(work: fn() -> f64) -> Duration {
    let run = |_| {
        let start = Instant::now();
        black_box(work());
        start.elapsed()
    };
    (0..RATIO_RUNS).map(run).min().unwrap_or_default()
}

criterion_group!(benches, solving);

fn main() {
    benches();
    let (solve, plain) = (fastest(solve_triple), fastest(plain_flips));
    println!("plain {plain:?} / solve {solve:?} = {:.2}", plain.as_secs_f64() / solve.as_secs_f64());
}
