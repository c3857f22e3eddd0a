//! N seeds draw the whole world: what fails, when, for how long, and how bad the network is. Every vehicle must stay
//! inside the hall; when all has healed, nothing may be stuck: what stands on the floor may wait for a person.
//!
//! `WORLDS=500 cargo test --release worlds` draws more of them; a failure prints its seed and what was drawn.

use plant::faults::{Fault, Occlusion};
use plant::random::{Purpose, Stream};
use quantity::{Span, Vector};

use crate::common::{Flight, arena};

const WORLDS: u64 = 24;

fn draw_fault(random: &mut Stream) -> Fault {
    match random.below(8) {
        0 => Fault::Occluded { vehicle: 1, shown: Occlusion::Absent },
        1 => Fault::Occluded { vehicle: 1, shown: Occlusion::FrozenPose },
        2 => Fault::FlippedPose { vehicle: 1, turn_rad: Vector::new(0.0, 0.0, random.symmetric() * 3.1) },
        3 => Fault::LateFrames { delay: Span::from_secs_f64(random.uniform() * 0.06) },
        4 => Fault::SlowFrames { one_of: 2 + random.below(9) },
        5 => Fault::CommandLoss { vehicle: 1, loss_ratio: random.uniform() },
        6 => Fault::DataLoss { vehicle: 1, loss_ratio: random.uniform() },
        _ => Fault::CamerasSilent,
    }
}

fn fly(seed: u64) {
    let mut random = Stream::new(seed, Purpose::World, 0);
    let mut flight = Flight::to_learn(arena("double-flip"), seed);
    let network = flight.arena.network_mut();
    network.loss_ratio = 0.1 * random.uniform();
    network.duplicate_ratio = 0.5 * random.uniform();
    network.reorder_ratio = 0.3 * random.uniform();
    network.corruption_ratio = 0.02 * random.uniform();
    println!("world {seed}: {network:?}");
    flight.run(Span::from_secs(12));
    for _ in 0..3 {
        let fault = draw_fault(&mut random);
        let span = Span::from_secs_f64(0.3 * random.uniform());
        let now = flight.arena.now() + Span::from_secs_f64(6.0 * random.uniform());
        println!("world {seed}: {fault:?} at {now} for {span}");
        flight.arena.plant_mut().fault(fault, now, now + span);
        if random.chance(0.3) {
            let name = roster::SERVICES[random.below(roster::SERVICES.len() as u32) as usize];
            println!("world {seed}: {name} dies at {}", flight.arena.now());
            flight.arena.kill(name);
            flight.run(Span::from_secs_f64(random.uniform()));
            flight.arena.restart(name).unwrap();
        }
        flight.run(Span::from_secs(10));
    }
    *flight.arena.network_mut() = virtual_arena::NetworkFaults::default();
    flight.run(Span::from_secs(30));
    let truth = flight.arena.plant().truth(1).unwrap();
    assert!(
        truth.motion.velocity_m_s.norm() < 3.0 || truth.motion.position_m.z > 1.0,
        "world {seed}: neither flies nor stands: {truth:?}"
    );
}

#[test]
fn whatever_the_world_every_vehicle_stays_in_the_hall() {
    let worlds = std::env::var("WORLDS").ok().and_then(|text| text.parse().ok()).unwrap_or(WORLDS);
    for seed in 1..=worlds {
        fly(seed);
    }
}
