//! The core, stepped directly, against small simulated vehicles on a link that loses frames.

use super::*;
use device::sbus;
use device::vehicle_link::{
    CommandFrame, FLIP_SET_LEN, FlightMode as LinkMode, ManeuverPhase as LinkPhase, Reason, Status, Uplink,
    UploadReply, UploadState, digest_of,
};
use device::xbee::{ApiMode, Decoder, Frame};
use quantity::{Rotation, Vector};
use schemas::{CommandMode, FlightMode, ManeuverPhase};
use service_core::Seed;
use std::path::Path;

mod fake;

use fake::Hall;

fn ms(milliseconds: i64) -> Time {
    Time::ZERO + Span::from_millis(milliseconds)
}

pub(crate) fn arena(scenario: &str) -> Arena {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    Arena::load(&folder, scenario).expect("the repository's own settings load")
}

fn bridge(scenario: &str) -> RadioBridge {
    let start = Start { at: ms(0), seed: Seed(7), incarnation: 1 };
    RadioBridge::new(&arena(scenario), Tuning::default(), start).expect("default tuning")
}

fn command(vehicle: u8, epoch: u32, now: Time) -> VehicleCommand {
    VehicleCommand {
        vehicle,
        mode: CommandMode::Fly,
        lease_epoch: epoch,
        valid_until: now + Span::from_millis(60),
        frame_received_at: now,
        collective_m_s2: 9.81,
        rate_rad_s: Vector::new(0.1, 0.2, 0.3),
        orientation: Rotation::IDENTITY,
        height_m: 2.0,
        vertical_speed_m_s: 0.0,
    }
}

fn start_order(maneuver_id: u16, valid_until: Time) -> ManeuverStart {
    let message = upload::tests::message(7);
    ManeuverStart { vehicle: 1, maneuver_id, set_id: 7, digest: message.digest, valid_until }
}

#[test]
fn commands_go_out_at_each_slot_and_silence_follows_the_last_one() {
    let mut hall = Hall::new("double-flip", 0.0);
    // Commands at 200 Hz until 1 s, not in step with the slots.
    hall.run(ms(1000), |hall, now| hall.give(now, command(1, 1, now)));
    let sent: Vec<Time> = hall.frames.iter().map(|(_, at, _)| *at).collect();
    assert_eq!(sent.len(), 50);
    assert!(sent.iter().zip(0..).all(|(at, slot)| *at == ms(20 * slot)));
    let reports = hall.sent.clone();
    assert!(reports.iter().zip(0..).all(|(report, slot)| {
        (report.slot, report.sent_at, report.next_slot_at)
            == (slot, ms(20 * slot as i64), ms(20 * slot as i64 + 20))
    }));
    hall.run(ms(3000), |_, _| {});
    // The last command came at 995 ms and is valid for 60 ms.
    assert_eq!(hall.frames.last().map(|(_, at, _)| *at), Some(ms(1040)));
    assert_eq!(hall.events_named("command-silent"), [ms(1060)]);
    hall.run(ms(3100), |hall, now| hall.give(now, command(1, 1, now)));
    assert_eq!(hall.events_named("command-sending"), [ms(0), ms(3000)]);
}

#[test]
fn each_vehicle_has_its_own_encoder_and_its_own_silence() {
    let mut hall = Hall::new("fleet", 0.0);
    hall.run(ms(200), |hall, now| {
        hall.give(now, command(1, 1, now));
        if now < ms(100) {
            hall.give(now, command(3, 1, now));
        }
    });
    let count = |vehicle| hall.frames.iter().filter(|(to, _, _)| *to == vehicle).count();
    assert_eq!((count(1), count(2)), (10, 0));
    assert!((5..=8).contains(&count(3)));
    for (vehicle, _, channels) in &hall.frames {
        assert_eq!(CommandFrame::decode(channels).map(|(to, _)| to), Ok(*vehicle));
    }
}

#[test]
fn an_older_epoch_is_never_heard_again_and_reported_if_it_goes_on() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.run(ms(100), |hall, now| hall.give(now, command(1, 4, now)));
    // A new controller takes over at once; the old one, paused, wakes and goes on.
    hall.run(ms(3100), |hall, now| {
        hall.give(now, command(1, 5, now));
        hall.give(now, command(1, 4, now));
    });
    assert!(
        hall.sent.iter().all(|report| report.lease_epoch == if report.sent_at < ms(100) { 4 } else { 5 })
    );
    assert_eq!(hall.events_named("lease-taken"), [ms(0), ms(100)]);
    assert_eq!(hall.events_named("lease-conflict").len(), 3, "once a second");
    assert_eq!(hall.bridge.counters().commands_refused, 600);
    // The new one dies: its place stays empty rather than go to the old one.
    hall.run(ms(4000), |hall, now| hall.give(now, command(1, 4, now)));
    assert_eq!(hall.sent.last().map(|report| report.sent_at), Some(ms(3140)));
}

