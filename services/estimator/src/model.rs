//! What a vehicle does with a command: rate loops, mixer, four rotors with their lags, and the body they
//! carry.
//!
//! It is the vehicle of the settings, as its builders believe it to be, plus two numbers learned in flight:
//! the ratio of thrust had to thrust asked, and the drag. Between two poses, and from the newest pose to the
//! execution of the next command, it moves by this model. In a maneuver, and whenever the vehicle follows
//! nothing the ground sent, it instead moves on with the accelerations last seen.

use quantity::{Body, GRAVITY_M_S2, Rotation, Vector, World};
use schemas::Kinematics;
use settings::Vehicle;

use crate::commands::Drive;
use crate::tuning::ModelTuning;

/// How a vehicle moves on between two poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Regime {
    /// It flies the commands sent.
    Commanded,
    /// It flies a maneuver by itself.
    Ballistic,
    /// It flies something else by itself, or nobody knows.
    Unknown,
}

/// State of motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    /// Position, velocity, attitude, body rate.
    pub kinematics: Kinematics,
    /// Thrust of the front, back, left and right rotor, as the model believes it before the learned ratio.
    pub thrust_n: [f64; 4],
    /// Acceleration the model does not explain; outside [`Regime::Commanded`], all of it.
    pub disturbance_m_s2: Vector<World>,
    /// Angular acceleration the model does not explain; outside [`Regime::Commanded`], all of it.
    pub angular_disturbance_rad_s2: Vector<Body>,
    /// Whole acceleration in the last step.
    pub acceleration_m_s2: Vector<World>,
    /// Whole angular acceleration in the last step.
    pub angular_acceleration_rad_s2: Vector<Body>,
    /// Whether it stands on the floor.
    pub resting: bool,
}

impl Motion {
    /// Moving as given, accelerating nowhere, rotors still.
    pub fn new(kinematics: Kinematics) -> Self {
        Self {
            kinematics,
            thrust_n: [0.0; 4],
            disturbance_m_s2: Vector::ZERO,
            angular_disturbance_rad_s2: Vector::ZERO,
            acceleration_m_s2: Vector::ZERO,
            angular_acceleration_rad_s2: Vector::ZERO,
            resting: false,
        }
    }

    /// Whether every number the filters build on is finite.
    pub fn is_finite(&self) -> bool {
        let k = &self.kinematics;
        k.position_m.is_finite()
            && k.velocity_m_s.is_finite()
            && k.orientation.is_finite()
            && k.rate_rad_s.is_finite()
            && self.disturbance_m_s2.is_finite()
            && self.angular_disturbance_rad_s2.is_finite()
            && self.thrust_n.iter().all(|thrust| thrust.is_finite())
    }
}

/// Decays of the disturbances, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Decay {
    /// Of the acceleration's.
    pub acceleration_1_s: f64,
    /// Of the angular acceleration's.
    pub angular_1_s: f64,
}

/// A vehicle's model.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    mass_kg: f64,
    arm_m: f64,
    inertia_kg_m2: [f64; 3],
    gain_up_1_s: f64,
    gain_down_1_s: f64,
    thrust_n_min: f64,
    thrust_n_max: f64,
    drag_torque_m: f64,
    rate_gain_1_s: f64,
    yaw_gain_1_s: f64,
    yaw_thrust_n_max: f64,
    floor_height_m: f64,
    /// Thrust had by thrust asked, learned.
    pub thrust_ratio: f64,
    /// Deceleration by speed, learned, 1/s.
    pub drag_1_s: f64,
}

/// On the floor, speeds and rates die with this time constant.
const SETTLE_S: f64 = 0.03;
/// A vehicle low over the floor rests on it while its thrust carries less than this part of its weight.
const RESTING_RATIO: f64 = 0.95;

impl Model {
    /// The vehicle of the settings, with nothing learned yet.
    pub fn new(vehicle: &Vehicle, tuning: &ModelTuning) -> Self {
        Self {
            mass_kg: vehicle.airframe.mass_kg,
            arm_m: vehicle.airframe.arm_m,
            inertia_kg_m2: vehicle.airframe.inertia_kg_m2,
            gain_up_1_s: vehicle.rotor.gain_up_1_s,
            gain_down_1_s: vehicle.rotor.gain_down_1_s,
            thrust_n_min: vehicle.rotor.thrust_n_min,
            thrust_n_max: vehicle.rotor.thrust_n_max,
            drag_torque_m: vehicle.rotor.drag_torque_m,
            rate_gain_1_s: vehicle.rate_loop.flight_p_1_s,
            yaw_gain_1_s: vehicle.rate_loop.yaw_p_1_s,
            yaw_thrust_n_max: tuning.yaw_thrust_n_max,
            floor_height_m: tuning.floor_height_m,
            thrust_ratio: 1.0,
            drag_1_s: 0.0,
        }
    }

