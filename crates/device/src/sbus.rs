//! SBUS, the serial protocol of hobby receivers: sixteen channels of eleven bits in 25 bytes.
//!
//! `0F`, the channels packed least significant bit first, flags, `00`; 100 000 baud, 8E2, inverted, so 3 ms a
//! frame. 192, 992 and 1792 stand for pulses of 1000, 1500 and 2000 µs. There is no checksum: what must not
//! be misunderstood brings its own, as [`vehicle_link`](crate::vehicle_link) does.

use core::fmt;

use crate::channels::{self, PACKED_BYTES};

/// Bytes of a frame.
pub const FRAME_BYTES: usize = 25;

const HEADER: u8 = 0x0F;
const FOOTER: u8 = 0x00;
const FLAG_CHANNEL_17: u8 = 1;
const FLAG_CHANNEL_18: u8 = 2;
const FLAG_FRAME_LOST: u8 = 4;
const FLAG_FAILSAFE: u8 = 8;

/// One frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// The channels, each 0 to 2047.
    pub channels: [u16; 16],
    /// The first two-state channel.
    pub channel_17: bool,
    /// The second two-state channel.
    pub channel_18: bool,
    /// The receiver lost a frame of its radio: these channels are repeated.
    pub frame_lost: bool,
    /// The receiver has given up its radio: these channels are its preset, not anybody's command.
    pub failsafe: bool,
}

impl Frame {
    /// A frame of these channels, no flag set.
    #[must_use]
    pub fn new(channels: [u16; 16]) -> Self {
        Self { channels, ..Self::default() }
    }

    /// The bytes of the frame. Of each channel the lower eleven bits are sent.
    #[must_use]
    pub fn encode(&self) -> [u8; FRAME_BYTES] {
        let mut out = [0; FRAME_BYTES];
        out[0] = HEADER;
        out[1..=PACKED_BYTES].copy_from_slice(&channels::pack(&self.channels));
        let flags = [
            (self.channel_17, FLAG_CHANNEL_17),
            (self.channel_18, FLAG_CHANNEL_18),
            (self.frame_lost, FLAG_FRAME_LOST),
            (self.failsafe, FLAG_FAILSAFE),
        ];
        out[23] = flags.iter().filter(|(set, _)| *set).fold(0, |all, (_, flag)| all | flag);
        out[24] = FOOTER;
        out
    }

    /// The frame these bytes are.
    ///
    /// # Errors
    /// [`NotAFrame`] where the first or the last byte is not what every frame has there.
    pub fn decode(bytes: &[u8; FRAME_BYTES]) -> Result<Self, NotAFrame> {
        let [HEADER, packed @ .., flags, FOOTER] = bytes else {
            return Err(NotAFrame { first: bytes[0], last: bytes[24] });
        };
        Ok(Self {
            channels: channels::unpack(packed),
            channel_17: flags & FLAG_CHANNEL_17 != 0,
            channel_18: flags & FLAG_CHANNEL_18 != 0,
            frame_lost: flags & FLAG_FRAME_LOST != 0,
            failsafe: flags & FLAG_FAILSAFE != 0,
        })
    }
}

/// Twenty-five bytes that do not begin and end like a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotAFrame {
    /// The first byte, which should be `0F`.
    pub first: u8,
    /// The last byte, which should be `00`.
    pub last: u8,
}

impl fmt::Display for NotAFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "not an SBUS frame: begins {:02X} (0F), ends {:02X} (00)", self.first, self.last)
    }
}

impl core::error::Error for NotAFrame {}

/// Finds frames in a stream of bytes.
///
/// `0F` and `00` occur inside frames too, so a finder that joined in the middle of one may at first cut
/// frames wrongly. It recovers as soon as a cut does not end in `00`, and for certain at the next silence on
/// the line, which the owner of the clock reports by [`gap`](Self::gap): frames last 3 ms and start at least
/// 6 ms apart.
#[derive(Clone, Debug, Default)]
pub struct FrameFinder {
    buffer: [u8; FRAME_BYTES],
    length: usize,
    skipped_bytes: u64,
}

