//! Services that die, sleep and come back.

use quantity::Span;
use schemas::topics;
use wire::DropReason;

use crate::cores::{TICK, answers, arena};

#[test]
fn a_killed_service_is_silent_and_a_restarted_one_has_a_higher_incarnation_and_no_memory() {
    let mut arena = arena(1);
    let before = answers(&mut arena, Span::from_millis(95));
    assert_eq!(before.len(), 10);
    assert!(before.iter().all(|(_, status)| status.vehicle == 1));
    assert_eq!(before.last().unwrap().1.iteration, 10);
    arena.kill("flip-manager");
    assert!(arena.node("flip-manager").is_none());
    assert!(answers(&mut arena, Span::from_millis(100)).is_empty());
    arena.restart("flip-manager").unwrap();
    let after = answers(&mut arena, Span::from_millis(100));
    assert_eq!(after.len(), 10, "what was said while it was dead is lost");
    assert_eq!((after[0].1.vehicle, after[0].1.iteration), (2, 1));
}

#[test]
fn restarting_a_service_that_lives_is_killing_it_first() {
    let mut arena = arena(2);
    arena.run_for(Span::from_millis(55), &mut |_| {});
    arena.restart("flip-manager").unwrap();
    assert_eq!(arena.node("flip-manager").unwrap().steps(), 0);
    let after = answers(&mut arena, Span::from_millis(50));
    assert!(after.iter().all(|(_, status)| status.vehicle == 2));
    assert_eq!(after.len(), 5, "it hears each tick once, as before");
}

#[test]
fn what_arrives_during_a_pause_waits_for_its_end_in_order() {
    let mut arena = arena(3);
    arena.run_for(Span::from_millis(95), &mut |_| {});
    let begin = arena.now();
    arena.pause("flip-manager", Span::from_millis(100));
    assert!(answers(&mut arena, Span::from_nanos(99_999_999)).is_empty());
    let after = answers(&mut arena, Span::from_millis(20));
    let at_once = after.iter().filter(|(at, _)| *at == begin + Span::from_millis(100)).count();
    assert_eq!(at_once, 10);
    let ticks: Vec<_> = after.iter().map(|(_, status)| status.began_at).collect();
    assert!(ticks.windows(2).all(|pair| pair[1] == pair[0] + TICK), "{ticks:?}");
    assert_eq!(after[0].1.iteration, 11, "it has forgotten nothing");
    assert_eq!(after[0].1.vehicle, 1);
}

#[test]
fn what_has_waited_too_long_is_dropped_unread_as_live() {
    let mut arena = arena(4);
    arena.run_for(Span::from_millis(995), &mut |_| {});
    arena.pause("flip-manager", Span::from_secs(1));
    arena.run_for(Span::from_nanos(999_999_999), &mut |_| {});
    let woken = answers(&mut arena, Span::from_nanos(1));
    assert_eq!(woken.len(), 25, "the last quarter of a second");
    let mut overflowed = None;
    arena.run_for(Span::from_secs(1), &mut |said| {
        if said.from == "flip-manager"
            && said.published.is_data()
            && said.published.topic == &topics::NODE_HEALTH
        {
            let health: schemas::NodeHealth = wire::decode(said.published.body).unwrap();
            overflowed = Some((health.overflowed, health.lost));
        }
    });
    assert_eq!(overflowed, Some((75, 75)));
}

#[test]
fn a_sleeper_misses_its_deadlines_and_wakes_once() {
    let mut arena = arena(5);
    arena.run_for(Span::from_millis(5), &mut |_| {});
    arena.pause("arena", Span::from_millis(100));
    let mut ticks = Vec::new();
    let begin = arena.now();
    arena.run_for(Span::from_millis(115), &mut |said| {
        if said.published.topic == &topics::ARENA_ORDER && said.published.is_data() {
            ticks.push(said.at - begin);
        }
    });
    assert_eq!(ticks, [Span::from_millis(100), Span::from_millis(110)]);
}

#[test]
fn a_pause_may_be_prolonged_and_ends_with_the_process() {
    let mut arena = arena(6);
    arena.run_for(Span::from_millis(5), &mut |_| {});
    arena.pause("flip-manager", Span::from_millis(50));
    arena.run_for(Span::from_millis(30), &mut |_| {});
    arena.pause("flip-manager", Span::from_millis(100));
    assert!(answers(&mut arena, Span::from_nanos(99_999_999)).is_empty(), "the first pause's end is none");
    assert!(!answers(&mut arena, Span::from_millis(1)).is_empty());
    arena.pause("flip-manager", Span::from_secs(5));
    arena.run_for(Span::from_millis(50), &mut |_| {});
    arena.restart("flip-manager").unwrap();
    let after = answers(&mut arena, Span::from_millis(50));
    assert_eq!(after.len(), 5, "the new process does not sleep, and has none of the old one's backlog");
    assert!(after.iter().all(|(_, status)| status.vehicle == 2));
}

#[test]
fn bytes_of_devices_wait_for_a_sleeping_bridge_too_and_are_lost_on_a_dead_one() {
    let frames = |arena: &mut virtual_arena::VirtualArena<'_>, span| {
        let mut numbers = Vec::new();
        arena.run_for(span, &mut |said| {
            if said.published.topic == &topics::MOCAP_FRAME && said.published.is_data() {
                numbers.push(wire::decode::<schemas::MocapFrame>(said.published.body).unwrap());
            }
        });
        numbers
    };
    let mut arena = arena(7);
    arena.run_for(Span::from_millis(100), &mut |_| {});
    arena.pause("vicon-bridge", Span::from_millis(100));
    assert!(frames(&mut arena, Span::from_nanos(99_999_999)).is_empty());
    let woken = frames(&mut arena, Span::from_nanos(1));
    assert!((19..=21).contains(&woken.len()), "200 Hz for 100 ms: {}", woken.len());
    arena.kill("vicon-bridge");
    assert!(frames(&mut arena, Span::from_millis(100)).is_empty());
    arena.restart("vicon-bridge").unwrap();
    assert_eq!(frames(&mut arena, Span::from_millis(50))[0].frame, 1);
}

#[test]
fn thrown_bytes_reach_every_living_node_past_the_filter_and_are_no_part_of_the_digest() {
    let (mut pestered, mut quiet) = (arena(8), arena(8));
    for arena in [&mut pestered, &mut quiet] {
        arena.run_for(Span::from_millis(100), &mut |_| {});
        arena.kill("vicon-bridge");
    }
    pestered.throw(b"garbage");
    // Until just before the next health, which tells the counters.
    for arena in [&mut pestered, &mut quiet] {
        arena.run_for(Span::from_millis(800), &mut |_| {});
    }
    assert_eq!(pestered.digest(), quiet.digest());
    for name in ["arena", "flip-manager"] {
        assert_eq!(pestered.node(name).unwrap().counters().dropped(DropReason::Malformed), 1, "{name}");
        assert_eq!(quiet.node(name).unwrap().counters().dropped_total(), 0, "{name}");
    }
}

#[test]
fn a_fault_for_nobody_is_refused() {
    for act in [
        (|arena: &mut virtual_arena::VirtualArena<'_>| arena.kill("estimater")) as fn(&mut _),
        |arena| arena.pause("estimater", Span::from_secs(1)),
        |arena| drop(arena.restart("estimater")),
    ] {
        let refused = std::panic::catch_unwind(|| act(&mut arena(9)));
        assert!(refused.is_err());
    }
}
