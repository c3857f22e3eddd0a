//! How far from its start a flip ended, recovered from motion capture.
//!
//! The vehicle reports *when* its maneuver began and ended, on the arena's clock; the cameras report where it
//! was, but at other instants and with noise. A running filter would have smeared the end: there the command
//! changes at once from the flip's last step to the hover controller's. So position and velocity *at* the
//! instant are fitted to the poses on both sides of it. Rotors lag, so the acceleration is continuous there
//! but its slope is not: the fit is a cubic with one slope of the acceleration before the instant and another
//! after.

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
/// The plane is that of the heading at the begin. Position counts from where the flip began; velocity and
/// pitch are those at its end as they are.
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
    let positions = around(poses, at, tuning.position_window_s, tuning.position_error_m_max, |pose| {
        let p = pose.position_m;
        SVector::from([p.x, p.y, p.z])
    });
    let fit = Kinked::fit(positions, tuning.poses_min)?;
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
    // Fitted as the difference from their mean direction: an angle near the cut at π must not jump.
    let (sin, cos) = poses.between(at - window, at + window).fold((0.0, 0.0), |(sin_sum, cos_sum), pose| {
        let (sin, cos) = math::sin_cos(pitch(pose));
        (sin_sum + sin, cos_sum + cos)
    });
    let reference = math::atan2(sin, cos);
    let pitches = around(poses, at, tuning.attitude_window_s, tuning.attitude_error_rad_max, |pose| {
        SVector::from([math::wrap_pi(pitch(pose) - reference)])
    });
    let fit = Kinked::fit(pitches, tuning.poses_min)?;
    Some(math::wrap_pi(reference + fit.value[0]))
}

/// A measurement with its time from the instant, in windows: -1 to 1.
#[derive(Clone, Copy, Debug)]
struct Sample<const D: usize> {
    time: f64,
    value: SVector<f64, D>,
}

/// The measurements within a window on either side of an instant.
struct Around<const D: usize> {
    window_s: f64,
    /// A measurement further off than this is wrong.
    off_max: f64,
    samples: Vec<Sample<D>>,
}

fn around<const D: usize>(
    poses: &Poses,
    at: Time,
    window_s: f64,
    off_max: f64,
    read: impl Fn(&Pose) -> SVector<f64, D>,
) -> Around<D> {
    let window = Span::from_secs_f64(window_s);
    let samples = poses
        .between(at - window, at + window)
        .map(|pose| Sample { time: (pose.at - at).as_secs_f64() / window_s, value: read(pose) })
        .collect();
    Around { window_s, off_max, samples }
}

/// Value and slope at the instant of a least-squares cubic whose third derivative may jump there.
struct Kinked<const D: usize> {
    value: SVector<f64, D>,
    slope_1_s: SVector<f64, D>,
}

impl<const D: usize> Kinked<D> {
    /// Fits, leaving out up to [`WRONG_MAX`] measurements that the others contradict: a swap of markers, a
    /// flipped pose.
    fn fit(mut around: Around<D>, poses_min: u32) -> Option<Self> {
        for left_out in 0..=WRONG_MAX {
            let fit = LeastSquares::of(&around.samples, poses_min)?;
            match fit.contradicted(&around).filter(|_| left_out < WRONG_MAX) {
                Some(index) => drop(around.samples.remove(index)),
                None => {
                    return Some(Self {
                        value: fit.coefficients.row(0).transpose(),
                        slope_1_s: fit.coefficients.row(1).transpose() / around.window_s,
                    });
                }
            }
        }
        None
    }
}

/// So many wrong measurements are left out.
const WRONG_MAX: usize = 3;

fn basis(time: f64) -> SVector<f64, 5> {
    let cube = time * time * time;
    SVector::from([1.0, time, time * time, cube.min(0.0), cube.max(0.0)])
}

/// Coefficients of the [`basis`], and what is needed to judge single measurements.
struct LeastSquares<const D: usize> {
    coefficients: SMatrix<f64, 5, D>,
    covariance: SMatrix<f64, 5, 5>,
}

impl<const D: usize> LeastSquares<D> {
    /// `None` for too few samples on either side of the instant.
    fn of(samples: &[Sample<D>], each_side_min: u32) -> Option<Self> {
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
        let covariance = normal.cholesky()?.inverse();
        Some(Self { coefficients: covariance * right, covariance })
    }

    /// The measurement furthest from what the others make of it, if that is too far.
    fn contradicted(&self, around: &Around<D>) -> Option<usize> {
        // Divided so, the residual of a single wrong measurement is the greatest, however it draws the fit to
        // itself.
        let off = |sample: &Sample<D>| {
            let row = basis(sample.time);
            let residual = sample.value - self.coefficients.transpose() * row;
            let leverage = row.dot(&(self.covariance * row));
            math::sqrt(residual.norm_squared() / (1.0 - leverage).max(1e-6))
        };
        let worst = around.samples.iter().map(off).enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        (worst.1 > around.off_max).then_some(worst.0)
    }
}

impl Unmeasured {
    /// In words.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::BeginUnseen => "motion capture did not see the begin",
            Self::EndUnseen => "motion capture did not see the end",
        }
    }
}
