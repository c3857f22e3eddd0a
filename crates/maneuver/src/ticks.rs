//! The model as a vehicle samples it: rate error read 800 times a second, thrust commands held in between.

use crate::dynamics::{Coefficients, State, StepLength};
use crate::lanes::Lanes;
use crate::model::Integral;
use crate::planar::LOOP_HZ;
use crate::primitive::Primitive;

/// Runge-Kutta steps within a tick. One would err by 4e-7 of the state; the commands are constant in a tick.
const STEPS_PER_TICK: u32 = 4;

/// How the collective is taken from the primitive at a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Collective {
    /// Its mean over the tick.
    Averaged,
    /// Its value at the tick's start.
    Sampled,
}

/// Flies a whole primitive and calls `observe` after each part of a tick with the time since the start, s.
pub(crate) fn fly(
    coefficients: &Coefficients,
    state: &mut State<1>,
    primitive: &Primitive,
    collective: Collective,
    mut observe: impl FnMut(f64, &State<1>),
) {
    let duration_s = primitive.duration_s();
    for tick in 0u32.. {
        let from_s = f64::from(tick) / LOOP_HZ;
        if from_s >= duration_s {
            break;
        }
        let until_s = (f64::from(tick + 1) / LOOP_HZ).min(duration_s);
        let setpoint = primitive.sample(from_s);
        let collective_m_s2 = match collective {
            Collective::Averaged => primitive.mean_collective_m_s2(from_s, until_s),
            Collective::Sampled => setpoint.collective_m_s2,
        };
        let share = Lanes([collective_m_s2 * coefficients.share]);
        let rate_error = Lanes([setpoint.rate_rad_s]) - state.rate * coefficients.gyro;
        state.integral = integrated(coefficients, share.0[0], rate_error.0[0], state.integral.0[0]);
        let difference = rate_error * coefficients.proportional + state.integral * coefficients.integral;
        let thrust_a = coefficients.clipped(share + difference);
        let thrust_b = coefficients.clipped(share - difference);
        let h_s = (until_s - from_s) / f64::from(STEPS_PER_TICK);
        let length = StepLength::new(coefficients, Lanes([h_s]));
        state.resynchronise();
        for part in 1..=STEPS_PER_TICK {
            state.advance(coefficients, &length, |_, _, _| [thrust_a, thrust_b]);
            observe(from_s + h_s * f64::from(part), state);
        }
    }
}

/// The integral after a tick, by the model's rule. The conditional one admits no more than what brings the
/// command to its limit.
fn integrated(c: &Coefficients, share: f64, rate_error: f64, before: f64) -> Lanes<1> {
    let growth = rate_error / LOOP_HZ;
    let admitted = match c.integral_rule {
        Integral::Literal => growth,
        Integral::Conditional => {
            let sign = if rate_error > 0.0 { 1.0 } else { -1.0 };
            let room = c.integral_limit(share, rate_error, sign) - sign * before;
            sign * (sign * growth).min(room.max(0.0))
        }
    };
    Lanes([before + admitted])
}
