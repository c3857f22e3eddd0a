//! The worked examples of `docs/hardware.md`: each is what its title says, and each message has one.

use std::collections::BTreeMap;

use device::vehicle_link::{
    ChannelMap, CommandFrame, CommandMode, Downlink, FlightMode, FlipSet, Items, ManeuverPhase, Reason,
    Status, StatusFlags, Uplink, UploadReply, UploadState,
};
use device::xbee::{self, ApiMode};
use device::{crsf, sbus};
use quantity::Vector;

const PAGE: &str = include_str!("../../../../docs/hardware.md");
const DIGEST: u64 = 0x1122_3344_5566_7788;

/// The page's examples by the first word of their titles.
fn examples() -> BTreeMap<String, Vec<u8>> {
    let mut examples = BTreeMap::new();
    for block in PAGE.split("\n```hex ").skip(1) {
        let (title, rest) = block.split_once('\n').unwrap();
        let name = title.split([' ', ':', ',']).next().unwrap().to_owned();
        let digits: String = rest.split("```").next().unwrap().split_whitespace().collect();
        let bytes = (0..digits.len()).step_by(2);
        let bytes = bytes.map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect();
        assert_eq!(examples.insert(name, bytes), None, "two of {title}");
    }
    examples
}

fn command(counter: u8) -> CommandFrame {
    CommandFrame {
        mode: CommandMode::Fly,
        counter,
        collective_m_s2: 9.81,
        rate_rad_s: Vector::new(1.0, -2.1, 0.5),
        attitude_valid: true,
        height_valid: true,
        roll_rad: 0.1,
        pitch_rad: -0.2,
        height_m: 4.0,
        vertical_speed_m_s: -0.3,
        epoch_low: 7,
    }
}

fn module_frame(channels: [u16; 16]) -> Vec<u8> {
    let mut bytes = [0; crsf::FRAME_BYTES_MAX];
    let length = crsf::Frame::Channels(channels).encode(crsf::ADDRESS_MODULE, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

fn uplink(message: &Uplink) -> Vec<u8> {
    let mut bytes = [0; 100];
    let length = message.encode(3, &mut bytes).unwrap();
    assert_eq!(Uplink::decode(&bytes[..length]), Ok((3, *message)));
    bytes[..length].to_vec()
}

fn downlink(message: &Downlink) -> Vec<u8> {
    let mut bytes = [0; 100];
    let length = message.encode(3, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

fn status() -> Status {
    Status {
        uptime_us: 12_345_678,
        mode: FlightMode::LevelHold,
        battery_mv: 11_100,
        set_id: 513,
        set_digest: DIGEST,
        maneuver_id: 7,
        maneuver_phase: ManeuverPhase::Aborted,
        reason: Reason::AbortOrdered,
        began_us: 9_000_000,
        ended_us: 9_500_000,
        command_age_ms: 101,
        command_counter: 31,
        command_received_us: 12_244_678,
        flags: StatusFlags::EMERGENCY_STOP.with(StatusFlags::ATTITUDE_KNOWN).with(StatusFlags::COMMAND_STALE),
    }
}

/// The paper's double flip.
fn double_flip() -> FlipSet {
    FlipSet {
        u1_m_s2: 20.39544,
        t1_s: 0.16092,
        t3_s: 0.27833,
        u5_m_s2: 20.30911,
        t5_s: 0.18268,
        rate_rad_s_max: 27.925268,
        envelope_low_m_s2: 3.589744,
        envelope_high_m_s2: 21.025_64,
        lever_m: 0.057818,
        flips: 2.0,
    }
}

fn xbee_ping() -> Vec<u8> {
    let data = uplink(&Uplink::Ping { token: 0x7E13 });
    let frame = xbee::Frame::Transmit16 { frame_id: 1, destination: 0x5001, options: 0, data: &data };
    let mut line = [0; 64];
    let length = frame.encode(ApiMode::Escaped, &mut line).unwrap();
    line[..length].to_vec()
}

#[test]
fn every_example_is_what_its_title_says_and_every_message_has_one() {
    let full = command(19).encode(3).unwrap();
    let compact = ChannelMap::Compact.encode(&command(18), 3).unwrap();
    let [_, items, commit] = Uplink::upload(513, &double_flip());
    let reply = UploadReply {
        set_id: 513,
        state: UploadState::Refused,
        received_mask: 0x3FF,
        digest: DIGEST,
        reason: Reason::DigestMismatch,
    };
    let expected = [
        ("sbus-full", sbus::Frame::new(full).encode().to_vec()),
        ("crsf-full", module_frame(full)),
        ("crsf-compact", module_frame(compact)),
        ("begin-ten-items", uplink(&Uplink::Begin { set_id: 513, count: 10, digest: DIGEST })),
        ("items-from-index-4", uplink(&Uplink::Items(Items::new(513, 4, &[0.5, -2.0]).unwrap()))),
        ("commit", uplink(&Uplink::Commit { set_id: 513, digest: DIGEST })),
        ("start", uplink(&Uplink::Start { maneuver_id: 7, set_id: 513, digest: DIGEST })),
        ("abort", uplink(&Uplink::Abort { maneuver_id: 7 })),
        ("ping", uplink(&Uplink::Ping { token: 0xBEEF })),
        ("stop", uplink(&Uplink::Stop)),
        ("rearm", uplink(&Uplink::Rearm)),
        ("status", downlink(&Downlink::Status(status()))),
        ("pong", downlink(&Downlink::Pong { token: 0xBEEF, received_us: 12_000_000, turnaround_us: 1_250 })),
        ("upload-reply", downlink(&Downlink::UploadReply(reply))),
        ("xbee-ping", xbee_ping()),
        ("double-flip-items", uplink(&items)),
        ("double-flip-commit", uplink(&commit)),
    ];
    let expected: BTreeMap<String, Vec<u8>> =
        expected.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).collect();
    assert_eq!(examples(), expected);
}

/// The numbers as the page writes them.
fn listed(channels: &[u16]) -> String {
    channels.iter().map(u16::to_string).collect::<Vec<_>>().join(", ")
}

#[test]
fn channels_and_digest_are_spelt_out_as_they_are() {
    let text: String = PAGE.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(text.contains(&listed(&command(19).encode(3).unwrap())));
    let compact = ChannelMap::Compact.encode(&command(18), 3).unwrap();
    assert!(text.contains(&format!("{}, then 992", listed(&compact[..9]))));
    assert!(text.contains(&format!("its digest is {:016x}", double_flip().digest())));
}

#[test]
fn every_reason_stands_on_the_page_with_its_number() {
    let text: String = PAGE.split_whitespace().collect::<Vec<_>>().join(" ");
    let list = text.split("Reasons: ").nth(1).unwrap().split(" (hexadecimal)").next().unwrap();
    let numbers: Vec<u8> = list
        .split([',', ';'])
        .map(|entry| u8::from_str_radix(entry.trim().split(' ').next().unwrap(), 16).unwrap())
        .collect();
    let known: Vec<u8> = (0..=u8::MAX).filter(|byte| Reason::from_byte(*byte).is_ok()).collect();
    assert_eq!(numbers, known);
}
