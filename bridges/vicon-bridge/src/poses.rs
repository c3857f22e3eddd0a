//! Which of the poses the cameras report may be believed.
//!
//! Vicon's stream has no sign of occlusion: a vehicle that is not seen may be absent, at zero, or repeat its last
//! pose. OptiTrack's has one, and shows the last pose or zero all the same. A number may be no number, and a changed unit at the vendor's system makes millimetres of metres.
//! What gets past here is finite, new, somewhere near the hall, and of unit length; whether it is *plausible*
//! is the estimator's question, who knows how the vehicle moved before.

use quantity::{Body, Rotation, Span, Time, Vector, World};
use settings::Hall;

use crate::sighting::Shown;

/// A pose in the vicinity of a thousandth of the last good one is that one in the wrong unit: how near.
const SLIP_TOLERANCE_M: f64 = 0.01;
/// Below this distance from the origin the two cannot be told apart.
const SLIP_DISTANCE_M_MIN: f64 = 0.3;
/// The last good pose says nothing about what is seen after a longer pause.
const SLIP_MEMORY: Span = Span::from_secs(2);

/// A pose in our units and frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Centre of the vehicle.
    pub(crate) position_m: Vector<World>,
    /// Attitude of the vehicle.
    pub(crate) orientation: Rotation<Body, World>,
}

/// Why a pose is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Refusal {
    /// Not finite.
    NotFinite,
    /// At zero: occluded.
    Zero,
    /// Bit for bit the one before, so many times: occluded or stuck.
    Repeated(u32),
    /// Far outside the hall: another unit, or nonsense.
    OutsideHall,
    /// The last one in metres, read as millimetres.
    UnitSlip,
    /// Angles of more than two turns, or a quaternion without a direction: another unit, or nonsense.
    Angles,
}

/// Limits that hold for all vehicles.
#[derive(Clone, Debug)]
pub(crate) struct PoseLimits {
    half_width_m: f64,
    half_depth_m: f64,
    height_m: f64,
    outside_m: f64,
    identical_accepted: u32,
}

impl PoseLimits {
    /// Poses up to `outside_m` outside the hall, repeated up to `identical_accepted` times.
    pub(crate) fn new(hall: &Hall, outside_m: f64, identical_accepted: u32) -> Self {
        Self {
            half_width_m: 0.5 * hall.width_m,
            half_depth_m: 0.5 * hall.depth_m,
            height_m: hall.height_m,
            outside_m,
            identical_accepted,
        }
    }

    fn contain(&self, position_m: Vector<World>) -> bool {
        position_m.x.abs() <= self.half_width_m + self.outside_m
            && position_m.y.abs() <= self.half_depth_m + self.outside_m
            && (-self.outside_m..=self.height_m + self.outside_m).contains(&position_m.z)
    }
}

/// Judges the poses of one vehicle.
#[derive(Clone, Debug, Default)]
pub(crate) struct PoseGuard {
    newest_bits: Option<[u64; 7]>,
    repeats: u32,
    accepted: Option<(Time, Vector<World>)>,
}

impl PoseGuard {
    /// The pose, if it may be believed.
    ///
    /// # Errors
    /// Why not.
    pub(crate) fn judge(&mut self, shown: &Shown, at: Time, limits: &PoseLimits) -> Result<Pose, Refusal> {
        self.count_repeats(shown);
        if !shown.is_finite() {
            return Err(Refusal::NotFinite);
        }
        let position_m = shown.position_m();
        // An exact zero in all three is never measured.
        if position_m == Vector::ZERO {
            return Err(Refusal::Zero);
        }
        if self.repeats > limits.identical_accepted {
            return Err(Refusal::Repeated(self.repeats));
        }
        let orientation = shown.orientation().ok_or(Refusal::Angles)?;
        if !limits.contain(position_m) {
            return Err(Refusal::OutsideHall);
        }
        if self.is_unit_slip(position_m, at) {
            return Err(Refusal::UnitSlip);
        }
        self.accepted = Some((at, position_m));
        Ok(Pose { position_m, orientation })
    }

    /// How often the newest pose has been repeated bit for bit.
    #[cfg(test)]
    pub(crate) const fn repeats(&self) -> u32 {
        self.repeats
    }

    fn count_repeats(&mut self, shown: &Shown) {
        let bits = shown.bits();
        self.repeats = if self.newest_bits == Some(bits) { self.repeats.saturating_add(1) } else { 0 };
        self.newest_bits = Some(bits);
    }

