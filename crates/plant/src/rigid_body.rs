//! A rigid body in three dimensions: Newton's and Euler's equations, quaternion attitude, classical
//! Runge-Kutta.

use quantity::{Body, Rotation, Vector, World};

/// Where a body is and how it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Centre of mass.
    pub position_m: Vector<World>,
    /// Its velocity.
    pub velocity_m_s: Vector<World>,
    /// Attitude.
    pub orientation: Rotation<Body, World>,
    /// Angular rate.
    pub rate_rad_s: Vector<Body>,
}

/// What acts on a body at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Sum of all forces by mass, gravity included.
    pub acceleration_m_s2: Vector<World>,
    /// Sum of all torques.
    pub torque_n_m: Vector<Body>,
}

/// Which instants of a step a Runge-Kutta stage stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The step's beginning.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// Principal moments of inertia, with their inverses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    moments_kg_m2: Vector<Body>,
    inverse: Vector<Body>,
}

impl Inertia {
    /// From the moments about the body's x, y and z axes, kg m², all above zero.
    #[must_use]
    pub fn new(moments_kg_m2: [f64; 3]) -> Self {
        let [x, y, z] = moments_kg_m2;
        Self { moments_kg_m2: Vector::new(x, y, z), inverse: Vector::new(1.0 / x, 1.0 / y, 1.0 / z) }
    }

    /// Angular momentum at a rate, kg m²/s.
    #[must_use]
    pub fn momentum(&self, rate_rad_s: Vector<Body>) -> Vector<Body> {
        times(self.moments_kg_m2, rate_rad_s)
    }

    /// Angular acceleration, rad/s², under a torque.
    #[must_use]
    pub fn angular_acceleration(&self, rate_rad_s: Vector<Body>, torque_n_m: Vector<Body>) -> Vector<Body> {
        times(self.inverse, torque_n_m - rate_rad_s.cross(self.momentum(rate_rad_s)))
    }
}

fn times(a: Vector<Body>, b: Vector<Body>) -> Vector<Body> {
    Vector::new(a.x * b.x, a.y * b.y, a.z * b.z)
}

/// Time derivative of a [`Motion`].
#[derive(Clone, Copy)]
struct Slope {
    velocity_m_s: Vector<World>,
    acceleration_m_s2: Vector<World>,
    /// Derivative of the quaternion, w x y z.
    quaternion: [f64; 4],
    angular_acceleration_rad_s2: Vector<Body>,
}

impl Motion {
    /// At rest and level at a place.
    #[must_use]
    pub fn at_rest(position_m: Vector<World>, heading_rad: f64) -> Self {
        Self {
            position_m,
            orientation: Rotation::from_yaw_pitch_roll(heading_rad, 0.0, 0.0),
            ..Self::default()
        }
    }

    /// This motion `step_s` later: one classical fourth-order Runge-Kutta step. `first` is the load at the
    /// step's beginning, `load` gives those of the later stages.
    #[must_use]
    pub fn stepped(
        &self,
        inertia: &Inertia,
        step_s: f64,
        first: Load,
        mut load: impl FnMut(Stage, &Self) -> Load,
    ) -> Self {
        let half_s = 0.5 * step_s;
        let k1 = self.slope(inertia, first);
        let middle = self.moved(&k1, half_s);
        let k2 = middle.slope(inertia, load(Stage::Middle, &middle));
        let middle = self.moved(&k2, half_s);
        let k3 = middle.slope(inertia, load(Stage::Middle, &middle));
        let end = self.moved(&k3, step_s);
        let k4 = end.slope(inertia, load(Stage::End, &end));
        let weighted = Slope {
            velocity_m_s: mean(k1.velocity_m_s, k2.velocity_m_s, k3.velocity_m_s, k4.velocity_m_s),
            acceleration_m_s2: mean(
                k1.acceleration_m_s2,
                k2.acceleration_m_s2,
                k3.acceleration_m_s2,
                k4.acceleration_m_s2,
            ),
            quaternion: core::array::from_fn(|i| {
                (k1.quaternion[i] + 2.0 * (k2.quaternion[i] + k3.quaternion[i]) + k4.quaternion[i]) / 6.0
            }),
            angular_acceleration_rad_s2: mean(
                k1.angular_acceleration_rad_s2,
                k2.angular_acceleration_rad_s2,
                k3.angular_acceleration_rad_s2,
                k4.angular_acceleration_rad_s2,
            ),
        };
        let mut end = self.moved(&weighted, step_s);
        end.orientation = nearly_renormalised(end.orientation);
        end
    }

    fn slope(&self, inertia: &Inertia, load: Load) -> Slope {
        let (q, rate) = (self.orientation, self.rate_rad_s);
        Slope {
            velocity_m_s: self.velocity_m_s,
            acceleration_m_s2: load.acceleration_m_s2,
            quaternion: [
                -0.5 * (q.x * rate.x + q.y * rate.y + q.z * rate.z),
                0.5 * (q.w * rate.x + q.y * rate.z - q.z * rate.y),
                0.5 * (q.w * rate.y - q.x * rate.z + q.z * rate.x),
                0.5 * (q.w * rate.z + q.x * rate.y - q.y * rate.x),
            ],
            angular_acceleration_rad_s2: inertia.angular_acceleration(rate, load.torque_n_m),
        }
    }

