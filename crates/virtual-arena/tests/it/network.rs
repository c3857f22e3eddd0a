//! What the network does to datagrams.

use quantity::Span;
use virtual_arena::{NetworkFaults, VirtualArena};
use wire::DropReason;

use crate::cores::{answers, arena};

const TICKS: u64 = 5_000;

/// What of the ticks of 50 s reached the answerer, under some faults.
fn fly(seed: u64, change: impl FnOnce(&mut NetworkFaults)) -> VirtualArena<'static> {
    let mut arena = arena(seed);
    // Its frames would be most of the work.
    arena.kill("vicon-bridge");
    change(arena.network_mut());
    arena.run_for(Span::from_millis(10 * TICKS as i64 - 5), &mut |_| {});
    *arena.network_mut() = NetworkFaults::default();
    arena.run_for(Span::from_millis(5), &mut |_| {});
    arena
}

fn accepted(arena: &VirtualArena<'_>) -> u64 {
    arena.node("flip-manager").unwrap().counters().accepted
}

fn dropped(arena: &VirtualArena<'_>, reason: DropReason) -> u64 {
    arena.node("flip-manager").unwrap().counters().dropped(reason)
}

/// Five sigma of a count of `TICKS` draws.
fn is_ratio(count: u64, ratio: f64) -> bool {
    let n = TICKS as f64;
    (count as f64 - n * ratio).abs() < 5.0 * quantity::math::sqrt(n * ratio * (1.0 - ratio))
}

#[test]
fn a_quiet_network_delivers_everything_once_within_its_delay_and_jitter() {
    let mut arena = arena(1);
    for (at, status) in answers(&mut arena, Span::from_secs(5)) {
        let delay = at - status.began_at;
        assert!((Span::from_micros(40)..=Span::from_micros(100)).contains(&delay), "{delay}");
    }
    let arena = fly(2, |_| {});
    assert_eq!(
        (accepted(&arena), arena.node("flip-manager").unwrap().counters().dropped_total()),
        (TICKS, 0)
    );
}

#[test]
fn losses_are_as_frequent_as_asked_for() {
    let arena = fly(3, |network| network.loss_ratio = 0.2);
    assert!(is_ratio(TICKS - accepted(&arena), 0.2), "{}", accepted(&arena));
    let arena = fly(4, |network| network.loss_ratio = 1.0);
    assert_eq!(accepted(&arena), 0);
}

#[test]
fn a_duplicate_is_taken_once() {
    let arena = fly(5, |network| network.duplicate_ratio = 0.3);
    assert_eq!(accepted(&arena), TICKS);
    assert!(is_ratio(dropped(&arena, DropReason::Replayed), 0.3));
}

#[test]
fn what_is_held_back_is_overtaken_and_still_taken() {
    let mut arena = arena(6);
    arena.network_mut().reorder_ratio = 0.3;
    arena.network_mut().reorder_delay = Span::from_millis(15);
    let ticks: Vec<_> =
        answers(&mut arena, Span::from_secs(20)).iter().map(|(_, status)| status.began_at).collect();
    let overtaken = ticks.windows(2).filter(|pair| pair[1] < pair[0]).count();
    assert!(overtaken > 200, "{overtaken}");
    assert!(ticks.len() >= 1998, "{}", ticks.len());
}

#[test]
fn a_flipped_bit_is_never_taken_for_a_message() {
    let arena = fly(7, |network| network.corruption_ratio = 0.25);
    let counters = *arena.node("flip-manager").unwrap().counters();
    // A bit of the topic's hash or of the kind makes it somebody else's, which is counted nowhere.
    let gone = TICKS - counters.accepted;
    assert!(is_ratio(gone, 0.25), "{gone}");
    assert!(counters.dropped_total() > gone * 3 / 4 && counters.dropped_total() <= gone);
}

#[test]
fn a_partition_cuts_one_way_between_two_services() {
    let cut = ("arena".to_owned(), "flip-manager".to_owned());
    let arena = fly(8, |network| network.partitions.extend([cut.clone()]));
    assert_eq!(accepted(&arena), 0);
    let arena = fly(9, |network| network.partitions.extend([(cut.1, cut.0)]));
    assert_eq!(accepted(&arena), TICKS);
}
