//! Horizontal speed of a vehicle that nobody tells it, from the drag it feels.
//!
//! A flying vehicle's accelerometers read no gravity, and thrust only along z: what they read across is drag,
//! which grows with the speed through the air. That makes the speed, and with it a slow error of the tilt,
//! observable on board. The drag coefficient need not be well known: a wrong one scales the speed, and a
//! vehicle that brakes ends at zero all the same.
// Martin, Salaün 2010: The True Role of Accelerometer Feedback in Quadrotor Control.

use quantity::{Body, GRAVITY_M_S2, Rotation, Vector, World};

use crate::settings::{Airframe, DriftSettings};

/// Cosine of the tilt beyond which the airflow is no longer along the propellers' plane.
const UPRIGHT_RATIO_MIN: f64 = 0.8;

/// The least time averaged over: one reading's noise is worth a speed of a metre per second.
const AVERAGE_S_MIN: f64 = 0.02;

/// Below this speed the accelerometers' own error is learned: in flight as a whole the mean speed is small.
const CALM_M_S: f64 = 0.5;

/// The tilt is corrected with half its gain at this speed.
const DRAG_SURE_M_S: f64 = 1.5;

/// The bias begins as if zero had been its mean for this long: wind says as little of it in this time as its
/// maker's tolerance does.
const BIAS_PRIOR_S: f64 = 8.0;

/// An accelerometer off by more across is broken.
const BIAS_M_S2_MAX: f64 = 0.3;

/// The estimate.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Drift {
    /// Horizontal, in the frame of the vehicle's own attitude.
    velocity_m_s: Vector<World>,
    /// What the accelerometers read across at rest in the air.
    bias_m_s2: Vector<Body>,
    /// Time the velocity rests on.
    followed_s: f64,
    /// Time the bias rests on.
    calm_s: f64,
}

impl Drift {
    /// Forgets the velocity; the sensors' error stays known.
    pub fn reset(&mut self) {
        (self.velocity_m_s, self.followed_s) = (Vector::ZERO, 0.0);
    }

    /// Horizontal speed; zero where nothing is known of it.
    pub const fn velocity_m_s(&self) -> Vector<World> {
        self.velocity_m_s
    }

    /// One tick in the air, out of maneuvers. Answers the rate, about the world's axes, at which the attitude
    /// must be turned to agree with the drag felt. Both speed and tilt follow it
    /// by `hurry_ratio` faster than the settings say.
    pub fn predict(
        &mut self,
        attitude: Rotation<Body, World>,
        acceleration_m_s2: Vector<Body>,
        dt_s: f64,
        hurry_ratio: f64,
        settings: &DriftSettings,
    ) -> Vector<World> {
        let force = acceleration_m_s2 - self.bias_m_s2;
        self.velocity_m_s += (attitude * force).horizontal() * dt_s;
        if attitude.z_axis().z < UPRIGHT_RATIO_MIN {
            return Vector::ZERO;
        }
        let across = Vector::<Body>::new(force.x, force.y, 0.0);
        let felt = (attitude * across * (-1.0 / settings.drag_1_s)).horizontal();
        let innovation = felt - self.velocity_m_s;
        self.followed_s += dt_s;
        let gain_1_s = (settings.follow_1_s * hurry_ratio).max(1.0 / self.followed_s.max(AVERAGE_S_MIN));
        self.velocity_m_s =
            (self.velocity_m_s + innovation * (gain_1_s * dt_s)).limited(settings.speed_m_s_max);
        // A fast vehicle's drag says more of the coefficient's error than of the tilt's.
        let fast = self.velocity_m_s.norm() / DRAG_SURE_M_S;
        let gain = settings.tilt_1_s2 * hurry_ratio * hurry_ratio / GRAVITY_M_S2 / (1.0 + fast * fast);
        Vector::<World>::Z.cross(innovation.limited(settings.speed_m_s_max)) * gain
    }

    /// One tick of calm flight under the ground's commands: the accelerometers' own error is the mean.
    pub fn learn_bias(&mut self, acceleration_m_s2: Vector<Body>, dt_s: f64, settings: &DriftSettings) {
        if self.velocity_m_s.norm() > CALM_M_S {
            return;
        }
        self.calm_s = (self.calm_s + dt_s).min(settings.bias_time_s);
        let across = Vector::<Body>::new(acceleration_m_s2.x, acceleration_m_s2.y, 0.0);
        let step = (across - self.bias_m_s2) * (dt_s / (BIAS_PRIOR_S + self.calm_s));
        self.bias_m_s2 = (self.bias_m_s2 + step).limited(BIAS_M_S2_MAX);
    }
}

/// Thrust the vehicle gets, by what it commands: batteries droop, rotors wear, and nobody weighs a vehicle
/// before each flight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ThrustRatio {
    ratio: f64,
}

