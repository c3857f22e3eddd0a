//! A frame: header, payload, check, signature.

use super::{
    CHECKSUM_BYTES, FLAG_SIGNED, HEADER_BYTES, Key, MavlinkError, Message, PAYLOAD_BYTES_MAX,
    SIGNATURE_BYTES, START, Signature, Signer, Timestamp, crc_extra,
};
use crate::bytes::{Reader, Writer};
use crate::crc::crc16_mcrf4xx;

/// Who says it, and how many frames were said before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Counts the frames of one sender, modulo 256.
    pub sequence: u8,
    /// The sending system: a vehicle, or a ground station (255 by custom).
    pub system: u8,
    /// The component of that system; 1 is an autopilot, 190 a ground station.
    pub component: u8,
}

/// One frame, whose check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Who says it.
    pub header: Header,
    /// Flags that may be ignored.
    pub compatibility_flags: u8,
    /// The message's number, 24 bits.
    pub message_id: u32,
    /// The payload as it was sent, commonly without its trailing zeros.
    pub payload: &'a [u8],
    /// Its signature, where it has one. Nothing has verified it: that is [`Verifier`](super::Verifier)'s.
    pub signature: Option<Signature>,
}

impl<'a> Frame<'a> {
    /// The frame that these bytes are, no more and no fewer; for bytes that come bit by bit see
    /// [`Decoder`](super::Decoder).
    ///
    /// # Errors
    /// [`MavlinkError`] for anything that is no frame, and for one of a message that is not known here.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, MavlinkError> {
        let size = MavlinkError::Size { bytes: bytes.len(), expected: frame_bytes(bytes) };
        let mut reader = Reader::new(bytes);
        match reader.u8() {
            Some(START) => {}
            Some(found) => return Err(MavlinkError::Start { found }),
            None => return Err(size),
        }
        let (Some(length), Some(flags)) = (reader.u8(), reader.u8()) else { return Err(size) };
        if flags & !FLAG_SIGNED != 0 {
            return Err(MavlinkError::Incompatible { flags });
        }
        let (compatibility_flags, header, message_id) = read_rest_of_header(&mut reader).ok_or(size)?;
        let extra = crc_extra(message_id).ok_or(MavlinkError::UnknownMessage { id: message_id })?;
        let payload = reader.take(usize::from(length)).ok_or(size)?;
        let received = reader.u16().ok_or(size)?;
        let signature = match flags & FLAG_SIGNED {
            0 => None,
            _ => Some(Signature::read(&mut reader).ok_or(size)?),
        };
        if !reader.rest().is_empty() {
            return Err(size);
        }
        let frame = Self { header, compatibility_flags, message_id, payload, signature };
        let computed = frame.check(flags, extra);
        if received != computed {
            return Err(MavlinkError::Checksum { received, computed });
        }
        Ok(frame)
    }

    /// What it says.
    #[must_use]
    pub fn message(&self) -> Message<'a> {
        Message::read(self.message_id, self.payload)
    }

    /// Writes the frame as it is, and answers its length.
    ///
    /// # Errors
    /// [`MavlinkError::UnknownMessage`], [`MavlinkError::TooLong`], [`MavlinkError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, MavlinkError> {
        let too_long = MavlinkError::TooLong { bytes: self.payload.len() };
        if self.payload.len() > PAYLOAD_BYTES_MAX {
            return Err(too_long);
        }
        let extra = crc_extra(self.message_id).ok_or(MavlinkError::UnknownMessage { id: self.message_id })?;
        let mut writer = Writer::new(out);
        writer.u8(START).bytes(&self.head(self.flags())).bytes(self.payload);
        writer.u16(self.check(self.flags(), extra));
        if let Some(signature) = self.signature {
            signature.write(&mut writer);
        }
        writer.finish().ok_or(MavlinkError::NoRoom)
    }

    /// The frame with a signature of `signer`, made now: stamp and send, never keep.
    ///
    /// # Errors
    /// [`MavlinkError::UnknownMessage`], [`MavlinkError::TooLong`].
    pub fn signed(mut self, signer: &mut Signer, now: Timestamp) -> Result<Self, MavlinkError> {
        if self.payload.len() > PAYLOAD_BYTES_MAX {
            return Err(MavlinkError::TooLong { bytes: self.payload.len() });
        }
        let extra = crc_extra(self.message_id).ok_or(MavlinkError::UnknownMessage { id: self.message_id })?;
        let (link, timestamp) = signer.stamp(now);
        self.signature = Some(Signature { link, timestamp, tag: [0; 6] });
        let tag = self.tag(signer.key(), extra, link, timestamp);
        self.signature = Some(Signature { link, timestamp, tag });
        Ok(self)
    }

    /// The tag that the holder of `key` would give this signed frame; `None` for a message not known here.
    pub(super) fn expected_tag(&self, key: &Key, signature: &Signature) -> Option<[u8; 6]> {
        let extra = crc_extra(self.message_id)?;
        Some(self.tag(key, extra, signature.link, signature.timestamp))
    }

    fn tag(&self, key: &Key, extra: u8, link: u8, timestamp: Timestamp) -> [u8; 6] {
        let check = self.check(FLAG_SIGNED, extra).to_le_bytes();
        key.tag(&[&[START], &self.head(FLAG_SIGNED), self.payload, &check, &[link], &timestamp.to_bytes()])
    }

    const fn flags(&self) -> u8 {
        if self.signature.is_some() { FLAG_SIGNED } else { 0 }
    }

    /// The header behind the first byte.
    fn head(&self, flags: u8) -> [u8; HEADER_BYTES - 1] {
        let [low, middle, high, _] = self.message_id.to_le_bytes();
        let Header { sequence, system, component } = self.header;
        let length = self.payload.len() as u8;
        [length, flags, self.compatibility_flags, sequence, system, component, low, middle, high]
    }

    fn check(&self, flags: u8, extra: u8) -> u16 {
        crc16_mcrf4xx(self.head(flags).iter().chain(self.payload).chain(&[extra]))
    }
}

