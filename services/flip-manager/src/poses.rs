//! What motion capture saw of one vehicle lately.

use std::collections::VecDeque;

use quantity::{Body, Rotation, Span, Time, Vector, World};

/// One pose at one exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// When the shutters were open.
    pub(crate) at: Time,
    /// Centre of the vehicle.
    pub(crate) position_m: Vector<World>,
    /// Attitude.
    pub(crate) orientation: Rotation<Body, World>,
}

/// More than this at one frame rate or another is never of use: bounds the memory whatever the stamps say.
const POSES_MAX: usize = 4096;

/// The poses of the last seconds, in the order of their exposures.
#[derive(Clone, Debug)]
pub(crate) struct Poses {
    history: Span,
    poses: VecDeque<Pose>,
}

impl Poses {
    pub(crate) fn new(history_s: f64) -> Self {
        Self { history: Span::from_secs_f64(history_s), poses: VecDeque::new() }
    }

    /// Takes a pose. One that is no later than the newest is not taken; where the stamps have fallen by more
    /// than the whole history, the camera's clock has started anew and so does the history.
    pub(crate) fn push(&mut self, pose: Pose) {
        if let Some(newest) = self.newest() {
            if newest.at - pose.at > self.history {
                self.poses.clear();
            } else if pose.at <= newest.at {
                return;
            }
        }
        let oldest_kept = pose.at - self.history;
        while self.poses.front().is_some_and(|oldest| oldest.at < oldest_kept)
            || self.poses.len() >= POSES_MAX
        {
            self.poses.pop_front();
        }
        self.poses.push_back(pose);
    }

    /// The pose of the latest exposure.
    pub(crate) fn newest(&self) -> Option<&Pose> {
        self.poses.back()
    }

    /// The poses from `from` until `until`, both included, in order.
    pub(crate) fn between(&self, from: Time, until: Time) -> impl Iterator<Item = &Pose> {
        let begin = self.poses.partition_point(|pose| pose.at < from);
        let end = self.poses.partition_point(|pose| pose.at <= until).max(begin);
        self.poses.range(begin..end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(millis: i64) -> Pose {
        Pose {
            at: Time::ZERO + Span::from_millis(millis),
            position_m: Vector::ZERO,
            orientation: Rotation::IDENTITY,
        }
    }

    fn stamps(poses: &Poses, from: i64, until: i64) -> Vec<i64> {
        poses.between(pose(from).at, pose(until).at).map(|pose| pose.at.as_nanos() / 1_000_000).collect()
    }

    #[test]
    fn keeps_order_and_forgets_the_old() {
        let mut poses = Poses::new(0.1);
        for millis in [1000, 1005, 1010, 1007, 1010, 1015] {
            poses.push(pose(millis));
        }
        assert_eq!(stamps(&poses, 1005, 1012), [1005, 1010]);
        assert_eq!(stamps(&poses, 1012, 1005), [0i64; 0]);
        poses.push(pose(1108));
        assert_eq!(stamps(&poses, 0, 5000), [1010, 1015, 1108]);
        poses.push(pose(300));
        assert_eq!(stamps(&poses, 0, 5000), [300], "the cameras' clock has started anew");
    }

    #[test]
    fn memory_is_bounded() {
        let mut poses = Poses::new(60.0);
        for micros in 0..10_000 {
            poses.push(Pose { at: Time::ZERO + Span::from_micros(micros), ..pose(0) });
        }
        assert_eq!(poses.poses.len(), POSES_MAX);
    }
}
