//! The flip again, written down once more in two dimensions: what the simulated vehicle must agree with where
//! it has no departures. Shares no code with the crate under test but the primitive.

use maneuver::{Envelope, FlipDesign, Model, Parameters, Primitive};
use quantity::{GRAVITY_M_S2, math};

/// Position, velocity, pitch, rate, and the thrusts of front, back and both sides.
pub type State = [f64; 9];

const MASS: f64 = 0.468;
const ARM: f64 = 0.17;
const INERTIA: f64 = 0.0023;

fn slope(s: &State, asked: &[f64; 3]) -> State {
    let [_, _, vx, vz, theta, rate, front, back, side] = *s;
    let collective = (front + back + 2.0 * side) / MASS;
    let lag = |now: f64, to: f64| {
        if to >= now { 50.0 * (to - now) } else { 25.0 * (to - now) }
    };
    [
        vx,
        vz,
        collective * math::sin(theta),
        collective * math::cos(theta) - GRAVITY_M_S2,
        rate,
        ARM * (back - front) / INERTIA,
        lag(front, asked[0]),
        lag(back, asked[1]),
        lag(side, asked[2]),
    ]
}

fn substep(s: &mut State, asked: &[f64; 3], h: f64) {
    let moved = |d: &State, by: f64| -> State { core::array::from_fn(|i| s[i] + d[i] * by) };
    let k1 = slope(s, asked);
    let k2 = slope(&moved(&k1, 0.5 * h), asked);
    let k3 = slope(&moved(&k2, 0.5 * h), asked);
    let k4 = slope(&moved(&k3, h), asked);
    *s = core::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
}

/// A motor command's 200 steps of speed.
fn quantised(thrust: f64) -> f64 {
    let steps = math::round(200.0 * math::sqrt(thrust / 2.8)) / 200.0;
    2.8 * steps * steps
}

/// Flies a flip from a state with an 800 Hz rate loop whose integral is never held back.
pub fn fly(mut s: State, design: &FlipDesign, parameters: &Parameters) -> State {
    let primitive = Primitive::new(design, Model::TABLE_I.alpha_l_m(), parameters).expect("a flip");
    let (mut t, mut sum) = (0.0, 0.0);
    while t < primitive.duration_s() {
        let command = primitive.sample(t);
        let error = command.rate_rad_s - s[5];
        sum += error / 800.0;
        let turn = 240.0 * error + 3600.0 * sum;
        let (share, half) = (MASS * command.collective_m_s2 / 4.0, INERTIA * turn / (2.0 * ARM));
        let asked = [share - half, share + half, share].map(|thrust| quantised(thrust.clamp(0.08, 2.8)));
        let span = (primitive.duration_s() - t).min(1.25e-3);
        for _ in 0..8 {
            substep(&mut s, &asked, span / 8.0);
        }
        t += 1.25e-3;
    }
    s
}

/// The double flip at 1600 deg/s.
pub fn design() -> FlipDesign {
    FlipDesign {
        flips: 2,
        rate_rad_s_max: 27.925_268,
        envelope: Envelope::with_margin(&Model::TABLE_I, 0.125).expect("an envelope"),
    }
}

/// Its P0 for collectives averaged over each tick (multi-flip.md, section 4).
pub fn p0() -> Parameters {
    Parameters { u1_m_s2: 20.378_20, t1_s: 0.161_48, t3_s: 0.278_25, u5_m_s2: 20.394_81, t5_s: 0.192_54 }
}
