use maneuver::*;
fn main(){
  for integral in [Integral::Literal, Integral::Conditional] {
  let model=Model{integral,..Model::TABLE_I};
  for (n,r,p0) in [(1,1000f64,[20.039854658921872, 0.14493726045306524, 0.25842685955853584, 20.90201322951486, 0.21327235832105615]),(2,1600.,[20.395436411047243, 0.16091608580109085, 0.278325628135175, 20.309106481867055, 0.18268163254135983]),(2,1600.,[20.37820,0.16148,0.27825,20.39481,0.19254]),(3,1600.,[20.795067643806824, 0.2593051499760897, 0.5014278546675619, 20.7561677249481, 0.2777426821850181])] {
   let d=FlipDesign{flips:n,rate_rad_s_max:r.to_radians(),envelope:Envelope::with_margin(&model,0.125).unwrap()};
   for disc in [Discretisation::Continuous,Discretisation::Average800,Discretisation::Hold800]{
    let mut peak:f64=0.;
    trajectory(&model,&d,&Parameters::from(p0),disc,|_,s|peak=peak.max(s.rate_rad_s)).unwrap();
    let t=std::time::Instant::now();
    let mut e=final_error(&model,&d,&Parameters::from(p0),disc).unwrap();
    for _ in 0..99 {e=final_error(&model,&d,&Parameters::from(p0),disc).unwrap();}
    println!("{integral:?} {n} {r} {disc:?} {:?} {:.2e} {:?} peak {} deg/s apex {}",t.elapsed()/100,e.norm(),e.to_array(),peak.to_degrees(),apex_m(&model,&d,&Parameters::from(p0),disc).unwrap());
   }}}
}
