//! From the vehicle to the bridge: its whole state, answers to clock probes, the state of an upload.
//!
//! | Type | Message | Body |
//! | --- | --- | --- |
//! | 81 | Status | the fields of [`Status`] in order, 53 bytes |
//! | 82 | Pong | token u16, received µs u64, turnaround µs u32 |
//! | 83 | UploadReply | set id u16, state u8, received mask u32, digest u64, reason u8 |

use super::LinkError;
use super::payload::{finish, open, seal};
use crate::bytes::{Reader, Writer};

/// What the firmware is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum FlightMode {
    /// Motors off, waiting.
    #[default]
    Disarmed = 0,
    /// Flies the commands it receives.
    Flying = 1,
    /// Flies a maneuver from its stored parameters and ignores commands.
    Maneuver = 2,
    /// Holds level at hover thrust: the link is lost, or a maneuver was ended early.
    LevelHold = 3,
    /// Descends level: the link has been lost for longer, or it was told to.
    Descend = 4,
    /// Motors off after a landing nobody ordered; latched.
    Landed = 5,
    /// Motors off by emergency stop or a fault nothing can fly with; latched.
    Stopped = 6,
}

/// How far the last maneuver got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum ManeuverPhase {
    /// None was ordered since the vehicle started.
    #[default]
    None = 0,
    /// It runs.
    Running = 1,
    /// It ran to its planned end.
    Completed = 2,
    /// It was ended early.
    Aborted = 3,
    /// It was not begun.
    Refused = 4,
}

/// Why a maneuver was refused or ended early, or an upload refused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
#[non_exhaustive]
pub enum Reason {
    /// Nothing to say.
    #[default]
    None = 0,
    /// Not armed and flying.
    NotFlying = 1,
    /// The newest command is too old.
    CommandStale = 2,
    /// The set or the digest named is not the active one.
    WrongSet = 3,
    /// The set is no flip, or outside the vehicle's own limits.
    OutsideLimits = 4,
    /// Battery below the limit for a flip.
    BatteryLow = 5,
    /// Too low.
    Height = 6,
    /// Tilted too far.
    Tilt = 7,
    /// Climbing or sinking too fast.
    VerticalSpeed = 8,
    /// Attitude or height not known on board.
    StateUnknown = 9,
    /// Ended by an abort message.
    AbortOrdered = 16,
    /// A body rate left its bounds.
    RateExceeded = 17,
    /// The rate did not follow its command.
    RateNotFollowed = 18,
    /// A sensor gave no usable number.
    SensorFault = 19,
    /// Ended by an emergency stop.
    Stopped = 20,
    /// It took longer than any maneuver may.
    TooLong = 21,
    /// A maneuver runs; the active set stays.
    Busy = 32,
    /// The digest over the items is not the one announced.
    DigestMismatch = 33,
    /// Nothing was announced under this identity.
    NotBegun = 34,
}

/// What has become of an upload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum UploadState {
    /// Announced; items may still be missing.
    #[default]
    Staging = 0,
    /// It is the active set.
    Committed = 1,
    /// It was thrown away; the reason says why.
    Refused = 2,
}

macro_rules! from_byte {
    ($type:ident, $field:literal, [$($variant:ident),+ $(,)?]) => {
        impl $type {
            /// The value a byte of the link stands for.
            ///
            /// # Errors
            /// [`LinkError::UnknownValue`] for a byte that stands for none.
            pub const fn from_byte(byte: u8) -> Result<Self, LinkError> {
                $(if byte == Self::$variant as u8 {
                    return Ok(Self::$variant);
                })+
                Err(LinkError::UnknownValue { field: $field })
            }
        }
    };
}

from_byte!(FlightMode, "mode", [Disarmed, Flying, Maneuver, LevelHold, Descend, Landed, Stopped]);
from_byte!(ManeuverPhase, "maneuver phase", [None, Running, Completed, Aborted, Refused]);
from_byte!(UploadState, "upload state", [Staging, Committed, Refused]);
from_byte!(
    Reason,
    "reason",
    [
        None,
        NotFlying,
        CommandStale,
        WrongSet,
        OutsideLimits,
        BatteryLow,
        Height,
        Tilt,
        VerticalSpeed,
        StateUnknown,
        AbortOrdered,
        RateExceeded,
        RateNotFollowed,
        SensorFault,
        Stopped,
        TooLong,
        Busy,
        DigestMismatch,
        NotBegun,
    ]
);