    /// How fast an error of the body rate decays in the closed rate loop: pitch and roll, and yaw. 1/s.
    pub fn rate_damping_1_s(&self) -> (f64, f64) {
        // Slower than the loop's gain, because the rotors lag.
        let lag = 0.5 * (self.gain_up_1_s + self.gain_down_1_s);
        let damping = |gain: f64| gain * lag / (gain + lag);
        (damping(self.rate_gain_1_s), damping(self.yaw_gain_1_s))
    }

    /// Collective acceleration the model believes the vehicle has.
    pub fn collective_m_s2(&self, motion: &Motion) -> f64 {
        self.thrust_ratio * motion.thrust_n.iter().sum::<f64>() / self.mass_kg
    }

    /// Gives the rotors the thrusts that explain this acceleration and angular acceleration.
    pub fn explain(&self, motion: &mut Motion, acceleration: Vector<World>, angular: Vector<Body>) {
        let thrust_axis = motion.kinematics.orientation.z_axis();
        let specific = acceleration + Vector::Z * GRAVITY_M_S2;
        let each = 0.25 * self.mass_kg * specific.dot(thrust_axis) / self.thrust_ratio;
        let pitch = 0.5 * self.inertia_kg_m2[1] * angular.y / self.arm_m;
        let roll = 0.5 * self.inertia_kg_m2[0] * angular.x / self.arm_m;
        motion.thrust_n = [each - pitch, each + pitch, each + roll, each - roll]
            .map(|thrust| thrust.clamp(self.thrust_n_min, self.thrust_n_max));
    }

    /// Moves on by one short step.
    pub fn advance(&self, motion: &mut Motion, regime: Regime, drive: Drive, decay: &Decay, step_s: f64) {
        let (acceleration, angular) = match regime {
            Regime::Commanded => self.commanded(motion, drive, step_s),
            Regime::Ballistic | Regime::Unknown => {
                (motion.disturbance_m_s2, motion.angular_disturbance_rad_s2)
            }
        };
        let low = motion.kinematics.position_m.z < self.floor_height_m;
        motion.resting = low
            && match regime {
                Regime::Commanded => self.collective_m_s2(motion) < RESTING_RATIO * GRAVITY_M_S2,
                Regime::Unknown => true,
                Regime::Ballistic => false,
            };
        if motion.resting {
            rest(motion, step_s);
            return;
        }
        motion.acceleration_m_s2 = acceleration;
        motion.angular_acceleration_rad_s2 = angular;
        let k = &mut motion.kinematics;
        k.position_m += k.velocity_m_s * step_s + acceleration * (0.5 * step_s * step_s);
        k.velocity_m_s += acceleration * step_s;
        let middle_rate = k.rate_rad_s + angular * (0.5 * step_s);
        k.rate_rad_s += angular * step_s;
        k.orientation = turned_little(k.orientation, middle_rate * step_s);
        motion.disturbance_m_s2 =
            motion.disturbance_m_s2 * (1.0 - (decay.acceleration_1_s * step_s).min(1.0));
        motion.angular_disturbance_rad_s2 =
            motion.angular_disturbance_rad_s2 * (1.0 - (decay.angular_1_s * step_s).min(1.0));
    }

