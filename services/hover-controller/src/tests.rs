//! The controller in a loop with a simulated vehicle.

use quantity::{Rotation, Span, Vector, World, math};
use schemas::{CommandMode, GoalKind};

use crate::testing::{Loop, START};

const PLACE: Vector<World> = Vector::new(0.0, 0.0, 4.0);

#[test]
fn probe() {
    let mut arena = Loop::new(Vector::new(0.3, -0.2, 0.04));
    arena.run(1.0);
    arena.order(GoalKind::Hover, PLACE);
    arena.run(12.0);
    for (at, k) in arena.track.iter().step_by(400) {
        println!(
            "{:.2} {:?} {:?}",
            (*at - START).as_secs_f64(),
            (k.position_m.x, k.position_m.y, k.position_m.z),
            k.velocity_m_s.norm()
        );
    }
    let from = arena.track.len();
    arena.run(60.0);
    let mut sum = 0.0;
    let mut peak = 0.0f64;
    for (_, k) in &arena.track[from..] {
        let e = (k.position_m - PLACE).norm();
        sum += e * e;
        peak = peak.max(e);
    }
    println!(
        "rms {} peak {}",
        math::sqrt(sum / (arena.track.len() - from) as f64),
        peak
    );
    arena.order(GoalKind::Land, PLACE);
    arena.run(10.0);
    println!(
        "{:?} {:?} touchdown {}",
        arena.events,
        arena.position(),
        arena.craft.touchdown_m_s
    );
    for (tilt, vx, vz, rate) in [
        (0.7, -4.0, -2.0, 5.0),
        (1.0, -4.0, -2.0, 10.0),
        (-1.0, -4.0, -2.0, -10.0),
        (3.1, 0.0, 0.0, 0.0),
        (0.1, -0.3, -0.2, 1.0),
        (0.3, -1.0, -0.5, 2.0),
    ] {
        let mut arena = Loop::hovering(PLACE);
        arena.craft.truth.orientation = Rotation::from_rotation_vector(Vector::new(0.0, tilt, 0.0));
        arena.craft.truth.velocity_m_s = Vector::new(vx, 0.0, vz);
        arena.craft.truth.rate_rad_s = Vector::new(0.0, rate, 0.0);
        arena.order(GoalKind::Hover, PLACE);
        arena.run(10.0);
        let mut low = 9.0f64;
        let mut far = 0.0f64;
        let mut bad = START;
        for (at, k) in &arena.track {
            low = low.min(k.position_m.z);
            far = far.max((k.position_m - PLACE).horizontal().norm());
            if (k.position_m - PLACE).norm() > 0.05 || k.velocity_m_s.norm() > 0.1 {
                bad = *at;
            }
        }
        println!(
            "{tilt} {vx} {vz} {rate}: low {low:.2} far {far:.2} settled {:.2}",
            (bad - START).as_secs_f64()
        );
    }
    let _ = (CommandMode::Fly, Span::ZERO);
}
