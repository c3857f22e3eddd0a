//! What is on the bus is what is in the recording.

use playback::{Command, Plan, Rate, Selection, Source, Tape};
use quantity::Span;
use schemas::{ReplayState, topics};
use wire::Kind;

use super::{Hall, Word, record};

/// Topic, definition, publish time and body, in order.
fn digest<'w>(words: impl Iterator<Item = (&'w str, u64, i64, &'w [u8])>) -> (usize, String) {
    let (mut count, mut hasher) = (0, blake3::Hasher::new());
    for (topic, schema_id, published_ns, body) in words {
        count += 1;
        hasher.update(topic.as_bytes()).update(&schema_id.to_le_bytes()).update(&published_ns.to_le_bytes());
        hasher.update(&(body.len() as u64).to_le_bytes()).update(body);
    }
    (count, hasher.finalize().to_hex().to_string())
}

fn on_the_bus(words: &[Word]) -> (usize, String) {
    digest(words.iter().filter(|word| word.is_of_the_recording()).map(|word| {
        (word.topic.as_str(), word.schema_id, word.published_at.as_nanos(), word.body.as_slice())
    }))
}

fn in_the_recording(tape: &Tape) -> (usize, String) {
    digest(tape.messages().iter().filter_map(|kept| {
        let stream = &tape.channels()[kept.channel].stream;
        (stream.kind == Kind::Data).then(|| {
            (stream.topic.as_str(), stream.schema_id, kept.published_at.as_nanos(), kept.body.as_slice())
        })
    }))
}

#[test]
fn bodies_topics_definitions_and_order_on_the_bus_are_those_of_the_recording_at_any_rate() {
    let hall = Hall::new("stream", 700);
    let tape = record(&hall.settings, Span::ZERO, Span::from_secs(6));
    let expected = in_the_recording(&tape);
    assert!(expected.0 > 5_000, "only {} messages", expected.0);
    for rate in [Rate::Ratio(3.0), Rate::Ratio(20.0), Rate::Max] {
        let (words, summary) = hall.hear(&tape, Plan { rate, ..Plan::default() });
        assert_eq!(on_the_bus(&words), expected, "at rate {rate}");
        assert_eq!((summary.messages, summary.unsent), (expected.0 as u64, 0));
        assert!(words.iter().all(|word| word.verified), "somebody else's key was used");
        let announced = words.iter().filter(|word| word.kind == Kind::Schema).count();
        assert!(announced >= 10, "{announced} definitions");
    }
}

#[test]
fn a_part_of_it_begins_with_what_is_latched() {
    let hall = Hall::new("part", 710);
    let tape = record(&hall.settings, Span::ZERO, Span::from_secs(8));
    let origin = tape.messages()[0].at;
    let (from, to) = (origin + Span::from_millis(5_900), origin + Span::from_secs(6));
    let selection = Selection {
        exclude: vec!["node/*".to_owned()],
        rename: vec![("vehicle/state".to_owned(), "old/state".to_owned())],
        ..Selection::default()
    };
    let (start, end) = (Some(from - origin), Some(to - origin));
    let plan = Plan { selection, start, end, rate: Rate::Ratio(1.0), ..Plan::default() };
    let (words, _) = hall.hear(&tape, plan);
    let words: Vec<&Word> = words.iter().filter(|word| word.is_of_the_recording()).collect();
    let latched: Vec<&str> =
        words.iter().take_while(|word| word.published_at < from).map(|word| word.topic.as_str()).collect();
    assert_eq!(latched, [topics::MANEUVER_PARAMETERS.name, topics::ARENA_ORDER.name]);
    let stream = |index: usize| &tape.channels()[tape.messages()[index].channel].stream;
    let expected: Vec<&[u8]> = (0..tape.messages().len())
        .filter(|index| (from..=to).contains(&tape.messages()[*index].at))
        .filter(|index| !stream(*index).topic.starts_with("node/"))
        .map(|index| tape.messages()[index].body.as_slice())
        .collect();
    let played: Vec<&[u8]> = words[latched.len()..].iter().map(|word| word.body.as_slice()).collect();
    assert!(played == expected, "{} messages instead of {}", played.len(), expected.len());
    assert!(words.iter().any(|word| word.topic == "old/state" && !word.verified));
    assert!(words.iter().all(|word| word.topic != "vehicle/state"));
}

#[test]
fn it_stands_still_steps_jumps_and_goes_round_as_told() {
    let hall = Hall::new("told", 720);
    let tape = record(&hall.settings, Span::ZERO, Span::from_secs(5));
    let origin = tape.messages()[0].at;
    let only = vec!["vehicle/state".to_owned(), "mocap/frame".to_owned()];
    let selection = Selection { include: only, ..Selection::default() };
    let plan = Plan { selection, paused: true, looped: true, rate: Rate::Ratio(10.0), ..Plan::default() };
    let mut orders = vec![
        Command::Step(None),
        Command::Step(Some("vehicle/state".to_owned())),
        Command::Step(Some("no/such".to_owned())),
        Command::Seek(Span::from_secs(4)),
        Command::Step(None),
        Command::Play,
    ]
    .into_iter();
    let (mut heard, mut epochs) = (Vec::new(), Vec::new());
    let (words, _) = hall.hear_while(&tape, plan, &mut |playback, clock| {
        if heard.is_empty() {
            orders.by_ref().for_each(|order| playback.order(order));
        }
        heard.push(clock.at);
        if epochs.last() != Some(&clock.epoch) {
            epochs.push(clock.epoch);
        }
        // Once round and into the next.
        if clock.epoch == 3 && clock.state == ReplayState::Playing && clock.at > origin + Span::from_secs(1) {
            playback.order(Command::Quit);
        }
    });
    assert_eq!(epochs, [1, 2, 3]);
    let words: Vec<&Word> = words.iter().filter(|word| word.is_of_the_recording()).collect();
    let named: Vec<&str> = words.iter().map(|word| word.topic.as_str()).collect();
    let first_state = named.iter().position(|name| *name == "vehicle/state").unwrap();
    assert!(first_state >= 1, "stepped to the first message, then to the first state");
    // Then four seconds on, to the end, and from the beginning again.
    let times: Vec<i64> =
        words.iter().map(|word| (word.published_at - origin).as_nanos() / 1_000_000).collect();
    assert!(
        times[first_state] < 3_000 && times[first_state + 1] >= 4_000,
        "{:?}",
        &times[..=first_state + 1]
    );
    let again = times.windows(2).position(|pair| pair[1] < pair[0] - 1_000).unwrap();
    assert!(times[again] >= 4_900 && times[again + 1] < 3_000, "{} then {}", times[again], times[again + 1]);
}