impl FrameFinder {
    /// A finder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The next byte of the line; a frame where it completes one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        if self.length == 0 && byte != HEADER {
            self.skipped_bytes += 1;
            return None;
        }
        self.buffer[self.length] = byte;
        self.length += 1;
        if self.length < FRAME_BYTES {
            return None;
        }
        match Frame::decode(&self.buffer) {
            Ok(frame) => {
                self.length = 0;
                Some(frame)
            }
            Err(_) => {
                self.restart_at_next_header();
                None
            }
        }
    }

    /// The line was silent for longer than between two bytes of a frame: what comes next begins one.
    pub fn gap(&mut self) {
        self.skipped_bytes += self.length as u64;
        self.length = 0;
    }

    /// Bytes that were part of no frame.
    #[must_use]
    pub const fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    fn restart_at_next_header(&mut self) {
        let next = self.buffer[1..].iter().position(|byte| *byte == HEADER).map_or(FRAME_BYTES, |at| at + 1);
        self.buffer.copy_within(next.., 0);
        self.length = FRAME_BYTES - next;
        self.skipped_bytes += next as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;
    use std::vec::Vec;

    const GOLDEN: &str = "0fc0001fc0c1073ef0810f7ce0031ff8c0073ef0810f7c0000";

    fn golden() -> (Frame, [u8; FRAME_BYTES]) {
        let mut channels = [992; 16];
        (channels[0], channels[2]) = (192, 1792);
        (Frame::new(channels), from_hex(GOLDEN).try_into().unwrap())
    }

    #[test]
    fn golden_frame_both_ways() {
        let (frame, bytes) = golden();
        assert_eq!(frame.encode(), bytes);
        assert_eq!(Frame::decode(&bytes), Ok(frame));
    }

    #[test]
    fn each_flag_has_its_bit() {
        let (frame, bytes) = golden();
        for (flag, flagged) in [
            (1, Frame { channel_17: true, ..frame }),
            (2, Frame { channel_18: true, ..frame }),
            (4, Frame { frame_lost: true, ..frame }),
            (8, Frame { failsafe: true, ..frame }),
        ] {
            let mut expected = bytes;
            expected[23] = flag;
            assert_eq!(flagged.encode(), expected);
            assert_eq!(Frame::decode(&expected), Ok(flagged));
        }
    }

    #[test]
    fn a_frame_is_found_after_rubbish_and_half_a_frame() {
        let (frame, bytes) = golden();
        let mut finder = FrameFinder::new();
        let stream = [&[0x55, 0x00][..], &bytes[11..], &bytes, &bytes].concat();
        let found: Vec<Frame> = stream.iter().filter_map(|byte| finder.push(*byte)).collect();
        assert_eq!(found.last(), Some(&frame));

        let mut finder = FrameFinder::new();
        bytes[..9].iter().for_each(|byte| assert_eq!(finder.push(*byte), None));
        finder.gap();
        assert_eq!(bytes.iter().filter_map(|byte| finder.push(*byte)).next(), Some(frame));
        assert_eq!(finder.skipped_bytes(), 9);
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
        fn round_trip(frame in any_frame()) {
            prop_assert_eq!(Frame::decode(&frame.encode()), Ok(frame));
        }

        #[test]
        fn a_stream_of_frames_is_found_whole(frames in prop::collection::vec(any_frame(), 1..8)) {
            let mut finder = FrameFinder::new();
            let bytes: Vec<u8> = frames.iter().flat_map(Frame::encode).collect();
            let found: Vec<Frame> = bytes.iter().filter_map(|byte| finder.push(*byte)).collect();
            prop_assert_eq!(found, frames);
        }

        #[test]
        fn any_bytes_are_swallowed_and_after_a_gap_a_frame_is_found(
            noise in prop::collection::vec(any::<u8>(), 0..200), frame in any_frame(),
        ) {
            let mut finder = FrameFinder::new();
            let found = noise.iter().filter_map(|byte| finder.push(*byte)).count() as u64;
            finder.gap();
            prop_assert_eq!(finder.skipped_bytes() + found * FRAME_BYTES as u64, noise.len() as u64);
            let after: Vec<Frame> = frame.encode().iter().filter_map(|byte| finder.push(*byte)).collect();
            prop_assert_eq!(after, [frame]);
        }
    }
}
