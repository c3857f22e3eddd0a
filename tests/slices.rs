//! In how many slices the time is run through makes no difference to a single byte of the whole arena.

use quantity::Span;

use crate::common::{Flight, arena};

#[test]
fn an_arena_run_in_slices_is_the_arena_run_at_once() {
    let span = Span::from_secs(30);
    let mut whole = Flight::to_learn(arena("fleet"), 21);
    whole.arena.run_for(span, &mut |_| {});
    for slice in [Span::from_micros(3_700), Span::from_millis(500), Span::from_micros(1_250)] {
        let mut sliced = Flight::to_learn(arena("fleet"), 21);
        let end = sliced.arena.now() + span;
        while sliced.arena.now() < end {
            let until = (sliced.arena.now() + slice).min(end);
            sliced.arena.run_until(until, &mut |_| {});
        }
        assert_eq!(sliced.arena.datagrams(), whole.arena.datagrams(), "in slices of {slice}");
        assert_eq!(sliced.arena.digest(), whole.arena.digest(), "in slices of {slice}");
    }
    assert!(whole.arena.take_maneuvers().len() >= 3, "a flip of each vehicle is part of it");
}
