//! Finding frames in the bytes of a serial line.

use super::{ApiMode, DELIMITER, ESCAPE, ESCAPE_BIT, Frame};

/// Most frame data that is accepted: a mesh packet of 255 bytes with its fields.
pub const FRAME_DATA_BYTES_MAX: usize = 270;

/// Delimiter, length, frame data, checksum.
const CAPACITY: usize = FRAME_DATA_BYTES_MAX + 4;

/// What was found wrong on the line so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderErrors {
    /// Frames whose checksum did not come out.
    pub checksum: u64,
    /// Lengths of zero or above [`FRAME_DATA_BYTES_MAX`].
    pub length: u64,
    /// Frames cut short by the next delimiter (escaped mode only).
    pub cut: u64,
    /// Frames whose data ended before their fields did.
    pub truncated: u64,
    /// Bytes outside any frame.
    pub skipped_bytes: u64,
}

/// Finds the frames of one serial line.
///
/// It resynchronises by itself: in escaped mode at the next `7E`, which cannot be anything but a delimiter;
/// in plain mode by looking for the next `7E` *within* what turned out not to be a frame, so that a false
/// start costs no true frame.
#[derive(Clone, Debug)]
pub struct Decoder {
    mode: ApiMode,
    escaped: bool,
    buffer: [u8; CAPACITY],
    length: usize,
    errors: DecoderErrors,
}

impl Decoder {
    /// A decoder that has seen nothing.
    #[must_use]
    pub const fn new(mode: ApiMode) -> Self {
        let errors = DecoderErrors { checksum: 0, length: 0, cut: 0, truncated: 0, skipped_bytes: 0 };
        Self { mode, escaped: false, buffer: [0; CAPACITY], length: 0, errors }
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
        let Some(byte) = self.unescape(byte) else { return };
        if self.length == 0 && byte != DELIMITER {
            self.errors.skipped_bytes += 1;
            return;
        }
        self.buffer[self.length] = byte;
        self.length += 1;
        while let Some(used) = self.judge(&mut on_frame) {
            self.drop_to_delimiter(used);
        }
    }

    /// `None` for a byte that only announces or restarts something.
    fn unescape(&mut self, byte: u8) -> Option<u8> {
        if self.mode == ApiMode::Plain {
            return Some(byte);
        }
        if byte == DELIMITER {
            if self.length > 0 {
                self.errors.cut += 1;
                self.errors.skipped_bytes += self.length as u64;
            }
            self.length = 0;
            self.escaped = false;
            return Some(byte);
        }
        if core::mem::take(&mut self.escaped) {
            return Some(byte ^ ESCAPE_BIT);
        }
        if byte == ESCAPE && self.length > 0 {
            self.escaped = true;
            return None;
        }
        Some(byte)
    }