#[test]
fn commands_of_the_instant_of_a_slot_are_in_time_for_it() {
    let (mut bridge, mut out) = (bridge("fleet"), Outbox::default());
    for vehicle in [1, 2, 3] {
        bridge.step(ms(0), Event::Input(Input::Command(command(vehicle, 1, ms(0)))), &mut out);
    }
    bridge.step(ms(0), Event::Deadline, &mut out);
    let sent = out.take_messages().filter(|message| matches!(message, Output::Sent(_))).count();
    assert_eq!(sent, 3);
}

#[test]
fn a_late_driver_skips_to_the_current_slot() {
    let (mut bridge, mut out) = (bridge("double-flip"), Outbox::default());
    let mut sent_at = |at: Time| {
        bridge.step(at, Event::Input(Input::Command(command(1, 1, at))), &mut out);
        bridge.step(at, Event::Deadline, &mut out);
        let sent = out.take_messages().filter(|message| matches!(message, Output::Sent(_))).count();
        (sent, bridge.counters().slots_missed)
    };
    assert_eq!(sent_at(ms(0)), (1, 0));
    assert_eq!(sent_at(ms(103)), (1, 4));
    assert_eq!(sent_at(ms(139)), (0, 5), "too late in its slot: left out");
    assert_eq!(sent_at(ms(140)), (1, 5));
}

#[test]
fn uploads_arrive_over_a_link_that_loses_a_third() {
    let mut rounds = Vec::new();
    for seed in 1..=100 {
        let mut hall = Hall::seeded("double-flip", 0.3, seed);
        hall.run(ms(200), |_, _| {});
        hall.input(ms(200), Input::Upload(upload::tests::message(7)));
        hall.run(ms(2300), |_, _| {});
        let digest = upload::tests::message(7).digest;
        assert_eq!(hall.vehicles[0].active(), Some((7, digest)), "seed {seed}");
        assert_eq!(hall.events_named("upload-failed"), []);
        let committed = hall.events_named("upload-committed");
        assert_eq!(committed.len(), 1, "seed {seed}");
        rounds.push((committed[0] - ms(200)).as_nanos() / 1_000_000);
    }
    rounds.sort_unstable();
    assert!(rounds[50] < 160, "median {} ms", rounds[50]);
    assert!(rounds[99] < 1000, "slowest {} ms", rounds[99]);
}

#[test]
fn a_set_the_vehicle_has_is_not_sent_again_and_a_new_one_replaces_one_on_its_way() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.run(ms(100), |_, _| {});
    hall.input(ms(100), Input::Upload(upload::tests::message(7)));
    hall.input(ms(101), Input::Upload(upload::tests::message(8)));
    hall.run(ms(420), |_, _| {});
    assert_eq!(hall.vehicles[0].active().map(|set| set.0), Some(8));
    let before = hall.bridge.counters().payloads_sent;
    hall.input(ms(420), Input::Upload(upload::tests::message(8)));
    assert_eq!(hall.bridge.counters().payloads_sent, before);
    assert_eq!(hall.events_named("upload-committed").len(), 1);
}

#[test]
fn an_upload_nobody_answers_ends_after_two_seconds() {
    let mut hall = Hall::new("double-flip", 1.0);
    hall.input(ms(100), Input::Upload(upload::tests::message(7)));
    hall.run(ms(5000), |_, _| {});
    assert_eq!(hall.events_named("upload-failed"), [ms(2100)]);
    let wrong = ManeuverUpload { digest: 1, ..upload::tests::message(7) };
    hall.input(ms(5001), Input::Upload(wrong));
    assert_eq!(hall.events_named("upload-digest-mismatch"), [ms(5001)]);
}

