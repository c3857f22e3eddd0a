//! From a design to the parameters that fly it on the model, and the Jacobian there.

use nalgebra::{Matrix5, Vector5};

use quantity::{GRAVITY_M_S2, math};

use crate::limits::{Bounds, Limits};
use crate::model::Model;
use crate::parameters::{FinalError, FlipDesign, Parameters};
use crate::planar::{CONTINUOUS_HZ, Discretisation, FlipError, apex_m};
use crate::primitive::{Primitive, PrimitiveError};
use crate::problem::{Grid, Problem, Evaluation};

/// The rough guess of the paper: symmetric, instantaneous, as printed. T3 comes out negative where the rate is so
/// high, and the turns so few, that starting and stopping turn further than asked.
///
/// # Errors
/// If model or design are impossible.
// Lupashin 2010, eqs. (23), (24).
pub fn rough_guess(model: &Model, design: &FlipDesign) -> Result<Parameters, FlipError> {
    model.check()?;
    design.envelope.check().map_err(PrimitiveError::from)?;
    let a2 = design.envelope.span_m_s2() / (2.0 * model.alpha_l_m());
    let u_m_s2 = 0.9 * design.envelope.high_m_s2;
    let rotate_s = design.rate_rad_s_max / a2;
    let coast_s = design.turn_rad() / design.rate_rad_s_max - rotate_s;
    let accelerate_s = GRAVITY_M_S2 * (rotate_s + coast_s + rotate_s) / (2.0 * u_m_s2);
    Ok(Parameters { u1_m_s2: u_m_s2, t1_s: accelerate_s, t3_s: coast_s, u5_m_s2: u_m_s2, t5_s: accelerate_s })
}

pub fn descend(problem:&Problem, bounds:&Bounds, start:[f64;5], grid:Grid, tol:f64, stats:&mut [usize;2])->([f64;5],f64,Limits){
    let mut p=bounds.clamp(start);
    let mut here=problem.evaluate(&p,grid).unwrap(); stats[0]+=1;
    let mut lambda=1e-3;
    let mut limits=Limits::NONE;
    for _ in 0..100 {
        let f=Vector5::from(here.error.to_array());
        if f.norm()<tol {break}
        let j=problem.jacobian(&p,&here,grid).unwrap(); stats[1]+=1;
        let j=Matrix5::from_fn(|r,c|j[r][c]);
        let g=j.transpose()*f;
        limits=bounds.pressed(&p,&g.into());
        let jtj=j.transpose()*j;
        let mut ok=false; let mut small=false;
        for _ in 0..16 {
            let mut a=jtj; let mut b=-g;
            for i in 0..5 { a[(i,i)]+=lambda*jtj[(i,i)];
              if limits.low(i)||limits.high(i){ for k in 0..5 {a[(i,k)]=0.;a[(k,i)]=0.;} a[(i,i)]=1.; b[i]=0.; } }
            let Some(d)=a.lu().solve(&b) else {lambda*=10.;continue};
            let trial=bounds.clamp(core::array::from_fn(|i|p[i]+d[i]));
            if trial==p {break}
            let Ok(t)=problem.evaluate(&trial,grid) else {lambda*=10.;continue}; stats[0]+=1;
            if t.error.norm()<here.error.norm() { small = t.error.norm()>here.error.norm()*(1.-1e-7); p=trial;here=t;lambda=f64::max(lambda*0.1,1e-12);ok=true;break }
            lambda*=10.;
        }
        if !ok||small {break}
    }
    (p,here.error.norm(),limits)
}
pub fn descend2(problem:&Problem, bounds:&Bounds, start:[f64;5], grid:Grid, tol:f64, stats:&mut [usize;2])->([f64;5],f64,Limits){
    let mut p=bounds.clamp(start);
    let mut here=problem.evaluate(&p,grid).unwrap(); stats[0]+=1;
    let mut lambda=1e-3;
    let mut limits=Limits::NONE;
    for _ in 0..100 {
        let f=Vector5::from(here.error.to_array());
        if f.norm()<tol {break}
        let j=problem.jacobian(&p,&here,grid).unwrap(); stats[1]+=1;
        let j=Matrix5::from_fn(|r,c|j[r][c]);
        let g=j.transpose()*f;
        limits=bounds.pressed(&p,&g.into());
        let jtj=j.transpose()*j;
        let mut ok=false; let mut small=false;
        for _ in 0..16 {
            let mut a=jtj; let mut b=-g;
            for i in 0..5 { a[(i,i)]+=lambda*jtj[(i,i)];
              if limits.low(i)||limits.high(i){ for k in 0..5 {a[(i,k)]=0.;a[(k,i)]=0.;} a[(i,i)]=1.; b[i]=0.; } }
            let Some(d)=a.lu().solve(&b) else {lambda*=10.;continue};
            let mut sc:f64=1.; for i in 0..5 {let lim=if i==0||i==3 {1.5} else {(0.3*p[i]).max(0.02)}; sc=sc.min(lim/d[i].abs().max(1e-30));} let trial=bounds.clamp(core::array::from_fn(|i|p[i]+d[i]*sc));
            if trial==p {break}
            let Ok(t)=problem.evaluate(&trial,grid) else {lambda*=10.;continue}; stats[0]+=1;
            if t.error.norm()<here.error.norm() { small = t.error.norm()>here.error.norm()*(1.-1e-7); p=trial;here=t;lambda=f64::max(lambda*0.1,1e-12);ok=true;break }
            lambda*=10.;
        }
        if !ok||small {break}
    }
    (p,here.error.norm(),limits)
}
