//! CRSF against the `crsf` crate.
//!
//! It knows channels and link statistics. Its parser takes 64 bytes off its buffer for every frame, however
//! short, and so loses what follows; it therefore gets one frame at a time.

use crsf as oracle;
use device::crsf::{
    ADDRESS_HANDSET, ADDRESS_MODULE, ADDRESS_RECEIVER, FRAME_BYTES_MAX, Frame, LinkStatistics, SYNC,
};
use oracle::{PacketAddress, PacketParser};
use proptest::prelude::*;

use crate::random::Random;

const ADDRESSES: [(u8, PacketAddress); 4] = [
    (SYNC, PacketAddress::Controller),
    (ADDRESS_HANDSET, PacketAddress::Handset),
    (ADDRESS_RECEIVER, PacketAddress::Receiver),
    (ADDRESS_MODULE, PacketAddress::Transmitter),
];

fn encoded(frame: &Frame<'_>, sync: u8) -> Vec<u8> {
    let mut out = [0; FRAME_BYTES_MAX];
    let length = frame.encode(sync, &mut out).unwrap();
    out[..length].to_vec()
}

fn theirs(bytes: &[u8]) -> Option<(PacketAddress, Frame<'static>)> {
    let mut parser = PacketParser::<1024>::new();
    parser.push_bytes(bytes);
    let (address, packet) = parser.next_packet()?.ok()?;
    Some((address, convert(&packet)))
}

fn convert(packet: &oracle::Packet) -> Frame<'static> {
    match packet {
        oracle::Packet::RcChannels(channels) => Frame::Channels(channels.0),
        oracle::Packet::LinkStatistics(link) => Frame::LinkStatistics(LinkStatistics {
            uplink_rssi_1: link.uplink_rssi_1,
            uplink_rssi_2: link.uplink_rssi_2,
            uplink_quality_percent: link.uplink_link_quality,
            uplink_snr_db: link.uplink_snr,
            active_antenna: link.active_antenna,
            rate: link.rf_mode,
            uplink_power: link.uplink_tx_power,
            downlink_rssi: link.downlink_rssi,
            downlink_quality_percent: link.downlink_link_quality,
            downlink_snr_db: link.downlink_snr,
        }),
        other => panic!("the oracle has learned of {other:?}"),
    }
}

fn their_bytes(frame: &Frame<'_>, address: PacketAddress) -> Vec<u8> {
    let packet = match *frame {
        Frame::Channels(channels) => oracle::Packet::RcChannels(oracle::RcChannels(channels)),
        Frame::LinkStatistics(link) => oracle::Packet::LinkStatistics(oracle::LinkStatistics {
            uplink_rssi_1: link.uplink_rssi_1,
            uplink_rssi_2: link.uplink_rssi_2,
            uplink_link_quality: link.uplink_quality_percent,
            uplink_snr: link.uplink_snr_db,
            active_antenna: link.active_antenna,
            rf_mode: link.rate,
            uplink_tx_power: link.uplink_power,
            downlink_rssi: link.downlink_rssi,
            downlink_link_quality: link.downlink_quality_percent,
            downlink_snr: link.downlink_snr_db,
        }),
        other => panic!("the oracle does not know {other:?}"),
    };
    packet.into_raw(address).data().to_vec()
}

fn any_channels() -> impl Strategy<Value = Frame<'static>> {
    prop::array::uniform16(0u16..2048).prop_map(Frame::Channels)
}

fn any_statistics() -> impl Strategy<Value = Frame<'static>> {
    any::<([u8; 8], i8, i8)>().prop_map(|(bytes, uplink_snr_db, downlink_snr_db)| {
        let [uplink_rssi_1, uplink_rssi_2, uplink_quality_percent, active_antenna, rate, ..] = bytes;
        let [.., uplink_power, downlink_rssi, downlink_quality_percent] = bytes;
        Frame::LinkStatistics(LinkStatistics {
            uplink_rssi_1,
            uplink_rssi_2,
            uplink_quality_percent,
            uplink_snr_db,
            active_antenna,
            rate,
            uplink_power,
            downlink_rssi,
            downlink_quality_percent,
            downlink_snr_db,
        })
    })
}

proptest! {
    #[test]
    fn what_we_write_they_read_and_the_other_way_round(
        frame in prop_oneof![any_channels(), any_statistics()], address in 0usize..4,
    ) {
        let (sync, address) = ADDRESSES[address];
        let bytes = encoded(&frame, sync);
        prop_assert_eq!(theirs(&bytes), Some((address, frame)));
        let their_bytes = their_bytes(&frame, address);
        prop_assert_eq!(Frame::decode(&their_bytes), Ok(frame));
        prop_assert_eq!(their_bytes, bytes);
    }
}

#[test]
fn we_agree_on_which_damaged_frames_are_none() {
    let (mut random, mut agreed) = (Random::new(11), [0u32; 2]);
    for round in 0..20_000u16 {
        let channels = core::array::from_fn(|i| (random.next() >> i) as u16 & 0x7FF);
        let mut bytes = encoded(&Frame::Channels(channels), SYNC);
        for _ in 0..random.below(3) {
            // The length stays, since the oracle would wait for what does not come.
            let at = [0, 2 + random.below(24)][usize::from(random.below(8) > 0)];
            bytes[at] ^= 1 << random.below(8);
        }
        let ours = match Frame::decode(&bytes) {
            Ok(frame @ (Frame::Channels(_) | Frame::LinkStatistics(_))) => Some(frame),
            _ => None,
        };
        assert_eq!(ours, theirs(&bytes).map(|(_, frame)| frame), "round {round}: {bytes:02x?}");
        agreed[usize::from(ours.is_some())] += 1;
    }
    assert!(agreed.iter().all(|count| *count > 5_000), "{agreed:?}");
}
