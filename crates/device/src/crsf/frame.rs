//! What the frames say.

use quantity::Span;

use super::{
    ADDRESS_HANDSET, ADDRESS_MODULE, CrsfError, FRAMING_BYTES, LENGTH_MAX, LENGTH_MIN, PAYLOAD_BYTES_MAX,
    is_sync,
};
use crate::bytes::{Reader, Writer};
use crate::channels::{self, PACKED_BYTES};
use crate::crc::crc8;

/// Bytes of a frame of channels.
pub const CHANNELS_FRAME_BYTES: usize = PACKED_BYTES + FRAMING_BYTES;

const KIND_LINK_STATISTICS: u8 = 0x14;
const KIND_CHANNELS: u8 = 0x16;
const KIND_PARAMETER_ENTRY: u8 = 0x2B;
const KIND_PARAMETER_READ: u8 = 0x2C;
const KIND_PARAMETER_WRITE: u8 = 0x2D;
const KIND_REMOTE: u8 = 0x3A;
const REMOTE_TIMING_CORRECTION: u8 = 0x10;

/// Of a tick of a timing correction.
const TICK_NANOS: i64 = 100;

/// One frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame<'a> {
    /// 16: the channels, each 0 to 2047. 192, 992 and 1792 stand for 1000, 1500 and 2000 µs.
    Channels([u16; 16]),
    /// 14: how the radio link fares.
    LinkStatistics(LinkStatistics),
    /// 3A, 10: when the module wants its channels.
    TimingCorrection(Route, TimingCorrection),
    /// 2C: say what a parameter is. It is answered with [`Frame::ParameterEntry`].
    ParameterRead {
        /// Whom it is for and from.
        route: Route,
        /// Which parameter; 0 is the folder of all.
        parameter: u8,
        /// Which part of the answer, from 0.
        chunk: u8,
    },
    /// 2D: give a parameter a value, which is answered with the same frame.
    ParameterWrite {
        /// Whom it is for and from.
        route: Route,
        /// Which parameter.
        parameter: u8,
        /// The value, as its type has it.
        value: &'a [u8],
    },
    /// 2B: a part of what a parameter is.
    ParameterEntry {
        /// Whom it is for and from.
        route: Route,
        /// Which parameter.
        parameter: u8,
        /// Parts that follow on request.
        chunks_remaining: u8,
        /// This part, at most 56 bytes.
        chunk: &'a [u8],
    },
    /// Any other frame.
    Other {
        /// Its type.
        kind: u8,
        /// Its payload, addresses included.
        payload: &'a [u8],
    },
}

/// Whom a frame is for and whom it is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Route {
    /// Address of whom it is for.
    pub to: u8,
    /// Address of whom it is from.
    pub from: u8,
}

impl Route {
    /// From the transmitter module to the handset, which to a module is whoever feeds it.
    pub const MODULE_TO_HANDSET: Self = Self { to: ADDRESS_HANDSET, from: ADDRESS_MODULE };
}

/// How the radio link fares; *uplink* is from the ground to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStatistics {
    /// Received power at the vehicle's first antenna, -dBm.
    pub uplink_rssi_1: u8,
    /// At its second antenna, -dBm.
    pub uplink_rssi_2: u8,
    /// Share of packets the vehicle received, percent.
    pub uplink_quality_percent: u8,
    /// Signal to noise at the vehicle.
    pub uplink_snr_db: i8,
    /// The antenna in use, 0 or 1.
    pub active_antenna: u8,
    /// Which of the radio's packet rates; what the numbers mean is the radio's own.
    pub rate: u8,
    /// Which of the radio's powers; 0 mW, 10, 25, 100, 500, 1000, 2000, 250, 50.
    pub uplink_power: u8,
    /// Received power on the ground, -dBm.
    pub downlink_rssi: u8,
    /// Share of packets the ground received, percent.
    pub downlink_quality_percent: u8,
    /// Signal to noise on the ground.
    pub downlink_snr_db: i8,
}

