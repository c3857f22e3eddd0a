//! CRTP, the protocol of Bitcraze's Crazyflie: small packets to numbered ports.
//!
//! A packet is a header byte, port · 16 + 12 + channel, and up to 30 bytes, little-endian. Packets of one
//! port keep their order, those of different ports need not. Over a radio one packet travels in each radio
//! packet; over UDP, which simulators speak, one in each datagram, without check or length, on ports 19850 to
//! 19859. A client that looks for vehicles sends the null packet `FF` there and takes any answer for one.
//!
//! | Port, channel | Packet |
//! | --- | --- |
//! | 0, 0 | console text |
//! | 5 | the log: what a vehicle can report, and its reports ([`LogRequest`], [`LogReply`]) |
//! | 6, 0 and 6, 1 id 8 | where motion capture sees the vehicle: position, or pose |
//! | 6, 1 ids 3, 4 | emergency stop and its watchdog, for firmware before 2025 |
//! | 7, 0 | setpoints by id: 0 stop, 7 position, 10 hover, 11 manual ([`Setpoint`]) |
//! | 7, 1 id 0 | setpoints end, let the vehicle's own planner take over |
//! | 9 | supervisor: arm, recover, stop, watchdog, state ([`Supervisor`]) |
//! | 15, 0 | echo |
//! | 15, 3 | null packet, which says nothing |
//!
//! A Crazyflie that hears no setpoint for half a second levels, and after two it cuts its motors. Everything
//! else here is [`Packet::Other`].

mod log;
mod setpoint;
mod supervisor;

use core::fmt;

use quantity::{Body, Rotation, Vector, World};

pub use log::{
    LOG_VALUE_BYTES_MAX, LOG_VARIABLES_MAX, LogOrder, LogReply, LogRequest, LogType, LogVariables, log_error,
};
pub use setpoint::Setpoint;
pub use supervisor::{Supervisor, SupervisorState};

use crate::bytes::{Reader, Writer};

/// Longest data of a packet.
pub const DATA_BYTES_MAX: usize = 30;

/// Longest packet.
pub const PACKET_BYTES_MAX: usize = 1 + DATA_BYTES_MAX;

/// The first of the UDP ports on which a simulated vehicle listens.
pub const UDP_PORT_FIRST: u16 = 19850;

/// How many there are.
pub const UDP_PORTS: u16 = 10;

/// The null packet, with which clients look for vehicles and pull answers.
pub const NULL_PACKET: [u8; 1] = [0xFF];

const PORT_CONSOLE: u8 = 0;
const PORT_LOCALIZATION: u8 = 6;
const PORT_SETPOINT: u8 = 7;
const PORT_SUPERVISOR: u8 = 9;
const PORT_LINK: u8 = 15;
const PORT_MAX: u8 = 15;
const CHANNEL_MAX: u8 = 3;
/// Bits of a header that boot loaders want set.
const HEADER_BITS: u8 = 0x0C;

const LINK_ECHO: u8 = 0;
const LINK_NULL: u8 = 3;
const LOCALIZATION_POSITION: u8 = 0;
const LOCALIZATION_GENERIC: u8 = 1;
const GENERIC_EMERGENCY_STOP: u8 = 3;
const GENERIC_WATCHDOG: u8 = 4;
const GENERIC_POSE: u8 = 8;
const SETPOINT_GENERIC: u8 = 0;
const SETPOINT_META: u8 = 1;
const META_RELEASE: u8 = 0;