    /// Turns the rotors by what the firmware makes of the command; acceleration and angular acceleration
    /// meanwhile.
    fn commanded(&self, motion: &mut Motion, drive: Drive, step_s: f64) -> (Vector<World>, Vector<Body>) {
        let (collective, wanted_rate) = match drive {
            Drive::Fly { collective_m_s2, rate_rad_s } => (collective_m_s2, rate_rad_s),
            // Motors off is obeyed on the floor only; elsewhere, and without commands, the vehicle keeps its
            // height.
            Drive::Off if motion.kinematics.position_m.z < self.floor_height_m => (0.0, Vector::ZERO),
            Drive::Off | Drive::Silent => (GRAVITY_M_S2 / self.thrust_ratio, Vector::ZERO),
        };
        let k = &motion.kinematics;
        let [ix, iy, iz] = self.inertia_kg_m2;
        let error = wanted_rate - k.rate_rad_s;
        // Lupashin 2010, eqs. (7), (8) and their counterparts about x; about z the rotors' drag turns the
        // body.
        let each = 0.25 * self.mass_kg * collective;
        let roll = 0.5 * ix * self.rate_gain_1_s * error.x / self.arm_m;
        let pitch = 0.5 * iy * self.rate_gain_1_s * error.y / self.arm_m;
        let yaw = 0.25 * iz * self.yaw_gain_1_s * error.z / self.drag_torque_m;
        let yaw = yaw.clamp(-self.yaw_thrust_n_max, self.yaw_thrust_n_max);
        let wanted = [each - pitch + yaw, each + pitch + yaw, each + roll - yaw, each - roll - yaw];
        let (up, down) = (approach(self.gain_up_1_s * step_s), approach(self.gain_down_1_s * step_s));
        let mut middle = [0.0; 4];
        for ((thrust, wanted), middle) in motion.thrust_n.iter_mut().zip(wanted).zip(&mut middle) {
            let wanted = wanted.clamp(self.thrust_n_min, self.thrust_n_max);
            let before = *thrust;
            *thrust += (wanted - before) * if wanted >= before { up } else { down };
            *middle = 0.5 * (before + *thrust);
        }
        let [front, back, left, right] = middle;
        let rate = k.rate_rad_s;
        let angular = Vector::new(
            (self.arm_m * (left - right) + (iy - iz) * rate.y * rate.z) / ix,
            (self.arm_m * (back - front) + (iz - ix) * rate.z * rate.x) / iy,
            (self.drag_torque_m * (front + back - left - right) + (ix - iy) * rate.x * rate.y) / iz,
        ) + motion.angular_disturbance_rad_s2;
        let specific = self.thrust_ratio * (front + back + left + right) / self.mass_kg;
        // The thrust's direction half-way through the step.
        let along = k.orientation * Vector::new(0.5 * step_s * rate.y, -0.5 * step_s * rate.x, 1.0);
        let acceleration = along * specific - Vector::Z * GRAVITY_M_S2 - k.velocity_m_s * self.drag_1_s
            + motion.disturbance_m_s2;
        (acceleration, angular)
    }
}

/// The part of a first-order lag's way that is gone after `gain_step` time constants: 1 - exp(-gain_step).
fn approach(gain_step: f64) -> f64 {
    // To 1e-5 for steps up to half a time constant, and never above one.
    (gain_step / (1.0 + gain_step * (0.5 + gain_step / 12.0))).min(1.0)
}

/// Stands on the floor for one step.
fn rest(motion: &mut Motion, step_s: f64) {
    let keep = 1.0 - (step_s / SETTLE_S).min(1.0);
    motion.acceleration_m_s2 = Vector::ZERO;
    motion.angular_acceleration_rad_s2 = Vector::ZERO;
    motion.kinematics.velocity_m_s = motion.kinematics.velocity_m_s * keep;
    motion.kinematics.rate_rad_s = motion.kinematics.rate_rad_s * keep;
    motion.disturbance_m_s2 = motion.disturbance_m_s2 * keep;
    motion.angular_disturbance_rad_s2 = motion.angular_disturbance_rad_s2 * keep;
}