/// Conditions that hold at the moment of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct StatusFlags(u8);

impl StatusFlags {
    /// Motors are off until a person re-arms.
    pub const LATCHED: Self = Self(1);
    /// The latch, or the last one, is that of an emergency stop.
    pub const EMERGENCY_STOP: Self = Self(2);
    /// A sensor gave numbers that were refused.
    pub const SENSOR_FAULT: Self = Self(4);
    /// Battery below the limit for a flip.
    pub const BATTERY_LOW: Self = Self(8);
    /// The vehicle knows its tilt.
    pub const ATTITUDE_KNOWN: Self = Self(16);
    /// The vehicle knows its height.
    pub const HEIGHT_KNOWN: Self = Self(32);
    /// The newest command is over 60 ms old.
    pub const COMMAND_STALE: Self = Self(64);

    /// All of both.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// All of `self`, and `other` where `condition` holds.
    #[must_use]
    pub const fn with_if(self, condition: bool, other: Self) -> Self {
        if condition { self.with(other) } else { self }
    }

    /// Whether all of `other` hold.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// As the link carries them.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// From the link's byte; bits without a meaning are kept.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }
}

/// Everything the ground may want to know of the vehicle. Times are on the vehicle's own clock, which starts
/// with the vehicle; zero stands for "never".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// When the report was made.
    pub uptime_us: u64,
    /// What the firmware is doing.
    pub mode: FlightMode,
    /// Battery voltage, averaged over a second outside maneuvers.
    pub battery_mv: u16,
    /// The active parameter set; zero for none.
    pub set_id: u16,
    /// Its digest, as computed on board.
    pub set_digest: u64,
    /// The last maneuver begun or refused; zero for none.
    pub maneuver_id: u16,
    /// How far it got.
    pub maneuver_phase: ManeuverPhase,
    /// Why it was refused or ended early.
    pub reason: Reason,
    /// When it began.
    pub began_us: u64,
    /// When it ended.
    pub ended_us: u64,
    /// Age of the newest accepted command, saturating.
    pub command_age_ms: u16,
    /// Counter of the newest accepted command.
    pub command_counter: u8,
    /// When the newest accepted command arrived.
    pub command_received_us: u64,
    /// Conditions.
    pub flags: StatusFlags,
}

/// The state of the upload spoken of last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UploadReply {
    /// The set.
    pub set_id: u16,
    /// What has become of it.
    pub state: UploadState,
    /// A bit per item received, the first item lowest.
    pub received_mask: u32,
    /// While staging the digest announced; of a committed set the digest computed over its items.
    pub digest: u64,
    /// Why it was refused, or a commit had no effect.
    pub reason: Reason,
}

/// A message from the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Downlink {
    /// Its whole state.
    Status(Status),
    /// The answer to a [`Ping`](super::Uplink::Ping).
    Pong {
        /// The ping's.
        token: u16,
        /// When the ping arrived, on the vehicle's clock.
        received_us: u64,
        /// From the ping's arrival to this answer being handed to the radio.
        turnaround_us: u32,
    },
    /// The state of an upload.
    UploadReply(UploadReply),
}

impl Downlink {
    /// Writes the payload of `vehicle` and answers its length.
    ///
    /// # Errors
    /// [`LinkError::NoRoom`] where `out` is too short.
    pub fn encode(&self, vehicle: u8, out: &mut [u8]) -> Result<usize, LinkError> {
        let kind = match self {
            Self::Status(_) => 0x81,
            Self::Pong { .. } => 0x82,
            Self::UploadReply(_) => 0x83,
        };
        seal(out, kind, vehicle, |writer| match self {
            Self::Status(status) => status.write(writer),
            Self::Pong { token, received_us, turnaround_us } => {
                writer.u16(*token).u64(*received_us).u32(*turnaround_us);
            }
            Self::UploadReply(reply) => {
                writer.u16(reply.set_id).u8(reply.state as u8).u32(reply.received_mask);
                writer.u64(reply.digest).u8(reply.reason as u8);
            }
        })
    }

