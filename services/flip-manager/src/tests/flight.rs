//! A flip in a vertical plane for tests: what the vehicle truly does around the begin and the end of its
//! maneuver, with lagging rotors, ringing rate loops and a hover controller that takes over at the end.

use quantity::{Body, Frame, Rotation, Span, Time, Vector, World, math};
use schemas::FlipError;

use super::random::Random;
use crate::poses::Pose;

/// How the vehicle departs from what its parameters were made for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Departures {
    pub(crate) thrust_ratio: f64,
    pub(crate) gyro_ratio: f64,
    pub(crate) inertia_ratio: f64,
    pub(crate) inflow_s_m: f64,
}

/// How the cameras depart from the truth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cameras {
    pub(crate) position_noise_m: f64,
    pub(crate) attitude_noise_rad: f64,
    pub(crate) stamp_noise_s: f64,
    pub(crate) dropout_ratio: f64,
}

/// The noise of the simulated arena's cameras.
pub(crate) const CAMERAS: Cameras = Cameras {
    position_noise_m: 0.0005,
    attitude_noise_rad: 0.003,
    stamp_noise_s: 0.0002,
    dropout_ratio: 0.001,
};

/// A flown flip: the poses seen, and the truth.
pub(crate) struct Flight {
    pub(crate) poses: Vec<Pose>,
    pub(crate) began_at: Time,
    pub(crate) ended_at: Time,
    pub(crate) error: FlipError,
}

/// Duration, collective acceleration and angular acceleration of each step of the double flip at 1600 deg/s.
const STEPS: [(f64, f64, f64); 5] = double_flip();

const fn double_flip() -> [(f64, f64, f64); 5] {
    const LEVER_M: f64 = 0.057_818;
    const LOW: f64 = 3.589_744;
    const HIGH: f64 = 21.025_641;
    const RATE: f64 = 27.925_268;
    let (u1, t1, t3, u5, t5) = (20.395_44, 0.160_92, 0.278_33, 20.309_11, 0.182_68);
    let (a1, a2, a5) = ((u1 - HIGH) / LEVER_M, (HIGH - LOW) / (2.0 * LEVER_M), (HIGH - u5) / LEVER_M);
    let middle = (HIGH + LOW) / 2.0;
    [
        (t1, u1, a1),
        ((RATE - a1 * t1) / a2, middle, a2),
        (t3, LOW, 0.0),
        ((RATE + a5 * t5) / a2, middle, -a2),
        (t5, u5, a5),
    ]
}

/// Duration of the double flip.
pub(crate) fn duration_s() -> f64 {
    STEPS.iter().map(|step| step.0).sum()
}

/// Steps of the simulation per onboard tick of 1/800 s.
const SUBSTEPS: u32 = 5;
const STEP_S: f64 = 1.0 / (800.0 * SUBSTEPS as f64);

/// State in the plane, with the thrusts of the front and back rotor (the sides have their mean).
#[derive(Clone, Copy, Debug)]
struct Plane {
    position_m: [f64; 2],
    velocity_m_s: [f64; 2],
    theta_rad: f64,
    rate_rad_s: f64,
    thrust_n: [f64; 2],
}

/// Where the flip begins in the hall.
const ORIGIN_M: Vector<World> = Vector::new(0.3, -0.2, 5.0);

const MASS_KG: f64 = 0.468;
const INERTIA_KG_M2: f64 = 0.0023;
const ARM_M: f64 = 0.17;

impl Plane {
    fn advance(&mut self, wanted_n: [f64; 2], departures: &Departures) {
        for (thrust, wanted) in self.thrust_n.iter_mut().zip(wanted_n) {
            let gain = if wanted >= *thrust { 50.0 } else { 25.0 };
            *thrust += STEP_S * gain * (wanted - *thrust);
        }
        let (sin, cos) = math::sin_cos(self.theta_rad);
        let climb = self.velocity_m_s[0] * sin + self.velocity_m_s[1] * cos;
        // A rotor that moves into its own inflow gives less: that is what damps the rotation.
        let inflow = |hub_m_s: f64| departures.thrust_ratio * (1.0 - departures.inflow_s_m * hub_m_s);
        let swing = self.rate_rad_s * ARM_M;
        let back = self.thrust_n[0] * inflow(climb + swing);
        let front = self.thrust_n[1] * inflow(climb - swing);
        let acceleration = 2.0 * (back + front) / MASS_KG;
        let angular = ARM_M * (back - front) / (INERTIA_KG_M2 * departures.inertia_ratio);
        for (axis, a) in [acceleration * sin, acceleration * cos - 9.81].into_iter().enumerate() {
            self.position_m[axis] += STEP_S * (self.velocity_m_s[axis] + 0.5 * STEP_S * a);
            self.velocity_m_s[axis] += STEP_S * a;
        }
        self.theta_rad += STEP_S * (self.rate_rad_s + 0.5 * STEP_S * angular);
        self.rate_rad_s += STEP_S * angular;
    }
}

/// A rate loop's two gains and its integral.
struct Loop {
    p_1_s: f64,
    i_1_s2: f64,
    integral_rad: f64,
}

impl Loop {
    fn thrusts_n(&mut self, collective_m_s2: f64, error_rad_s: f64) -> [f64; 2] {
        self.integral_rad += error_rad_s / 800.0;
        let asked = self.p_1_s * error_rad_s + self.i_1_s2 * self.integral_rad;
        let half = INERTIA_KG_M2 * asked / (2.0 * ARM_M);
        let share = MASS_KG * collective_m_s2 / 4.0;
        [share + half, share - half].map(|thrust| thrust.clamp(0.08, 2.8))
    }
}