/// One packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Packet<'a> {
    /// A piece of what the firmware prints.
    Console(&'a [u8]),
    /// Where motion capture sees the vehicle.
    ExternalPosition {
        /// In the hall.
        position_m: [f32; 3],
    },
    /// Where motion capture sees the vehicle, and how it lies.
    ExternalPose(ExternalPose),
    /// Emergency stop as firmware before 2025 understands it; later firmware wants [`Supervisor::Stop`]. Send
    /// both.
    OldEmergencyStop,
    /// Watchdog as firmware before 2025 understands it; later firmware wants [`Supervisor::Watchdog`].
    OldWatchdog,
    /// What the vehicle shall do.
    Setpoint(Setpoint),
    /// No more setpoints will come; the last one holds for so long.
    ReleaseSetpoints {
        /// How long.
        hold_ms: u32,
    },
    /// Arming, stopping, and how the vehicle fares.
    Supervisor(Supervisor),
    /// Send these bytes back.
    Echo(&'a [u8]),
    /// Nothing; the data is the link's.
    Null(&'a [u8]),
    /// Any other packet.
    Other {
        /// Port, 0 to 15.
        port: u8,
        /// Channel, 0 to 3.
        channel: u8,
        /// What it carries.
        data: &'a [u8],
    },
}

/// Where motion capture sees a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExternalPose {
    /// In the hall, z up.
    pub position_m: [f32; 3],
    /// Attitude, a unit quaternion with the real part last. The vehicle's axes are ours: x forward, y left, z
    /// up.
    pub orientation_xyzw: [f32; 4],
}

impl ExternalPose {
    /// The pose as it is sent, to the nearest `f32`.
    #[must_use]
    pub fn new(position_m: Vector<World>, orientation: Rotation<Body, World>) -> Self {
        let (Vector { x, y, z, .. }, q) = (position_m, orientation);
        Self {
            position_m: [x, y, z].map(|metres| metres as f32),
            orientation_xyzw: [q.x, q.y, q.z, q.w].map(|component| component as f32),
        }
    }
}

/// Why bytes are no packet, or a packet cannot become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CrtpError {
    /// No byte at all.
    Empty,
    /// More data than a packet can have.
    TooLong {
        /// Bytes of it.
        bytes: usize,
    },
    /// Data of another length than the packet's. The firmware halts on such a setpoint.
    Length {
        /// The packet's port.
        port: u8,
        /// The packet's channel.
        channel: u8,
        /// Bytes of its data.
        bytes: usize,
    },
    /// A field holds a value outside its list.
    Value {
        /// The field's name.
        field: &'static str,
        /// As received.
        value: u8,
    },
    /// A port above 15 or a channel above 3.
    Address {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
    },
    /// A quantity that is not a finite number is not sent.
    NotFinite,
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for CrtpError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "packet without a header"),
            Self::TooLong { bytes } => write!(f, "{bytes} bytes of data, at most {DATA_BYTES_MAX}"),
            Self::Length { port, channel, bytes } => {
                write!(f, "{bytes} bytes are not the length of this packet to port {port}, channel {channel}")
            }
            Self::Value { field, value } => write!(f, "value {value} of {field} outside its list"),
            Self::Address { port, channel } => write!(f, "no port {port} with a channel {channel}"),
            Self::NotFinite => write!(f, "not a finite number"),
            Self::NoRoom => write!(f, "buffer too short for the packet"),
        }
    }
}

impl core::error::Error for CrtpError {}

