//! How well a flip's end is recovered.

use quantity::{Rotation, Span, Vector, math};
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

/// Medians of how far position, velocity and pitch are off, over many flips, in m, m/s and rad.
fn median_errors(departures: &[Departures], cameras: &Cameras, clock_error: Span) -> [f64; 3] {
    let mut off = [const { Vec::new() }; 3];
    for seed in 0..60 {
        let departure = &departures[seed as usize % departures.len()];
        let flight = fly(seed, 0.1 * seed as f64, departure, cameras);
        let (truth, found) = (flight.error, recovered(&flight, clock_error).expect("seen"));
        off[0].push(math::sqrt((found.x_m - truth.x_m).powi(2) + (found.z_m - truth.z_m).powi(2)));
        off[1].push(math::sqrt((found.vx_m_s - truth.vx_m_s).powi(2) + (found.vz_m_s - truth.vz_m_s).powi(2)));
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
    println!("medians: {position_m:.4} m, {velocity_m_s:.4} m/s, {:.3} deg", theta_rad.to_degrees());
    assert!(position_m < 0.02 && velocity_m_s < 0.05 && theta_rad < 2f64.to_radians());
}
#[test]
fn scan() {
    for w in [0.03,0.04,0.05,0.06,0.08] { for (name, cam) in [("noise", CAMERAS), ("clean", Cameras{position_noise_m:0.,attitude_noise_rad:0.,stamp_noise_s:0.,dropout_ratio:0.})] {
    for v in [false,true] { let t = MeasureTuning{position_window_s:w, attitude_window_s: if v {w} else {w*0.5}, ..MeasureTuning::default()};
    let mut off=[vec![],vec![],vec![]];
    for seed in 0..60 { let d=various()[seed as usize%4]; let f=fly(seed,0.1*seed as f64,&d,&cam);
      if w==0.03 && name=="clean" && seed<4 { println!("{:?}", f.error);} 
      let e=flip_error(&poses(&f), f.began_at,f.ended_at,&t); let Ok(e)=e else {println!("err"); off[0].push(9.);off[1].push(9.);off[2].push(9.);continue}; let tr=f.error;
      off[0].push((e.x_m-tr.x_m).hypot(e.z_m-tr.z_m)); off[1].push((e.vx_m_s-tr.vx_m_s).hypot(e.vz_m_s-tr.vz_m_s)); off[2].push(math::wrap_pi(e.theta_rad-tr.theta_rad).abs().to_degrees()); }
    for o in &mut off { o.sort_by(f64::total_cmp); }
    println!("{w} {v} {name} median {:.5} {:.4} {:.3}  max {:.5} {:.4} {:.3}", off[0][30],off[1][30],off[2][30],off[0][59],off[1][59],off[2][59]); }}}
    for ms in [-3,-1,1,3] { println!("clock {ms} ms {:?}", median_errors(&various(), &CAMERAS, Span::from_millis(ms))); }
}
