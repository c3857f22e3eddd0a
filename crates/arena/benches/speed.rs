//! Virtual seconds per wall second of the full double-flip experiment on one core, and where the time goes.
//!
//! `cargo bench -p arena --bench speed [-- ITERATIONS]`. Each part is measured alone in the same run, so that the shares hold
//! on a noisy machine; nothing is asserted.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use front_door::experiment::{self, Observer};
use plant::Plant;
use quantity::{Span, Time};
use service_core::Identity;
use settings::Arena;
use virtual_arena::Heard;
use wire::{Domain, Keyring, Kind, Role, Secret, TopicName, Windows};

/// Datagrams and bytes by topic.
#[derive(Default)]
struct Traffic {
    datagrams: u64,
    bytes: u64,
    by_topic: Vec<(&'static str, u64, u64)>,
}

impl Observer for Traffic {
    fn heard(&mut self, heard: &Heard<'_>) {
        let length = heard.published.datagram.len() as u64;
        self.datagrams += 1;
        self.bytes += length;
        let name = heard.published.topic.name;
        match self.by_topic.iter_mut().find(|(topic, _, _)| *topic == name) {
            Some((_, count, bytes)) => {
                *count += 1;
                *bytes += length;
            }
            None => self.by_topic.push((name, 1, length)),
        }
    }
}

fn main() {
    let iterations = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(129);
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let mut arena = Arena::load(&config, "double-flip").expect("the settings of the repository");
    arena.scenario.flip.as_mut().expect("a flip").iterations = iterations;

    let started = Instant::now();
    let flown = experiment::learn(&arena, 1, &mut ()).expect("settings that fly");
    let experiment_s = started.elapsed().as_secs_f64();
    let virtual_s = flown.report.virtual_s;
    println!("double-flip, {iterations} flips: {virtual_s:.1} virtual s in {experiment_s:.3} s");
    println!("  {:.0} times real time on one core", virtual_s / experiment_s);

    let mut traffic = Traffic::default();
    let _ = experiment::learn(&arena, 1, &mut traffic);
    println!(
        "  {:.0} datagrams and {:.0} kB per virtual second",
        traffic.datagrams as f64 / virtual_s,
        traffic.bytes as f64 / virtual_s / 1e3
    );
    traffic.by_topic.sort_by_key(|(_, count, _)| std::cmp::Reverse(*count));
    for (topic, count, bytes) in traffic.by_topic.iter().take(8) {
        println!("    {topic:<24} {:7.1} per s, {} bytes each", *count as f64 / virtual_s, bytes / count);
    }

    let sealing_s = sealing(&traffic);
    println!(
        "  one seal and one verification of each datagram, alone: {sealing_s:.3} s, {:.0} %",
        100.0 * sealing_s / experiment_s
    );
    let (plant_s, ticks) = plant_alone(&arena, virtual_s);
    println!("  the plant on the floor, alone: {plant_s:.3} s, {:.0} %", 100.0 * plant_s / experiment_s);
    println!("  {:.2} million 800 Hz ticks per second", ticks / plant_s / 1e6);
}

/// Seals and verifies as many datagrams, of the average length.
fn sealing(traffic: &Traffic) -> f64 {
    let secret = Secret::new([5; 32]);
    let role = Role("estimator");
    let keyring = Keyring::new(&secret, Domain::Sim, 7, role, [role]);
    let topic = TopicName::new("vehicle/state").expect("a short name");
    let body = vec![7_u8; (traffic.bytes / traffic.datagrams.max(1)) as usize - 56 - 16 - 13];
    let identity =
        Identity { source: 1, incarnation: 1, domain: Domain::Sim, run: 7, seed: service_core::Seed(1) };
    let mut windows = Windows::new();
    let mut datagram = Vec::new();
    let started = Instant::now();
    for sequence in 1..=traffic.datagrams {
        let header = wire::Header {
            kind: Kind::Data,
            domain: identity.domain,
            latched: false,
            source: identity.source,
            schema_id: 9,
            run: identity.run,
            incarnation: identity.incarnation,
            sequence,
            published_at: Time::ZERO,
        };
        wire::seal(&header, topic, &body, keyring.own(), &mut datagram).expect("a datagram that can be");
        let opened = wire::open(&datagram).expect("what was just sealed");
        let key = keyring.verify_key(role).expect("its own role");
        black_box(opened.verify(key).and_then(|authentic| authentic.fresh(&mut windows)).is_ok());
    }
    started.elapsed().as_secs_f64()
}

/// The plant alone, hovering by luck of its placement or standing: the cameras, links and firmware run all the same.
fn plant_alone(arena: &Arena, virtual_s: f64) -> (f64, f64) {
    let mut plant = Plant::new(arena, 1, Time::ZERO).expect("settings that fly");
    let end = Time::ZERO + Span::from_secs_f64(virtual_s);
    let mut bytes = 0_usize;
    let started = Instant::now();
    while plant.next_event() < end {
        let now = plant.next_event();
        plant.advance(now, &mut |output| bytes += output.bytes.len());
    }
    black_box(bytes);
    (started.elapsed().as_secs_f64(), virtual_s * 800.0)
}
