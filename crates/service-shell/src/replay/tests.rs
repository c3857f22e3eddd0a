//! A toy service in a replay: when it is woken, when it hears, when it begins anew.

use std::cell::RefCell;

use quantity::Time;
use reflect::Message;
use schemas::{DeviceBytes, ReplayAnswer, ReplayClock, VehicleCommand};
use service_core::{Core, Event, Identity, Node, Outbox, Publisher, Sink, Start, inputs, outputs};
use settings::{Arena, ConfigError};
use wire::{Domain, Secret};

use super::*;
use crate::identity::identity;

inputs! {
    /// What the toy radio bridge hears.
    pub enum Input {
        /// Commands.
        Command(VehicleCommand) = topics::VEHICLE_COMMAND,
        /// Its device.
        Bytes(DeviceBytes) = topics::RADIO_RX,
    }
}
outputs! {
    /// What it says: nothing.
    pub enum Output {}
}

/// What happened to the toy, with the time it was told.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Did {
    Begin(i64, u32),
    Wake(i64),
    Command(i64, u8),
    Bytes(i64),
}

thread_local! {
    static DONE: RefCell<Vec<Did>> = const { RefCell::new(Vec::new()) };
}

fn note(did: Did) {
    DONE.with_borrow_mut(|done| done.push(did));
}

fn done() -> Vec<Did> {
    DONE.take()
}

/// Due every 20 ms from its beginning.
struct Toy {
    due_at: Time,
}

fn ms(at: Time) -> i64 {
    at.as_nanos() / 1_000_000
}

impl Core for Toy {
    const NAME: &'static str = "radio-bridge";
    type Tuning = toml::Table;
    type Input = Input;
    type Output = Output;

    fn new(_: &Arena, _: toml::Table, start: Start) -> Result<Self, ConfigError> {
        if start.at > Time::ZERO {
            note(Did::Begin(ms(start.at), start.incarnation));
        }
        Ok(Self { due_at: start.at + Span::from_millis(20) })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.due_at)
    }

    fn step(&mut self, now: Time, event: Event<Input>, _: &mut Outbox<Output>) {
        note(match event {
            Event::Deadline => {
                self.due_at += Span::from_millis(20);
                Did::Wake(ms(now))
            }
            Event::Input(Input::Command(command)) => Did::Command(ms(now), command.vehicle),
            Event::Input(Input::Bytes(_)) => Did::Bytes(ms(now)),
        });
    }
}

const RUN: u64 = 0x77;
/// Where the recording begins, in milliseconds.
const BEGIN_MS: i64 = 1_000_000;

fn at(milliseconds: i64) -> Time {
    Time::ZERO + Span::from_millis(BEGIN_MS + milliseconds)
}

/// A program of the replay domain, to speak as.
struct Voice {
    publisher: Publisher,
    datagram: Vec<u8>,
}

impl Voice {
    fn new(role: &'static str) -> Self {
        Self::of(role, 1)
    }

    fn of(role: &'static str, incarnation: u32) -> Self {
        let identity = identity(role, Domain::Replay, RUN, incarnation);
        Self { publisher: Publisher::new(role, &Secret::new([7; 32]), identity), datagram: Vec::new() }
    }

    fn say<M: Message>(&mut self, at: Time, topic: &'static Topic, message: &M) -> Vec<u8> {
        let kept = &mut self.datagram;
        self.publisher
            .publish(at, topic, message, &mut |published| *kept = published.datagram.to_vec())
            .unwrap();
        self.datagram.clone()
    }

    fn tick(&mut self, epoch: u32, milliseconds: i64) -> Vec<u8> {
        let clock = ReplayClock { at: at(milliseconds), epoch, rate_ratio: 1.0, ..ReplayClock::default() };
        self.say(clock.at, &topics::REPLAY_CLOCK, &clock)
    }

    fn command(&mut self, milliseconds: i64, vehicle: u8) -> Vec<u8> {
        let command = VehicleCommand { vehicle, ..VehicleCommand::default() };
        self.say(at(milliseconds), &topics::VEHICLE_COMMAND, &command)
    }
}

