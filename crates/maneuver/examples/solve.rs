use maneuver::*;
fn main(){
 for integral in [Integral::Literal,Integral::Conditional] {
 for m in [0.125,0.,0.05] { for n in 1..=5u8 { for r in [1000.,1200.,1400.,1600.,1800.] {
  let model=Model{integral,..Model::TABLE_I};
  let d=FlipDesign{flips:n,rate_rad_s_max:f64::to_radians(r),envelope:Envelope::with_margin(&model,m).unwrap()};
  for disc in [Discretisation::Continuous,Discretisation::Average800]{
  let t=std::time::Instant::now();
  let s=solve(&model,&d,disc); let el=t.elapsed();
  match s {Ok(s)=>{ let mut peak:f64=0.; trajectory(&model,&d,&s.parameters,disc,|_,q|peak=peak.max(q.rate_rad_s)).unwrap();
    println!("N={n} {r} {m} {integral:?} {disc:?} {el:?} {:?} |F| {:.1e} cond {:.1} T {:.4} apex {:.3} peak {:.0}",s.parameters.to_array().map(|x|(x*1e5).round()/1e5),s.final_error.norm(),s.condition,s.duration_s(),s.apex_m,peak.to_degrees());
    if n==2 && r==1600. && m==0.125 {for row in s.jacobian{println!("   N= {row:?}")}} },
   Err(e)=>println!("N={n} {r} {m} {integral:?} {disc:?} {el:?} ERR {e}")}
  }}}}}
}