    /// While a slip lasts, the last good pose is remembered.
    fn is_unit_slip(&mut self, position_m: Vector<World>, at: Time) -> bool {
        let Some((seen_at, accepted_m)) = &mut self.accepted else {
            return false;
        };
        let slipped = at - *seen_at < SLIP_MEMORY
            && accepted_m.norm() > SLIP_DISTANCE_M_MIN
            && (position_m - *accepted_m * 1e-3).norm() < SLIP_TOLERANCE_M;
        if slipped {
            *seen_at = at;
        }
        slipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(identical_accepted: u32) -> PoseLimits {
        let hall = Hall { width_m: 10.0, depth_m: 10.0, height_m: 10.0, margin_m: 0.5 };
        PoseLimits::new(&hall, 5.0, identical_accepted)
    }

    fn object(translation_mm: [f64; 3], rotation_rad: [f64; 3]) -> Shown {
        Shown::Vicon { translation_mm, rotation_rad }
    }

    fn judge(
        guard: &mut PoseGuard,
        translation_mm: [f64; 3],
        rotation_rad: [f64; 3],
    ) -> Result<Pose, Refusal> {
        guard.judge(&object(translation_mm, rotation_rad), Time::ZERO, &limits(0))
    }

    #[test]
    fn units_and_rotation_order_are_the_vendors() {
        let pose = judge(&mut PoseGuard::default(), [100.0, -200.5, 1500.25], [0.1, -0.2, 0.3]).unwrap();
        assert!((pose.position_m - Vector::new(0.1, -0.2005, 1.50025)).norm() < 1e-12);
        // Rx(0.1)·Ry(-0.2)·Rz(0.3) carries the body's x axis here, by hand from the three matrices:
        // Rz e_x = (cos z, sin z, 0), then Ry, then Rx.
        let (sz, cz) = quantity::math::sin_cos(0.3);
        let (sy, cy) = quantity::math::sin_cos(-0.2);
        let (sx, cx) = quantity::math::sin_cos(0.1);
        let (x, y, z) = (cy * cz, sz, -sy * cz);
        let expected = Vector::new(x, cx * y - sx * z, sx * y + cx * z);
        assert!((pose.orientation * Vector::<Body>::new(1.0, 0.0, 0.0) - expected).norm() < 1e-12);
    }

    #[test]
    fn poison_is_refused_with_its_reason() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for index in 0..6 {
                let mut numbers = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3];
                numbers[index] = bad;
                let [x, y, z, a, b, c] = numbers;
                assert_eq!(judge(&mut PoseGuard::default(), [x, y, z], [a, b, c]), Err(Refusal::NotFinite));
            }
        }
        for (translation_mm, rotation_rad, refusal) in [
            ([0.0; 3], [0.0; 3], Refusal::Zero),
            ([0.0, -0.0, 0.0], [0.1, 0.0, 0.0], Refusal::Zero),
            ([15e3, 0.0, 1e3], [0.0; 3], Refusal::OutsideHall),
            ([0.0, 0.0, -6e3], [0.0; 3], Refusal::OutsideHall),
            ([1.5e6, 0.0, 5e6], [0.0; 3], Refusal::OutsideHall),
            ([1e3, 0.0, 1e3], [90.0, 0.0, 0.0], Refusal::Angles),
            ([1e308, 1e308, 1e308], [0.0; 3], Refusal::OutsideHall),
        ] {
            assert_eq!(judge(&mut PoseGuard::default(), translation_mm, rotation_rad), Err(refusal));
        }
    }

    #[test]
    fn the_first_identical_pose_is_already_stale_and_a_moved_one_is_not() {
        let mut guard = PoseGuard::default();
        assert!(judge(&mut guard, [1.0, 2.0, 3.0], [0.1; 3]).is_ok());
        for repeats in 1..=7 {
            assert_eq!(judge(&mut guard, [1.0, 2.0, 3.0], [0.1; 3]), Err(Refusal::Repeated(repeats)));
        }
        assert!(judge(&mut guard, [1.0, 2.0, 3.000_001], [0.1; 3]).is_ok());
        assert_eq!(guard.repeats(), 0);
    }

    #[test]
    fn a_noise_free_world_may_allow_repeats() {
        let mut guard = PoseGuard::default();
        for _ in 0..50 {
            let pose = guard.judge(&object([1.0, 2.0, 3.0], [0.0; 3]), Time::ZERO, &limits(u32::MAX));
            assert!(pose.is_ok());
        }
    }

    #[test]
    fn metres_in_place_of_millimetres_are_refused_while_they_last() {
        let (mut guard, limits) = (PoseGuard::default(), limits(0));
        let second = |n| Time::ZERO + Span::from_millis(n);
        assert!(guard.judge(&object([1500.0, 0.0, 5000.0], [0.1; 3]), second(0), &limits).is_ok());
        let slipped = [1.5008, 0.0003, 5.0009];
        assert_eq!(guard.judge(&object(slipped, [0.1; 3]), second(5), &limits), Err(Refusal::UnitSlip));
        assert!(guard.judge(&object([1501.0, 0.0, 5001.0], [0.1; 3]), second(10), &limits).is_ok());
        for step in 2..2_000 {
            let seen = guard.judge(
                &object([1.5 + 1e-6 * step as f64, 0.0, 5.0], [0.1; 3]),
                second(5 * step),
                &limits,
            );
            assert_eq!(seen, Err(Refusal::UnitSlip));
        }
        assert!(guard.judge(&object([1510.0, 0.0, 5001.0], [0.1; 3]), second(10_000), &limits).is_ok());
        // A vehicle that was not seen for long may well stand at the origin.
        assert!(guard.judge(&object(slipped, [0.1; 3]), second(12_100), &limits).is_ok());
    }
}
