//! Four rotors on a plus: front, back, left, right, each with a first-order lag of its thrust.
//!
//! The state of a rotor is its *static* thrust: what it would give at its present speed in still air far from
//! the floor. Inflow and ground effect are factors on that ([`crate::air`]). Between two motor commands the
//! lag has a closed solution, so the thrusts inside a step are exact and cost no integration.

use quantity::{Body, Vector, math};
use settings::{FleetVehicle, RotorPlantSettings};

/// Rotors of a vehicle.
pub const ROTORS: usize = 4;

/// Greatest motor command.
pub const COMMAND_MAX: u8 = 200;

/// Which way each rotor turns about the body's z axis: front and back clockwise seen from above, left and
/// right the other way. The torque of its drag on the body has the opposite sign.
pub const SPIN: [f64; ROTORS] = [-1.0, -1.0, 1.0, 1.0];

/// Static thrust below which a rotor counts as stopped.
const STOPPED_N: f64 = 1e-6;

/// Lag factors over half a step and over a whole one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    up: [f64; 2],
    down: [f64; 2],
}

impl Lag {
    /// For a step of that length.
    #[must_use]
    pub fn over(step_s: f64, gain_up_1_s: f64, gain_down_1_s: f64) -> Self {
        let factors = |gain: f64| [math::exp(-0.5 * gain * step_s), math::exp(-gain * step_s)];
        Self { up: factors(gain_up_1_s), down: factors(gain_down_1_s) }
    }
}

/// Thrusts at the middle and at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// At the middle.
    pub middle_n: [f64; ROTORS],
    /// At the end.
    pub end_n: [f64; ROTORS],
    /// Square roots of those at the end: rotor speed and power follow from them.
    pub end_roots: [f64; ROTORS],
}

impl Course {
    /// Square roots of the thrusts at the middle, from those at the step's beginning.
    #[must_use]
    pub fn middle_roots(&self, begin_roots: &[f64; ROTORS]) -> [f64; ROTORS] {
        core::array::from_fn(|i| {
            // One Newton step from the mean of both ends: within 1e-5, at a fraction of a square root's cost.
            let guess = (0.5 * (begin_roots[i] + self.end_roots[i])).max(1e-6);
            0.5 * (guess + self.middle_n[i] / guess)
        })
    }
}

/// Constants of a vehicle's four rotors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotors {
    /// Full scale of the motor command, and what the firmware believes the greatest thrust to be.
    full_scale_n: f64,
    /// True thrust by asked thrust, rotor by rotor.
    thrust_ratio: [f64; ROTORS],
    gain_up_1_s: f64,
    gain_down_1_s: f64,
    arm_m: f64,
    drag_torque_m: f64,
    spin_inertia_kg_m2: f64,
    /// Rotor speed by the square root of static thrust.
    speed_by_root_thrust: f64,
    /// One by the power of all four at full scale.
    power_scale: f64,
}

impl Rotors {
    /// The rotors of a vehicle; `spread` is one standard normal number for each.
    #[must_use]
    pub fn new(member: &FleetVehicle, spread: [f64; ROTORS]) -> Self {
        let believed = &member.vehicle.rotor;
        let truth: &RotorPlantSettings = &member.vehicle.plant.rotor;
        Self {
            full_scale_n: believed.thrust_n_max,
            thrust_ratio: spread.map(|draw| truth.thrust_ratio * (1.0 + truth.spread_ratio * draw)),
            gain_up_1_s: truth.gain_up_1_s,
            gain_down_1_s: truth.gain_down_1_s,
            arm_m: member.vehicle.airframe.arm_m,
            drag_torque_m: believed.drag_torque_m,
            spin_inertia_kg_m2: truth.spin_inertia_kg_m2,
            speed_by_root_thrust: truth.speed_rad_s_max / math::sqrt(believed.thrust_n_max),
            power_scale: 1.0 / (ROTORS as f64 * power(believed.thrust_n_max)),
        }
    }

    /// The lag over a step of that length.
    #[must_use]
    pub fn lag(&self, step_s: f64) -> Lag {
        Lag::over(step_s, self.gain_up_1_s, self.gain_down_1_s)
    }