impl<'a> Packet<'a> {
    /// The packet that these bytes are: a datagram, or what a radio packet carries.
    ///
    /// # Errors
    /// [`CrtpError::Empty`], [`CrtpError::TooLong`], [`CrtpError::Length`] or [`CrtpError::Value`].
    pub fn decode(bytes: &'a [u8]) -> Result<Self, CrtpError> {
        let [header, data @ ..] = bytes else {
            return Err(CrtpError::Empty);
        };
        if data.len() > DATA_BYTES_MAX {
            return Err(CrtpError::TooLong { bytes: data.len() });
        }
        let (port, channel) = (header >> 4, header & CHANNEL_MAX);
        let length = CrtpError::Length { port, channel, bytes: data.len() };
        match (port, channel) {
            (PORT_CONSOLE, 0) => Ok(Self::Console(data)),
            (PORT_LOCALIZATION, LOCALIZATION_POSITION) => {
                let position_m = whole(data, Reader::f32s).ok_or(length)?;
                Ok(Self::ExternalPosition { position_m })
            }
            (PORT_LOCALIZATION, LOCALIZATION_GENERIC) => {
                let [id, data @ ..] = data else { return Err(length) };
                match *id {
                    GENERIC_EMERGENCY_STOP => Ok(Self::OldEmergencyStop),
                    GENERIC_WATCHDOG => Ok(Self::OldWatchdog),
                    GENERIC_POSE => read_pose(data).map(Self::ExternalPose).ok_or(length),
                    _ => Ok(Self::other(bytes, port, channel)),
                }
            }
            (PORT_SETPOINT, SETPOINT_GENERIC) => match Setpoint::read(data, length)? {
                Some(setpoint) => Ok(Self::Setpoint(setpoint)),
                None => Ok(Self::other(bytes, port, channel)),
            },
            (PORT_SETPOINT, SETPOINT_META) => match data {
                [META_RELEASE, hold @ ..] => {
                    let hold_ms = whole(hold, Reader::u32).ok_or(length)?;
                    Ok(Self::ReleaseSetpoints { hold_ms })
                }
                _ => Ok(Self::other(bytes, port, channel)),
            },
            (PORT_SUPERVISOR, _) => match Supervisor::read(channel, data, length)? {
                Some(message) => Ok(Self::Supervisor(message)),
                None => Ok(Self::other(bytes, port, channel)),
            },
            (PORT_LINK, LINK_ECHO) => Ok(Self::Echo(data)),
            (PORT_LINK, LINK_NULL) => Ok(Self::Null(data)),
            _ => Ok(Self::other(bytes, port, channel)),
        }
    }

    fn other(bytes: &'a [u8], port: u8, channel: u8) -> Self {
        Self::Other { port, channel, data: bytes.get(1..).unwrap_or(&[]) }
    }

    /// Writes the packet and answers its length, at most [`PACKET_BYTES_MAX`].
    ///
    /// # Errors
    /// [`CrtpError::NotFinite`] for a setpoint or a pose that is no number, [`CrtpError::Address`],
    /// [`CrtpError::TooLong`], [`CrtpError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, CrtpError> {
        let mut data = [0; DATA_BYTES_MAX];
        let mut writer = Writer::new(&mut data);
        let (port, channel) = self.write(&mut writer)?;
        if port > PORT_MAX || channel > CHANNEL_MAX {
            return Err(CrtpError::Address { port, channel });
        }
        let length = writer.finish().ok_or(CrtpError::TooLong { bytes: self.free_bytes() })?;
        let mut writer = Writer::new(out);
        writer.u8((port << 4) | HEADER_BITS | channel).bytes(&data[..length]);
        writer.finish().ok_or(CrtpError::NoRoom)
    }

    /// Writes the data and answers port and channel.
    fn write(&self, writer: &mut Writer<'_>) -> Result<(u8, u8), CrtpError> {
        Ok(match *self {
            Self::Console(text) => {
                writer.bytes(text);
                (PORT_CONSOLE, 0)
            }
            Self::ExternalPosition { position_m } => {
                writer.f32s(finite(&position_m)?);
                (PORT_LOCALIZATION, LOCALIZATION_POSITION)
            }
            Self::ExternalPose(ref pose) => {
                writer.u8(GENERIC_POSE).f32s(finite(&pose.position_m)?);
                writer.f32s(finite(&pose.orientation_xyzw)?);
                (PORT_LOCALIZATION, LOCALIZATION_GENERIC)
            }
            Self::OldEmergencyStop => {
                writer.u8(GENERIC_EMERGENCY_STOP);
                (PORT_LOCALIZATION, LOCALIZATION_GENERIC)
            }
            Self::OldWatchdog => {
                writer.u8(GENERIC_WATCHDOG);
                (PORT_LOCALIZATION, LOCALIZATION_GENERIC)
            }
            Self::Setpoint(ref setpoint) => {
                setpoint.write(writer)?;
                (PORT_SETPOINT, SETPOINT_GENERIC)
            }
            Self::ReleaseSetpoints { hold_ms } => {
                writer.u8(META_RELEASE).u32(hold_ms);
                (PORT_SETPOINT, SETPOINT_META)
            }
            Self::Supervisor(message) => (PORT_SUPERVISOR, message.write(writer)),
            Self::Echo(data) => {
                writer.bytes(data);
                (PORT_LINK, LINK_ECHO)
            }
            Self::Null(data) => {
                writer.bytes(data);
                (PORT_LINK, LINK_NULL)
            }
            Self::Other { port, channel, data } => {
                writer.bytes(data);
                (port, channel)
            }
        })
    }

    /// Bytes of the data that has no fixed length.
    const fn free_bytes(&self) -> usize {
        match self {
            Self::Console(data) | Self::Echo(data) | Self::Null(data) | Self::Other { data, .. } => {
                data.len()
            }
            _ => 0,
        }
    }
}