    /// The vehicle that sent it and the message.
    ///
    /// # Errors
    /// Length, checksum, unknown type, or a value that stands for nothing.
    pub fn decode(bytes: &[u8]) -> Result<(u8, Self), LinkError> {
        let (kind, vehicle, mut reader) = open(bytes)?;
        let message = match kind {
            0x81 => Status::read(&mut reader).transpose()?.map(Self::Status),
            0x82 => Self::read_pong(&mut reader),
            0x83 => UploadReply::read(&mut reader).transpose()?.map(Self::UploadReply),
            other => return Err(LinkError::UnknownType(other)),
        };
        finish(message, &reader, bytes).map(|message| (vehicle, message))
    }

    fn read_pong(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self::Pong { token: reader.u16()?, received_us: reader.u64()?, turnaround_us: reader.u32()? })
    }
}

impl Status {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.u64(self.uptime_us).u8(self.mode as u8).u16(self.battery_mv);
        writer.u16(self.set_id).u64(self.set_digest);
        writer.u16(self.maneuver_id).u8(self.maneuver_phase as u8).u8(self.reason as u8);
        writer.u64(self.began_us).u64(self.ended_us);
        writer.u16(self.command_age_ms).u8(self.command_counter).u64(self.command_received_us);
        writer.u8(self.flags.bits());
    }

    /// `None` where bytes are missing, an error where one stands for nothing.
    fn read(reader: &mut Reader<'_>) -> Option<Result<Self, LinkError>> {
        let (uptime_us, mode, battery_mv) = (reader.u64()?, reader.u8()?, reader.u16()?);
        let (set_id, set_digest) = (reader.u16()?, reader.u64()?);
        let (maneuver_id, phase, reason) = (reader.u16()?, reader.u8()?, reader.u8()?);
        let (began_us, ended_us) = (reader.u64()?, reader.u64()?);
        let (command_age_ms, command_counter) = (reader.u16()?, reader.u8()?);
        let (command_received_us, flags) = (reader.u64()?, reader.u8()?);
        let typed = || {
            Ok(Self {
                uptime_us,
                mode: FlightMode::from_byte(mode)?,
                battery_mv,
                set_id,
                set_digest,
                maneuver_id,
                maneuver_phase: ManeuverPhase::from_byte(phase)?,
                reason: Reason::from_byte(reason)?,
                began_us,
                ended_us,
                command_age_ms,
                command_counter,
                command_received_us,
                flags: StatusFlags::from_bits(flags),
            })
        };
        Some(typed())
    }
}

impl UploadReply {
    /// `None` where bytes are missing, an error where one stands for nothing.
    fn read(reader: &mut Reader<'_>) -> Option<Result<Self, LinkError>> {
        let (set_id, state, received_mask) = (reader.u16()?, reader.u8()?, reader.u32()?);
        let (digest, reason) = (reader.u64()?, reader.u8()?);
        let typed = || {
            Ok(Self {
                set_id,
                state: UploadState::from_byte(state)?,
                received_mask,
                digest,
                reason: Reason::from_byte(reason)?,
            })
        };
        Some(typed())
    }
}

#[cfg(test)]
mod tests {
    use super::super::PAYLOAD_BYTES_MAX;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn encoded(message: &Downlink, vehicle: u8) -> Vec<u8> {
        let mut out = [0; PAYLOAD_BYTES_MAX];
        let length = message.encode(vehicle, &mut out).unwrap();
        out[..length].to_vec()
    }

    /// Worked out with a separate program from the table above and the catalogue's CRC-16/IBM-3740.
    #[test]
    fn golden_payloads_both_ways() {
        let digest = 0x1122_3344_5566_7788;
        let status = Status {
            uptime_us: 12_345_678,
            mode: FlightMode::LevelHold,
            battery_mv: 11_100,
            set_id: 513,
            set_digest: digest,
            maneuver_id: 7,
            maneuver_phase: ManeuverPhase::Aborted,
            reason: Reason::AbortOrdered,
            began_us: 9_000_000,
            ended_us: 9_500_000,
            command_age_ms: 101,
            command_counter: 31,
            command_received_us: 12_244_678,
            flags: StatusFlags::EMERGENCY_STOP
                .with(StatusFlags::ATTITUDE_KNOWN)
                .with(StatusFlags::COMMAND_STALE),
        };
        let reply = UploadReply {
            set_id: 513,
            state: UploadState::Refused,
            received_mask: 0x3FF,
            digest,
            reason: Reason::DigestMismatch,
        };
        let pong = Downlink::Pong { token: 0xBEEF, received_us: 12_000_000, turnaround_us: 1_250 };
        let golden = [
            (
                Downlink::Status(status),
                "81034e61bc0000000000035c2b0102887766554433221107000310405489000000000060f59000000000\
                 0065001fc6d6ba0000000000525890",
            ),
            (pong, "8203efbe001bb70000000000e204000047de"),
            (Downlink::UploadReply(reply), "8303010202ff030000887766554433221121b193"),
        ];
        for (message, hex) in golden {
            let bytes = crate::bytes::from_hex(hex);
            assert_eq!(encoded(&message, 3), bytes);
            assert_eq!(Downlink::decode(&bytes), Ok((3, message)));
        }
    }