    /// Static thrust each rotor goes for under motor commands of 0 to 200 steps. Speed is proportional to the
    /// command, thrust to speed squared, and the battery's voltage limits the speed: `limit_ratio` of
    /// full-scale thrust.
    #[must_use]
    pub fn asked_n(&self, commands: [u8; ROTORS], limit_ratio: f64) -> [f64; ROTORS] {
        core::array::from_fn(|i| {
            let speed_ratio = f64::from(commands[i].min(COMMAND_MAX)) * (1.0 / f64::from(COMMAND_MAX));
            (speed_ratio * speed_ratio).min(limit_ratio) * self.full_scale_n * self.thrust_ratio[i]
        })
    }

    /// How the thrusts go from `from_n` toward `asked_n` in a step.
    // Lupashin 2010, eq. (6), solved for a constant command.
    #[must_use]
    pub fn course(lag: &Lag, from_n: &[f64; ROTORS], asked_n: &[f64; ROTORS]) -> Course {
        let at = |i: usize, part: usize| {
            let factor = if asked_n[i] >= from_n[i] { lag.up[part] } else { lag.down[part] };
            asked_n[i] + (from_n[i] - asked_n[i]) * factor
        };
        let end_n = core::array::from_fn(|i| {
            let thrust = at(i, 1);
            if thrust < STOPPED_N { 0.0 } else { thrust }
        });
        Course { middle_n: core::array::from_fn(|i| at(i, 0)), end_roots: Self::roots(&end_n), end_n }
    }

    /// Torque of the thrusts about the body's axes; `static_n` drags, `actual_n` lifts.
    #[must_use]
    pub fn torque_n_m(&self, static_n: &[f64; ROTORS], actual_n: &[f64; ROTORS]) -> Vector<Body> {
        let [front, back, left, right] = *actual_n;
        let drag = -(0..ROTORS).map(|i| SPIN[i] * static_n[i]).sum::<f64>() * self.drag_torque_m;
        Vector::new(self.arm_m * (left - right), self.arm_m * (back - front), drag)
    }

    /// Upward speed of each rotor's hub along the body's z axis, m/s.
    #[must_use]
    pub fn axial_m_s(&self, body_z_m_s: f64, rate_rad_s: Vector<Body>) -> [f64; ROTORS] {
        let (pitching, rolling) = (self.arm_m * rate_rad_s.y, self.arm_m * rate_rad_s.x);
        [body_z_m_s - pitching, body_z_m_s + pitching, body_z_m_s + rolling, body_z_m_s - rolling]
    }

    /// Square roots of the thrusts, which speed and power follow from.
    #[must_use]
    pub fn roots(static_n: &[f64; ROTORS]) -> [f64; ROTORS] {
        static_n.map(math::sqrt)
    }

    /// Angular momentum of the four rotors about the body's z axis, kg m²/s.
    #[must_use]
    pub fn spin_momentum(&self, roots: &[f64; ROTORS]) -> f64 {
        let sum = (0..ROTORS).map(|i| SPIN[i] * roots[i]).sum::<f64>();
        sum * self.speed_by_root_thrust * self.spin_inertia_kg_m2
    }

    /// Power drawn by power drawn at full scale: thrust to the power 3/2.
    #[must_use]
    pub fn power_ratio(&self, static_n: &[f64; ROTORS], roots: &[f64; ROTORS]) -> f64 {
        (0..ROTORS).map(|i| static_n[i] * roots[i]).sum::<f64>() * self.power_scale
    }
}