#[test]
fn a_start_is_repeated_until_the_vehicle_has_it() {
    for seed in 1..=30 {
        let mut hall = Hall::seeded("double-flip", 0.3, seed);
        hall.run(ms(100), |_, _| {});
        hall.input(ms(100), Input::Start(start_order(41, ms(600))));
        hall.run(ms(1500), |_, _| {});
        assert_eq!(hall.vehicles[0].started(), [41], "seed {seed}");
        let starts = hall.vehicles[0].starts_heard;
        hall.input(ms(1501), Input::Start(start_order(41, ms(1900))));
        hall.run(ms(1800), |_, _| {});
        assert_eq!(hall.vehicles[0].starts_heard, starts, "answered is answered");
        let began = hall.telemetry.last().map(|report| (report.maneuver_phase, report.maneuver_id));
        assert_eq!(began, Some((ManeuverPhase::Running, 41)));
    }
}

#[test]
fn no_start_arrives_after_its_validity() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.vehicles[0].deaf_to_starts = true;
    hall.run(ms(2000), |_, _| {});
    hall.input(ms(2000), Input::Start(start_order(41, ms(2200))));
    hall.run(ms(4000), |_, _| {});
    let arrived = &hall.vehicles[0].start_arrivals;
    assert!(arrived.len() >= 6, "every 30 ms");
    assert!(arrived.iter().all(|at| *at <= ms(2202)), "{arrived:?}");
    assert_eq!(hall.events_named("start-unanswered").len(), 1);
}

#[test]
fn an_abort_is_sent_five_times_and_takes_the_start_back() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.vehicles[0].deaf_to_starts = true;
    hall.run(ms(1000), |_, _| {});
    hall.input(ms(1000), Input::Start(start_order(41, ms(2000))));
    hall.input(ms(1001), Input::Abort(ManeuverAbort { vehicle: 1, maneuver_id: 41 }));
    hall.input(ms(1050), Input::Start(start_order(41, ms(2000))));
    hall.run(ms(2500), |_, _| {});
    assert_eq!(hall.vehicles[0].start_arrivals.len(), 1);
    assert_eq!(hall.vehicles[0].aborts_heard, 5);
}

#[test]
fn telemetry_is_on_the_arenas_clock() {
    let mut hall = Hall::new("double-flip", 0.02);
    hall.run(ms(3000), |_, _| {});
    hall.input(ms(3000), Input::Start(start_order(9, ms(3400))));
    hall.run(ms(6000), |_, _| {});
    let report = hall.telemetry.last().copied().expect("reports");
    let began = hall.vehicles[0].began.expect("begun");
    assert!((report.began_at - began).abs() < Span::from_micros(500), "{} {began}", report.began_at);
    assert_eq!((report.ended_at, report.mode, report.set_id), (Time::ZERO, FlightMode::Maneuver, 0));
    assert!((report.battery_v - 11.5).abs() < 1e-9);
    assert!((0.008..0.011).contains(&report.clock_uncertainty_s), "{}", report.clock_uncertainty_s);
    assert!(report.received_at > ms(5900));
}

#[test]
fn the_command_links_delay_is_measured() {
    let mut hall = Hall::new("double-flip", 0.02);
    let setting_s = 0.018;
    hall.vehicles[0].command_delay = Span::from_micros(26_300);
    hall.run(ms(100), |hall, now| hall.give(now, command(1, 1, now)));
    assert_eq!(hall.sent.last().map(|report| report.link_delay_s), Some(setting_s));
    hall.run(ms(15_000), |hall, now| hall.give(now, command(1, 1, now)));
    let delay_s = hall.sent.last().expect("sent").link_delay_s;
    // Half a tick of the vehicle's loop on top.
    assert!((delay_s - 0.026_925).abs() < 5e-4, "{delay_s}");
    assert_eq!(hall.telemetry.last().map(|report| report.link_delay_s), Some(delay_s));
}

#[test]
fn stale_matches_do_not_spoil_the_delay() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.vehicles[0].command_delay = Span::from_micros(18_000);
    for round in 0..40 {
        // The vehicle hears nothing for 1.2 s of every 2 s, and goes on reporting its last counter.
        hall.vehicles[0].deaf_to_commands = round % 5 >= 2;
        hall.run(ms(400 * (round + 1)), |hall, now| hall.give(now, command(1, 1, now)));
    }
    let delay_s = hall.sent.last().expect("sent").link_delay_s;
    assert!((delay_s - 0.018_625).abs() < 5e-4, "{delay_s}");
}