/// When the module wants its channels, so that they leave with its next packet and not the one after.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimingCorrection {
    /// Time from packet to packet, in 100 ns.
    pub interval_ticks: u32,
    /// How much too early the last channels came (negative: too late), in 100 ns.
    pub offset_ticks: i32,
}

impl TimingCorrection {
    /// Time from packet to packet.
    #[must_use]
    pub fn interval(&self) -> Span {
        Span::from_nanos(i64::from(self.interval_ticks) * TICK_NANOS)
    }

    /// How much too early the last channels came; negative where they came too late.
    #[must_use]
    pub fn offset(&self) -> Span {
        Span::from_nanos(i64::from(self.offset_ticks) * TICK_NANOS)
    }
}

impl<'a> Frame<'a> {
    /// The frame that these bytes are, no more and no fewer; for bytes that come bit by bit see
    /// [`Decoder`](super::Decoder). A payload that is longer than its fields is read all the same, since
    /// later versions of the protocol add to them.
    ///
    /// # Errors
    /// [`CrsfError`] for anything that is no frame, or is one whose payload is too short for its type.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, CrsfError> {
        let [sync, length, rest @ ..] = bytes else {
            return Err(CrsfError::Size { bytes: bytes.len(), expected: LENGTH_MIN + 2 });
        };
        if !is_sync(*sync) {
            return Err(CrsfError::Sync { found: *sync });
        }
        let wanted = usize::from(*length);
        if !(LENGTH_MIN..=LENGTH_MAX).contains(&wanted) {
            return Err(CrsfError::Length { found: *length });
        }
        let ([kind, payload @ .., received], true) = (rest, rest.len() == wanted) else {
            return Err(CrsfError::Size { bytes: bytes.len(), expected: wanted + 2 });
        };
        let computed = crc8(&rest[..wanted - 1]);
        if *received != computed {
            return Err(CrsfError::Checksum { received: *received, computed });
        }
        Self::read(*kind, payload).ok_or(CrsfError::Payload { kind: *kind, bytes: payload.len() })
    }

    fn read(kind: u8, payload: &'a [u8]) -> Option<Self> {
        let mut reader = Reader::new(payload);
        Some(match kind {
            KIND_CHANNELS => Self::Channels(channels::unpack(&reader.array()?)),
            KIND_LINK_STATISTICS => Self::LinkStatistics(LinkStatistics::read(&mut reader)?),
            KIND_REMOTE if payload.get(2) == Some(&REMOTE_TIMING_CORRECTION) => {
                let (route, _) = (Route::read(&mut reader)?, reader.u8()?);
                let interval_ticks = u32::from_be_bytes(reader.array()?);
                let offset_ticks = i32::from_be_bytes(reader.array()?);
                Self::TimingCorrection(route, TimingCorrection { interval_ticks, offset_ticks })
            }
            KIND_PARAMETER_READ => Self::ParameterRead {
                route: Route::read(&mut reader)?,
                parameter: reader.u8()?,
                chunk: reader.u8()?,
            },
            KIND_PARAMETER_WRITE => Self::ParameterWrite {
                route: Route::read(&mut reader)?,
                parameter: reader.u8()?,
                value: reader.rest(),
            },
            KIND_PARAMETER_ENTRY => Self::ParameterEntry {
                route: Route::read(&mut reader)?,
                parameter: reader.u8()?,
                chunks_remaining: reader.u8()?,
                chunk: reader.rest(),
            },
            kind => Self::Other { kind, payload },
        })
    }

    /// Writes the frame behind a sync byte and answers its length. On a serial line that byte is
    /// [`SYNC`](super::SYNC), towards a transmitter module commonly its address
    /// [`ADDRESS_MODULE`]. Of each channel the lower eleven bits are sent.
    ///
    /// # Errors
    /// [`CrsfError::Sync`] for a byte with which no frame begins, [`CrsfError::TooLong`],
    /// [`CrsfError::NoRoom`].
    pub fn encode(&self, sync: u8, out: &mut [u8]) -> Result<usize, CrsfError> {
        if !is_sync(sync) {
            return Err(CrsfError::Sync { found: sync });
        }
        let mut content = [0; PAYLOAD_BYTES_MAX];
        let mut writer = Writer::new(&mut content);
        let kind = self.write(&mut writer);
        let bytes = writer.finish().ok_or(CrsfError::TooLong { bytes: self.payload_bytes() })?;
        let mut writer = Writer::new(out);
        writer.u8(sync).u8((bytes + LENGTH_MIN) as u8).u8(kind).bytes(&content[..bytes]);
        let check = crc8(writer.written().get(2..).unwrap_or(&[]));
        writer.u8(check).finish().ok_or(CrsfError::NoRoom)
    }

    /// Writes the payload and answers the type.
    fn write(&self, writer: &mut Writer<'_>) -> u8 {
        match *self {
            Self::Channels(ref channels) => {
                writer.bytes(&channels::pack(channels));
                KIND_CHANNELS
            }
            Self::LinkStatistics(statistics) => {
                statistics.write(writer);
                KIND_LINK_STATISTICS
            }
            Self::TimingCorrection(route, TimingCorrection { interval_ticks, offset_ticks }) => {
                route.write(writer).u8(REMOTE_TIMING_CORRECTION);
                writer.bytes(&interval_ticks.to_be_bytes()).bytes(&offset_ticks.to_be_bytes());
                KIND_REMOTE
            }
            Self::ParameterRead { route, parameter, chunk } => {
                route.write(writer).u8(parameter).u8(chunk);
                KIND_PARAMETER_READ
            }
            Self::ParameterWrite { route, parameter, value } => {
                route.write(writer).u8(parameter).bytes(value);
                KIND_PARAMETER_WRITE
            }
            Self::ParameterEntry { route, parameter, chunks_remaining, chunk } => {
                route.write(writer).u8(parameter).u8(chunks_remaining).bytes(chunk);
                KIND_PARAMETER_ENTRY
            }
            Self::Other { kind, payload } => {
                writer.bytes(payload);
                kind
            }
        }
    }

    /// Bytes of the payloads that have no fixed length.
    const fn payload_bytes(&self) -> usize {
        match self {
            Self::ParameterWrite { value, .. } => 3 + value.len(),
            Self::ParameterEntry { chunk, .. } => 4 + chunk.len(),
            Self::Other { payload, .. } => payload.len(),
            _ => PACKED_BYTES,
        }
    }
}