fn command(time_s: f64) -> (f64, f64) {
    let (mut left, mut rate) = (time_s, 0.0);
    for (duration, collective, angular) in STEPS {
        if left < duration {
            return (collective, rate + angular * left);
        }
        left -= duration;
        rate += angular * duration;
    }
    (STEPS[4].1, rate)
}

/// What a hover controller of 50 Hz asks for: level first, then stop.
fn catch(plane: &Plane) -> (f64, f64) {
    let theta = math::wrap_pi(plane.theta_rad);
    let lean = (-0.25 * plane.velocity_m_s[0]).clamp(-0.7, 0.7);
    let rate = (10.0 * (lean - theta)).clamp(-10.0, 10.0);
    let up = 9.81 - 4.0 * plane.velocity_m_s[1];
    ((up / math::cos(theta).max(0.4)).clamp(2.0, 23.0), rate)
}

/// The vehicle with its firmware and its hover controller.
struct Craft {
    plane: Plane,
    departures: Departures,
    maneuver: Loop,
    flight: Loop,
    /// The hover controller's last command: collective acceleration and rate.
    held: (f64, f64),
    hover_n: f64,
}

impl Craft {
    fn new(departures: &Departures, random: &mut Random) -> Self {
        let hover_n = MASS_KG * 9.81 / (4.0 * departures.thrust_ratio);
        Self {
            plane: Plane {
                position_m: [0.01 * random.gaussian(), 0.01 * random.gaussian()],
                velocity_m_s: [0.03 * random.gaussian(), 0.03 * random.gaussian()],
                theta_rad: 0.01 * random.gaussian(),
                rate_rad_s: 0.0,
                thrust_n: [hover_n; 2],
            },
            departures: *departures,
            maneuver: Loop { p_1_s: 240.0, i_1_s2: 3600.0, integral_rad: 0.0 },
            flight: Loop { p_1_s: 40.0, i_1_s2: 60.0, integral_rad: 0.0 },
            held: (9.81, 0.0),
            hover_n,
        }
    }

    /// Thrusts asked for at a tick, that long after the begin of the maneuver.
    fn tick(&mut self, tick: u32, since_begin_s: f64) -> [f64; 2] {
        if tick.is_multiple_of(16) {
            self.held = catch(&self.plane);
        }
        let measured = self.plane.rate_rad_s * self.departures.gyro_ratio;
        if since_begin_s < 0.0 {
            [self.hover_n; 2]
        } else if since_begin_s < duration_s() {
            let (collective, rate) = command(since_begin_s);
            self.maneuver.thrusts_n(collective, rate - measured)
        } else {
            let (collective, rate) = self.held;
            self.flight.thrusts_n(collective / self.departures.thrust_ratio, rate - measured)
        }
    }
}

/// Flies the double flip from a hover and films it; `heading_rad` turns its plane in the hall.
pub(crate) fn fly(seed: u64, heading_rad: f64, departures: &Departures, cameras: &Cameras) -> Flight {
    let mut random = Random::new(seed);
    let mut craft = Craft::new(departures, &mut random);
    let begin_s = 0.3 + 0.005 * random.uniform();
    let base = Time::ZERO + Span::from_secs(100);
    let (mut begin, mut end, mut poses) = (None, None, Vec::new());
    let (mut wanted_n, mut exposure_s) = ([craft.hover_n; 2], 0.0);
    for step in 0..(SUBSTEPS * 800 * 2) {
        let time_s = f64::from(step) * STEP_S;
        if time_s >= begin_s && begin.is_none() {
            begin = Some((time_s, craft.plane));
        }
        let since_begin_s = begin.map_or(-1.0, |(began_s, _)| time_s - began_s);
        if since_begin_s >= duration_s() && end.is_none() {
            end = Some((time_s, craft.plane));
        }
        if step.is_multiple_of(SUBSTEPS) {
            wanted_n = craft.tick(step / SUBSTEPS, since_begin_s);
        }
        if time_s >= exposure_s {
            exposure_s += 0.005;
            if random.uniform() >= cameras.dropout_ratio {
                let at = base + Span::from_secs_f64(time_s + cameras.stamp_noise_s * random.gaussian());
                poses.push(film(at, &craft.plane, heading_rad, cameras, &mut random));
            }
        }
        craft.plane.advance(wanted_n, departures);
    }
    let ((began_s, start), (ended_s, stop)) = begin.zip(end).expect("two seconds hold the whole flip");
    Flight {
        poses,
        began_at: base + Span::from_secs_f64(began_s),
        ended_at: base + Span::from_secs_f64(ended_s),
        error: FlipError {
            x_m: stop.position_m[0] - start.position_m[0],
            z_m: stop.position_m[1] - start.position_m[1],
            vx_m_s: stop.velocity_m_s[0],
            vz_m_s: stop.velocity_m_s[1],
            theta_rad: math::wrap_pi(stop.theta_rad),
        },
    }
}

fn film(at: Time, plane: &Plane, heading_rad: f64, cameras: &Cameras, random: &mut Random) -> Pose {
    let (sin, cos) = math::sin_cos(heading_rad);
    let [x, z] = plane.position_m;
    let jitter: Vector<World> = noise(random, cameras.position_noise_m);
    let wobble: Vector<Body> = noise(random, cameras.attitude_noise_rad);
    Pose {
        at,
        position_m: ORIGIN_M + Vector::new(x * cos, x * sin, z) + jitter,
        orientation: Rotation::from_yaw_pitch_roll(heading_rad, plane.theta_rad, 0.0).turned(wobble),
    }
}

fn noise<F: Frame>(random: &mut Random, sigma: f64) -> Vector<F> {
    Vector::new(random.gaussian(), random.gaussian(), random.gaussian()) * sigma
}