    fn moved(&self, slope: &Slope, by_s: f64) -> Self {
        let mut orientation = self.orientation;
        orientation.w += slope.quaternion[0] * by_s;
        orientation.x += slope.quaternion[1] * by_s;
        orientation.y += slope.quaternion[2] * by_s;
        orientation.z += slope.quaternion[3] * by_s;
        Self {
            position_m: self.position_m + slope.velocity_m_s * by_s,
            velocity_m_s: self.velocity_m_s + slope.acceleration_m_s2 * by_s,
            orientation,
            rate_rad_s: self.rate_rad_s + slope.angular_acceleration_rad_s2 * by_s,
        }
    }
}

fn mean<F: quantity::Frame>(a: Vector<F>, b: Vector<F>, c: Vector<F>, d: Vector<F>) -> Vector<F> {
    (a + (b + c) * 2.0 + d) * (1.0 / 6.0)
}

/// One Newton step toward unit length. A step leaves the quaternion within 1e-8 of it, this within 1e-16: no
/// square root needed.
fn nearly_renormalised(mut q: Rotation<Body, World>) -> Rotation<Body, World> {
    let scale = 1.5 - 0.5 * (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    q.w *= scale;
    q.x *= scale;
    q.y *= scale;
    q.z *= scale;
    q
}

#[cfg(test)]
mod tests {
    use super::*;
    use quantity::GRAVITY_M_S2;

    const STEP_S: f64 = 1.25e-3;

    fn fly(mut motion: Motion, inertia: &Inertia, steps: usize, load: Load) -> Motion {
        for _ in 0..steps {
            motion = motion.stepped(inertia, STEP_S, load, |_, _| load);
        }
        motion
    }

    #[test]
    fn free_fall_follows_the_parabola() {
        let inertia = Inertia::new([0.0023, 0.0023, 0.004]);
        let start = Motion {
            position_m: Vector::new(1.0, 2.0, 9.0),
            velocity_m_s: Vector::new(0.5, -0.25, 3.0),
            ..Motion::default()
        };
        let gravity = Load { acceleration_m_s2: Vector::new(0.0, 0.0, -GRAVITY_M_S2), ..Load::default() };
        let end = fly(start, &inertia, 800, gravity);
        let expected = Vector::new(1.5, 1.75, 9.0 + 3.0 - 0.5 * GRAVITY_M_S2);
        assert!((end.position_m - expected).norm() < 1e-11);
        assert!((end.velocity_m_s.z - (3.0 - GRAVITY_M_S2)).abs() < 1e-11);
    }

    #[test]
    fn a_tumbling_body_keeps_energy_and_angular_momentum() {
        let inertia = Inertia::new([0.0020, 0.0026, 0.0041]);
        let start = Motion { rate_rad_s: Vector::new(6.0, -9.0, 4.0), ..Motion::default() };
        let momentum = |m: &Motion| m.orientation * inertia.momentum(m.rate_rad_s);
        let energy = |m: &Motion| 0.5 * m.rate_rad_s.dot(inertia.momentum(m.rate_rad_s));
        let end = fly(start, &inertia, 8_000, Load::default());
        assert!((energy(&end) / energy(&start) - 1.0).abs() < 1e-8);
        assert!((momentum(&end) - momentum(&start)).norm() / momentum(&start).norm() < 1e-8);
        // It did tumble: the rate moved in the body.
        assert!((end.rate_rad_s - start.rate_rad_s).norm() > 1.0);
        assert!((end.orientation * Vector::<Body>::Z).norm() - 1.0 < 1e-14);
    }

    #[test]
    fn a_constant_rate_about_one_axis_turns_by_rate_times_time() {
        let inertia = Inertia::new([0.0023, 0.0023, 0.004]);
        let start = Motion { rate_rad_s: Vector::new(0.0, 27.925_268, 0.0), ..Motion::default() };
        let end = fly(start, &inertia, 80, Load::default());
        let expected = Rotation::from_rotation_vector(Vector::new(0.0, 2.792_526_8, 0.0));
        assert!(end.orientation.angle_to(expected) < 1e-7);
    }

    #[test]
    fn a_torque_turns_about_its_own_axis_and_direction() {
        let inertia = Inertia::new([0.0023, 0.0023, 0.004]);
        let load = Load { torque_n_m: Vector::new(0.0, 0.0, 0.004), ..Load::default() };
        let end = fly(Motion::default(), &inertia, 800, load);
        assert!((end.rate_rad_s.z - 1.0).abs() < 1e-12);
        assert!((end.orientation.yaw_rad() - 0.5).abs() < 1e-12);
    }
}