fn read_rest_of_header(reader: &mut Reader<'_>) -> Option<(u8, Header, u32)> {
    let compatibility_flags = reader.u8()?;
    let header = Header { sequence: reader.u8()?, system: reader.u8()?, component: reader.u8()? };
    let [low, middle, high] = reader.array()?;
    Some((compatibility_flags, header, u32::from_le_bytes([low, middle, high, 0])))
}

/// Bytes that a frame has, by what its first three say; of an unsigned one without payload where they have
/// not come yet.
pub(super) fn frame_bytes(bytes: &[u8]) -> usize {
    let length = bytes.get(1).copied().unwrap_or(0);
    let signed = bytes.get(2).is_some_and(|flags| flags & FLAG_SIGNED != 0);
    HEADER_BYTES + usize::from(length) + CHECKSUM_BYTES + if signed { SIGNATURE_BYTES } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::super::{
        AttitudeTarget, FRAME_BYTES_MAX, Heartbeat, ParamEncoding, ParamId, ParamNumber, ParamSet,
    };
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;
    use std::vec::Vec;

    const STATION: Header = Header { sequence: 0, system: 255, component: 190 };

    const RATES: &str = "fd27000000ffbe520000e80300000000803f0000000000000000000000000000003f
        000000bf0000803e9a99193f0101804fdf";
    const PARAM_SET: &str = "fd17000000ffbe1700000000c03f0101464c49505f543100000000000000000009c578";

    fn encoded(frame: &Frame<'_>) -> Vec<u8> {
        let mut out = [0xEE; FRAME_BYTES_MAX];
        let length = frame.encode(&mut out).unwrap();
        out[..length].to_vec()
    }

    fn check(message: &Message<'_>, hex: &str) {
        let (bytes, mut payload) = (from_hex(hex), [0xEE; PAYLOAD_BYTES_MAX]);
        let frame = message.frame(STATION, &mut payload).unwrap();
        assert_eq!(encoded(&frame), bytes);
        let decoded = Frame::decode(&bytes).unwrap();
        assert_eq!(decoded, frame);
        assert_eq!(decoded.message(), *message);
    }

    #[test]
    fn golden_rates_both_ways() {
        let target = AttitudeTarget {
            since_boot_ms: 1000,
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
            rate_frd_rad_s: [0.5, -0.5, 0.25],
            thrust_ratio: 0.6,
            target_system: 1,
            target_component: 1,
            ignored: AttitudeTarget::IGNORE_ATTITUDE,
        };
        check(&Message::SetAttitudeTarget(target), RATES);
    }

    #[test]
    fn golden_parameter_both_ways() {
        let (value_bits, kind) = ParamNumber::Real32(1.5).to_wire(ParamEncoding::Bytewise).unwrap();
        let id = ParamId::new(b"FLIP_T1").unwrap();
        let set = ParamSet { value_bits, target_system: 1, target_component: 1, id, kind };
        check(&Message::ParamSet(set), PARAM_SET);
    }

    #[test]
    fn a_message_of_nothing_but_zeros_keeps_one_of_them() {
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let nothing = Message::Other { id: super::super::ID_ODOMETRY, payload: &[] };
        let frame = nothing.frame(STATION, &mut payload).unwrap();
        assert_eq!(frame.payload, [0]);
        assert_eq!(Frame::decode(&encoded(&frame)).unwrap().message(), nothing);
    }

    #[test]
    fn what_an_older_sender_did_not_trim_and_what_a_newer_one_adds_is_read() {
        let heartbeat = Heartbeat { custom_mode: 7, ..Heartbeat::GROUND_STATION };
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let short = Message::Heartbeat(heartbeat).frame(STATION, &mut payload).unwrap();
        let longer = [short.payload, &[0, 0, 9]].concat();
        let frame = Frame { payload: &longer, ..short };
        let bytes = encoded(&frame);
        assert_eq!(Frame::decode(&bytes).unwrap().message(), Message::Heartbeat(heartbeat));
    }

    #[test]
    fn what_is_no_frame_is_an_error() {
        let good = from_hex(RATES);
        for length in 3..good.len() {
            let error = MavlinkError::Size { bytes: length, expected: 51 };
            assert_eq!(Frame::decode(&good[..length]), Err(error));
        }
        assert_eq!(Frame::decode(&[]), Err(MavlinkError::Size { bytes: 0, expected: 12 }));
        assert_eq!(Frame::decode(&[0xFE, 9]), Err(MavlinkError::Start { found: 0xFE }));
        let longer = [&good[..], &[0]].concat();
        assert_eq!(Frame::decode(&longer), Err(MavlinkError::Size { bytes: 52, expected: 51 }));
        let mut unknown = good.clone();
        unknown[7..10].copy_from_slice(&[0x59, 0x01, 0]);
        assert_eq!(Frame::decode(&unknown), Err(MavlinkError::UnknownMessage { id: 345 }));
        for flags in [2, 4, 0x80, 0x83] {
            let mut incompatible = good.clone();
            incompatible[2] = flags;
            assert_eq!(Frame::decode(&incompatible), Err(MavlinkError::Incompatible { flags }));
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = from_hex(RATES);
        for bit in 0..good.len() * 8 {
            let mut wrong = good.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert!(Frame::decode(&wrong).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn what_cannot_be_sent_is_an_error() {
        let frame = Frame {
            header: STATION,
            compatibility_flags: 0,
            message_id: 0,
            payload: &[0; 256],
            signature: None,
        };
        assert_eq!(frame.encode(&mut [0; 300]), Err(MavlinkError::TooLong { bytes: 256 }));
        let frame = Frame { payload: &[1], ..frame };
        assert_eq!(frame.encode(&mut [0; 12]), Err(MavlinkError::NoRoom));
        let unknown = Frame { message_id: 1, ..frame };
        assert_eq!(unknown.encode(&mut [0; 99]), Err(MavlinkError::UnknownMessage { id: 1 }));
        let mut signer = Signer::new(Key::new([1; 32]), 0);
        let signed = unknown.signed(&mut signer, Timestamp::new(5).unwrap());
        assert_eq!(signed, Err(MavlinkError::UnknownMessage { id: 1 }));
    }

    proptest! {
        #[test]
        fn frames_round_trip(
            sequence: u8, system: u8, component: u8, compatibility_flags: u8,
            message_id in prop::sample::select(std::vec![0u32, 22, 23, 69, 70, 82, 104, 111, 138, 331]),
            payload in prop::collection::vec(any::<u8>(), 0..=PAYLOAD_BYTES_MAX),
        ) {
            let header = Header { sequence, system, component };
            let frame = Frame { header, compatibility_flags, message_id, payload: &payload, signature: None };
            let bytes = encoded(&frame);
            prop_assert_eq!(Frame::decode(&bytes), Ok(frame));
        }
    }
}
