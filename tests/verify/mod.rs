//! Proof by re-execution: what a recording proves, and what it cannot.

mod golden;
mod live;
mod tape;

use std::sync::OnceLock;

use front_door::experiment::{core, node, services};
use quantity::Span;
use recording::verify::{Cause, DivergenceKind, Outcome, Reason};
use schemas::{JournalStep, Topic, topics};
use service_core::{Said, Seed, Start, source_of};
use settings::Arena;
use virtual_arena::VirtualArena;

use crate::common::arena;
use tape::{Message, Tape, assert_identical_but, unverifiable, verdict_on};

/// Half a minute of learning on a good network: take-off, flights to the place, flips.
fn good_tape() -> &'static Tape {
    static TAPE: OnceLock<Tape> = OnceLock::new();
    TAPE.get_or_init(|| {
        let settings = arena("double-flip");
        let mut flying = VirtualArena::new(&settings, 51, &services(), &node).unwrap();
        let mut tape = Tape::default();
        flying.run_for(Span::from_secs(30), &mut |heard| tape.hear(&heard));
        flying.close(&mut |heard| tape.hear(&heard));
        assert!(tape.0.iter().any(|message| message.is_of(&topics::MANEUVER_RESULT)), "nothing was flown");
        tape
    })
}

/// The place of a message of this topic in the middle of the flight.
fn somewhere_in(tape: &Tape, topic: &Topic) -> usize {
    let places: Vec<usize> = (0..tape.0.len()).filter(|place| tape.0[*place].is_of(topic)).collect();
    places[places.len() / 2]
}

/// The step that a message caused in a service.
fn step_caused_in(tape: &Tape, service: &str, message: &Message) -> u64 {
    let journal = tape.journal(service);
    journal.iter().find(|journalled| message.caused(journalled)).unwrap().number
}

#[test]
fn every_core_says_the_same_again() {
    let report = good_tape().verify(&arena("double-flip"), None);
    assert_identical_but(&report, &[]);
    let names: Vec<&str> = report.verdicts.iter().map(|verdict| verdict.service.as_str()).collect();
    for service in services() {
        assert!(names.contains(&service), "{service} is not among {names:?}");
        let verdict = verdict_on(&report, service);
        assert_eq!((verdict.copies_absent, verdict.copies_damaged), (0, 0), "{verdict:#?}");
        assert!(verdict.copies_identical > 0 && verdict.settings.is_none(), "{verdict:#?}");
        assert_eq!(verdict.steps_journalled, good_tape().journal(service).len() as u64);
    }
    assert!(report.holds() && report.unjournalled.is_empty());
}

#[test]
fn a_bad_network_and_restarts_change_nothing_in_the_proof() {
    let settings = arena("double-flip");
    let mut flying = VirtualArena::new(&settings, 52, &services(), &node).unwrap();
    let mut tape = Tape::default();
    let mut run = |flying: &mut VirtualArena<'_>, millis| {
        flying.run_for(Span::from_millis(millis), &mut |heard| tape.hear(&heard));
    };
    run(&mut flying, 8000);
    let faults = flying.network_mut();
    faults.loss_ratio = 0.03;
    faults.duplicate_ratio = 0.1;
    faults.reorder_ratio = 0.1;
    faults.corruption_ratio = 0.02;
    for service in roster::SERVICES {
        flying.kill(service);
        run(&mut flying, 60);
        flying.restart(service).unwrap();
        run(&mut flying, 3700);
    }
    flying.pause("estimator", Span::from_millis(300));
    run(&mut flying, 2000);
    flying.pause("learner", Span::from_secs(3));
    run(&mut flying, 5000);
    flying.close(&mut |heard| tape.hear(&heard));
    let report = tape.verify(&settings, None);
    assert_identical_but(&report, &[]);
    for service in roster::SERVICES {
        let starts: Vec<u32> = report
            .verdicts
            .iter()
            .filter(|verdict| verdict.service == *service)
            .map(|verdict| verdict.incarnation)
            .collect();
        assert_eq!(starts, [1, 2], "{service}");
    }
    assert!(report.holds());
}

