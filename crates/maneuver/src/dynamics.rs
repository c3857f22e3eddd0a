//! The equations of motion in the vertical plane, and one Runge-Kutta step of them.
//!
//! The rotation knows nothing of the translation, and neither of theta's sine except through what the thrusts push:
//! the step below computes the rotation first and carries sine and cosine along by turning them a small angle, which
//! is several times cheaper than computing them anew at each of the four stages.

use core::array;

use quantity::{GRAVITY_M_S2, math};

use crate::lanes::Lanes;
use crate::model::{Integral, Model};
use crate::stress::Deviation;

/// State of the vertical-plane model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarState {
    /// Lateral position, m.
    pub x_m: f64,
    /// Height above the start, m.
    pub z_m: f64,
    /// Lateral velocity, m/s.
    pub vx_m_s: f64,
    /// Velocity up, m/s.
    pub vz_m_s: f64,
    /// Pitch, positive tips the thrust toward +x; counts whole turns, rad.
    pub theta_rad: f64,
    /// Pitch rate, rad/s.
    pub rate_rad_s: f64,
    /// Thrust of propeller a, which raises the pitch, N.
    pub thrust_a_n: f64,
    /// Thrust of propeller b, which lowers the pitch, N.
    pub thrust_b_n: f64,
    /// Integral of the rate error, rad.
    pub integral_rad: f64,
}

/// [`PlanarState`] in lanes, with the sine and cosine of theta beside it. Thrusts are what is commanded and lagged,
/// before any deviation of the vehicle's thrust.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<const N: usize> {
    pub x: Lanes<N>,
    pub z: Lanes<N>,
    pub vx: Lanes<N>,
    pub vz: Lanes<N>,
    pub theta: Lanes<N>,
    pub sine: Lanes<N>,
    pub cosine: Lanes<N>,
    pub rate: Lanes<N>,
    pub thrust_a: Lanes<N>,
    pub thrust_b: Lanes<N>,
    pub integral: Lanes<N>,
}

/// The model's numbers, combined once for the inner loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coefficients {
    /// Collective acceleration per newton of Fa + Fb. Eqs. (4), (5).
    pub lift: f64,
    /// Angular acceleration per newton of Fa - Fb, rad/s². Eq. (3).
    pub torque: f64,
    pub gain_up: f64,
    pub gain_down: f64,
    pub thrust_min: f64,
    pub thrust_max: f64,
    /// Thrust share per m/s² of collective: M / 4. Eqs. (7), (8).
    pub share: f64,
    /// Thrust difference per rad/s of rate error: P Iyy / (2 L). Eqs. (7) to (9).
    pub proportional: f64,
    /// Thrust difference per rad of integral: I Iyy / (2 L).
    pub integral: f64,
    pub integral_rule: Integral,
    /// What the gyro reads per rad/s.
    pub gyro: f64,
    pub hover_thrust: f64,
}

impl Coefficients {
    /// The controller computes with the model; the vehicle moves as the model with its deviation.
    pub fn new(model: &Model, deviation: &Deviation) -> Self {
        let per_torque = model.inertia_kg_m2 / (2.0 * model.arm_m);
        let mass_kg = model.mass_kg * deviation.mass;
        Self {
            lift: 2.0 * deviation.thrust / mass_kg,
            torque: model.arm_m * deviation.thrust / (model.inertia_kg_m2 * deviation.inertia),
            gain_up: model.rotor_gain_up_1_s * deviation.rotor_gain,
            gain_down: model.rotor_gain_down_1_s * deviation.rotor_gain,
            thrust_min: model.thrust_n_min,
            thrust_max: model.thrust_n_max,
            share: model.mass_kg / 4.0,
            proportional: model.rate_gain_p_1_s * per_torque,
            integral: model.rate_gain_i_1_s2 * per_torque,
            integral_rule: model.integral,
            gyro: deviation.gyro,
            hover_thrust: mass_kg * GRAVITY_M_S2 / (4.0 * deviation.thrust),
        }
    }

    /// Thrusts kept within what is ever commanded.
    #[inline(always)]
    pub fn clipped<const N: usize>(&self, thrust: Lanes<N>) -> Lanes<N> {
        thrust.at_least(self.thrust_min).at_most(self.thrust_max)
    }

    /// The integral after a step that began with `before` and would end with `after`, by the model's rule.
    ///
    /// Conditional integration admits no more than what brings the command to its limit. The step that would cross
    /// the limit counts in part: a step that counted whole or not at all would make the final error jump with the
    /// parameters, and a Jacobian of it meaningless.
    #[inline(always)]
    pub fn admitted<const N: usize>(
        &self,
        share: Lanes<N>,
        rate_error: Lanes<N>,
        before: Lanes<N>,
        after: Lanes<N>,
    ) -> Lanes<N> {
        match self.integral_rule {
            Integral::Literal => after,
            Integral::Conditional => Lanes(array::from_fn(|lane| {
                let (before, after) = (before.0[lane], after.0[lane]);
                let proportional = rate_error.0[lane] * self.proportional;
                let room = self.room(share.0[lane]);
                if after > before {
                    after.min(before.max((room - proportional) / self.integral))
                } else {
                    after.max(before.min((-room - proportional) / self.integral))
                }
            })),
        }
    }