impl Route {
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { to: reader.u8()?, from: reader.u8()? })
    }

    fn write<'w, 'o>(self, writer: &'w mut Writer<'o>) -> &'w mut Writer<'o> {
        writer.u8(self.to).u8(self.from)
    }
}

impl LinkStatistics {
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            uplink_rssi_1: reader.u8()?,
            uplink_rssi_2: reader.u8()?,
            uplink_quality_percent: reader.u8()?,
            uplink_snr_db: reader.u8()?.cast_signed(),
            active_antenna: reader.u8()?,
            rate: reader.u8()?,
            uplink_power: reader.u8()?,
            downlink_rssi: reader.u8()?,
            downlink_quality_percent: reader.u8()?,
            downlink_snr_db: reader.u8()?.cast_signed(),
        })
    }

    fn write(&self, writer: &mut Writer<'_>) {
        writer.u8(self.uplink_rssi_1).u8(self.uplink_rssi_2).u8(self.uplink_quality_percent);
        writer.u8(self.uplink_snr_db.cast_unsigned()).u8(self.active_antenna).u8(self.rate);
        writer.u8(self.uplink_power).u8(self.downlink_rssi).u8(self.downlink_quality_percent);
        writer.u8(self.downlink_snr_db.cast_unsigned());
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FRAME_BYTES_MAX, SYNC};
    use super::*;
    use crate::bytes::from_hex;
    use crate::vehicle_link::{CommandFrame, CommandMode};
    use proptest::prelude::*;
    use std::vec::Vec;

    fn encoded(frame: &Frame<'_>) -> Vec<u8> {
        let mut out = [0xEE; FRAME_BYTES_MAX];
        let length = frame.encode(SYNC, &mut out).unwrap();
        out[..length].to_vec()
    }

    fn check(frame: &Frame<'_>, hex: &str) {
        let bytes = from_hex(hex);
        assert_eq!(encoded(frame), bytes);
        assert_eq!(Frame::decode(&bytes), Ok(*frame));
    }

    #[test]
    fn golden_channels_both_ways() {
        check(&Frame::Channels([992; 16]), "c81816 e0031ff8c0073ef0810f7ce0031ff8c0073ef0810f7c ad");
        let mut channels = [992; 16];
        channels[..4].copy_from_slice(&[172, 992, 1811, 191]);
        check(&Frame::Channels(channels), "c81816ac00dfc47f013ef0810f7ce0031ff8c0073ef0810f7c15");
    }

    #[test]
    fn further_frames_both_ways() {
        // By hand from the layout tables; checks by the specification's table of 256.
        let statistics = LinkStatistics {
            uplink_rssi_1: 16,
            uplink_rssi_2: 19,
            uplink_quality_percent: 99,
            uplink_snr_db: -105,
            active_antenna: 1,
            rate: 2,
            uplink_power: 3,
            downlink_rssi: 8,
            downlink_quality_percent: 88,
            downlink_snr_db: -108,
        };
        check(&Frame::LinkStatistics(statistics), "c80c14 10136397010203085894 fc");
        let route = Route::MODULE_TO_HANDSET;
        // 4 ms, and 12.3 µs too late.
        let correction = TimingCorrection { interval_ticks: 40_000, offset_ticks: -123 };
        check(&Frame::TimingCorrection(route, correction), "c80d3a eaee10 00009c40 ffffff85 4e");
        assert_eq!(correction.interval(), Span::from_millis(4));
        assert_eq!(correction.offset(), Span::from_nanos(-12_300));
        let route = Route { to: ADDRESS_MODULE, from: ADDRESS_HANDSET };
        check(&Frame::ParameterRead { route, parameter: 2, chunk: 1 }, "c8062c eeea 02 01 4e");
        let value = &[0, 0, 1, 0x2C];
        check(&Frame::ParameterWrite { route, parameter: 9, value }, "c8092d eeea 09 0000012c c8");
        let chunk = &[7, 8];
        let entry = Frame::ParameterEntry {
            route: Route::MODULE_TO_HANDSET,
            parameter: 9,
            chunks_remaining: 1,
            chunk,
        };
        check(&entry, "c8082b eaee 09 01 0708 a3");
        check(&Frame::Other { kind: 0x0B, payload: &[0, 200] }, "c8040b 00c8 ed");
        check(&Frame::Other { kind: 0x3A, payload: &[0xEA, 0xEE, 0x11] }, "c8053a eaee11 15");
    }

    #[test]
    fn a_command_is_the_same_over_sbus_and_over_crsf() {
        let command = CommandFrame {
            mode: CommandMode::Fly,
            counter: 31,
            collective_m_s2: 24.0,
            rate_rad_s: quantity::Vector::new(12.0, -12.0, 0.0),
            attitude_valid: true,
            height_valid: true,
            epoch_low: 255,
            ..CommandFrame::default()
        };
        let channels = command.encode(255).unwrap();
        assert!(channels.contains(&2047) && channels.contains(&0), "both ends of the range are used");
        let over_crsf = encoded(&Frame::Channels(channels));
        let over_sbus = crate::sbus::Frame::new(channels).encode();
        assert_eq!(over_crsf.len(), CHANNELS_FRAME_BYTES);
        assert_eq!(over_crsf[3..25], over_sbus[1..23]);
        let Ok(Frame::Channels(read)) = Frame::decode(&over_crsf) else { panic!("no channels") };
        assert_eq!(CommandFrame::decode(&read).unwrap(), (255, command.quantise().unwrap()));
    }

    #[test]
    fn longer_payloads_are_read_and_shorter_ones_refused() {
        for (kind, least) in [(0x16, 22), (0x14, 10), (0x2C, 4), (0x2D, 3), (0x2B, 4)] {
            let payload = [0x5A; PAYLOAD_BYTES_MAX];
            for bytes in 0..=PAYLOAD_BYTES_MAX {
                let frame = encoded(&Frame::Other { kind, payload: &payload[..bytes] });
                let decoded = Frame::decode(&frame);
                if bytes < least {
                    assert_eq!(decoded, Err(CrsfError::Payload { kind, bytes }));
                } else {
                    assert!(!matches!(decoded, Err(_) | Ok(Frame::Other { .. })));
                }
            }
        }
        let frame = encoded(&Frame::Other { kind: 0x3A, payload: &[0xEA, 0xEE, 0x10, 0, 0, 0, 0, 0, 0, 0] });
        assert_eq!(Frame::decode(&frame), Err(CrsfError::Payload { kind: 0x3A, bytes: 10 }));
    }

    #[test]
    fn what_is_no_frame_is_an_error() {
        let good = encoded(&Frame::Channels([992; 16]));
        for length in 2..good.len() {
            let error = CrsfError::Size { bytes: length, expected: 26 };
            assert_eq!(Frame::decode(&good[..length]), Err(error));
        }
        assert_eq!(Frame::decode(&[]), Err(CrsfError::Size { bytes: 0, expected: 4 }));
        for found in [0, 1, 63, 255] {
            assert_eq!(Frame::decode(&[SYNC, found, 0, 0]), Err(CrsfError::Length { found }));
        }
        assert_eq!(Frame::decode(&[0x0F, 2, 0, 0]), Err(CrsfError::Sync { found: 0x0F }));
        let longer = [&good[..], &[0]].concat();
        assert_eq!(Frame::decode(&longer), Err(CrsfError::Size { bytes: 27, expected: 26 }));
        for bit in 16..26 * 8 {
            let mut wrong = good.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(Frame::decode(&wrong), Err(CrsfError::Checksum { .. })), "bit {bit}");
        }
    }

    #[test]
    fn what_cannot_be_sent_is_an_error() {
        let frame = Frame::Other { kind: 1, payload: &[0; 61] };
        assert_eq!(frame.encode(SYNC, &mut [0; 99]), Err(CrsfError::TooLong { bytes: 61 }));
        let route = Route::MODULE_TO_HANDSET;
        let frame = Frame::ParameterEntry { route, parameter: 1, chunks_remaining: 0, chunk: &[0; 57] };
        assert_eq!(frame.encode(SYNC, &mut [0; 99]), Err(CrsfError::TooLong { bytes: 61 }));
        let frame = Frame::Channels([0; 16]);
        assert_eq!(frame.encode(SYNC, &mut [0; 25]), Err(CrsfError::NoRoom));
        assert_eq!(frame.encode(0x0F, &mut [0; 26]), Err(CrsfError::Sync { found: 0x0F }));
    }

    proptest! {
        #[test]
        fn channels_round_trip(channels in prop::array::uniform16(0u16..2048)) {
            let bytes = encoded(&Frame::Channels(channels));
            prop_assert_eq!(Frame::decode(&bytes), Ok(Frame::Channels(channels)));
        }

        #[test]
        fn any_frame_that_decodes_encodes_to_the_same_meaning(
            kind: u8, payload in prop::collection::vec(any::<u8>(), 0..=PAYLOAD_BYTES_MAX),
        ) {
            let bytes = encoded(&Frame::Other { kind, payload: &payload });
            if let Ok(frame) = Frame::decode(&bytes) {
                let again = encoded(&frame);
                prop_assert_eq!(Frame::decode(&again), Ok(frame));
                prop_assert!(bytes[3..].starts_with(&again[3..again.len() - 1]));
            }
        }
    }
}