/// The number of the first step at which a core with one setting and a core with another say different things, found
/// with both of them side by side, fed from the whole tape.
fn first_effect(tape: &Tape, service: &str, one: &Arena, other: &Arena) -> u64 {
    let by_address = tape.by_address();
    let batch =
        tape.0.iter().filter_map(Message::batch).find(|batch| batch.node.as_str() == service).unwrap();
    let start = Start { at: batch.started_at, seed: Seed(batch.seed), incarnation: 1 };
    let mut cores = [core(service, one, start).unwrap(), core(service, other, start).unwrap()];
    for journalled in tape.journal(service) {
        let JournalStep { at, sequence, .. } = journalled.step;
        let said = cores.each_mut().map(|core| match journalled.stream {
            None => core.step_deadline(at, &mut |_, _| ()),
            Some(stream) => {
                let address = (stream.topic_hash, stream.source, stream.incarnation, sequence);
                let topics = core.topics_in();
                let index = topics.iter().position(|topic| topic.hash == stream.topic_hash).unwrap();
                core.step_input(at, index, &by_address[&address].body, &mut |_, _| ()).unwrap()
            }
        });
        if said[0] != said[1] {
            let Said { outputs, digest } = said[0];
            assert_eq!((outputs, digest), (journalled.step.outputs, journalled.step.digest));
            return journalled.number;
        }
    }
    panic!("no effect at all");
}

/// The settings with one constant of the estimator's filter changed.
fn with_other_filter(settings: &Arena, section: &str, key: &str, value: f64) -> Arena {
    let mut other = settings.clone();
    other.services = toml::from_str(&format!("[estimator.{section}]\n{key} = {value:?}")).unwrap();
    assert_ne!(other.digest(), settings.digest());
    other
}

#[test]
fn a_changed_filter_constant_is_found_at_its_first_effect() {
    let (tape, settings) = (good_tape(), arena("double-flip"));
    // One that acts at once, and one that acts only when a flip is over.
    for (section, key, value) in [("noise", "position_m", 0.0031), ("timing", "flip_coast_s", 0.1)] {
        let other = with_other_filter(&settings, section, key, value);
        let first = first_effect(tape, "estimator", &settings, &other);
        let report = tape.verify(&other, Some("estimator"));
        let [verdict] = &report.verdicts[..] else { panic!("{report:?}") };
        let Outcome::Diverged(divergence) = &verdict.outcome else { panic!("{key}: {verdict:#?}") };
        assert_eq!((divergence.step, verdict.steps_identical), (first, first), "{key}");
        assert!(divergence.recorded_proven, "{key}: {divergence:#?}");
        assert_eq!(verdict.settings.map(|settings| settings.given), Some(other.digest()));
        let differing: usize = divergence.messages.iter().map(|message| message.differing().count()).sum();
        assert!(differing > 0, "{key}: {divergence:#?}");
        assert!(matches!(divergence.kind, DivergenceKind::Output { .. }), "{key}");
        if let Cause::Message { fields, .. } = &divergence.cause {
            assert!(!fields.is_empty(), "{key}");
        }
        assert!(!report.holds());
    }
}

#[test]
fn after_a_message_that_nobody_recorded_its_readers_are_unverifiable_and_nobody_else() {
    let settings = arena("double-flip");
    for (topic, readers) in [
        (&topics::VEHICLE_STATE, &["hover-controller", "flip-manager"][..]),
        (&topics::RADIO_RX, &["radio-bridge"]),
        (&topics::MOCAP_FRAME, &["estimator", "flip-manager"]),
        (&topics::MANEUVER_RESULT, &["learner"]),
    ] {
        let mut tape = good_tape().clone();
        let missing = tape.0.remove(somewhere_in(&tape, topic));
        let report = tape.verify(&settings, None);
        assert_identical_but(&report, readers);
        for reader in readers {
            let (from_step, reason) = unverifiable(verdict_on(&report, reader));
            assert_eq!(from_step, step_caused_in(&tape, reader, &missing), "{} in {reader}", topic.name);
            let Reason::InputMissing(input) = reason else { panic!("{reason:?}") };
            assert_eq!((input.topic.as_str(), input.sequence), (topic.name, missing.sequence));
            assert_eq!(input.source, source_of(topic.writer));
        }
        assert!(!report.holds());
    }
}

