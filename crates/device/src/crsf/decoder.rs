//! Finding frames in the bytes of a serial line.

use super::{CrsfError, FRAME_BYTES_MAX, Frame, LENGTH_MAX, LENGTH_MIN, is_sync};

/// What was found wrong on the line so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderErrors {
    /// Frames whose check did not come out.
    pub checksum: u64,
    /// Lengths that no frame has.
    pub length: u64,
    /// Frames whose payload was too short for their type.
    pub payload: u64,
    /// Frames cut short by silence.
    pub cut: u64,
    /// Bytes outside any frame.
    pub skipped_bytes: u64,
}

/// Finds the frames of one serial line.
///
/// What begins like a frame and turns out to be none is looked through for the next beginning, so that a
/// false start costs no true frame. It may delay one, until as many bytes have come as the false start
/// announced; the owner of the clock ends that wait with [`gap`](Self::gap) once the line has been silent for
/// longer than between two bytes.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; FRAME_BYTES_MAX],
    length: usize,
    errors: DecoderErrors,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder that has seen nothing.
    #[must_use]
    pub const fn new() -> Self {
        let errors = DecoderErrors { checksum: 0, length: 0, payload: 0, cut: 0, skipped_bytes: 0 };
        Self { buffer: [0; FRAME_BYTES_MAX], length: 0, errors }
    }

    /// What was found wrong so far.
    #[must_use]
    pub const fn errors(&self) -> DecoderErrors {
        self.errors
    }

    /// The next bytes of the line, any number; `on_frame` gets each frame they complete.
    pub fn receive(&mut self, bytes: &[u8], mut on_frame: impl FnMut(Frame<'_>)) {
        for byte in bytes {
            self.push(*byte, &mut on_frame);
        }
    }

    /// The next byte of the line. It may complete more than one frame: after a false start, frames found
    /// within it.
    pub fn push(&mut self, byte: u8, mut on_frame: impl FnMut(Frame<'_>)) {
        if self.length == 0 && !is_sync(byte) {
            self.errors.skipped_bytes += 1;
            return;
        }
        // A full buffer is a whole frame of the greatest length, and has been judged.
        self.buffer[self.length] = byte;
        self.length += 1;
        while let Some(used) = self.judge(&mut on_frame) {
            self.drop_to_sync(used);
        }
    }

    /// The line was silent for longer than between two bytes of a frame: what has not come will not. Frames
    /// within what turns out to have been a false start still come out.
    pub fn gap(&mut self, mut on_frame: impl FnMut(Frame<'_>)) {
        while self.length > 0 {
            match self.judge(&mut on_frame) {
                Some(used) => self.drop_to_sync(used),
                None => {
                    self.errors.cut += 1;
                    self.refuse();
                }
            }
        }
    }

    /// Whether the buffer holds a frame, or cannot become one: answers how many bytes are done with.
    fn judge(&mut self, on_frame: &mut impl FnMut(Frame<'_>)) -> Option<usize> {
        let [_, length, rest @ ..] = &self.buffer[..self.length] else {
            return None;
        };
        let wanted = usize::from(*length);
        if !(LENGTH_MIN..=LENGTH_MAX).contains(&wanted) {
            self.errors.length += 1;
            self.errors.skipped_bytes += 1;
            return Some(1);
        }
        rest.get(..wanted)?;
        match Frame::decode(&self.buffer[..wanted + 2]) {
            Ok(frame) => on_frame(frame),
            // It was a frame all right.
            Err(CrsfError::Payload { .. }) => self.errors.payload += 1,
            Err(_) => {
                self.errors.checksum += 1;
                self.errors.skipped_bytes += 1;
                return Some(1);
            }
        }
        Some(wanted + 2)
    }

    /// Gives up what the buffer begins with.
    fn refuse(&mut self) {
        self.errors.skipped_bytes += 1;
        self.drop_to_sync(1);
    }

    /// Forgets the first `used` bytes and what follows them up to the next beginning.
    fn drop_to_sync(&mut self, used: usize) {
        let rest = &self.buffer[used..self.length];
        let skipped = rest.iter().position(|byte| is_sync(*byte)).unwrap_or(rest.len());
        self.errors.skipped_bytes += skipped as u64;
        let from = used + skipped;
        self.buffer.copy_within(from..self.length, 0);
        self.length -= from;
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ADDRESS_HANDSET, ADDRESS_MODULE, LinkStatistics, SYNC};
    use super::*;
    use proptest::prelude::*;
    use std::string::String;
    use std::vec::Vec;

    /// A frame in a form that can be kept and compared.
    fn describe(frame: Frame<'_>) -> String {
        std::format!("{frame:?}")
    }

    fn encoded(frame: &Frame<'_>, sync: u8) -> Vec<u8> {
        let mut out = [0; FRAME_BYTES_MAX];
        let length = frame.encode(sync, &mut out).unwrap();
        out[..length].to_vec()
    }

    fn channels(n: u16) -> Frame<'static> {
        Frame::Channels(core::array::from_fn(|i| (n * 131 + i as u16 * 97) & 0x7FF))
    }

    #[test]
    fn frames_of_every_kind_follow_each_other() {
        let frames = [
            channels(1),
            Frame::LinkStatistics(LinkStatistics { uplink_quality_percent: 100, ..Default::default() }),
            Frame::Other { kind: 0x21, payload: b"ACRO\0" },
            Frame::Other { kind: 0xAA, payload: &[0xC8; 60] },
            Frame::Other { kind: 0x28, payload: &[] },
        ];
        let mut decoder = Decoder::new();
        let mut found = Vec::new();
        for (frame, sync) in frames.iter().zip([SYNC, ADDRESS_HANDSET, ADDRESS_MODULE, SYNC, 0xEC]) {
            decoder.receive(&encoded(frame, sync), |frame| found.push(describe(frame)));
        }
        assert_eq!(found, frames.map(describe));
        assert_eq!(decoder.errors(), DecoderErrors::default());
    }

    #[test]
    fn errors_are_counted_and_the_next_frame_is_found() {
        let good = encoded(&channels(2), SYNC);
        let mut wrong = good.clone();
        wrong[20] ^= 1;
        let short = encoded(&Frame::Other { kind: 0x16, payload: &[1, 2, 3] }, SYNC);
        let line = [&[0x00, 0x55, SYNC, 0][..], &wrong, &short, &good].concat();
        let (mut decoder, mut found) = (Decoder::new(), Vec::new());
        decoder.receive(&line, |frame| found.push(describe(frame)));
        decoder.gap(|frame| found.push(describe(frame)));
        assert_eq!(found, [describe(channels(2))]);
        let errors = decoder.errors();
        assert_eq!((errors.length, errors.checksum, errors.payload), (1, 1, 1));
        assert_eq!(errors.skipped_bytes, 4 + 26);
    }

    #[test]
    fn a_false_start_costs_no_frame_and_a_gap_ends_the_wait_for_it() {
        let good = encoded(&channels(3), SYNC);
        // Says that 62 bytes follow.
        let line = [&[SYNC, 62, 0x16][..], &good].concat();
        let (mut decoder, mut found) = (Decoder::new(), Vec::new());
        decoder.receive(&line, |frame| found.push(describe(frame)));
        assert!(found.is_empty());
        decoder.gap(|frame| found.push(describe(frame)));
        assert_eq!(found, [describe(channels(3))]);
        assert_eq!((decoder.errors().cut, decoder.errors().skipped_bytes), (1, 3));
        // Without the gap it comes out with what follows.
        let (mut decoder, mut found) = (Decoder::new(), Vec::new());
        let line = [&line[..], &good, &good].concat();
        decoder.receive(&line, |frame| found.push(describe(frame)));
        assert_eq!(found.len(), 3);
        assert_eq!(decoder.errors().skipped_bytes, 3);
    }

    #[test]
    fn half_a_frame_is_forgotten_at_a_gap() {
        let good = encoded(&channels(4), SYNC);
        for length in 1..good.len() {
            let (mut decoder, mut found) = (Decoder::new(), Vec::new());
            decoder.receive(&good[..length], |frame| found.push(describe(frame)));
            decoder.gap(|frame| found.push(describe(frame)));
            assert_eq!((found.len(), decoder.errors().skipped_bytes), (0, length as u64));
            decoder.receive(&good, |frame| found.push(describe(frame)));
            assert_eq!(found, [describe(channels(4))]);
        }
    }

    /// Bytes in which the special ones are frequent.
    fn any_bytes(most: usize) -> impl Strategy<Value = Vec<u8>> {
        let byte = prop_oneof![
            any::<u8>(),
            prop::sample::select(std::vec![SYNC, ADDRESS_HANDSET, ADDRESS_MODULE, 2, 24, 62, 0x16])
        ];
        prop::collection::vec(byte, 0..most)
    }

    proptest! {
        #[test]
        fn frames_come_out_of_any_split(
            payloads in prop::collection::vec(any_bytes(61), 1..6), split in 1usize..80,
        ) {
            let sent: Vec<Frame<'_>> =
                payloads.iter().map(|payload| Frame::Other { kind: 0x80, payload }).collect();
            let line: Vec<u8> = sent.iter().flat_map(|frame| encoded(frame, SYNC)).collect();
            let (mut decoder, mut found) = (Decoder::new(), Vec::new());
            line.chunks(split).for_each(|chunk| decoder.receive(chunk, |frame| found.push(describe(frame))));
            prop_assert_eq!(found, sent.into_iter().map(describe).collect::<Vec<_>>());
            prop_assert_eq!(decoder.errors(), DecoderErrors::default());
        }

        #[test]
        fn any_line_is_survived_and_every_byte_accounted_for(noise in any_bytes(800)) {
            let (mut decoder, mut in_frames) = (Decoder::new(), 0);
            let mut count = |frame: Frame<'_>| {
                let mut out = [0; FRAME_BYTES_MAX];
                in_frames += frame.encode(SYNC, &mut out).unwrap() as u64;
            };
            decoder.receive(&noise, &mut count);
            decoder.gap(&mut count);
            let errors = decoder.errors();
            prop_assert!(errors.skipped_bytes + in_frames <= noise.len() as u64);
            let mut found = Vec::new();
            decoder.receive(&encoded(&channels(9), SYNC), |frame| found.push(describe(frame)));
            prop_assert_eq!(found, [describe(channels(9))]);
        }
    }
}