    #[test]
    fn a_mode_that_does_not_exist_is_refused() {
        let mut bytes = encoded(&Downlink::Status(Status::default()), 1);
        bytes[10] = 7;
        let end = bytes.len() - 2;
        let check = crate::crc::crc16(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&check);
        assert_eq!(Downlink::decode(&bytes), Err(LinkError::UnknownValue { field: "mode" }));
    }

    #[test]
    fn bytes_and_reasons_agree() {
        let known: Vec<u8> = (0..=255u8).filter(|byte| Reason::from_byte(*byte).is_ok()).collect();
        assert_eq!(known, (0..10).chain(16..22).chain(32..35).collect::<Vec<u8>>());
        for byte in known {
            assert_eq!(Reason::from_byte(byte).map(|reason| reason as u8), Ok(byte));
        }
    }

    fn any_downlink() -> impl Strategy<Value = Downlink> {
        prop_oneof![
            any::<((u64, u16, u16, u64, u16), (u64, u64, u16, u8, u64, u8), (u8, u8, u8))>().prop_map(
                |(
                    (uptime_us, battery_mv, set_id, set_digest, maneuver_id),
                    (began_us, ended_us, command_age_ms, command_counter, command_received_us, flags),
                    (mode, phase, reason),
                )| {
                    Downlink::Status(Status {
                        uptime_us,
                        mode: FlightMode::from_byte(mode % 7).unwrap(),
                        battery_mv,
                        set_id,
                        set_digest,
                        maneuver_id,
                        maneuver_phase: ManeuverPhase::from_byte(phase % 5).unwrap(),
                        reason: Reason::from_byte(reason % 10).unwrap(),
                        began_us,
                        ended_us,
                        command_age_ms,
                        command_counter,
                        command_received_us,
                        flags: StatusFlags::from_bits(flags),
                    })
                }
            ),
            any::<(u16, u64, u32)>().prop_map(|(token, received_us, turnaround_us)| Downlink::Pong {
                token,
                received_us,
                turnaround_us
            }),
            any::<(u16, u8, u32, u64, u8)>().prop_map(|(set_id, state, received_mask, digest, reason)| {
                Downlink::UploadReply(UploadReply {
                    set_id,
                    state: UploadState::from_byte(state % 3).unwrap(),
                    received_mask,
                    digest,
                    reason: Reason::from_byte(32 + reason % 3).unwrap(),
                })
            }),
        ]
    }

    proptest! {
        #[test]
        fn round_trip_in_bounds(message in any_downlink(), vehicle: u8) {
            let bytes = encoded(&message, vehicle);
            prop_assert!(bytes.len() <= PAYLOAD_BYTES_MAX);
            prop_assert_eq!(Downlink::decode(&bytes), Ok((vehicle, message)));
        }

        #[test]
        fn a_wrong_byte_is_refused(message in any_downlink(), at: prop::sample::Index, flip in 1u8..=255) {
            let mut bytes = encoded(&message, 9);
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            prop_assert!(Downlink::decode(&bytes).is_err());
        }

        #[test]
        fn any_bytes_decode_or_are_refused(
            mut bytes in prop::collection::vec(any::<u8>(), 0..120), seal: bool,
        ) {
            if seal && bytes.len() >= 2 {
                let end = bytes.len() - 2;
                bytes[0] = 0x80 | (bytes[0] % 5);
                let check = crate::crc::crc16(&bytes[..end]).to_le_bytes();
                bytes[end..].copy_from_slice(&check);
            }
            let _ = Downlink::decode(&bytes);
        }
    }
}