#[test]
fn one_bit_of_a_recorded_message_is_found_with_its_sender_and_blamed_on_no_reader() {
    let settings = arena("double-flip");
    let mut tape = good_tape().clone();
    let place = somewhere_in(&tape, &topics::VEHICLE_STATE);
    let middle = tape.0[place].body.len() / 2;
    tape.0[place].body[middle] ^= 0x10;
    let bent = tape.0[place].clone();
    let report = tape.verify(&settings, None);
    let readers = ["hover-controller", "flip-manager"];
    assert_identical_but(&report, &["hover-controller", "flip-manager", "estimator"]);
    for reader in readers {
        let (from_step, reason) = unverifiable(verdict_on(&report, reader));
        assert_eq!(from_step, step_caused_in(&tape, reader, &bent), "{reader}");
        assert!(
            matches!(reason, Reason::InputDamaged(input) if input.sequence == bent.sequence),
            "{reason:?}"
        );
    }
    let verdict = verdict_on(&report, "estimator");
    assert_eq!((&verdict.outcome, verdict.copies_damaged), (&Outcome::Identical, 1));
    let damage = verdict.first_damage.as_ref().unwrap();
    assert_eq!((damage.message.sequence, damage.at), (bent.sequence, bent.published_at));
    assert!(damage.message.differing().count() >= 1, "{damage:#?}");
    assert!(!report.holds());
}

#[test]
fn a_bent_message_of_a_device_is_a_divergence_of_its_bridge_with_the_cause_field_by_field() {
    let mut tape = good_tape().clone();
    let place = somewhere_in(&tape, &topics::VICON_RX);
    let last = tape.0[place].body.len() - 3;
    tape.0[place].body[last] ^= 0x40;
    let (bent, step) = (tape.0[place].clone(), step_caused_in(&tape, "vicon-bridge", &tape.0[place]));
    let report = tape.verify(&arena("double-flip"), None);
    assert_identical_but(&report, &["vicon-bridge"]);
    let Outcome::Diverged(divergence) = &verdict_on(&report, "vicon-bridge").outcome else {
        panic!("{:#?}", verdict_on(&report, "vicon-bridge"))
    };
    assert!(divergence.step >= step, "{} before {step}", divergence.step);
    assert_eq!(divergence.step, step, "every piece of the stream carries whole frames: {divergence:#?}");
    let Cause::Message { input, fields } = &divergence.cause else { panic!("{divergence:#?}") };
    assert_eq!((input.topic.as_str(), input.sequence), ("vicon/rx", bent.sequence));
    assert!(fields.iter().any(|(path, _)| path == "bytes"), "{fields:?}");
}

#[test]
fn a_journal_with_a_hole_ends_the_proof_there() {
    let settings = arena("double-flip");
    let is_batch = |message: &Message, first: u64| {
        message.batch().is_some_and(|batch| batch.node.as_str() == "estimator" && batch.first_step == first)
    };
    let batches: Vec<_> = good_tape().0.iter().filter_map(Message::batch).collect();
    let firsts: Vec<u64> = batches
        .iter()
        .filter(|batch| batch.node.as_str() == "estimator")
        .map(|batch| batch.first_step)
        .collect();
    let (missing, next) = (firsts[40], firsts[41]);
    let without = |gone: &dyn Fn(&Message) -> bool| {
        let kept = good_tape().0.iter().filter(|message| !gone(message)).cloned().collect();
        Tape(kept).verify(&settings, None)
    };

    let report = without(&|message| is_batch(message, missing));
    assert_identical_but(&report, &["estimator"]);
    let found = unverifiable(verdict_on(&report, "estimator"));
    assert_eq!(found, (missing, &Reason::JournalMissing { resumes_at_step: next }));

    let report = without(&|message| is_batch(message, 0));
    assert_identical_but(&report, &["estimator"]);
    let found = unverifiable(verdict_on(&report, "estimator"));
    assert_eq!(found, (0, &Reason::JournalBeginsLate));

    let from = firsts[40];
    let report = without(&|message| firsts.iter().any(|first| *first >= from && is_batch(message, *first)));
    assert_identical_but(&report, &["estimator"]);
    let found = unverifiable(verdict_on(&report, "estimator"));
    assert!(
        matches!(found, (step, Reason::JournalEnds { steps_reported }) if step == from && *steps_reported > from)
    );

    let report = without(&|message| message.batch().is_some_and(|batch| batch.node.as_str() == "estimator"));
    assert_identical_but(&report, &[]);
    assert_eq!(report.unjournalled.len(), 1);
    assert_eq!(report.unjournalled[0].service, "estimator");
}

#[test]
fn a_recording_without_journals_proves_nothing() {
    let kept =
        good_tape().0.iter().filter(|message| message.batch().is_none()).take(20_000).cloned().collect();
    let report = Tape(kept).verify(&arena("double-flip"), None);
    assert!(report.verdicts.is_empty() && !report.holds());
}
