//! The equations of motion in the vertical plane, and one Runge-Kutta step of them.
//!
//! The rotation knows nothing of the translation, and neither of theta's sine except through what the thrusts
//! push: the step below computes the rotation first and carries sine and cosine along by turning them a small
//! angle, which is several times cheaper than computing them anew at each of the four stages.

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

/// [`PlanarState`] in lanes, with the sine and cosine of theta beside it. Thrusts are what is commanded and
/// lagged, before any deviation of the vehicle's thrust.
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

    /// Value of the integral at which the command saturates in the direction of its growth, times `sign`;
    /// `sign` is that direction, 1 or -1. Saturated means that no more of it changes any thrust.
    pub fn integral_limit(&self, share: f64, rate_error: f64, sign: f64) -> f64 {
        let room = (self.thrust_max - share).max(share - self.thrust_min);
        (room - self.proportional * rate_error * sign) / self.integral
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
        state.mapped(|value| Lanes::splat(value.0[0]))
    }

    /// The first lane alone.
    pub fn only_first(&self) -> State<1> {
        self.mapped(|value| Lanes([value.0[0]]))
    }

    fn mapped<const M: usize>(&self, map: impl Fn(Lanes<N>) -> Lanes<M>) -> State<M> {
        State {
            x: map(self.x),
            z: map(self.z),
            vx: map(self.vx),
            vz: map(self.vz),
            theta: map(self.theta),
            sine: map(self.sine),
            cosine: map(self.cosine),
            rate: map(self.rate),
            thrust_a: map(self.thrust_a),
            thrust_b: map(self.thrust_b),
            integral: map(self.integral),
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

    /// One step of classical fourth-order Runge-Kutta, except for the integral. `command` gives the thrusts
    /// wanted at a stage: its arguments are the stage (0 to 3), the rate there, and the angle turned since
    /// the step began.
    ///
    /// Returns the angle turned by the step.
    #[inline(always)]
    pub fn advance<C>(&mut self, c: &Coefficients, step: &StepLength<N>, command: C) -> Lanes<N>
    where
        C: Fn(usize, Lanes<N>, Lanes<N>) -> [Lanes<N>; 2],
    {
        let stage1 = Stage { rate: self.rate, thrusts: [self.thrust_a, self.thrust_b] };
        let slope1 = stage1.slope(command(0, stage1.rate, Lanes::ZERO));
        let stage2 = stage1.after(&slope1, &step.half);
        let angle2 = stage1.rate * step.half.h;
        let slope2 = stage2.slope(command(1, stage2.rate, angle2));
        let stage3 = stage1.after(&slope2, &step.half);
        let angle3 = stage2.rate * step.half.h;
        let slope3 = stage3.slope(command(2, stage3.rate, angle3));
        let stage4 = stage1.after(&slope3, &step.whole);
        let angle4 = stage3.rate * step.whole.h;
        let slope4 = stage4.slope(command(3, stage4.rate, angle4));
        let mean = Slope::weighed(&slope1, &slope2, &slope3, &slope4);
        let turn = weighed(stage1.rate, stage2.rate, stage3.rate, stage4.rate) * step.sixth.h;

        // Theta differs between the two middle stages, and between the last stage and the step's end, by so
        // little that sine and cosine are linear in the difference to the last bit. Two evaluations do
        // instead of four.
        let end = self.turned(turn);
        let last = {
            let ahead = angle4 - turn;
            (end.0 + end.1 * ahead, end.1 - end.0 * ahead)
        };
        let middle = self.turned((angle2 + angle3) * 0.5);
        let push = |thrusts: Lanes<N>, (sine, cosine): (Lanes<N>, Lanes<N>)| {
            // Eqs. (1), (2), (4), (5), without gravity.
            let collective = thrusts * c.lift;
            (collective * sine, collective * cosine)
        };
        let (ax1, az1) = push(stage1.sum(), (self.sine, self.cosine));
        let (ax23, az23) = push(stage2.sum() + stage3.sum(), middle);
        let (ax4, az4) = push(stage4.sum(), last);

        let StepLength { whole: Length { h, .. }, sixth: Length { h: sixth, .. }, fall, .. } = *step;
        // The four velocities of the stages, summed: 6 v + h (a1 + a2 + a3). Gravity is constant and done
        // exactly.
        let (ax123, az123) = (ax1 + ax23, az1 + az23);
        self.x = self.x + (self.vx + ax123 * sixth) * h;
        self.z = self.z + (self.vz + az123 * sixth - fall * 0.5) * h;
        self.vx = self.vx + (ax123 + ax23 + ax4) * sixth;
        self.vz = self.vz + (az123 + az23 + az4) * sixth - fall;
        (self.sine, self.cosine) = end;
        self.theta = self.theta + turn;
        let Stage { rate, thrusts: [thrust_a, thrust_b] } = stage1.after(&mean, &step.sixth);
        (self.rate, self.thrust_a, self.thrust_b) = (rate, thrust_a, thrust_b);
        turn
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

/// The length of a Runge-Kutta step, and what is computed with it once for many steps of the same length.
#[derive(Clone, Copy)]
pub(crate) struct StepLength<const N: usize> {
    whole: Length<N>,
    half: Length<N>,
    sixth: Length<N>,
    /// Velocity lost to gravity, m/s.
    fall: Lanes<N>,
}

impl<const N: usize> StepLength<N> {
    pub fn new(c: &Coefficients, h: Lanes<N>) -> Self {
        Self {
            whole: Length::new(c, h),
            half: Length::new(c, h * 0.5),
            sixth: Length::new(c, h * (1.0 / 6.0)),
            fall: h * GRAVITY_M_S2,
        }
    }

    /// The length, s.
    pub fn h(&self) -> Lanes<N> {
        self.whole.h
    }
}

/// A part of a step, times the constants of eqs. (3) and (6).
#[derive(Clone, Copy)]
struct Length<const N: usize> {
    h: Lanes<N>,
    torque: Lanes<N>,
    gain_down: Lanes<N>,
    /// What a rising thrust gains beyond the gain of a falling one.
    gain_up_more: Lanes<N>,
}

impl<const N: usize> Length<N> {
    fn new(c: &Coefficients, h: Lanes<N>) -> Self {
        Self {
            h,
            torque: h * c.torque,
            gain_down: h * c.gain_down,
            gain_up_more: h * (c.gain_up - c.gain_down),
        }
    }
}

/// The rotation's state at one stage.
#[derive(Clone, Copy)]
struct Stage<const N: usize> {
    rate: Lanes<N>,
    /// Of a and b.
    thrusts: [Lanes<N>; 2],
}

/// Derivative of the rotation's state at one stage, before the constants of eqs. (3) and (6): those are
/// multiplied into the step's length, which keeps them out of the chain of operations that one step waits
/// for.
#[derive(Clone, Copy)]
struct Slope<const N: usize> {
    /// Fa - Fb.
    difference: Lanes<N>,
    /// How far the thrusts of a and b lie below their commands.
    missing: [Lanes<N>; 2],
    /// The same where they rise, zero where they fall.
    rising: [Lanes<N>; 2],
}

impl<const N: usize> Stage<N> {
    #[inline(always)]
    fn slope(&self, wanted: [Lanes<N>; 2]) -> Slope<N> {
        let missing = [wanted[0] - self.thrusts[0], wanted[1] - self.thrusts[1]];
        Slope {
            difference: self.thrusts[0] - self.thrusts[1],
            missing,
            rising: missing.map(|missing| missing.at_least(0.0)),
        }
    }

    // Lupashin 2010, eqs. (3) and (6). Without a branch on rising or falling: it would often be mispredicted.
    #[inline(always)]
    fn after(&self, slope: &Slope<N>, length: &Length<N>) -> Self {
        let lagged = |rotor: usize| {
            self.thrusts[rotor]
                + slope.missing[rotor] * length.gain_down
                + slope.rising[rotor] * length.gain_up_more
        };
        Self { rate: self.rate + slope.difference * length.torque, thrusts: [lagged(0), lagged(1)] }
    }

    #[inline(always)]
    fn sum(&self) -> Lanes<N> {
        self.thrusts[0] + self.thrusts[1]
    }
}

impl<const N: usize> Slope<N> {
    #[inline(always)]
    fn weighed(k1: &Self, k2: &Self, k3: &Self, k4: &Self) -> Self {
        let each = |part: fn(&Self) -> Lanes<N>| weighed(part(k1), part(k2), part(k3), part(k4));
        Self {
            difference: each(|k| k.difference),
            missing: [each(|k| k.missing[0]), each(|k| k.missing[1])],
            rising: [each(|k| k.rising[0]), each(|k| k.rising[1])],
        }
    }
}

/// Runge-Kutta's weights, to be divided by six.
#[inline(always)]
fn weighed<const N: usize>(k1: Lanes<N>, k2: Lanes<N>, k3: Lanes<N>, k4: Lanes<N>) -> Lanes<N> {
    let middle = k2 + k3;
    k1 + (middle + middle) + k4
}
