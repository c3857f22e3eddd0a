//! The five-step flip primitive, its planar model, its solver and its Jacobian.
#![no_std]

mod continuous;
mod dynamics;
mod envelope;
mod lanes;
mod limits;
mod model;
mod parameters;
mod planar;
mod primitive;
mod problem;
pub mod solve;
mod stress;
mod ticks;

pub use dynamics::PlanarState;
pub use envelope::{Envelope, EnvelopeError};
pub use model::{Integral, Model, ModelError};
pub use parameters::{FinalError, FlipDesign, Parameters};
pub use planar::{CONTINUOUS_HZ, Discretisation, FlipError, LOOP_HZ, apex_m, final_error, trajectory};
pub use primitive::{Primitive, PrimitiveError, Setpoint, Step};
pub use stress::Deviation;
extern crate std;
#[doc(hidden)]
pub fn lane_probe(){
  fn go<const N:usize>(){
    let model=Model::TABLE_I; let c=dynamics::Coefficients::new(&model,&Deviation::NONE);
    let d=FlipDesign{flips:3,rate_rad_s_max:1600f64.to_radians(),envelope:Envelope::with_margin(&model,0.125).unwrap()};
    let p=[20.795067643806824, 0.2593051499760897, 0.5014278546675619, 20.7561677249481, 0.2777426821850181];
    let pr=Primitive::new(&d,model.alpha_l_m(),&p.into()).unwrap(); let prs=[pr;N];
    let t=std::time::Instant::now(); let mut sum=0.;
    for _ in 0..100 { let mut s=dynamics::State::<N>::hovering(&c); for i in 0..5 {continuous::fly_step(&c,&mut s,&prs,i,12800.,|_,_|());} sum+=s.x.0[N-1]; }
    let e=t.elapsed()/100; std::println!("N={N} {e:?} per lane {:?} {sum}",e/N as u32);
  }
  go::<1>();go::<2>();go::<3>();go::<4>();go::<6>();go::<8>();go::<10>();
}
#[doc(hidden)]
pub fn solve_probe(){
 use std::println;
 let hz=800.;
 let mut seed=12345u64; let mut rnd=move||{seed=seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);(seed>>11) as f64/(1u64<<53) as f64};
 for m in [0.125,0.0,0.05,0.1,0.15,0.2] { for n in 1..=5u8 { for r in [1000.,1200.,1400.,1600.,1800.] {
   let model=Model::TABLE_I;
   let d=FlipDesign{flips:n,rate_rad_s_max:f64::to_radians(r),envelope:Envelope::with_margin(&model,m).unwrap()};
   let pr=problem::Problem::new(&model,&d).unwrap(); let b=limits::Bounds::new(&d);
   let g=solve::rough_guess(&model,&d).unwrap();
   let mut best=(f64::INFINITY,[0.;5]); let mut hits=0; let mut sols:std::vec::Vec<[f64;5]>=std::vec![];
   for k in 0..30 { let mut st=[0;2];
     let start=if k==0 {g.to_array()} else {core::array::from_fn(|i| if i==0||i==3 {b.low[i]+(b.high[i]-b.low[i])*rnd()} else {g.to_array()[i].max(0.02)*(0.4+1.5*rnd())})};
     let (p,e,_)=solve::descend(&pr,&b,start,problem::Grid::Steps(hz),1e-6,&mut st);
     if e<1e-4 {hits+=1; if !sols.iter().any(|q|(0..5).all(|i|(q[i]-p[i]).abs()<1e-3)) {sols.push(p)}}
     if e<best.0 {best=(e,p)} }
   let mut res=std::vec![];
   for mode in 0..4 { let mut st=[0;2]; let mut s0=b.clamp(g.to_array());
     if mode&1==1 { // theta through T3
       for _ in 0..6 { let e=pr.evaluate(&s0,problem::Grid::Steps(400.)).unwrap().error; st[0]+=1; if e.theta_rad.abs()<0.05{break} s0[2]=(s0[2]-e.theta_rad/d.rate_rad_s_max).max(1e-3); } }
     let (_,e,_)=if mode<2 {solve::descend(&pr,&b,s0,problem::Grid::Steps(hz),1e-4,&mut st)} else {solve::descend2(&pr,&b,s0,problem::Grid::Steps(hz),1e-4,&mut st)};
     res.push(std::format!("{:.2e} {:?}",e,st)); }
   println!("m{m} N{n} {r}: best {:.3e} hits {hits} sols {} {:?} | {}",best.0,sols.len(),best.1.map(|x|(x*1e4).round()/1e4),res.join(" | "));
  }}}
}
