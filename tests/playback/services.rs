//! Services take a replay for live data.

use playback::{Await, Plan, Rate, Selection, Tape};
use quantity::{Span, Time};
use schemas::{Tracking, VehicleState, topics};
use service_core::source_of;
use wire::Kind;

use super::{Hall, Word, record};

fn replayed(hall: &Hall, tape: &Tape, services: &[&str], rate: Rate) -> Vec<Word> {
    let names: Vec<String> = services.iter().map(|name| (*name).to_owned()).collect();
    let _running: Vec<_> = services.iter().map(|name| hall.run(name)).collect();
    let selection = Selection { running: names.clone(), ..Selection::default() };
    let plan = Plan { selection, rate, awaits: Await::Nodes(names), ..Plan::default() };
    let (words, summary) = hall.hear(tape, plan);
    assert_eq!(summary.dropped_nodes, [] as [&str; 0]);
    words
}

/// What the estimator itself said, not what is played of it.
fn states(words: &[Word]) -> Vec<VehicleState> {
    let own = |word: &&Word| {
        word.topic == topics::VEHICLE_STATE.name
            && word.kind == Kind::Data
            && word.source == source_of("estimator")
    };
    words.iter().filter(own).map(|word| wire::decode(&word.body).unwrap()).collect()
}

fn recorded_states(tape: &Tape) -> Vec<VehicleState> {
    let channels = playback::Source::channels(tape);
    let of_states = |channel: usize| channels[channel].stream.topic == topics::VEHICLE_STATE.name;
    let messages = tape.messages().iter().filter(|kept| of_states(kept.channel));
    messages.map(|kept| wire::decode(&kept.body).unwrap()).collect()
}

/// The greatest distance between two accounts of one flight, once both track, and for how many states.
fn worst_m(replayed: &[VehicleState], recorded: &[VehicleState], from: Time) -> (f64, usize) {
    let (mut worst, mut compared) = (0.0_f64, 0);
    let mut known = recorded.iter().peekable();
    for state in replayed.iter().filter(|state| state.estimated_for >= from) {
        while known.next_if(|known| known.estimated_for < state.estimated_for).is_some() {}
        let Some(same) = known.peek().filter(|known| known.estimated_for == state.estimated_for) else {
            continue;
        };
        if state.tracking == Tracking::Tracking && same.tracking == Tracking::Tracking {
            worst = worst.max((state.estimate.position_m - same.estimate.position_m).norm());
            compared += 1;
        }
    }
    (worst, compared)
}

/// Up to its first flips and beyond.
fn double_flip(hall: &Hall) -> Tape {
    record(&hall.settings, Span::ZERO, Span::from_secs(24))
}

#[test]
fn an_estimator_tracks_on_a_replay_as_it_did_at_whatever_rate() {
    let hall = Hall::new("estimator", 730);
    let tape = double_flip(&hall);
    let recorded = recorded_states(&tape);
    assert!(recorded.iter().any(|state| state.tracking == Tracking::Ballistic), "it does not flip");
    let from = tape.messages()[0].at + Span::from_secs(1);
    for rate in [Rate::Max, Rate::Ratio(5.0)] {
        let replayed = states(&replayed(&hall, &tape, &["estimator"], rate));
        let (worst, compared) = worst_m(&replayed, &recorded, from);
        println!("rate {rate}: {} states, {compared} compared, worst {worst:.6} m", replayed.len());
        // By the clock, a busy machine leaves gaps; in lock step it must not. Not all of a flight is tracking.
        let least = if rate == Rate::Max { 0.99 } else { 0.3 };
        let share = replayed.len() as f64 / recorded.len() as f64;
        assert!(
            share > least && compared > replayed.len() / 2,
            "{share} of them at {rate}, {compared} compared"
        );
        assert!(replayed.iter().any(|state| state.tracking == Tracking::Ballistic));
        assert!(worst < 0.01, "{worst} m at rate {rate}");
    }
}

#[test]
fn all_services_follow_a_replay_in_lock_step_and_none_falls_behind() {
    let hall = Hall::new("lock-step", 740);
    let tape = record(&hall.settings, Span::ZERO, Span::from_secs(12));
    let from = tape.messages()[0].at + Span::from_secs(1);
    let words = replayed(&hall, &tape, roster::SERVICES, Rate::Max);
    let replayed = states(&words);
    let (worst, compared) = worst_m(&replayed, &recorded_states(&tape), from);
    println!("{} states, {compared} compared, worst {worst:.6} m", replayed.len());
    assert!(compared > 1_500, "{compared} of {} states track", replayed.len());
    assert!(worst < 0.01, "{worst} m");
    for service in roster::SERVICES {
        let source = source_of(service);
        let last = words.iter().rev().find(|word| word.source == source && word.topic == "node/health");
        let spoke_until = last.map_or(Time::ZERO, |word| word.published_at);
        let end = tape.messages().last().unwrap().at;
        assert!(
            end - spoke_until < Span::from_millis(1_500),
            "{service} was last heard at {spoke_until} of {end}"
        );
    }
}