/// As [`Rotation::turned`] for turns below a fifth of a radian, without trigonometry; the length drifts by
/// less than 1e-8 per turn and is restored by [`Rotation::renormalised`] where a path of turns ends.
pub(crate) fn turned_little(
    orientation: Rotation<Body, World>,
    turn_rad: Vector<Body>,
) -> Rotation<Body, World> {
    let half = turn_rad * 0.5;
    let square = half.dot(half);
    if square > 0.01 {
        return orientation.turned(turn_rad);
    }
    let mut turn = Rotation::<Body, Body>::IDENTITY;
    let scale = 1.0 - square / 6.0 * (1.0 - square / 20.0);
    turn.w = 1.0 - square / 2.0 * (1.0 - square / 12.0);
    (turn.x, turn.y, turn.z) = (half.x * scale, half.y * scale, half.z * scale);
    orientation * turn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    const DECAY: Decay = Decay { acceleration_1_s: 1.0, angular_1_s: 20.0 };

    fn model() -> Model {
        Model::new(&testing::vehicle(), &ModelTuning::default())
    }

    fn hovering(model: &Model, height_m: f64) -> Motion {
        let mut motion =
            Motion::new(Kinematics { position_m: Vector::new(0.0, 0.0, height_m), ..Kinematics::default() });
        model.explain(&mut motion, Vector::ZERO, Vector::ZERO);
        motion
    }

    #[test]
    fn little_turns_are_turns() {
        let start = Rotation::from_yaw_pitch_roll(0.4, -0.9, 2.0);
        for turn in [Vector::new(0.1, 0.0, -0.05), Vector::new(1e-9, 0.0, 0.0), Vector::new(0.0, 0.7, 0.3)] {
            let exact = start.turned(turn);
            let little = turned_little(start, turn);
            assert!(exact.angle_to(little.renormalised()) < 1e-9, "{turn:?}");
        }
    }

    #[test]
    fn hover_stays_and_rates_are_reached() {
        let model = model();
        let mut motion = hovering(&model, 4.0);
        let hover = Drive::Fly { collective_m_s2: GRAVITY_M_S2, rate_rad_s: Vector::ZERO };
        for _ in 0..400 {
            model.advance(&mut motion, Regime::Commanded, hover, &DECAY, 0.0025);
        }
        assert!((motion.kinematics.position_m.z - 4.0).abs() < 1e-9);
        let turn = Drive::Fly { collective_m_s2: GRAVITY_M_S2, rate_rad_s: Vector::new(0.0, 1.0, 0.2) };
        for _ in 0..200 {
            model.advance(&mut motion, Regime::Commanded, turn, &DECAY, 0.0025);
        }
        let rate = motion.kinematics.rate_rad_s;
        assert!((rate - Vector::new(0.0, 1.0, 0.2)).norm() < 0.02, "{rate:?}");
        assert!(motion.kinematics.orientation.z_axis().x > 0.3, "positive pitch tips the thrust toward +x");
    }

    #[test]
    fn torque_is_what_the_rotors_can_give() {
        let model = model();
        let mut motion = hovering(&model, 4.0);
        let jerk = Drive::Fly { collective_m_s2: GRAVITY_M_S2, rate_rad_s: Vector::new(1000.0, 0.0, 0.0) };
        for _ in 0..600 {
            model.advance(&mut motion, Regime::Commanded, jerk, &DECAY, 0.0005);
        }
        // L (Fmax - Fmin) / I
        assert!((motion.angular_acceleration_rad_s2.x - 0.17 * 2.72 / 0.0023).abs() < 0.5);
    }

    #[test]
    fn steps_of_any_size_agree() {
        let model = model();
        let drive = Drive::Fly { collective_m_s2: 12.0, rate_rad_s: Vector::new(2.0, -3.0, 0.5) };
        let fly = |step_s: f64, steps: u32| {
            let mut motion = hovering(&model, 4.0);
            for _ in 0..steps {
                model.advance(&mut motion, Regime::Commanded, drive, &DECAY, step_s);
            }
            motion.kinematics
        };
        let (coarse, fine) = (fly(0.0025, 24), fly(0.0001, 600));
        assert!(
            (coarse.position_m - fine.position_m).norm() < 2e-4,
            "{:?}",
            coarse.position_m - fine.position_m
        );
        assert!((coarse.velocity_m_s - fine.velocity_m_s).norm() < 5e-3);
        assert!(coarse.orientation.angle_to(fine.orientation) < 3e-3);
        assert!((coarse.rate_rad_s - fine.rate_rad_s).norm() < 0.1);
    }

    #[test]
    fn the_floor_carries_what_the_thrust_does_not() {
        let model = model();
        let mut motion =
            Motion::new(Kinematics { position_m: Vector::new(1.0, 1.0, 0.04), ..Kinematics::default() });
        motion.kinematics.velocity_m_s = Vector::new(0.1, 0.0, -0.3);
        for _ in 0..400 {
            model.advance(&mut motion, Regime::Commanded, Drive::Off, &DECAY, 0.0025);
        }
        assert!(motion.resting && motion.kinematics.velocity_m_s.norm() < 1e-9);
        assert!((motion.kinematics.position_m.z - 0.04).abs() < 1e-12);
        let take_off = Drive::Fly { collective_m_s2: 12.0, rate_rad_s: Vector::ZERO };
        for _ in 0..200 {
            model.advance(&mut motion, Regime::Commanded, take_off, &DECAY, 0.0025);
        }
        assert!(!motion.resting && motion.kinematics.position_m.z > 0.1);
    }

    #[test]
    fn explained_thrusts_give_the_acceleration_back() {
        let model = model();
        let mut motion = hovering(&model, 3.0);
        motion.kinematics.orientation = Rotation::from_yaw_pitch_roll(0.0, 0.5, 0.0);
        let wanted = motion.kinematics.orientation.z_axis() * 14.0 - Vector::Z * GRAVITY_M_S2;
        let angular = Vector::new(5.0, -10.0, 0.0);
        model.explain(&mut motion, wanted, angular);
        let thrusts = motion.thrust_n.iter().sum::<f64>() / 0.468;
        let drive = Drive::Fly { collective_m_s2: thrusts, rate_rad_s: angular * (1.0 / 40.0) };
        model.advance(&mut motion, Regime::Commanded, drive, &DECAY, 1e-6);
        assert!((motion.acceleration_m_s2 - wanted).norm() < 1e-3);
        assert!((motion.angular_acceleration_rad_s2 - angular).norm() < 1e-2);
    }
}
