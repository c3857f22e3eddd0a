//! Finding frames in a stream of bytes.

use super::frame::frame_bytes;
use super::{FRAME_BYTES_MAX, Frame, MavlinkError, START};

/// What was found wrong in the stream so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderErrors {
    /// Frames whose check did not come out.
    pub checksum: u64,
    /// What began like a frame of a message that is not known here.
    pub unknown: u64,
    /// What began like a frame with flags that are not known here.
    pub incompatible: u64,
    /// Frames cut short by silence.
    pub cut: u64,
    /// Bytes outside any frame that is known here.
    pub skipped_bytes: u64,
}

/// Finds the frames of one stream: a serial line, or datagrams one after the other.
///
/// What begins like a frame and turns out to be none is looked through for the next beginning, so that a
/// false start costs no true frame. It may delay one, until as many bytes have come as the false start
/// announced; the owner of the clock ends that wait with [`gap`](Self::gap) once the line has been silent for
/// longer than between two bytes, or at a datagram's end.
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
        let errors = DecoderErrors { checksum: 0, unknown: 0, incompatible: 0, cut: 0, skipped_bytes: 0 };
        Self { buffer: [0; FRAME_BYTES_MAX], length: 0, errors }
    }

    /// What was found wrong so far.
    #[must_use]
    pub const fn errors(&self) -> DecoderErrors {
        self.errors
    }

    /// The next bytes of the stream, any number; `on_frame` gets each frame they complete.
    pub fn receive(&mut self, bytes: &[u8], mut on_frame: impl FnMut(Frame<'_>)) {
        for byte in bytes {
            self.push(*byte, &mut on_frame);
        }
    }

    /// The next byte of the stream. It may complete more than one frame: after a false start, frames found
    /// within it.
    pub fn push(&mut self, byte: u8, mut on_frame: impl FnMut(Frame<'_>)) {
        if self.length == 0 && byte != START {
            self.errors.skipped_bytes += 1;
            return;
        }
        // A full buffer is a whole frame of the greatest length, and has been judged.
        self.buffer[self.length] = byte;
        self.length += 1;
        while let Some(used) = self.judge(&mut on_frame) {
            self.drop_to_start(used);
        }
    }

    /// The line was silent for longer than between two bytes of a frame: what has not come will not. Frames
    /// within what turns out to have been a false start still come out.
    pub fn gap(&mut self, mut on_frame: impl FnMut(Frame<'_>)) {
        while self.length > 0 {
            match self.judge(&mut on_frame) {
                Some(used) => self.drop_to_start(used),
                None => {
                    self.errors.cut += 1;
                    self.errors.skipped_bytes += 1;
                    self.drop_to_start(1);
                }
            }
        }
    }

    /// Whether the buffer holds a frame, or cannot become one: answers how many bytes are done with.
    fn judge(&mut self, on_frame: &mut impl FnMut(Frame<'_>)) -> Option<usize> {
        let bytes = &self.buffer[..self.length];
        let wanted = frame_bytes(bytes);
        let count = match Frame::decode(bytes.get(..wanted).unwrap_or(bytes)) {
            Ok(frame) => {
                on_frame(frame);
                return Some(wanted);
            }
            Err(MavlinkError::Incompatible { .. }) => &mut self.errors.incompatible,
            Err(MavlinkError::UnknownMessage { .. }) => &mut self.errors.unknown,
            Err(MavlinkError::Checksum { .. }) => &mut self.errors.checksum,
            // More is to come.
            Err(_) => return None,
        };
        *count += 1;
        self.errors.skipped_bytes += 1;
        Some(1)
    }

    /// Forgets the first `used` bytes and what follows them up to the next beginning.
    fn drop_to_start(&mut self, used: usize) {
        let rest = &self.buffer[used..self.length];
        let skipped = rest.iter().position(|byte| *byte == START).unwrap_or(rest.len());
        self.errors.skipped_bytes += skipped as u64;
        let from = used + skipped;
        self.buffer.copy_within(from..self.length, 0);
        self.length -= from;
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Header, Heartbeat, Message, PAYLOAD_BYTES_MAX, TimeSync};
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    const AUTOPILOT: Header = Header { sequence: 1, system: 1, component: 1 };

    fn encoded(message: &Message<'_>, sequence: u8) -> Vec<u8> {
        let (mut payload, mut out) = ([0; PAYLOAD_BYTES_MAX], [0; FRAME_BYTES_MAX]);
        let frame = message.frame(Header { sequence, ..AUTOPILOT }, &mut payload).unwrap();
        let length = frame.encode(&mut out).unwrap();
        out[..length].to_vec()
    }

    fn time_sync(n: i64) -> Message<'static> {
        Message::TimeSync(TimeSync { answered_ns: -n, asked_ns: n * 0x00FD_FDFD_FDFD, ..TimeSync::default() })
    }

    fn sequences(decoder: &mut Decoder, bytes: &[u8]) -> Vec<u8> {
        let mut found = Vec::new();
        decoder.receive(bytes, |frame| found.push(frame.header.sequence));
        found
    }

    #[test]
    fn frames_of_every_kind_follow_each_other() {
        let ids = [104, 138, 331];
        let others = ids.map(|id| Message::Other { id, payload: &[0xFD; PAYLOAD_BYTES_MAX] });
        let known = [time_sync(1), Message::Heartbeat(Heartbeat::GROUND_STATION), time_sync(2)];
        let line: Vec<u8> =
            (0..).zip(others.iter().chain(&known)).flat_map(|(n, message)| encoded(message, n)).collect();
        let mut decoder = Decoder::new();
        assert_eq!(sequences(&mut decoder, &line), [0, 1, 2, 3, 4, 5]);
        assert_eq!(decoder.errors(), DecoderErrors::default());
    }

    #[test]
    fn errors_are_counted_and_the_next_frame_is_found() {
        let good = encoded(&time_sync(3), 9);
        let (mut wrong, mut unknown, mut incompatible) = (good.clone(), good.clone(), good.clone());
        wrong[12] ^= 1;
        unknown[7] = 1;
        incompatible[2] = 2;
        let line = [&[0x00, 0x55][..], &wrong, &unknown, &incompatible, &good].concat();
        let mut decoder = Decoder::new();
        let mut found = sequences(&mut decoder, &line);
        decoder.gap(|frame| found.push(frame.header.sequence));
        assert_eq!(found, [9]);
        let errors = decoder.errors();
        assert!(errors.checksum >= 1 && errors.unknown >= 1 && errors.incompatible >= 1, "{errors:?}");
        assert_eq!(errors.skipped_bytes, (line.len() - good.len()) as u64);
    }

    #[test]
    fn a_false_start_costs_no_frame() {
        let good = encoded(&time_sync(4), 7);
        // Announces 255 bytes of a message that is known: only silence tells that they do not come.
        let start = [START, 255, 0, 0, 0, 0, 0, 0, 0, 0];
        let mut decoder = Decoder::new();
        let mut found = sequences(&mut decoder, &[&start[..], &good, &good].concat());
        assert_eq!(found, []);
        decoder.gap(|frame| found.push(frame.header.sequence));
        assert_eq!(found, [7, 7]);
        assert_eq!((decoder.errors().cut, decoder.errors().skipped_bytes), (1, 10));
    }

    proptest! {
        #[test]
        fn any_portions_give_the_same_frames(
            count in 1i64..20, split in 1usize..60, noise in prop::collection::vec(any::<u8>(), 0..30),
        ) {
            let frames: Vec<u8> = (0..count).flat_map(|n| encoded(&time_sync(n), n as u8)).collect();
            let line = [&noise[..], &frames].concat();
            let (mut whole, mut split_up) = (Decoder::new(), Decoder::new());
            let mut at_once = sequences(&mut whole, &line);
            let mut by_and_by = Vec::new();
            for portion in line.chunks(split) {
                by_and_by.extend(sequences(&mut split_up, portion));
            }
            whole.gap(|frame| at_once.push(frame.header.sequence));
            split_up.gap(|frame| by_and_by.push(frame.header.sequence));
            prop_assert_eq!(&at_once, &by_and_by);
            prop_assert!(at_once.ends_with(&(0..count as u8).collect::<Vec<_>>()));
            prop_assert_eq!(whole.errors(), split_up.errors());
        }

        #[test]
        fn any_stream_is_survived_and_after_a_gap_a_frame_is_found(
            noise in prop::collection::vec(prop_oneof![any::<u8>(), Just(START), Just(0)], 0..900),
        ) {
            let mut decoder = Decoder::new();
            decoder.receive(&noise, |_| {});
            decoder.gap(|_| {});
            prop_assert_eq!(sequences(&mut decoder, &encoded(&time_sync(5), 3)), [3]);
        }
    }
}
