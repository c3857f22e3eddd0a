//! The same seed gives the same bytes, however the time is run through and whoever listens.

use proptest::prelude::*;
use quantity::{Span, Time};
use schemas::{PlantTruth, topics};

use crate::cores::{Restless, SERVICES, arena, node, settings};
use virtual_arena::VirtualArena;

#[test]
fn a_seed_has_one_digest_and_another_seed_another() {
    let digest = |seed| {
        let mut arena = arena(seed);
        arena.run_for(Span::from_secs(1), &mut |_| {});
        (arena.digest(), arena.datagrams())
    };
    assert_eq!(digest(1), digest(1));
    assert_ne!(digest(1).0, digest(2).0);
    assert!(digest(1).1 > 400);
}

#[test]
fn whoever_listens_changes_nothing_and_hears_everything_in_order() {
    let mut quiet = arena(3);
    quiet.run_for(Span::from_secs(1), &mut |_| {});
    let (mut heard, mut last) = (0, Time::ZERO);
    let mut listened = arena(3);
    listened.run_for(Span::from_secs(1), &mut |said| {
        assert!(said.at >= last);
        last = said.at;
        heard += 1;
        assert_eq!(wire::open(said.published.datagram).unwrap().topic().name(), said.published.topic.name);
    });
    assert_eq!(listened.digest(), quiet.digest());
    assert_eq!(listened.datagrams(), heard);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn in_how_many_calls_the_time_is_run_through_makes_no_difference(
        slices in prop::collection::vec(0..30_000_000_i64, 1..60), loss_ratio in 0.0..0.3_f64,
        camera_hz in prop::sample::select(vec![37.0, 200.0]), delay_s in prop::sample::select(vec![0.0, 0.001, 0.008]),
    ) {
        let span = Span::from_millis(400);
        // Cameras and radios so that the plant's events come at instants that depend on how far it was brought before.
        let mut settings = settings();
        for member in &mut settings.fleet {
            member.vehicle.plant.camera.rate_hz = camera_hz;
            member.vehicle.plant.data_link.delay_s = delay_s;
        }
        let arena = || VirtualArena::new(&settings, 4, &SERVICES, &node).unwrap();
        let mut whole = arena();
        whole.network_mut().loss_ratio = loss_ratio;
        let end = whole.now() + span;
        whole.run_until(end, &mut |_| {});
        let mut sliced = arena();
        sliced.network_mut().loss_ratio = loss_ratio;
        for slice in slices {
            let until = (sliced.now() + Span::from_nanos(slice)).min(end);
            sliced.run_until(until, &mut |_| {});
            prop_assert_eq!(sliced.now(), until);
        }
        sliced.run_until(end, &mut |_| {});
        prop_assert_eq!(sliced.datagrams(), whole.datagrams());
        prop_assert_eq!(sliced.digest(), whole.digest());
        for id in [1, 2, 3] {
            prop_assert_eq!(sliced.plant().truth(id), whole.plant().truth(id));
        }
    }
}

#[test]
fn the_truth_is_told_of_every_vehicle_every_20_ms_on_the_dot() {
    let mut arena = arena(5);
    let begin = arena.now();
    let mut told = Vec::new();
    arena.run_for(Span::from_millis(200), &mut |said| {
        if said.published.is_data() && said.published.topic == &topics::PLANT_TRUTH {
            assert_eq!(said.from, "simulator");
            let truth: PlantTruth = wire::decode(said.published.body).unwrap();
            assert_eq!(truth.at, said.at);
            told.push((truth.vehicle, said.at - begin));
        }
    });
    let expected: Vec<(u8, Span)> =
        (0..=10).flat_map(|n| [1, 2, 3].map(|id| (id, Span::from_millis(20 * n)))).collect();
    assert_eq!(told, expected);
}

#[test]
fn time_never_goes_back() {
    let mut arena = arena(6);
    arena.run_for(Span::from_millis(50), &mut |_| {});
    let (now, digest) = (arena.now(), arena.digest());
    arena.run_until(now - Span::from_millis(20), &mut |_| panic!("something was said in the past"));
    assert_eq!((arena.now(), arena.digest()), (now, digest));
    assert_eq!(arena.elapsed(), Span::from_millis(50));
}

#[test]
fn the_order_in_which_services_are_named_is_part_of_the_seed_s_world_and_a_missing_one_only_missing() {
    let mut without_bridge = VirtualArena::new(&settings(), 7, &SERVICES[..2], &node).unwrap();
    without_bridge.run_for(Span::from_millis(100), &mut |said| assert_ne!(said.from, "vicon-bridge"));
    assert!(without_bridge.node("vicon-bridge").is_none());
    assert!(without_bridge.node("arena").is_some());
}

#[test]
#[should_panic(expected = "learner asks without end to be woken")]
fn a_core_that_would_let_no_time_pass_is_found_out() {
    let mut arena =
        VirtualArena::new(&settings(), 8, &[<Restless as service_core::Core>::NAME], &node).unwrap();
    arena.run_for(Span::from_millis(1), &mut |_| {});
}