fn read_pose(data: &[u8]) -> Option<ExternalPose> {
    let mut reader = Reader::new(data);
    let pose = ExternalPose { position_m: reader.f32s()?, orientation_xyzw: reader.f32s()? };
    reader.rest().is_empty().then_some(pose)
}

/// Writes a packet of the data, port and channel that `write` gives, and answers its length.
fn write_packet(out: &mut [u8], write: impl FnOnce(&mut Writer<'_>) -> (u8, u8)) -> Result<usize, CrtpError> {
    let mut data = [0; DATA_BYTES_MAX];
    let mut writer = Writer::new(&mut data);
    let (port, channel) = write(&mut writer);
    let length = writer.finish().ok_or(CrtpError::TooLong { bytes: DATA_BYTES_MAX + 1 })?;
    let mut writer = Writer::new(out);
    writer.u8((port << 4) | HEADER_BITS | channel).bytes(&data[..length]);
    writer.finish().ok_or(CrtpError::NoRoom)
}

/// What `read` takes, if that is all there is.
fn whole<'a, T>(data: &'a [u8], read: impl FnOnce(&mut Reader<'a>) -> Option<T>) -> Option<T> {
    let mut reader = Reader::new(data);
    read(&mut reader).filter(|_| reader.rest().is_empty())
}

/// The numbers, if all of them are.
fn finite(numbers: &[f32]) -> Result<&[f32], CrtpError> {
    if numbers.iter().all(|number| number.is_finite()) { Ok(numbers) } else { Err(CrtpError::NotFinite) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn encoded(packet: &Packet<'_>) -> Vec<u8> {
        let mut out = [0xEE; PACKET_BYTES_MAX];
        let length = packet.encode(&mut out).unwrap();
        out[..length].to_vec()
    }

    fn check(packet: &Packet<'_>, hex: &str) {
        let bytes = from_hex(hex);
        assert_eq!(encoded(packet), bytes);
        assert_eq!(Packet::decode(&bytes), Ok(*packet));
    }

    #[test]
    fn golden_setpoint_both_ways() {
        let rates = Setpoint::Rates { roll_deg_s: 100.0, pitch_deg_s: -50.0, yaw_deg_s: 0.0, thrust: 36_000 };
        check(&Packet::Setpoint(rates), "7c 0b 0000c842 000048c2 00000000 a08c 01");
    }

    #[test]
    fn further_packets_both_ways() {
        // By hand from the firmware's structures.
        check(&Packet::Null(&[]), "ff");
        assert_eq!(encoded(&Packet::Null(&[])), NULL_PACKET);
        check(&Packet::Echo(&[1, 2]), "fc 0102");
        check(&Packet::Console(b"up"), "0c 7570");
        check(&Packet::ExternalPosition { position_m: [1.0, 2.0, 3.0] }, "6c 0000803f 00000040 00004040");
        let orientation_xyzw = [0.0, 0.0, 0.5, 1.0];
        let pose = ExternalPose { position_m: [1.0, 2.0, 3.0], orientation_xyzw };
        check(
            &Packet::ExternalPose(pose),
            "6d 08 0000803f 00000040 00004040 00000000 00000000 0000003f 0000803f",
        );
        check(&Packet::OldEmergencyStop, "6d 03");
        check(&Packet::OldWatchdog, "6d 04");
        check(&Packet::ReleaseSetpoints { hold_ms: 500 }, "7d 00 f4010000");
        check(&Packet::Other { port: 5, channel: 2, data: &[9] }, "5e 09");
        // Safelink: a null packet that says something to the radio.
        check(&Packet::Null(&[5, 1]), "ff 0501");
    }

    #[test]
    fn the_reserved_bits_of_a_header_do_not_matter() {
        for header in [0xF0, 0xF4, 0xF8, 0xFC] {
            assert_eq!(Packet::decode(&[header, 7]), Ok(Packet::Echo(&[7])));
        }
    }

    #[test]
    fn a_pose_is_that_of_the_hall() {
        let attitude = Rotation::from_yaw_pitch_roll(core::f64::consts::PI, 0.0, 0.0);
        let pose = ExternalPose::new(Vector::new(1.0, -2.0, 0.5), attitude);
        assert_eq!(pose.position_m, [1.0, -2.0, 0.5]);
        assert!((pose.orientation_xyzw[2] - 1.0).abs() < 1e-7);
    }

    #[test]
    fn packets_of_another_length_are_refused() {
        for hex in ["7c0b0000c842000048c200000000a08c01", "6c0000803f0000004000004040", "7d00f4010000"] {
            let mut bytes = from_hex(hex);
            for length in 2..bytes.len() {
                let error = Packet::decode(&bytes[..length]).unwrap_err();
                assert!(matches!(error, CrtpError::Length { bytes, .. } if bytes == length - 1));
            }
            bytes.push(0);
            assert!(matches!(Packet::decode(&bytes), Err(CrtpError::Length { .. })));
        }
        assert_eq!(Packet::decode(&[]), Err(CrtpError::Empty));
        assert_eq!(Packet::decode(&[0; 32]), Err(CrtpError::TooLong { bytes: 31 }));
        let empty = CrtpError::Length { port: 7, channel: 0, bytes: 0 };
        assert_eq!(Packet::decode(&[0x7C]), Err(empty));
    }

    #[test]
    fn what_cannot_be_sent_is_an_error() {
        let mut out = [0; PACKET_BYTES_MAX];
        for bad in [f32::NAN, f32::INFINITY] {
            let pose = ExternalPose { position_m: [0.0, bad, 0.0], ..ExternalPose::default() };
            assert_eq!(Packet::ExternalPose(pose).encode(&mut out), Err(CrtpError::NotFinite));
            let position = Packet::ExternalPosition { position_m: [bad, 0.0, 0.0] };
            assert_eq!(position.encode(&mut out), Err(CrtpError::NotFinite));
        }
        assert_eq!(Packet::Echo(&[0; 31]).encode(&mut out), Err(CrtpError::TooLong { bytes: 31 }));
        for (port, channel) in [(16, 0), (0, 4)] {
            let packet = Packet::Other { port, channel, data: &[] };
            assert_eq!(packet.encode(&mut out), Err(CrtpError::Address { port, channel }));
        }
        assert_eq!(Packet::Echo(&[0; 30]).encode(&mut out[1..]), Err(CrtpError::NoRoom));
    }

    proptest! {
        #[test]
        fn any_packet_that_decodes_encodes_to_the_same_bytes(
            header: u8, id in 0u8..16, data in prop::collection::vec(any::<u8>(), 0..DATA_BYTES_MAX),
        ) {
            let bytes: Vec<u8> = [header | HEADER_BITS, id].into_iter().chain(data).collect();
            if let Ok(packet) = Packet::decode(&bytes) {
                let mut out = [0; PACKET_BYTES_MAX];
                match packet.encode(&mut out) {
                    Ok(length) => {
                        // Commands without fields take no notice of what follows their number.
                        prop_assert!(bytes.starts_with(&out[..length]));
                        prop_assert!(Packet::decode(&out[..length]).is_ok());
                    }
                    Err(error) => prop_assert_eq!(error, CrtpError::NotFinite),
                }
            }
        }
    }
}
