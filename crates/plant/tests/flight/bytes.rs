//! The same settings, seed and calls give the same bytes, whatever the steps time passes in; no bytes do
//! harm.

use device::vicon::{Datagram, euler_to_rotation};
use plant::{Device, Motion, Plant};
use proptest::prelude::*;
use quantity::{Span, Time, Vector};

use crate::flips::{double_flip, place};
use crate::ground::{Ground, arena, ideal_arena};

#[test]
fn bytes_are_the_same_for_the_same_seed_and_others_for_another() {
    let digest = |seed| {
        let mut ground = Ground::new(&arena(), seed);
        ground.hover_at(place());
        ground.flip(1, &double_flip());
        (ground.digest, ground.vicon.len())
    };
    let (first, again, other) = (digest(3), digest(3), digest(4));
    assert_eq!(first, again);
    assert_ne!(first.0, other.0);
}

/// All bytes of a falling vehicle, with their times, time passing by `step` or by the plant's own events.
fn bytes_by(step: Option<Span>) -> Vec<(Time, Vec<u8>)> {
    let mut plant = Plant::new(&arena(), 8, Time::ZERO).expect("the shipped settings fly");
    plant.place(1, Motion::at_rest(Vector::new(0.0, 0.0, 8.0), 0.5));
    let (mut sent, mut now) = (Vec::new(), Time::ZERO);
    let end = Time::ZERO + Span::from_secs(3);
    while now < end {
        now = step.map_or_else(|| plant.next_event(), |step| now + step).min(end);
        plant.advance(now, &mut |output| {
            assert!(output.at <= now);
            sent.push((output.at, output.bytes.to_vec()));
        });
    }
    sent
}

#[test]
fn the_steps_in_which_time_passes_do_not_matter() {
    let by_events = bytes_by(None);
    assert!(by_events.len() > 600);
    assert!(by_events.is_sorted_by_key(|(at, _)| *at));
    for micros in [137, 1_250, 20_000, 3_000_000] {
        assert!(bytes_by(Some(Span::from_micros(micros))) == by_events, "{micros} µs");
    }
}

#[test]
fn nothing_is_sent_before_the_next_event() {
    let mut plant = Plant::new(&arena(), 9, Time::ZERO).unwrap();
    let mut sent = 0;
    for _ in 0..3_000 {
        let event = plant.next_event();
        assert!(event > plant.now() || sent == 0);
        plant.advance(event - Span::from_nanos(1), &mut |output| panic!("{output:?} before {event}"));
        plant.advance(event, &mut |_| sent += 1);
    }
    assert!(sent > 1_000);
}

#[test]
fn poses_in_the_datagrams_are_the_truth_of_their_exposure() {
    let arena = ideal_arena();
    let mut plant = Plant::new(&arena, 10, Time::ZERO).unwrap();
    let tumbling = Motion {
        position_m: Vector::new(0.0, 0.0, 9.0),
        velocity_m_s: Vector::new(0.5, -0.2, 2.0),
        rate_rad_s: Vector::new(1.0, 20.0, -2.0),
        ..Motion::default()
    };
    plant.place(1, tumbling);
    let (mut truths, mut poses) = (std::collections::BTreeMap::new(), Vec::new());
    while plant.now() < Time::ZERO + Span::from_millis(900) {
        let event = plant.next_event();
        plant.advance(event, &mut |output| {
            if output.device == Device::MotionCapture {
                let object = Datagram::decode(output.bytes).unwrap().objects().next().unwrap();
                let [x, y, z] = object.translation_mm;
                let rotation = euler_to_rotation(object.rotation_rad).unwrap();
                poses.push((output.at, Vector::new(x, y, z) * 1e-3, rotation));
            }
        });
        truths.insert(event, plant.truth(1).unwrap().motion);
    }
    assert!(poses.len() > 150);
    for (at, position_m, rotation) in poses {
        let truth = truths.get(&(at - Span::from_millis(10))).expect("an exposure is an event");
        assert!((position_m - truth.position_m).norm() < 1e-9);
        assert!(rotation.angle_to(truth.orientation) < 1e-7);
    }
}

#[test]
fn what_the_cameras_draw_does_not_move_the_vehicle() {
    let end = |noise_m: f64| {
        let mut arena = arena();
        arena.fleet[0].vehicle.plant.camera.position_noise_m = noise_m;
        let mut ground = Ground::new(&arena, 12);
        ground.hover_at(place());
        (ground.motion(), ground.digest)
    };
    let (quiet, noisy) = (end(0.0005), end(0.005));
    assert_eq!(quiet.0, noisy.0);
    assert_ne!(quiet.1, noisy.1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_bytes_on_any_port_do_no_harm(
        pieces in prop::collection::vec((prop::sample::select(vec![0u16, 0x101, 0x1FF, 7]),
            prop::collection::vec(any::<u8>(), 0..200), 0i64..30), 0..40),
    ) {
        let mut plant = Plant::new(&arena(), 1, Time::ZERO).unwrap();
        let mut now = Time::ZERO;
        for (port, bytes, millis) in pieces {
            plant.receive(now, port, &bytes);
            now += Span::from_millis(millis);
            plant.advance(now, &mut |_| ());
        }
        prop_assert!(plant.truth(1).unwrap().motors_off());
    }
}
