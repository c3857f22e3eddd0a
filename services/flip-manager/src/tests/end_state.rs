//! How well a flip's end is recovered.

use quantity::{Body, Rotation, Span, Vector, math};
use schemas::FlipError;

use super::flight::{CAMERAS, Cameras, Departures, Flight, fly};
use crate::end_state::{Unmeasured, flip_error};
use crate::poses::Poses;
use crate::tuning::MeasureTuning;

const PAPER: Departures =
    Departures { thrust_ratio: 0.92, gyro_ratio: 1.045, inertia_ratio: 0.97, inflow_s_m: 0.04 };

fn poses(flight: &Flight) -> Poses {
    let mut poses = Poses::new(6.0);
    flight.poses.iter().for_each(|pose| poses.push(*pose));
    poses
}

fn recovered(flight: &Flight, clock_error: Span) -> Result<FlipError, Unmeasured> {
    let (began_at, ended_at) = (flight.began_at + clock_error, flight.ended_at + clock_error);
    flip_error(&poses(flight), began_at, ended_at, &MeasureTuning::default())
}

fn length(x: f64, z: f64) -> f64 {
    math::sqrt(x * x + z * z)
}

/// Medians of how far position, velocity and pitch are off, over many flips, in m, m/s and rad.
fn median_errors(departures: &[Departures], cameras: &Cameras, clock_error: Span) -> [f64; 3] {
    let mut off = [const { Vec::new() }; 3];
    for seed in 0..60 {
        let departure = &departures[seed as usize % departures.len()];
        let flight = fly(seed, 0.1 * seed as f64, departure, cameras);
        let (truth, found) = (flight.error, recovered(&flight, clock_error).expect("seen"));
        off[0].push(length(found.x_m - truth.x_m, found.z_m - truth.z_m));
        off[1].push(length(found.vx_m_s - truth.vx_m_s, found.vz_m_s - truth.vz_m_s));
        off[2].push(math::wrap_pi(found.theta_rad - truth.theta_rad).abs());
    }
    off.map(|mut values| {
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() / 2]
    })
}

fn various() -> [Departures; 4] {
    [
        PAPER,
        Departures { thrust_ratio: 1.0, gyro_ratio: 1.0, inertia_ratio: 1.0, inflow_s_m: 0.0 },
        Departures { thrust_ratio: 0.85, ..PAPER },
        Departures { gyro_ratio: 0.97, inflow_s_m: 0.02, ..PAPER },
    ]
}

#[test]
fn medians_are_within_two_centimetres_five_centimetres_per_second_and_two_degrees() {
    let [position_m, velocity_m_s, theta_rad] = median_errors(&various(), &CAMERAS, Span::ZERO);
    assert!(position_m < 0.02 && velocity_m_s < 0.05 && theta_rad < 2f64.to_radians());
}

#[test]
fn without_noise_the_fit_follows_the_kink_of_the_end() {
    let perfect =
        Cameras { position_noise_m: 0.0, attitude_noise_rad: 0.0, stamp_noise_s: 0.0, dropout_ratio: 0.0 };
    let [position_m, velocity_m_s, theta_rad] = median_errors(&various(), &perfect, Span::ZERO);
    assert!(position_m < 1e-4 && velocity_m_s < 5e-3 && theta_rad < 5e-4);
}

#[test]
fn three_milliseconds_of_clock_error_are_still_within_the_limits() {
    for millis in [-3, 3] {
        let [position_m, velocity_m_s, theta_rad] =
            median_errors(&various(), &CAMERAS, Span::from_millis(millis));
        assert!(position_m < 0.02 && velocity_m_s < 0.05 && theta_rad < 2f64.to_radians());
    }
}

#[test]
fn a_tenth_of_the_frames_missing_changes_little() {
    let cameras = Cameras { dropout_ratio: 0.1, ..CAMERAS };
    let [position_m, velocity_m_s, theta_rad] = median_errors(&various(), &cameras, Span::ZERO);
    assert!(position_m < 0.02 && velocity_m_s < 0.05 && theta_rad < 2f64.to_radians());
}

#[test]
fn wrong_poses_are_left_out_wherever_they_fall() {
    let truth = fly(7, 0.4, &PAPER, &CAMERAS);
    let clean = recovered(&truth, Span::ZERO).unwrap();
    let near_end: Vec<usize> = (0..truth.poses.len())
        .filter(|index| (truth.poses[*index].at - truth.ended_at).abs() < Span::from_millis(60))
        .collect();
    assert!(near_end.len() > 20);
    let turn = Rotation::<Body, Body>::from_rotation_vector(Vector::new(0.0, core::f64::consts::PI, 0.0));
    for index in near_end {
        let mut flight = fly(7, 0.4, &PAPER, &CAMERAS);
        flight.poses[index].position_m += Vector::new(0.5, -0.3, 0.2);
        flight.poses[index].orientation = flight.poses[index].orientation * turn;
        let found = recovered(&flight, Span::ZERO).unwrap();
        assert!((found.x_m - clean.x_m).abs() < 0.005, "pose {index}");
        assert!((found.vx_m_s - clean.vx_m_s).abs() < 0.05, "pose {index}");
        assert!(math::wrap_pi(found.theta_rad - clean.theta_rad).abs() < 0.02, "pose {index}");
    }
}

#[test]
fn an_end_nobody_saw_is_unmeasured() {
    let mut flight = fly(3, 0.0, &PAPER, &CAMERAS);
    let (began_at, ended_at) = (flight.began_at, flight.ended_at);
    flight.poses.retain(|pose| pose.at < ended_at);
    assert_eq!(recovered(&flight, Span::ZERO), Err(Unmeasured::EndUnseen));
    flight.poses.retain(|pose| pose.at > began_at);
    assert_eq!(recovered(&flight, Span::ZERO), Err(Unmeasured::BeginUnseen));
}
