use maneuver::*;
fn main(){
 let model=Model{integral:Integral::Conditional,..Model::TABLE_I};
 let disc=Discretisation::Continuous;
 let d=FlipDesign{flips:1,rate_rad_s_max:f64::to_radians(1000.),envelope:Envelope::with_margin(&model,0.125).unwrap()};
 let p=match solve(&model,&d,disc){Ok(s)=>{println!("N= ok {:?}",s.parameters);s.parameters},Err(SolveError::Infeasible(e))=>{println!("N= {e:?}");e.parameters},_=>return};
 let run=|u:f64|{let mut a=p.to_array();a[0]=u;let mut v=vec![];let f=final_error(&model,&d,&a.into(),disc).unwrap();trajectory(&model,&d,&a.into(),disc,|t,s|v.push((t,s))).unwrap();(f,v)};
 let (mut lo,mut hi)=(p.u1_m_s2-1e-5,p.u1_m_s2+1e-5);
 let (fl,_)=run(lo); 
 for _ in 0..60 { let m=(lo+hi)/2.; let (f,_)=run(m); let e=(f.vx_m_s-fl.vx_m_s).abs(); if e<6e-5 {lo=m} else {hi=m} }
 let (a,va)=run(lo); let (b,vb)=run(hi); println!("N= {lo} {hi} {:?}\nN= {:?}",a,b); println!("N= {} {}",va.len(),vb.len());
 let pr=Primitive::new(&d,model.alpha_l_m(),&p).unwrap(); println!("N= {:?}",pr.steps().map(|s|s.duration_s*12800.));
 let mut shown=0; for (i,(x,y)) in va.iter().zip(&vb).enumerate() { let q=(x.1.integral_rad-y.1.integral_rad).abs()+(x.1.rate_rad_s-y.1.rate_rad_s).abs(); if q>1e-9 { println!("N= {i} {:?}\nN= {i} {:?}",x,y); shown+=1; if shown>4{break} } }
}