/// A thrust to the power 3/2, which the power drawn is proportional to.
pub(crate) fn power(thrust: f64) -> f64 {
    thrust * math::sqrt(thrust)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{ideal, member};

    const STEP_S: f64 = 1.25e-3;

    #[test]
    fn thrust_rises_with_one_gain_and_falls_with_the_other() {
        let rotors = Rotors::new(&ideal(), [0.0; 4]);
        let lag = rotors.lag(STEP_S);
        let run = |from: f64, to: f64, steps: usize| {
            (0..steps).fold([from; 4], |thrust, _| Rotors::course(&lag, &thrust, &[to; 4]).end_n)[0]
        };
        // After one time constant 1 - 1/e of the way: 20 ms up, 40 ms down.
        let part = 1.0 - math::exp(-1.0);
        assert!((run(1.0, 2.0, 16) - (1.0 + part)).abs() < 1e-12);
        assert!((run(2.0, 1.0, 32) - (2.0 - part)).abs() < 1e-12);
    }

    #[test]
    fn the_middle_lies_on_the_same_exponential() {
        let lag = Lag::over(2.0 * STEP_S, 50.0, 25.0);
        let half = Lag::over(STEP_S, 50.0, 25.0);
        let whole = Rotors::course(&lag, &[0.5, 0.5, 2.5, 2.5], &[2.0, 1.0, 0.1, 2.5]);
        let first = Rotors::course(&half, &[0.5, 0.5, 2.5, 2.5], &[2.0, 1.0, 0.1, 2.5]);
        for (a, b) in whole.middle_n.iter().zip(first.end_n) {
            assert!((a - b).abs() < 1e-12);
        }
        let begin = Rotors::roots(&[0.5, 0.5, 2.5, 2.5]);
        for (root, thrust) in first.middle_roots(&begin).iter().zip(first.middle_n) {
            assert!((root / math::sqrt(thrust) - 1.0).abs() < 1e-5, "{root} {thrust}");
        }
    }

    #[test]
    fn commands_ask_for_thrust_by_their_square_up_to_the_batterys_limit() {
        let rotors = Rotors::new(&ideal(), [0.0; 4]);
        let asked = rotors.asked_n([0, 100, 200, 255], 1.0);
        for (thrust, expected) in asked.iter().zip([0.0, 0.7, 2.8, 2.8]) {
            assert!((thrust - expected).abs() < 1e-12);
        }
        let asked = rotors.asked_n([100, 180, 200, 0], 0.9);
        for (thrust, expected) in asked.iter().zip([0.7, 2.8 * 0.81, 2.52, 0.0]) {
            assert!((thrust - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn spread_and_weakness_stay_with_their_rotor() {
        let member = member();
        let rotors = Rotors::new(&member, [1.0, -1.0, 0.0, 2.0]);
        let asked = rotors.asked_n([200; 4], 1.0);
        for (thrust, spread) in asked.iter().zip([1.005, 0.995, 1.0, 1.01]) {
            assert!((thrust - 2.8 * 0.92 * spread).abs() < 1e-12);
        }
    }

    #[test]
    fn torques_point_as_the_frame_says() {
        let rotors = Rotors::new(&ideal(), [0.0; 4]);
        let back_strong = [1.0, 2.0, 1.5, 1.5];
        let torque = rotors.torque_n_m(&back_strong, &back_strong);
        assert!((torque.y - 0.17).abs() < 1e-12);
        let left_strong = [1.5, 1.5, 2.0, 1.0];
        let torque = rotors.torque_n_m(&left_strong, &left_strong);
        assert!((torque.x - 0.17).abs() < 1e-12 && torque.z.abs() < 1e-12);
        let pair = [2.0, 2.0, 1.0, 1.0];
        let torque = rotors.torque_n_m(&pair, &pair);
        assert!((torque.z + SPIN[0] * 2.0 * 0.0244).abs() < 1e-12);
    }

    #[test]
    fn power_and_spin_follow_from_the_thrusts() {
        let rotors = Rotors::new(&member(), [0.0; 4]);
        let at = |thrust: [f64; 4]| {
            let roots = Rotors::roots(&thrust);
            (rotors.power_ratio(&thrust, &roots), rotors.spin_momentum(&roots))
        };
        let (power, momentum) = at([2.8; 4]);
        assert!((power - 1.0).abs() < 1e-12 && momentum.abs() < 1e-15);
        assert!((at([0.7; 4]).0 - 0.125).abs() < 1e-12);
        // Two rotors at 709 rad/s, the others at half of that.
        let (_, momentum) = at([2.8, 2.8, 0.7, 0.7]);
        assert!((momentum - SPIN[0] * 709.0 * 8e-6).abs() < 1e-12);
    }

    #[test]
    fn hubs_move_with_the_bodys_rate() {
        let rotors = Rotors::new(&ideal(), [0.0; 4]);
        // Pitching at 27.9 rad/s the front rotor goes down and the back one up at 4.7 m/s.
        let axial = rotors.axial_m_s(0.5, Vector::new(0.0, 27.925, 0.0));
        assert!((axial[0] - (0.5 - 4.747_25)).abs() < 1e-9 && (axial[1] - (0.5 + 4.747_25)).abs() < 1e-9);
        let axial = rotors.axial_m_s(0.0, Vector::new(10.0, 0.0, 0.0));
        assert!((axial[2] - 1.7).abs() < 1e-12 && (axial[3] + 1.7).abs() < 1e-12);
    }
}