    /// Greatest thrust difference that still changes a thrust.
    fn room(&self, share: f64) -> f64 {
        (self.thrust_max - share).max(share - self.thrust_min)
    }
}

impl<const N: usize> State<N> {
    /// Hovering at the origin, rate loop at rest.
    pub fn hovering(coefficients: &Coefficients) -> Self {
        let hover = Lanes::splat(coefficients.hover_thrust);
        Self {
            x: Lanes::ZERO,
            z: Lanes::ZERO,
            vx: Lanes::ZERO,
            vz: Lanes::ZERO,
            theta: Lanes::ZERO,
            sine: Lanes::ZERO,
            cosine: Lanes::splat(1.0),
            rate: Lanes::ZERO,
            thrust_a: hover,
            thrust_b: hover,
            integral: Lanes::ZERO,
        }
    }

    /// Every lane like the one lane of `state`.
    pub fn like(state: &State<1>) -> Self {
        let all = |value: Lanes<1>| Lanes::splat(value.0[0]);
        Self {
            x: all(state.x),
            z: all(state.z),
            vx: all(state.vx),
            vz: all(state.vz),
            theta: all(state.theta),
            sine: all(state.sine),
            cosine: all(state.cosine),
            rate: all(state.rate),
            thrust_a: all(state.thrust_a),
            thrust_b: all(state.thrust_b),
            integral: all(state.integral),
        }
    }

    /// One lane, as the public type.
    pub fn lane(&self, lane: usize) -> PlanarState {
        PlanarState {
            x_m: self.x.0[lane],
            z_m: self.z.0[lane],
            vx_m_s: self.vx.0[lane],
            vz_m_s: self.vz.0[lane],
            theta_rad: self.theta.0[lane],
            rate_rad_s: self.rate.0[lane],
            thrust_a_n: self.thrust_a.0[lane],
            thrust_b_n: self.thrust_b.0[lane],
            integral_rad: self.integral.0[lane],
        }
    }

    /// Recomputes sine and cosine from theta, which ends the drift of turning them step by step.
    pub fn resynchronise(&mut self) {
        for lane in 0..N {
            (self.sine.0[lane], self.cosine.0[lane]) = math::sin_cos(self.theta.0[lane]);
        }
    }

    /// One step of classical fourth-order Runge-Kutta. `command` gives rate error and commanded thrusts at a stage:
    /// its arguments are the stage (0 start, 1 middle, 2 end), the rate and the integral there.
    #[inline(always)]
    pub fn advance<C>(&mut self, c: &Coefficients, h: Lanes<N>, command: C)
    where
        C: Fn(usize, Lanes<N>, Lanes<N>) -> Command<N>,
    {
        let half = h * 0.5;
        let stage1 =
            Stage { rate: self.rate, thrust_a: self.thrust_a, thrust_b: self.thrust_b, integral: self.integral };
        let slope1 = stage1.slope(&command(0, stage1.rate, stage1.integral));
        let stage2 = stage1.after(&slope1, c, half);
        let slope2 = stage2.slope(&command(1, stage2.rate, stage2.integral));
        let stage3 = stage1.after(&slope2, c, half);
        let slope3 = stage3.slope(&command(1, stage3.rate, stage3.integral));
        let stage4 = stage1.after(&slope3, c, h);
        let slope4 = stage4.slope(&command(2, stage4.rate, stage4.integral));

        let (ax1, az1) = stage1.push(c, (self.sine, self.cosine));
        let (ax2, az2) = stage2.push(c, self.turned(stage1.rate * half));
        let (ax3, az3) = stage3.push(c, self.turned(stage2.rate * half));
        let (ax4, az4) = stage4.push(c, self.turned(stage3.rate * h));

        let sixth = h * (1.0 / 6.0);
        // The four velocities of the stages, summed: 6 v + h (a1 + a2 + a3). Gravity is constant and done exactly.
        let fall = h * GRAVITY_M_S2;
        self.x = self.x + (self.vx + (ax1 + ax2 + ax3) * sixth) * h;
        self.z = self.z + (self.vz + (az1 + az2 + az3) * sixth - fall * 0.5) * h;
        self.vx = self.vx + weighed(ax1, ax2, ax3, ax4) * sixth;
        self.vz = self.vz + weighed(az1, az2, az3, az4) * sixth - fall;
        let turn = weighed(stage1.rate, stage2.rate, stage3.rate, stage4.rate) * sixth;
        (self.sine, self.cosine) = self.turned(turn);
        self.theta = self.theta + turn;
        let slope = |part: fn(&Slope<N>) -> Lanes<N>| {
            weighed(part(&slope1), part(&slope2), part(&slope3), part(&slope4))
        };
        let mean = Slope {
            difference: slope(|s| s.difference),
            rising: [slope(|s| s.rising[0]), slope(|s| s.rising[1])],
            falling: [slope(|s| s.falling[0]), slope(|s| s.falling[1])],
            integral: slope(|s| s.integral),
        };
        let stage = stage1.after(&mean, c, sixth);
        (self.rate, self.thrust_a, self.thrust_b) = (stage.rate, stage.thrust_a, stage.thrust_b);
        self.integral = stage.integral;
    }

