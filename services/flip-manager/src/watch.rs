//! What is watched while a vehicle flies by itself, and when it counts as caught afterwards.

use quantity::{Time, Vector, World};
use schemas::{Tracking, VehicleState};
use settings::Hall;

use crate::gate::age_s;
use crate::tuning::WatchTuning;

/// Why a flip is ended early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Breach {
    /// Too low, and sinking.
    Low,
    /// Leaving the hall less its margin.
    Leaving,
    /// Nobody sees it.
    Unseen,
}

impl Breach {
    /// In words.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::Low => "too low and sinking",
            Self::Leaving => "leaving the hall",
            Self::Unseen => "unseen by motion capture",
        }
    }
}

impl WatchTuning {
    /// Whether a flip must be ended, judged by the newest usable estimate and when it was one.
    pub(crate) fn breach(&self, now: Time, hall: &Hall, last_valid: Option<&VehicleState>) -> Option<Breach> {
        let state = last_valid.filter(|state| age_s(now, state.estimated_for) <= self.blind_s_max);
        let Some(state) = state else {
            return Some(Breach::Unseen);
        };
        let (at, velocity) = (state.estimate.position_m, state.estimate.velocity_m_s);
        if at.z < self.height_m_min && velocity.z < 0.0 {
            return Some(Breach::Low);
        }
        let beyond = |position_m: f64, velocity_m_s: f64, limit_m: f64| {
            position_m.abs() > limit_m && position_m * velocity_m_s > 0.0
        };
        let leaving = beyond(at.x, velocity.x, 0.5 * hall.width_m - self.wall_m_min)
            || beyond(at.y, velocity.y, 0.5 * hall.depth_m - self.wall_m_min)
            || (at.z > hall.height_m - self.wall_m_min && velocity.z > 0.0);
        leaving.then_some(Breach::Leaving)
    }

    /// Whether the hover controller has caught a vehicle after its flip.
    pub(crate) fn is_recovered(&self, state: &VehicleState, place_m: Vector<World>) -> bool {
        state.tracking == Tracking::Tracking
            && (state.estimate.position_m - place_m).norm() <= self.recovered_place_m_max
            && state.estimate.velocity_m_s.norm() <= self.recovered_speed_m_s_max
            && state.estimate.orientation.tilt_rad() <= self.recovered_tilt_rad_max
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quantity::Span;
    use schemas::Kinematics;

    const HALL: Hall = Hall { width_m: 10.0, depth_m: 8.0, height_m: 9.0, margin_m: 0.5 };

    fn state(position_m: [f64; 3], velocity_m_s: [f64; 3]) -> VehicleState {
        let vector = |[x, y, z]: [f64; 3]| Vector::new(x, y, z);
        VehicleState {
            tracking: Tracking::Ballistic,
            estimate: Kinematics {
                position_m: vector(position_m),
                velocity_m_s: vector(velocity_m_s),
                ..Kinematics::default()
            },
            ..VehicleState::default()
        }
    }

    #[test]
    fn each_limit_counts_only_on_the_way_out() {
        let watch = WatchTuning::default();
        let breach = |position, velocity| watch.breach(Time::ZERO, &HALL, Some(&state(position, velocity)));
        assert_eq!(breach([0.0, 0.0, 5.0], [9.0, 9.0, -9.0]), None);
        assert_eq!(breach([0.0, 0.0, 0.99], [0.0, 0.0, -0.1]), Some(Breach::Low));
        assert_eq!(breach([0.0, 0.0, 0.99], [0.0, 0.0, 0.1]), None);
        assert_eq!(breach([0.0, 0.0, 1.01], [0.0, 0.0, -5.0]), None);
        for (at, out) in [
            ([4.51, 0.0, 5.0], [0.1, 0.0, 0.0]),
            ([-4.51, 0.0, 5.0], [-0.1, 0.0, 0.0]),
            ([0.0, 3.51, 5.0], [0.0, 0.1, 0.0]),
            ([0.0, -3.51, 5.0], [0.0, -0.1, 0.0]),
            ([0.0, 0.0, 8.51], [0.0, 0.0, 0.1]),
        ] {
            assert_eq!(breach(at, out), Some(Breach::Leaving), "{at:?}");
            assert_eq!(breach(at, out.map(|v: f64| -v)), None, "{at:?} on its way back");
        }
    }

    #[test]
    fn blindness_ends_a_flip_after_its_time() {
        let watch = WatchTuning::default();
        let seen = state([0.0, 0.0, 5.0], [0.0; 3]);
        let at = |millis| Time::ZERO + Span::from_millis(millis);
        assert_eq!(watch.breach(at(200), &HALL, Some(&seen)), None);
        assert_eq!(watch.breach(at(201), &HALL, Some(&seen)), Some(Breach::Unseen));
        assert_eq!(watch.breach(at(0), &HALL, None), Some(Breach::Unseen));
    }
}
