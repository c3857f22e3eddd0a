//! From where the vehicle is and shall be to the acceleration it needs, and from that to thrust.

use quantity::{Body, GRAVITY_M_S2, Rotation, Vector, World, math};
use schemas::Kinematics;

use crate::tuning::PositionTuning;

/// Where to be at the instant a command takes effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// Place.
    pub position_m: Vector<World>,
    /// Velocity at that place.
    pub velocity_m_s: Vector<World>,
    /// Acceleration at that place.
    pub acceleration_m_s2: Vector<World>,
    /// Heading of the body's x axis.
    pub heading_rad: f64,
}

/// Thrust asked for: a direction, and how much along the body's present axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Thrust {
    /// Where the thrust axis shall point.
    pub axis: Vector<World>,
    /// Collective acceleration meanwhile.
    pub collective_m_s2: f64,
}

/// How the vehicle may fly to its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Manner {
    /// Greatest tilt asked for.
    pub tilt_rad_max: f64,
    /// Vertical speed to hold instead of flying to the target's height.
    pub vertical_m_s: Option<f64>,
    /// Whether the integral and the compensation of disturbances go on learning.
    pub learning: bool,
}

/// Position loop of one vehicle: what it has learned of the forces nobody told it of.
#[derive(Clone, Debug, Default)]
pub(crate) struct PositionLoop {
    integral_m_s: Vector<World>,
    disturbance_m_s2: Vector<World>,
}

/// Collective acceleration that at least must point up, however fast the vehicle is to sink.
const LIFT_M_S2_MIN: f64 = 4.0;

impl PositionLoop {
    /// Forgets the integral: the vehicle was flown by somebody else.
    pub fn reset_integral(&mut self) {
        self.integral_m_s = Vector::ZERO;
    }

    /// Collective acceleration that holds the height, by what is known of the thrust.
    pub fn hover_m_s2(&self) -> f64 {
        GRAVITY_M_S2 - self.disturbance_m_s2.z
    }

    /// Takes the estimator's word on unexplained accelerations, `span_s` after the last.
    pub fn learn(&mut self, tuning: &PositionTuning, disturbance_m_s2: Vector<World>, span_s: f64) {
        let share = (span_s / tuning.disturbance_time_s).clamp(0.0, 1.0);
        let wanted = disturbance_m_s2.limited(tuning.disturbance_m_s2_max);
        self.disturbance_m_s2 += (wanted - self.disturbance_m_s2) * share;
    }

    /// Acceleration wanted of thrust and gravity together.
    pub fn acceleration_m_s2(
        &mut self,
        tuning: &PositionTuning,
        state: &Kinematics,
        target: &Target,
        manner: &Manner,
        span_s: f64,
    ) -> Vector<World> {
        let error = target.position_m - state.position_m;
        let toward = error * tuning.position_gain_1_s;
        let sideways = toward.horizontal().limited(tuning.speed_m_s_max);
        let vertical = match manner.vertical_m_s {
            Some(speed) => speed,
            None => target.velocity_m_s.z + toward.z.clamp(-tuning.descent_m_s_max, tuning.climb_m_s_max),
        };
        let velocity = target.velocity_m_s.horizontal() + sideways + Vector::Z * vertical;
        let short = velocity - state.velocity_m_s;
        if manner.learning {
            self.integrate(tuning, error, manner, span_s);
        }
        target.acceleration_m_s2
            + short.horizontal() * tuning.velocity_gain_1_s
            + Vector::Z * (short.z * tuning.vertical_gain_1_s)
            + self.integral_m_s * tuning.integral_gain_1_s3
            - self.disturbance_m_s2
    }

    fn integrate(&mut self, tuning: &PositionTuning, error: Vector<World>, manner: &Manner, span_s: f64) {
        if error.norm() > tuning.integral_reach_m || tuning.integral_gain_1_s3 <= 0.0 {
            return;
        }
        let error = if manner.vertical_m_s.is_some() { error.horizontal() } else { error };
        let max = tuning.integral_m_s2_max / tuning.integral_gain_1_s3;
        self.integral_m_s = (self.integral_m_s + error * span_s).limited(max);
    }
}