    /// Sine and cosine of theta + `turn`.
    #[inline(always)]
    fn turned(&self, turn: Lanes<N>) -> (Lanes<N>, Lanes<N>) {
        // Taylor to below 2⁻⁵³ up to 0.045 rad, the turn of one 800 Hz tick at 2000 deg/s.
        let square = turn * turn;
        let add = |terms: Lanes<N>, constant: f64| terms.map(|term| term + constant);
        let sine = add(square * (-1.0 / 5040.0), 1.0 / 120.0);
        let sine = turn * add(square * add(square * sine, -1.0 / 6.0), 1.0);
        let cosine = add(square * (-1.0 / 720.0), 1.0 / 24.0);
        let cosine = add(square * add(square * cosine, -0.5), 1.0);
        (self.sine * cosine + self.cosine * sine, self.cosine * cosine - self.sine * sine)
    }
}

/// What the rate loop wants at one stage.
#[derive(Clone, Copy)]
pub(crate) struct Command<const N: usize> {
    pub rate_error: Lanes<N>,
    pub thrust_a: Lanes<N>,
    pub thrust_b: Lanes<N>,
}

/// The rotation's state at one stage.
#[derive(Clone, Copy)]
struct Stage<const N: usize> {
    rate: Lanes<N>,
    thrust_a: Lanes<N>,
    thrust_b: Lanes<N>,
    integral: Lanes<N>,
}

/// Derivative of the rotation's state at one stage, before the factors that make it one: multiplied into the step's
/// length, they leave the chain of operations that one step waits for.
#[derive(Clone, Copy)]
struct Slope<const N: usize> {
    /// Fa - Fb.
    difference: Lanes<N>,
    /// How far the thrusts of a and b lie below their commands, zero if above.
    rising: [Lanes<N>; 2],
    /// How far the thrusts of a and b lie above their commands, negative; zero if below.
    falling: [Lanes<N>; 2],
    /// Rate error.
    integral: Lanes<N>,
}

impl<const N: usize> Stage<N> {
    #[inline(always)]
    fn slope(&self, command: &Command<N>) -> Slope<N> {
        let missing_a = command.thrust_a - self.thrust_a;
        let missing_b = command.thrust_b - self.thrust_b;
        Slope {
            difference: self.thrust_a - self.thrust_b,
            rising: [missing_a.at_least(0.0), missing_b.at_least(0.0)],
            falling: [missing_a.at_most(0.0), missing_b.at_most(0.0)],
            integral: command.rate_error,
        }
    }

    // Lupashin 2010, eqs. (3) and (6). One of rising and falling is zero: no branch, hence none mispredicted.
    #[inline(always)]
    fn after(&self, slope: &Slope<N>, c: &Coefficients, h: Lanes<N>) -> Self {
        let (up, down) = (h * c.gain_up, h * c.gain_down);
        Self {
            rate: self.rate + slope.difference * (h * c.torque),
            thrust_a: self.thrust_a + slope.rising[0] * up + slope.falling[0] * down,
            thrust_b: self.thrust_b + slope.rising[1] * up + slope.falling[1] * down,
            integral: self.integral + slope.integral * h,
        }
    }

    /// Lateral and vertical acceleration without gravity's. // Lupashin 2010, eqs. (1), (2), (4), (5).
    #[inline(always)]
    fn push(&self, c: &Coefficients, (sine, cosine): (Lanes<N>, Lanes<N>)) -> (Lanes<N>, Lanes<N>) {
        let collective = (self.thrust_a + self.thrust_b) * c.lift;
        (collective * sine, collective * cosine)
    }
}

/// Runge-Kutta's weights, to be divided by six.
#[inline(always)]
fn weighed<const N: usize>(k1: Lanes<N>, k2: Lanes<N>, k3: Lanes<N>, k4: Lanes<N>) -> Lanes<N> {
    k1 + (k2 + k3) * 2.0 + k4
}