/// Time the ratio is averaged over.
const THRUST_TIME_S: f64 = 0.5;

/// Bounds of the ratio.
const THRUST_RATIO_RANGE: [f64; 2] = [0.7, 1.3];

impl ThrustRatio {
    /// What the settings say.
    pub fn new(airframe: &Airframe) -> Self {
        let [low, high] = THRUST_RATIO_RANGE;
        let ratio = (GRAVITY_M_S2 / airframe.hover_collective_m_s2).clamp(low, high);
        Self { ratio }
    }

    /// The ratio.
    pub const fn ratio(&self) -> f64 {
        self.ratio
    }

    /// One tick in the air: the force the accelerometer feels along z under a commanded collective.
    pub fn learn(&mut self, force_m_s2: f64, commanded_m_s2: f64, dt_s: f64) {
        if commanded_m_s2 > 0.5 * GRAVITY_M_S2 {
            let [low, high] = THRUST_RATIO_RANGE;
            let felt = (force_m_s2 / commanded_m_s2).clamp(low, high);
            self.ratio += (felt - self.ratio) * (dt_s / THRUST_TIME_S);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{FirmwareSettings, LOOP_HZ};

    const SETTINGS: DriftSettings = FirmwareSettings::table_i(1).attitude.drift;
    const DT_S: f64 = 1.0 / LOOP_HZ;

    /// A level vehicle that drag slows down, as its accelerometers feel it; its velocity after so long.
    fn glide(drift: &mut Drift, drag_1_s: f64, from_m_s: f64, seconds: f64) -> f64 {
        let mut speed_m_s = from_m_s;
        for _ in 0..(seconds * LOOP_HZ) as u32 {
            let felt = Vector::new(-drag_1_s * speed_m_s, 0.0, GRAVITY_M_S2);
            drift.predict(Rotation::IDENTITY, felt, DT_S, 1.0, &SETTINGS);
            speed_m_s -= drag_1_s * speed_m_s * DT_S;
        }
        speed_m_s
    }

    #[test]
    fn the_speed_is_felt_within_a_tenth_of_a_second() {
        for from_m_s in [-4.0, 1.0, 5.0] {
            let mut drift = Drift::default();
            let speed_m_s = glide(&mut drift, SETTINGS.drag_1_s, from_m_s, 0.1);
            assert!((drift.velocity_m_s().x - speed_m_s).abs() < 0.1 * from_m_s.abs());
            drift.reset();
            assert_eq!(drift.velocity_m_s(), Vector::ZERO);
        }
    }

    #[test]
    fn a_wrong_drag_coefficient_keeps_the_direction() {
        for drag_1_s in [0.5 * SETTINGS.drag_1_s, 2.0 * SETTINGS.drag_1_s] {
            let mut drift = Drift::default();
            let speed_m_s = glide(&mut drift, drag_1_s, 3.0, 0.5);
            let ratio = drift.velocity_m_s().x / speed_m_s;
            assert!((0.45..2.2).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn a_tilt_that_is_not_there_is_turned_back() {
        let mut drift = Drift::default();
        // It believes itself pitched up front down, and at rest is level: no drag is felt.
        let mut believed = Rotation::<Body, World>::from_yaw_pitch_roll(0.4, 0.1, 0.0);
        for _ in 0..8 * LOOP_HZ as u32 {
            let turn = drift.predict(believed, Vector::new(0.0, 0.0, GRAVITY_M_S2), DT_S, 1.0, &SETTINGS);
            believed = believed.turned(believed.inverse() * (turn * DT_S));
        }
        assert!(believed.tilt_rad() < 0.01, "{}", believed.tilt_rad());
    }

    #[test]
    fn the_accelerometers_error_across_is_the_mean_of_calm_flight() {
        let mut drift = Drift::default();
        let bias = Vector::new(0.1, -0.05, GRAVITY_M_S2);
        for _ in 0..60 * LOOP_HZ as u32 {
            drift.learn_bias(bias, DT_S, &SETTINGS);
        }
        assert!((drift.bias_m_s2 - Vector::new(0.1, -0.05, 0.0)).norm() < 0.02);
    }

    #[test]
    fn weak_thrust_is_learned_and_idle_rotors_say_nothing() {
        let mut thrust = ThrustRatio::new(&FirmwareSettings::table_i(1).airframe);
        assert_eq!(thrust.ratio(), 1.0);
        for _ in 0..2 * LOOP_HZ as u32 {
            thrust.learn(9.0, 10.0, DT_S);
            thrust.learn(9.8, 0.0, DT_S);
        }
        assert!((thrust.ratio() - 0.9).abs() < 0.003);
        for _ in 0..8 * LOOP_HZ as u32 {
            thrust.learn(150.0, 10.0, DT_S);
        }
        assert!(thrust.ratio() <= 1.3);
    }
}
