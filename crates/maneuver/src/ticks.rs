//! The model as a vehicle samples it: rate error read 800 times a second, thrust commands held in between.

use crate::dynamics::{Coefficients, Command, State};
use crate::lanes::Lanes;
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
        let after = state.integral + rate_error * (1.0 / LOOP_HZ);
        state.integral = coefficients.admitted(share, rate_error, state.integral, after);
        let difference = rate_error * coefficients.proportional + state.integral * coefficients.integral;
        let thrust_a = coefficients.clipped(share + difference);
        let thrust_b = coefficients.clipped(share - difference);
        // The integral advances once a tick, above; within the tick it stands.
        let held = Command { rate_error: Lanes::ZERO, thrust_a, thrust_b };
        let h_s = (until_s - from_s) / f64::from(STEPS_PER_TICK);
        state.resynchronise();
        for part in 1..=STEPS_PER_TICK {
            state.advance(coefficients, Lanes([h_s]), |_, _, _| held);
            observe(from_s + h_s * f64::from(part), state);
        }
    }
}
