//! The continuous model: each step of the primitive cut into equal Runge-Kutta steps.

use core::array;

use quantity::math;

use crate::dynamics::{Coefficients, Command, State};
use crate::lanes::Lanes;
use crate::primitive::Primitive;

/// Steps between two fresh computations of sine and cosine.
const RESYNCHRONISE_STEPS: u32 = 64;

/// Flies step `index` (0 to 4) of one primitive per lane, cut into `ceil(steps_hz * T)` parts, and calls `observe`
/// after each part with the time since the maneuver's start in the first lane, s.
pub(crate) fn fly_step<const N: usize>(
    c: &Coefficients,
    state: &mut State<N>,
    primitives: &[Primitive; N],
    index: usize,
    steps_hz: f64,
    mut observe: impl FnMut(f64, &State<N>),
) {
    let step = |lane: usize| &primitives[lane].steps()[index];
    let counts: [u32; N] = array::from_fn(|lane| math::ceil(steps_hz * step(lane).duration_s) as u32);
    let h = Lanes(array::from_fn(|lane| step(lane).duration_s / f64::from(counts[lane].max(1))));
    let share = Lanes(array::from_fn(|lane| step(lane).collective_m_s2 * c.share));
    let start_rate = Lanes(array::from_fn(|lane| primitives[lane].start_rate_rad_s(index)));
    let slope = h * Lanes(array::from_fn(|lane| step(lane).angular_acceleration_rad_s2));
    let fewest = counts.iter().copied().min().unwrap_or(0);
    let most = counts.iter().copied().max().unwrap_or(0);
    for part in 0..most {
        if part % RESYNCHRONISE_STEPS == 0 {
            state.resynchronise();
        }
        // A lane that is done stands still: a step of no length changes nothing.
        let h = if part < fewest {
            h
        } else {
            Lanes(array::from_fn(|lane| if part < counts[lane] { h.0[lane] } else { 0.0 }))
        };
        let wanted = |parts: f64| start_rate + slope * parts;
        let part = f64::from(part);
        let rates = [wanted(part), wanted(part + 0.5), wanted(part + 1.0)];
        // Eqs. (7) to (9), what does not depend on the state added up beforehand.
        let shares = rates.map(|rate| {
            let proportional = rate * c.proportional;
            [share + proportional, share - proportional]
        });
        let before = state.integral;
        state.advance(c, h, |stage, rate, integral| {
            let gyro = rate * (c.gyro * c.proportional);
            let integral = integral * c.integral;
            Command {
                rate_error: rates[stage] - rate * c.gyro,
                thrust_a: c.clipped((shares[stage][0] + integral) - gyro),
                thrust_b: c.clipped((shares[stage][1] - integral) + gyro),
            }
        });
        let rate_error = rates[2] - state.rate * c.gyro;
        state.integral = c.admitted(share, rate_error, before, state.integral);
        observe(primitives[0].start_s(index) + h.0[0] * (part + 1.0), state);
    }
}