fn with_driver(act: impl FnOnce(&mut Driver<'_>)) {
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let arena = Arena::load(&config, "double-flip").unwrap();
    let secret = Secret::new([7; 32]);
    let factory = |identity: Identity, now: Time| {
        let node = Node::<Toy>::new(&arena, &secret, identity, now)?;
        Ok(Box::new(node) as Box<dyn service_core::AnyNode>)
    };
    let mut driver =
        Driver::new(&secret, identity("radio-bridge", Domain::Replay, RUN, 40), &factory).unwrap();
    assert_eq!(done(), []);
    act(&mut driver);
}

fn take(driver: &mut Driver<'_>, datagram: &[u8]) {
    driver.take(datagram, &mut |_| {}).unwrap();
}

#[test]
fn it_begins_with_the_first_tick_and_is_woken_at_its_own_instants() {
    with_driver(|driver| {
        let (mut playback, mut controller) = (Voice::new("playback"), Voice::new("hover-controller"));
        // Before playback says the time there is none.
        take(driver, &controller.command(0, 1));
        assert_eq!(done(), []);
        take(driver, &playback.tick(1, 0));
        take(driver, &playback.tick(1, 19));
        assert_eq!(done(), [Did::Begin(BEGIN_MS, 40)]);
        // A tick that came late: each deadline at its own instant all the same.
        take(driver, &playback.tick(1, 65));
        let woken = [20, 40, 60].map(|milliseconds| Did::Wake(BEGIN_MS + milliseconds));
        assert_eq!(done(), woken);
    });
}

#[test]
fn a_message_moves_time_to_when_it_was_said_and_finds_its_deadlines_done() {
    with_driver(|driver| {
        let (mut playback, mut controller) = (Voice::new("playback"), Voice::new("hover-controller"));
        take(driver, &playback.tick(1, 15));
        done();
        take(driver, &controller.command(20, 1));
        take(driver, &controller.command(17, 2));
        take(driver, &controller.command(35, 3));
        // Said earlier than what is known, it does not turn time back.
        assert_eq!(
            done(),
            [
                Did::Command(BEGIN_MS + 20, 1),
                Did::Command(BEGIN_MS + 20, 2),
                Did::Wake(BEGIN_MS + 35),
                Did::Command(BEGIN_MS + 35, 3)
            ]
        );
    });
}

#[test]
fn nobody_without_a_key_moves_time() {
    with_driver(|driver| {
        let mut playback = Voice::new("playback");
        take(driver, &playback.tick(1, 0));
        done();
        // A node that may not speak as the controller, and one that may not say the time.
        let mut estimator = Voice::new("estimator");
        let command = VehicleCommand::default();
        let mut forged = estimator.say(at(15), &topics::VEHICLE_COMMAND, &command);
        take(driver, &forged);
        let clock = ReplayClock { at: at(500), epoch: 1, ..ReplayClock::default() };
        take(driver, &estimator.say(at(500), &topics::REPLAY_CLOCK, &clock));
        // Its own clock word, heard twice, and one spoilt.
        let tick = playback.tick(1, 10);
        take(driver, &tick);
        take(driver, &tick);
        forged = playback.tick(1, 400);
        let last = forged.len() - 1;
        forged[last] ^= 1;
        take(driver, &forged);
        assert_eq!(done(), []);
        take(driver, &playback.tick(1, 20));
        assert_eq!(done(), [Did::Wake(BEGIN_MS + 20)]);
    });
}

#[test]
fn after_a_jump_it_is_new_and_what_is_left_of_the_time_before_is_dropped() {
    with_driver(|driver| {
        let (mut playback, mut controller) = (Voice::new("playback"), Voice::new("hover-controller"));
        take(driver, &playback.tick(1, 5_000));
        let leftover = controller.command(5_010, 1);
        let old_tick = playback.tick(1, 5_015);
        done();
        take(driver, &playback.tick(2, 0));
        take(driver, &leftover);
        take(driver, &old_tick);
        // The tick of the old epoch came late and is not heard either: its number was skipped, its epoch is past.
        assert_eq!(done(), [Did::Begin(BEGIN_MS, 41)]);
        take(driver, &controller.command(7, 2));
        assert_eq!(done(), [Did::Command(BEGIN_MS + 7, 2)]);
        // Another playback joins the run after the first: its epochs count anew, its incarnation is higher.
        take(driver, &Voice::of("playback", 2).tick(1, 3));
        assert_eq!(done(), [Did::Begin(BEGIN_MS + 3, 42)]);
    });
}

#[test]
fn device_bytes_come_from_the_bus_and_no_echo_of_anything_else() {
    with_driver(|driver| {
        let (mut playback, mut replayed) = (Voice::new("playback"), Voice::new("radio-bridge"));
        take(driver, &playback.tick(1, 0));
        done();
        take(driver, &replayed.say(at(3), &topics::RADIO_RX, &DeviceBytes::default()));
        take(driver, &Voice::new("playback").say(at(4), &topics::RADIO_RX, &DeviceBytes::default()));
        assert_eq!(done(), [Did::Bytes(BEGIN_MS + 3)]);
    });
}

#[test]
fn in_lock_step_it_answers_what_it_did_and_when_it_is_due_next() {
    with_driver(|driver| {
        let (mut playback, mut controller) = (Voice::new("playback"), Voice::new("hover-controller"));
        let mut answers = Vec::new();
        let mut ask = |driver: &mut Driver<'_>, playback: &mut Voice, milliseconds: i64, round: u32| {
            let clock = ReplayClock {
                at: at(milliseconds),
                epoch: 1,
                tick: 9,
                round,
                answer: true,
                ..ReplayClock::default()
            };
            let datagram = playback.say(clock.at, &topics::REPLAY_CLOCK, &clock);
            let sink: &mut Sink<'_> = &mut |published| {
                if *published.topic == topics::REPLAY_ANSWER {
                    let answer: ReplayAnswer = wire::decode(published.body).unwrap();
                    answers.push((answer.tick, answer.round, answer.steps, ms(answer.due_at) - BEGIN_MS));
                }
            };
            driver.take(&datagram, sink).unwrap();
        };
        ask(driver, &mut playback, 0, 0);
        take(driver, &controller.command(5, 1));
        ask(driver, &mut playback, 40, 0);
        ask(driver, &mut playback, 40, 1);
        assert_eq!(answers, [(9, 0, 0, 20), (9, 0, 3, 60), (9, 1, 0, 60)]);
    });
}

#[test]
fn no_device_is_opened_in_a_replay() {
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let arena = Arena::load(&config, "double-flip").unwrap();
    let secret = Secret::new([7; 32]);
    let identity = identity("radio-bridge", Domain::Replay, RUN, 1);
    let mut node = Node::<Toy>::new(&arena, &secret, identity, Time::ZERO).unwrap();
    let setup = Setup { arena, secret, identity, started_at: Time::ZERO, supervised: false };
    let refused = crate::drive(&setup, &mut node).unwrap_err().to_string();
    assert!(refused.contains("radio-bridge") && refused.contains("replay"), "{refused}");
}
