use maneuver::*;
fn main() {
    for n in 2..=4 {
        for r in [1000f64, 1200., 1400., 1600., 1800.] {
            let model = Model::TABLE_I;
            let d = FlipDesign {
                flips: n,
                rate_rad_s_max: r.to_radians(),
                envelope: Envelope::with_margin(&model, 0.125).unwrap(),
            };
            println!("N==== {n} {r}");
            std::hint::black_box(solve(&model, &d, Discretisation::Continuous).unwrap());
        }
    }
}
