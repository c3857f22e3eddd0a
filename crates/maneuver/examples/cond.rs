use maneuver::*;
fn main(){
 let (mut fails,mut total)=(0,0);
 for integral in [Integral::Conditional] {
 for m in [0.125,0.05] { for n in 1..=3u8 { for r in [1000.,1200.,1400.,1600.,1800.] {
  let model=Model{integral,..Model::TABLE_I};
  let d=FlipDesign{flips:n,rate_rad_s_max:f64::to_radians(r),envelope:Envelope::with_margin(&model,m).unwrap()};
  for disc in [Discretisation::Continuous,Discretisation::Average800]{
  let t=std::time::Instant::now();
  let s=solve(&model,&d,disc); let el=t.elapsed(); total+=1;
  match s {Ok(s)=>{ let mut peak:f64=0.; trajectory(&model,&d,&s.parameters,disc,|_,q|peak=peak.max(q.rate_rad_s)).unwrap();
    println!("N={n} {r} {m} {disc:?} {el:?} {:?} |F| {:.1e} cond {:.1} T {:.4} apex {:.3} peak {:.0}",s.parameters.to_array().map(|x|(x*1e5).round()/1e5),s.final_error.norm(),s.condition,s.duration_s(),s.apex_m,peak.to_degrees());
    if n==2 && r==1600. && m==0.125 {for row in s.jacobian{println!("   N= {row:?}")}} },
   Err(SolveError::Infeasible(e))=>{fails+=1;println!("N={n} {r} {m} {disc:?} {el:?} ERR {:.1e} {}",e.least_residual,e.limits)} Err(e)=>println!("N= {e}")}
  }}}}}
 println!("N= fails {fails} of {total}");
}