    /// Whether the buffer holds a frame, or cannot become one: answers how many bytes are done with.
    fn judge(&mut self, on_frame: &mut impl FnMut(Frame<'_>)) -> Option<usize> {
        let [_, high, low, rest @ ..] = &self.buffer[..self.length] else {
            return None;
        };
        let wanted = usize::from(u16::from_be_bytes([*high, *low]));
        if wanted == 0 || wanted > FRAME_DATA_BYTES_MAX {
            self.errors.length += 1;
            self.errors.skipped_bytes += 1;
            return Some(1);
        }
        let frame_data = rest.get(..wanted)?;
        let checksum = rest.get(wanted)?;
        if frame_data.iter().fold(*checksum, |sum, byte| sum.wrapping_add(*byte)) != 0xFF {
            self.errors.checksum += 1;
            self.errors.skipped_bytes += 1;
            return Some(1);
        }
        match Frame::decode(frame_data) {
            Ok(frame) => on_frame(frame),
            Err(_) => self.errors.truncated += 1,
        }
        Some(wanted + 4)
    }

    /// Forgets the first `used` bytes and what follows them up to the next delimiter.
    fn drop_to_delimiter(&mut self, used: usize) {
        let rest = &self.buffer[used.min(self.length)..self.length];
        let skipped = match self.mode {
            ApiMode::Plain => rest.iter().position(|byte| *byte == DELIMITER).unwrap_or(rest.len()),
            // An escaped 7E inside a broken frame is no delimiter: only the line's own next one is.
            ApiMode::Escaped => rest.len(),
        };
        self.errors.skipped_bytes += skipped as u64;
        let from = used + skipped;
        self.buffer.copy_within(from.min(self.length)..self.length, 0);
        self.length = self.length.saturating_sub(from);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{TransmitResult, XbeeError};
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;
    use std::string::String;
    use std::vec::Vec;

    /// A frame in a form that can be kept and compared.
    fn describe(frame: Frame<'_>) -> String {
        std::format!("{frame:?}")
    }

    fn frames(mode: ApiMode, line: &[u8]) -> (Vec<String>, DecoderErrors) {
        let mut decoder = Decoder::new(mode);
        let mut found = Vec::new();
        decoder.receive(line, |frame| found.push(describe(frame)));
        (found, decoder.errors())
    }

    fn encoded(frame: Frame<'_>, mode: ApiMode) -> Vec<u8> {
        let mut out = [0; 600];
        let length = frame.encode(mode, &mut out).unwrap();
        out[..length].to_vec()
    }

    fn check(frame: Frame<'_>, mode: ApiMode, hex: &str) {
        let line = from_hex(hex);
        assert_eq!(encoded(frame, mode), line);
        assert_eq!(frames(mode, &line), (std::vec![describe(frame)], DecoderErrors::default()));
    }

    #[test]
    fn golden_frames_both_ways() {
        let example = Frame::Other { id: 0x23, data: &[0x11] };
        check(example, ApiMode::Plain, "7E0002 23 11 CB");
        check(example, ApiMode::Escaped, "7E0002 23 7D31 CB");
        for mode in [ApiMode::Plain, ApiMode::Escaped] {
            let transmit = Frame::Transmit16 { frame_id: 1, destination: 0x5001, options: 0, data: b"Hi" };
            check(transmit, mode, "7E0007 01 01 5001 00 4869 FB");
            let receive = Frame::Receive16 { source: 0x5001, rssi: 40, options: 0, data: b"Hi" };
            check(receive, mode, "7E0007 81 5001 28 00 4869 54");
            let mesh = Frame::TransmitMesh {
                frame_id: 1,
                destination: 0x0013_A200_40AA_BBCC,
                destination_short: 0xFFFE,
                radius: 0,
                options: 0,
                data: b"Hi",
            };
            let hex = match mode {
                ApiMode::Plain => "7E0010 10 01 0013A20040AABBCC FFFE 00 00 4869 1A",
                ApiMode::Escaped => "7E0010 10 01 007D33A20040AABBCC FFFE 00 00 4869 1A",
            };
            check(mesh, mode, hex);
        }
    }

    #[test]
    fn further_frames_both_ways() {
        // By hand from the layout table; the checksum is FF minus the sum of what stands between.
        let status = Frame::TransmitStatus { frame_id: 5, result: TransmitResult::NoAck };
        check(status, ApiMode::Escaped, "7E0003 89 05 01 70");
        check(Frame::ModemStatus { status: 6 }, ApiMode::Escaped, "7E0002 8A 06 6F");
        let destination = 0x0102_0304_0506_0708;
        let transmit = Frame::Transmit64 { frame_id: 2, destination, options: 4, data: &[0x7E] };
        check(transmit, ApiMode::Escaped, "7E000C 00 02 0102030405060708 04 7D5E 57");
        let receive = Frame::Receive64 { source: destination, rssi: 0x21, options: 2, data: &[9] };
        check(receive, ApiMode::Escaped, "7E000C 80 0102030405060708 21 02 09 2F");
        let mesh = Frame::ReceiveMesh { source: destination, source_short: 0xFFFE, options: 1, data: &[9] };
        check(mesh, ApiMode::Escaped, "7E000D 90 0102030405060708 FFFE 01 09 44");
    }

    #[test]
    fn errors_are_counted_and_the_next_frame_is_found() {
        let good = from_hex("7E0007 81 5001 28 00 4869 54");
        let mut wrong = good.clone();
        wrong[7] ^= 1;
        for mode in [ApiMode::Plain, ApiMode::Escaped] {
            let line = [&[0x00, 0x55][..], &wrong, &good].concat();
            let (found, errors) = frames(mode, &line);
            assert_eq!(found.len(), 1);
            assert_eq!((errors.checksum, errors.skipped_bytes), (1, 13));
        }
        let (found, errors) = frames(ApiMode::Escaped, &[&good[..6], &good].concat());
        assert_eq!((found.len(), errors.cut), (1, 1));
        let (found, errors) = frames(ApiMode::Plain, &[&from_hex("7EFFFF 7E0000")[..], &good].concat());
        assert_eq!((found.len(), errors.length), (1, 2));
        let (found, errors) = frames(ApiMode::Plain, &from_hex("7E0002 81 50 2E"));
        assert_eq!((found.len(), errors.truncated), (0, 1));
    }

    #[test]
    fn a_false_start_costs_no_frame_in_plain_mode() {
        let good = from_hex("7E0007 81 5001 28 00 4869 54");
        // Says 25 bytes follow: it swallows the two frames behind it before its checksum fails.
        let line = [&from_hex("7E0019 00 00 00 00")[..], &good, &good].concat();
        let (found, errors) = frames(ApiMode::Plain, &line);
        assert_eq!(found.len(), 2);
        assert_eq!((errors.checksum, errors.skipped_bytes), (1, 7));
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let frame = Frame::Transmit16 { frame_id: 1, destination: 1, options: 0, data: &[0; 300] };
        assert_eq!(frame.encode(ApiMode::Plain, &mut [0; 400]), Err(XbeeError::TooLong { bytes: 305 }));
        let frame = Frame::ModemStatus { status: 0 };
        assert_eq!(frame.encode(ApiMode::Plain, &mut [0; 5]), Err(XbeeError::NoRoom));
        assert_eq!(Frame::decode(&[]), Err(XbeeError::Empty));
    }

    fn any_mode() -> impl Strategy<Value = ApiMode> {
        prop_oneof![Just(ApiMode::Plain), Just(ApiMode::Escaped)]
    }

    /// Bytes in which the special ones are frequent.
    fn any_bytes(most: usize) -> impl Strategy<Value = Vec<u8>> {
        let byte = prop_oneof![
            any::<u8>(),
            prop::sample::select(std::vec![0x7E, 0x7D, 0x11, 0x13, 0x5E, 0x00, 0x02, 0x81])
        ];
        prop::collection::vec(byte, 0..most)
    }

    proptest! {
        #[test]
        fn frames_round_trip_through_any_split(
            mode in any_mode(), source: u16, rssi: u8, options: u8,
            payloads in prop::collection::vec(any_bytes(101), 1..5), split in 1usize..40,
        ) {
            let sent: Vec<Frame<'_>> =
                payloads.iter().map(|data| Frame::Receive16 { source, rssi, options, data }).collect();
            let line: Vec<u8> = sent.iter().flat_map(|frame| encoded(*frame, mode)).collect();
            let mut decoder = Decoder::new(mode);
            let mut found = Vec::new();
            line.chunks(split).for_each(|chunk| decoder.receive(chunk, |frame| found.push(describe(frame))));
            prop_assert_eq!(found, sent.into_iter().map(describe).collect::<Vec<_>>());
            prop_assert_eq!(decoder.errors(), DecoderErrors::default());
        }

        #[test]
        fn frame_data_round_trips(data in any_bytes(200)) {
            if let Ok(frame) = Frame::decode(&data) {
                let line = encoded(frame, ApiMode::Plain);
                prop_assert_eq!(Frame::decode(&line[3..line.len() - 1]).map(describe), Ok(describe(frame)));
            }
        }

        #[test]
        fn any_line_is_survived_and_the_decoder_recovers(mode in any_mode(), noise in any_bytes(800)) {
            let mut decoder = Decoder::new(mode);
            decoder.receive(&noise, |_| {});
            // Silence long enough to end any frame begun in the noise, then a frame.
            decoder.receive(&[0; CAPACITY], |_| {});
            let mut found = Vec::new();
            let frame = Frame::Receive16 { source: 1, rssi: 2, options: 0, data: b"after" };
            decoder.receive(&encoded(frame, mode), |frame| found.push(describe(frame)));
            prop_assert_eq!(found, [describe(frame)]);
        }
    }
}
