//! What the air does: drag, thrust lost to inflow, ground effect, gusts.

use quantity::{Body, Span, Vector, World, math};
use settings::PlantSettings;

use crate::random::Stream;

/// Least distance of a rotor from the floor, in radii, that the ground effect is computed for; the formula
/// has a pole at a quarter.
const GROUND_RADII_MIN: f64 = 0.5;

/// Above so many radii the ground effect is below one in ten thousand and left out.
const GROUND_RADII_MAX: f64 = 25.0;

/// Constants of the air around one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    drag_1_s: f64,
    rate_drag_n_m_s2: f64,
    inflow_loss_s_m: f64,
    radius_m: f64,
    ground_effect_ratio: f64,
}

impl Air {
    /// From a vehicle's settings.
    #[must_use]
    pub fn new(settings: &PlantSettings) -> Self {
        Self {
            drag_1_s: settings.body.drag_1_s,
            rate_drag_n_m_s2: settings.body.rate_drag_n_m_s2,
            inflow_loss_s_m: settings.rotor.inflow_loss_s_m,
            radius_m: settings.rotor.radius_m,
            ground_effect_ratio: settings.air.ground_effect_ratio,
        }
    }

    /// Deceleration by drag.
    #[must_use]
    pub fn drag_m_s2(&self, velocity_m_s: Vector<World>) -> Vector<World> {
        velocity_m_s * -self.drag_1_s
    }

    /// Torque of the drag on a turning body, each axis by itself.
    #[must_use]
    pub fn rate_drag_n_m(&self, rate_rad_s: Vector<Body>) -> Vector<Body> {
        let about = |rate: f64| -self.rate_drag_n_m_s2 * rate * rate.abs();
        Vector::new(about(rate_rad_s.x), about(rate_rad_s.y), about(rate_rad_s.z))
    }

    /// Factor on a rotor's static thrust while its hub climbs along its axis: linear, never below zero nor
    /// above two.
    #[must_use]
    pub fn inflow_ratio(&self, axial_m_s: f64) -> f64 {
        (1.0 - self.inflow_loss_s_m * axial_m_s).clamp(0.0, 2.0)
    }

    /// Factor on the thrust of a rotor at that height above the floor.
    // Cheeseman, Bennett 1955: 1 / (1 - (R / 4z)²).
    #[must_use]
    pub fn ground_ratio(&self, height_m: f64) -> f64 {
        if height_m > GROUND_RADII_MAX * self.radius_m {
            return 1.0;
        }
        let height_m = height_m.max(GROUND_RADII_MIN * self.radius_m);
        let part = self.radius_m / (4.0 * height_m);
        1.0 + self.ground_effect_ratio * (1.0 / (1.0 - part * part) - 1.0)
    }
}

/// Gusts: an Ornstein-Uhlenbeck process of acceleration on each axis, advanced in exact steps of
/// [`Gusts::STEP`].
#[derive(Clone, Debug, PartialEq)]
pub struct Gusts {
    acceleration_m_s2: Vector<World>,
    kept: f64,
    fresh_m_s2: f64,
    stream: Stream,
}

impl Gusts {
    /// Between two changes; short against any gust and long against a tick.
    pub const STEP: Span = Span::from_millis(10);

    /// Gusts of that strength (one sigma) and correlation time, in their stationary distribution from the
    /// start.
    #[must_use]
    pub fn new(gust_m_s2: f64, gust_time_s: f64, mut stream: Stream) -> Self {
        let kept = math::exp(-Self::STEP.as_secs_f64() / gust_time_s);
        let acceleration_m_s2 = draw(&mut stream) * gust_m_s2;
        Self { acceleration_m_s2, kept, fresh_m_s2: gust_m_s2 * math::sqrt(1.0 - kept * kept), stream }
    }

    /// The present acceleration.
    #[must_use]
    pub fn acceleration_m_s2(&self) -> Vector<World> {
        self.acceleration_m_s2
    }

    /// Goes on by [`Gusts::STEP`].
    pub fn advance(&mut self) {
        self.acceleration_m_s2 =
            self.acceleration_m_s2 * self.kept + draw(&mut self.stream) * self.fresh_m_s2;
    }
}

fn draw(stream: &mut Stream) -> Vector<World> {
    let (x, y, z) = (stream.gaussian(), stream.gaussian(), stream.gaussian());
    Vector::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;
    use crate::testing::member;

    #[test]
    fn ground_effect_has_the_published_values() {
        let air = Air::new(&member().vehicle.plant);
        assert!((air.ground_ratio(0.1) - 1.066_667).abs() < 1e-6);
        assert!((air.ground_ratio(0.5) - 1.002_506).abs() < 1e-6);
        assert_eq!(air.ground_ratio(5.0), 1.0);
        // Bounded on the floor, and left out so high up that nobody can tell.
        assert!((air.ground_ratio(0.0) - 4.0 / 3.0).abs() < 1e-12);
        assert!((air.ground_ratio(2.499_999) - 1.0) < 1.1e-4);
    }

    #[test]
    fn inflow_takes_four_percent_for_each_metre_per_second() {
        let air = Air::new(&member().vehicle.plant);
        assert!((air.inflow_ratio(4.7) - 0.812).abs() < 1e-12);
        assert!((air.inflow_ratio(-4.7) - 1.188).abs() < 1e-12);
        assert_eq!(air.inflow_ratio(1e9), 0.0);
        assert_eq!(air.inflow_ratio(-1e9), 2.0);
    }

    #[test]
    fn drag_is_against_the_motion() {
        let air = Air::new(&member().vehicle.plant);
        assert!((air.drag_m_s2(Vector::new(2.0, 0.0, -1.0)) - Vector::new(-0.6, 0.0, 0.3)).norm() < 1e-12);
        let torque = air.rate_drag_n_m(Vector::new(0.0, -27.925, 10.0));
        assert!((torque - Vector::new(0.0, 2e-5 * 27.925 * 27.925, -2e-3)).norm() < 1e-12);
    }

    #[test]
    fn gusts_have_their_strength_and_their_correlation_time() {
        let mut gusts = Gusts::new(0.1, 1.0, Stream::new(3, Purpose::Gust, 1));
        let n = 400_000;
        let (mut power, mut product) = (0.0, 0.0);
        let mut history = Vec::with_capacity(n);
        for _ in 0..n {
            history.push(gusts.acceleration_m_s2().x);
            gusts.advance();
        }
        // A lag of one correlation time is 100 steps; 4000 of those give the standard error of 3 %.
        for i in 0..n - 100 {
            power += history[i] * history[i];
            product += history[i] * history[i + 100];
        }
        assert!((math::sqrt(power / n as f64) - 0.1).abs() < 0.006);
        assert!((product / power - math::exp(-1.0)).abs() < 0.06);
    }
}