/// The thrust that gives this acceleration, as far as the rotors and `tilt_rad_max` go: attitude first, then
/// the vertical, then the horizontal.
pub(crate) fn thrust(
    tuning: &PositionTuning,
    acceleration_m_s2: Vector<World>,
    orientation: Rotation<Body, World>,
    tilt_rad_max: f64,
) -> Thrust {
    let most = tuning.collective_m_s2_max;
    let lift = (acceleration_m_s2.z + GRAVITY_M_S2).clamp(LIFT_M_S2_MIN, most);
    let (sin, cos) = math::sin_cos(tilt_rad_max);
    let spare = math::sqrt((most * most - lift * lift).max(0.0));
    let sideways = acceleration_m_s2.horizontal().limited(spare.min(lift * sin / cos));
    let wanted = sideways + Vector::Z * lift;
    let axis = wanted.direction().unwrap_or(Vector::Z);
    // Thrust in a direction nobody wants helps nobody: as much as the present axis has of the wanted one.
    let collective_m_s2 = wanted.dot(orientation.z_axis()).clamp(tuning.collective_m_s2_min, most);
    Thrust { axis, collective_m_s2 }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;

    fn tuning() -> PositionTuning {
        PositionTuning::default()
    }

    const CALM: Manner = Manner { tilt_rad_max: 0.5, vertical_m_s: None, learning: true };

    fn at(position_m: Vector<World>) -> Kinematics {
        Kinematics { position_m, ..Kinematics::default() }
    }

    fn target(position_m: Vector<World>) -> Target {
        Target { position_m, velocity_m_s: Vector::ZERO, acceleration_m_s2: Vector::ZERO, heading_rad: 0.0 }
    }

    #[test]
    fn hovering_needs_gravity_and_what_is_missing_of_it() {
        let mut position = PositionLoop::default();
        position.learn(&tuning(), Vector::new(0.0, 0.0, -0.8), 10.0);
        let place = Vector::new(1.0, 2.0, 3.0);
        let acceleration = position.acceleration_m_s2(&tuning(), &at(place), &target(place), &CALM, 0.005);
        let thrust = thrust(&tuning(), acceleration, Rotation::IDENTITY, 0.5);
        assert!((thrust.collective_m_s2 - (GRAVITY_M_S2 + 0.8)).abs() < 1e-9);
        assert!((thrust.axis - Vector::Z).norm() < 1e-12);
        assert!((position.hover_m_s2() - (GRAVITY_M_S2 + 0.8)).abs() < 1e-9);
    }

    #[test]
    fn far_goals_are_approached_at_the_speed_allowed() {
        let mut position = PositionLoop::default();
        let mut state = at(Vector::new(0.0, 0.0, 4.0));
        state.velocity_m_s = Vector::new(tuning().speed_m_s_max, 0.0, 0.0);
        let far = target(Vector::new(4.0, 0.0, 4.0));
        let acceleration = position.acceleration_m_s2(&tuning(), &state, &far, &CALM, 0.005);
        assert!(acceleration.norm() < 1e-9, "{acceleration:?}");
        assert_eq!(position.integral_m_s, Vector::ZERO, "the integral waits until it is near");
    }

    #[test]
    fn the_vertical_comes_before_the_horizontal() {
        let wild = Vector::new(100.0, 0.0, 50.0);
        let most = thrust(&tuning(), wild, Rotation::IDENTITY, 0.85);
        assert!((most.axis - Vector::Z).norm() < 1e-12);
        let sideways = thrust(&tuning(), Vector::new(100.0, 0.0, 0.0), Rotation::IDENTITY, 0.5);
        assert!((math::acos(sideways.axis.z) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn thrust_waits_for_the_attitude() {
        let over = Rotation::from_yaw_pitch_roll(0.0, PI, 0.0);
        let thrust = thrust(&tuning(), Vector::ZERO, over, 0.5);
        assert_eq!(thrust.collective_m_s2, tuning().collective_m_s2_min);
    }

    #[test]
    fn the_integral_is_limited() {
        let mut position = PositionLoop::default();
        let place = target(Vector::new(0.0, 0.0, 4.1));
        for _ in 0..100_000 {
            position.acceleration_m_s2(&tuning(), &at(Vector::new(0.0, 0.0, 4.0)), &place, &CALM, 0.005);
        }
        let limit = tuning().integral_m_s2_max / tuning().integral_gain_1_s3;
        assert!((position.integral_m_s.norm() - limit).abs() < 1e-9);
    }
}
