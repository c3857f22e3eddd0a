//! The continuous model: each step of the primitive cut into equal Runge-Kutta steps.

use core::array;

use quantity::math;

use crate::dynamics::{Coefficients, State, StepLength};
use crate::lanes::Lanes;
use crate::model::Integral;
use crate::primitive::Primitive;

/// Steps between two fresh computations of sine and cosine.
const RESYNCHRONISE_STEPS: u32 = 64;

/// Flies step `index` (0 to 4) of one primitive per lane, cut into `ceil(steps_hz * T)` parts, and calls
/// `observe` after each part with the time since the maneuver's start in the first lane, s.
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
    let length = StepLength::new(c, h);
    let gyro = [c.gyro * c.proportional, c.gyro * c.integral];
    for part in 0..most {
        if part % RESYNCHRONISE_STEPS == 0 {
            state.resynchronise();
        }
        let remaining;
        let length = if part < fewest {
            &length
        } else {
            // A lane that is done stands still: a step of no length changes nothing.
            let h = Lanes(array::from_fn(|lane| if part < counts[lane] { h.0[lane] } else { 0.0 }));
            remaining = StepLength::new(c, h);
            &remaining
        };
        let h = length.h();
        let wanted = |parts: f64| start_rate + slope * parts;
        let part = f64::from(part);
        let rates = [wanted(part), wanted(part + 0.5), wanted(part + 1.0)];
        // Eqs. (7) to (9). Runge-Kutta's stages of the integral are those of the angle turned, which are at
        // hand anyway; what does not depend on the state at a stage is added up beforehand.
        let integral = state.integral;
        let integrals = [integral, integral + rates[0] * h * 0.5, integral + rates[1] * h * 0.5];
        let integrals = [integrals[0], integrals[1], integrals[2], integral + rates[1] * h];
        let known: [Lanes<N>; 4] =
            array::from_fn(|i| rates[i.div_ceil(2)] * c.proportional + integrals[i] * c.integral);
        let rate_before = state.rate;
        let turn = state.advance(c, length, |stage, rate, angle| {
            let difference = known[stage] - (rate * gyro[0] + angle * gyro[1]);
            [c.clipped(share + difference), c.clipped(share - difference)]
        });
        state.integral = integrals[3] - turn * c.gyro;
        if c.integral_rule == Integral::Conditional {
            let errors = [rates[0] - rate_before * c.gyro, rates[2] - state.rate * c.gyro];
            state.integral = Lanes(array::from_fn(|lane| {
                let errors = [errors[0].0[lane], errors[1].0[lane]];
                admitted(c, share.0[lane], errors, integral.0[lane], state.integral.0[lane])
            }));
        }
        observe(primitives[0].start_s(index) + h.0[0] * (part + 1.0), state);
    }
}

/// The integral after a step from `before` to `after` under the conditional rule, given the rate errors at
/// its two ends.
///
/// Of a step that is saturated in part, that part counts which is not. Counting such a step whole or not at
/// all would err by as much as the step itself, and the final error would jump with the parameters.
fn admitted(c: &Coefficients, share: f64, rate_errors: [f64; 2], before: f64, after: f64) -> f64 {
    let sign = if after > before { 1.0 } else { -1.0 };
    let [begin, end] = rate_errors.map(|error| c.integral_limit(share, error, sign) - sign * before);
    let apart = begin.abs() + end.abs();
    let free = if apart > 0.0 { (begin.max(0.0) + end.max(0.0)) / apart } else { 0.0 };
    let growth = (sign * (after - before) * free).min(begin.max(end).max(0.0));
    before + sign * growth
}
