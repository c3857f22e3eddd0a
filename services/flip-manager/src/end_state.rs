//! How far from its start a flip ended, recovered from motion capture.
//!
//! The vehicle reports *when* its maneuver began and ended, on the arena's clock; the cameras report where it was, but
//! at other instants and with noise. A running filter would have smeared the end: there the command changes at once
//! from the flip's last step to the hover controller's. So position and velocity *at* the instant are fitted to the
//! poses on both sides of it. Rotors lag, so the acceleration is continuous there but its slope is not: the fit is a
//! cubic with one slope of the acceleration before the instant and another after.

use nalgebra::{SMatrix, SVector};
use quantity::{Body, Span, Time, Vector, World, math};
use schemas::FlipError;

use crate::poses::{Pose, Poses};
use crate::tuning::MeasureTuning;

/// Why a flip's end cannot be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unmeasured {
    /// Too few poses around its begin.
    BeginUnseen,
    /// Too few poses around its end.
    EndUnseen,
}

/// The error of a flip that began and ended at those instants.
///
/// The plane is that of the heading at the begin. Position counts from where the flip began; velocity and pitch are
/// those at its end as they are.
///
/// # Errors
/// Motion capture did not see enough of its begin or its end.
pub(crate) fn flip_error(
    poses: &Poses,
    began_at: Time,
    ended_at: Time,
    tuning: &MeasureTuning,
) -> Result<FlipError, Unmeasured> {
    let (begin_m, _) = position_and_velocity(poses, began_at, tuning).ok_or(Unmeasured::BeginUnseen)?;
    let forward = heading(poses, began_at, tuning).ok_or(Unmeasured::BeginUnseen)?;
    let (end_m, velocity_m_s) =
        position_and_velocity(poses, ended_at, tuning).ok_or(Unmeasured::EndUnseen)?;
    let theta_rad = pitch_rad(poses, ended_at, forward, tuning).ok_or(Unmeasured::EndUnseen)?;
    let moved_m = end_m - begin_m;
    Ok(FlipError {
        x_m: moved_m.dot(forward),
        z_m: moved_m.z,
        vx_m_s: velocity_m_s.dot(forward),
        vz_m_s: velocity_m_s.z,
        theta_rad,
    })
}

/// Position and velocity at an instant.
fn position_and_velocity(
    poses: &Poses,
    at: Time,
    tuning: &MeasureTuning,
) -> Option<(Vector<World>, Vector<World>)> {
    let samples = around(poses, at, tuning.position_window_s, |pose| {
        let p = pose.position_m;
        SVector::from([p.x, p.y, p.z])
    });
    let fit = Kinked::fit(&samples, tuning)?;
    let [value, slope] = [fit.value, fit.slope_1_s].map(|v| Vector::new(v[0], v[1], v[2]));
    Some((value, slope))
}

/// Direction of the body's x axis before the flip began, level: where the flip's plane points.
fn heading(poses: &Poses, began_at: Time, tuning: &MeasureTuning) -> Option<Vector<World>> {
    let from = began_at - Span::from_secs_f64(tuning.position_window_s);
    let mut sum = Vector::ZERO;
    let mut count = 0;
    for pose in poses.between(from, began_at) {
        sum += pose.orientation * Vector::<Body>::new(1.0, 0.0, 0.0);
        count += 1;
    }
    (count >= tuning.poses_min).then(|| sum.horizontal().direction())?
}

/// Pitch at an instant: angle of the body's z axis in the vertical plane of `forward`, in (-π, π].
fn pitch_rad(poses: &Poses, at: Time, forward: Vector<World>, tuning: &MeasureTuning) -> Option<f64> {
    let pitch = |pose: &Pose| {
        let up = pose.orientation.z_axis();
        math::atan2(up.dot(forward), up.z)
    };
    let window = Span::from_secs_f64(tuning.attitude_window_s);
    // Fitted as the difference from one of them: an angle near the cut at π must not jump.
    let reference = pitch(poses.between(at - window, at).last()?);
    let samples = around(poses, at, tuning.attitude_window_s, |pose| {
        SVector::from([math::wrap_pi(pitch(pose) - reference)])
    });
    let fit = Kinked::fit(&samples, tuning)?;
    Some(math::wrap_pi(reference + fit.value[0]))
}

/// A measurement with its time from the instant, in windows: -1 to 1.
#[derive(Clone, Copy, Debug)]
struct Sample<const D: usize> {
    time: f64,
    value: SVector<f64, D>,
}

/// The measurements within a window on either side of an instant, and the window's length.
struct Around<const D: usize> {
    window_s: f64,
    samples: Vec<Sample<D>>,
}

fn around<const D: usize>(
    poses: &Poses,
    at: Time,
    window_s: f64,
    read: impl Fn(&Pose) -> SVector<f64, D>,
) -> Around<D> {
    let window = Span::from_secs_f64(window_s);
    let samples = poses
        .between(at - window, at + window)
        .map(|pose| Sample { time: (pose.at - at).as_secs_f64() / window_s, value: read(pose) })
        .collect();
    Around { window_s, samples }
}

/// A least-squares cubic whose third derivative may jump at the instant.
struct Kinked<const D: usize> {
    value: SVector<f64, D>,
    slope_1_s: SVector<f64, D>,
}

impl<const D: usize> Kinked<D> {
    /// Fits twice: the second time without what lies far off the first.
    fn fit(around: &Around<D>, tuning: &MeasureTuning) -> Option<Self> {
        let samples = &around.samples;
        let first = least_squares(samples.iter(), tuning.poses_min)?;
        let distance = |sample: &&Sample<D>| {
            math::sqrt((sample.value - first.transpose() * basis(sample.time)).norm_squared())
        };
        let mut distances: Vec<f64> = samples.iter().map(|sample| distance(&sample)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        let limit = OUTLIER_RATIO * distances[distances.len() / 2];
        let second = least_squares(samples.iter().filter(|sample| distance(sample) <= limit), tuning.poses_min)?;
        Some(Self {
            value: second.row(0).transpose(),
            slope_1_s: second.row(1).transpose() / around.window_s,
        })
    }
}

/// A measurement so many times as far off as the median is a wrong one: a swap of markers, a flipped pose.
const OUTLIER_RATIO: f64 = 6.0;

fn basis(time: f64) -> SVector<f64, 5> {
    let cube = time * time * time;
    SVector::from([1.0, time, time * time, cube.min(0.0), cube.max(0.0)])
}

/// Coefficients of the [`basis`]; `None` for too few samples on either side.
fn least_squares<'a, const D: usize>(
    samples: impl Iterator<Item = &'a Sample<D>>,
    each_side_min: u32,
) -> Option<SMatrix<f64, 5, D>> {
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    let mut right = SMatrix::<f64, 5, D>::zeros();
    let (mut before, mut after) = (0, 0);
    for sample in samples {
        let row = basis(sample.time);
        normal += row * row.transpose();
        right += row * sample.value.transpose();
        if sample.time <= 0.0 { before += 1 } else { after += 1 }
    }
    if before < each_side_min || after < each_side_min {
        return None;
    }
    normal.cholesky().map(|factors| factors.solve(&right))
}
