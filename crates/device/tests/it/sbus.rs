//! SBUS against the `sbus-rs` crate, which reads it.

use device::sbus::{FRAME_BYTES, Frame, FrameFinder};
use proptest::prelude::*;
use sbus_rs::{SbusPacket, StreamingParser};

use crate::random::Random;

/// What they read, in our form.
fn theirs(packet: SbusPacket) -> Frame {
    Frame {
        channels: packet.channels,
        channel_17: packet.flags.d1,
        channel_18: packet.flags.d2,
        frame_lost: packet.flags.frame_lost,
        failsafe: packet.flags.failsafe,
    }
}

fn any_frame() -> impl Strategy<Value = Frame> {
    (prop::array::uniform16(0u16..2048), any::<[bool; 4]>()).prop_map(
        |(channels, [channel_17, channel_18, frame_lost, failsafe])| Frame {
            channels,
            channel_17,
            channel_18,
            frame_lost,
            failsafe,
        },
    )
}

proptest! {
    #[test]
    fn what_we_write_they_read(frame in any_frame()) {
        prop_assert_eq!(SbusPacket::from_array(&frame.encode()).map(theirs), Ok(frame));
    }

    #[test]
    fn a_line_of_frames_is_the_same_to_both(frames in prop::collection::vec(any_frame(), 1..9)) {
        let line: Vec<u8> = frames.iter().flat_map(Frame::encode).collect();
        let mut parser = StreamingParser::new();
        let read: Vec<Frame> =
            line.iter().filter_map(|byte| parser.push_byte(*byte).unwrap()).map(theirs).collect();
        prop_assert_eq!(read, frames);
    }
}

#[test]
fn we_read_any_bytes_as_they_do() {
    let (mut random, mut found) = (Random::new(41), 0);
    for _ in 0..20_000 {
        let mut bytes = [0; FRAME_BYTES];
        bytes.iter_mut().for_each(|byte| *byte = random.next() as u8);
        bytes[0] = [0x0F, 0x0F, 0xF0][random.below(3)];
        // They take SBUS 2's endings too; we take the plain one.
        bytes[24] = [0x00, 0x00, 0x01][random.below(3)];
        let ours = Frame::decode(&bytes).ok();
        assert_eq!(ours, SbusPacket::from_array(&bytes).ok().map(theirs), "{bytes:02x?}");
        let mut finder = FrameFinder::new();
        assert_eq!(bytes.iter().filter_map(|byte| finder.push(*byte)).next(), ours);
        found += u32::from(ours.is_some());
    }
    assert!((5_000..15_000).contains(&found), "{found}");
}
