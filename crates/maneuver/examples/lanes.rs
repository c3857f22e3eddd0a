use maneuver::*;
fn main(){
 let model=Model::TABLE_I;
 let d=FlipDesign{flips:3,rate_rad_s_max:1600f64.to_radians(),envelope:Envelope::with_margin(&model,0.125).unwrap()};
 let p=Parameters::from([20.795067643806824, 0.2593051499760897, 0.5014278546675619, 20.7561677249481, 0.2777426821850181]);
 for disc in [Discretisation::Continuous,Discretisation::Average800] {
 let t=std::time::Instant::now(); let mut s=0.; for _ in 0..200 { s+=final_error(&model,&d,&p,disc).unwrap().norm(); }
 println!("N=1 {disc:?} {:?} {s}",t.elapsed()/200); }
 let t=std::time::Instant::now(); for _ in 0..100 { s_(solve(&model,&d,Discretisation::Continuous).unwrap()); }
 println!("N=3 solve {:?}",t.elapsed()/100);
 fn s_(s:Solution){ std::hint::black_box(s); }
}