#[test]
fn lost_telemetry_and_a_restarted_vehicle_are_reported() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.run(ms(2000), |_, _| {});
    hall.loss_ratio = 1.0;
    hall.run(ms(5000), |_, _| {});
    assert_eq!(hall.events_named("telemetry-lost").len(), 1);
    hall.loss_ratio = 0.0;
    hall.run(ms(6000), |_, _| {});
    assert_eq!(hall.events_named("telemetry-back").len(), 1);
    hall.vehicles[0].reboot(ms(6000));
    hall.run(ms(8000), |_, _| {});
    assert_eq!(hall.events_named("vehicle-restarted").len(), 1);
    let reports = hall.telemetry.iter().filter(|report| report.received_at > ms(7000)).count();
    assert!(reports >= 19, "reports go on: {reports}");
    let newest = hall.telemetry.last().expect("some");
    assert!(newest.clock_uncertainty_s < 0.01);
}

#[test]
fn payloads_of_the_wrong_vehicle_are_refused() {
    let mut hall = Hall::new("fleet", 0.0);
    hall.vehicles[0].address = 0x5002;
    hall.vehicles[1].address = 0x5001;
    hall.vehicles[2].address = 0x7777;
    hall.run(ms(1000), |_, _| {});
    assert!(hall.telemetry.is_empty());
    assert!(!hall.events_named("vehicle-address-mismatch").is_empty());
    assert!(!hall.events_named("radio-unknown").is_empty());
}

#[test]
fn any_bytes_from_the_radio_are_survived() {
    let mut hall = Hall::new("double-flip", 0.0);
    hall.run(ms(500), |_, _| {});
    let mut state = 1u64;
    for step in 0..3000i64 {
        let mut bytes = [0u8; 40];
        for byte in &mut bytes {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *byte = if state >> 61 == 0 { 0x7E } else { (state >> 40) as u8 };
        }
        hall.bytes_from_radio(ms(500 + step), &bytes);
    }
    assert!(hall.bridge.counters().bytes_skipped > 10_000);
    hall.run(ms(5000), |_, _| {});
    assert!(hall.telemetry.last().is_some_and(|report| report.received_at > ms(4900)));
}

#[test]
fn the_same_inputs_give_the_same_outputs() {
    let run = || {
        let mut hall = Hall::seeded("fleet", 0.2, 5);
        hall.run(ms(3000), |hall, now| hall.give(now, command(2, 1, now)));
        (hall.transcript.clone(), hall.sent.clone(), hall.telemetry.clone())
    };
    assert!(run() == run());
}

#[test]
fn impossible_settings_are_refused() {
    let start = Start { at: ms(0), seed: Seed(7), incarnation: 1 };
    let tuning = Tuning { slot_s: f64::NAN, ..Tuning::default() };
    assert!(matches!(RadioBridge::new(&arena("fleet"), tuning, start), Err(ConfigError::OutOfRange { .. })));
}

#[test]
fn messages_for_unknown_vehicles_are_reported_and_dropped() {
    let mut hall = Hall::new("double-flip", 0.0);
    for now in (0..500).map(ms) {
        hall.give(now, command(77, 1, now));
    }
    assert!(hall.frames.is_empty());
    assert_eq!(hall.events_named("vehicle-unknown").len(), 1);
    assert_eq!(hall.bridge.counters().foreign, 500);
}

#[test]
fn a_crsf_module_that_hears_half_of_its_vehicle_is_reported_of_that_vehicle() {
    let mut bridge = bridge("fleet");
    let mut out = Outbox::default();
    let mut line = [0; device::crsf::FRAME_BYTES_MAX];
    for (at, quality) in [(100, 100), (200, 50), (300, 49)] {
        let statistics =
            device::crsf::LinkStatistics { uplink_quality_percent: quality, ..Default::default() };
        let frame = device::crsf::Frame::LinkStatistics(statistics);
        let length = frame.encode(device::crsf::ADDRESS_HANDSET, &mut line).expect("fits");
        // A serial line cuts where it likes.
        for piece in line[..length].chunks(5) {
            let bytes = piece.try_into().expect("fits");
            let received = DeviceBytes { port: Ports::command_link(2), at: ms(at), bytes };
            bridge.step(ms(at), Event::Input(Input::Received(received)), &mut out);
        }
    }
    let weak: Vec<_> =
        out.events().iter().filter(|event| event.name.as_str() == "command-link-weak").collect();
    assert_eq!(weak.len(), 1);
    assert_eq!((weak[0].vehicle, weak[0].at), (2, ms(300)));
    assert_eq!(bridge.counters().foreign, 0);
}
