use maneuver::Deviation;
use super::school::*;

#[test]
fn probe() {
    let none = Deviation::NONE;
    for scenario in ["single-flip","double-flip","triple-flip","rate-mismatch"] {
        for lit in [false,true] { for (name, d) in [
            ("paper", Deviation{thrust:0.92,inertia:0.97,gyro:1.045,..none}),
            ("thrust.75", Deviation{thrust:0.75,..none}),
            ("thrust1.4", Deviation{thrust:1.4,..none}),
            ("mass.8", Deviation{mass:0.8,..none}),
            ("mass1.3", Deviation{mass:1.3,..none}),
            ("inertia.6", Deviation{inertia:0.6,..none}),
            ("inertia1.3", Deviation{inertia:1.3,..none}),
            ("gyro.94", Deviation{gyro:0.94,..none}),
            ("gyro1.12", Deviation{gyro:1.12,..none}),
        ] {
            for noise in [NO_NOISE, NOISE] {
            if noise[0]>0. {continue} let mut a=arena(scenario); a.scenario.flip.iterations=200; if lit {a.fleet[0].vehicle.rate_loop.integral=settings::Integral::Literal;} let mut s = School::of(&a, d, noise, 1);
            let first = s.flown().to_array();
            let norms = s.learn(200);
            let five = norms.iter().position(|n| *n < 0.05*norms[0]);
            let tail = norms[norms.len().saturating_sub(20)..].iter().sum::<f64>()/20.0;
            let mut ev = std::collections::BTreeMap::new();
            for e in &s.events { *ev.entry(e.clone()).or_insert(0)+=1; }
            let delta: Vec<f64> = s.flown().to_array().iter().zip(first).map(|(a,b)| ((a-b)*1e3).round()/1e3).collect();
            println!("{scenario} {name} lit {lit} noise {}: first {:.2} 2nd {:.2} max {:.2} n {} five {five:?} tail {tail:.3} {ev:?} {:?} dP {delta:?} loss {:.2} {}", noise[0]>0., norms[0], norms.get(1).unwrap_or(&0.), norms.iter().fold(0f64,|a,b|a.max(*b)), norms.len(), s.word.verdict, s.word.height_loss_m, s.word.reason);
            }
        }}
    }
}
