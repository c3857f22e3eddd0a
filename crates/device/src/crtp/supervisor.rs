//! The supervisor: arming, stopping, and how the vehicle fares.
//!
//! | Channel | Bytes | Message |
//! | --- | --- | --- |
//! | 0 | `0C` | say your state |
//! | 0 | `8C`, u16 | the state |
//! | 1 | `01`, u8 | arm (1) or disarm (0) |
//! | 1 | `02` | recover from a crash |
//! | 1 | `03` | emergency stop, latched until the vehicle is restarted |
//! | 1 | `04` | stop unless this comes again within a second; begins with the first |
//! | 1 | `80` + command, u8, u8 | whether it was done, and whether the vehicle is now armed (or recovered) |

use super::{CrtpError, whole};
use crate::bytes::{Reader, Writer};

const CHANNEL_INFO: u8 = 0;
const CHANNEL_COMMAND: u8 = 1;

const INFO_STATE: u8 = 0x0C;
const COMMAND_ARM: u8 = 0x01;
const COMMAND_RECOVER: u8 = 0x02;
const COMMAND_STOP: u8 = 0x03;
const COMMAND_WATCHDOG: u8 = 0x04;
const ANSWER: u8 = 0x80;

/// A message to or from the vehicle's supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supervisor {
    /// Say your state.
    RequestState,
    /// How the vehicle fares.
    State(SupervisorState),
    /// Arm, or disarm.
    Arm(bool),
    /// Recover from a crash.
    Recover,
    /// Emergency stop: motors off now, latched until the vehicle is restarted.
    Stop,
    /// Stop unless this comes again within a second.
    Watchdog,
    /// What became of a command.
    Answer {
        /// Its number.
        command: u8,
        /// Whether it was done.
        done: bool,
        /// What it was about: whether the vehicle is armed, or no longer crashed.
        holds: bool,
    },
}

/// How a vehicle fares, a bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SupervisorState(pub u16);

impl SupervisorState {
    /// Bit: it would obey an order to arm.
    pub const CAN_BE_ARMED: u16 = 1 << 0;
    /// Bit: it is armed.
    pub const ARMED: u16 = 1 << 1;
    /// Bit: it arms by itself.
    pub const ARMS_ITSELF: u16 = 1 << 2;
    /// Bit: it is ready to fly.
    pub const CAN_FLY: u16 = 1 << 3;
    /// Bit: it flies.
    pub const FLYING: u16 = 1 << 4;
    /// Bit: it lies on its back.
    pub const TUMBLED: u16 = 1 << 5;
    /// Bit: it must be restarted.
    pub const LOCKED: u16 = 1 << 6;
    /// Bit: it has crashed.
    pub const CRASHED: u16 = 1 << 7;

    /// Whether all of these bits are set.
    #[must_use]
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }
}

impl Supervisor {
    /// The message in a packet's data; `None` for one that is not listed here.
    pub(super) fn read(channel: u8, data: &[u8], length: CrtpError) -> Result<Option<Self>, CrtpError> {
        let [number, fields @ ..] = data else { return Err(length) };
        Ok(Some(match (channel, *number) {
            (CHANNEL_INFO, INFO_STATE) => Self::RequestState,
            (CHANNEL_INFO, number) if number == ANSWER | INFO_STATE => {
                Self::State(SupervisorState(whole(fields, Reader::u16).ok_or(length)?))
            }
            (CHANNEL_COMMAND, COMMAND_ARM) => {
                Self::Arm(flag("arm", whole(fields, Reader::u8).ok_or(length)?)?)
            }
            (CHANNEL_COMMAND, COMMAND_RECOVER) => Self::Recover,
            (CHANNEL_COMMAND, COMMAND_STOP) => Self::Stop,
            (CHANNEL_COMMAND, COMMAND_WATCHDOG) => Self::Watchdog,
            (CHANNEL_COMMAND, number) if number & ANSWER != 0 => {
                let [done, holds] = whole(fields, Reader::array).ok_or(length)?;
                let (done, holds) = (flag("done", done)?, flag("holds", holds)?);
                Self::Answer { command: number & !ANSWER, done, holds }
            }
            _ => return Ok(None),
        }))
    }

    /// Writes the data and answers the channel.
    pub(super) fn write(self, writer: &mut Writer<'_>) -> u8 {
        match self {
            Self::RequestState => {
                writer.u8(INFO_STATE);
                return CHANNEL_INFO;
            }
            Self::State(SupervisorState(bits)) => {
                writer.u8(ANSWER | INFO_STATE).u16(bits);
                return CHANNEL_INFO;
            }
            Self::Arm(arm) => writer.u8(COMMAND_ARM).u8(u8::from(arm)),
            Self::Recover => writer.u8(COMMAND_RECOVER),
            Self::Stop => writer.u8(COMMAND_STOP),
            Self::Watchdog => writer.u8(COMMAND_WATCHDOG),
            Self::Answer { command, done, holds } => {
                writer.u8(ANSWER | command).u8(u8::from(done)).u8(u8::from(holds))
            }
        };
        CHANNEL_COMMAND
    }
}

fn flag(field: &'static str, value: u8) -> Result<bool, CrtpError> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        value => Err(CrtpError::Value { field, value }),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PACKET_BYTES_MAX, Packet};
    use super::*;
    use crate::bytes::from_hex;

    #[test]
    fn messages_both_ways() {
        let state = SupervisorState(SupervisorState::CAN_FLY | SupervisorState::ARMED | 0x0400);
        for (message, hex) in [
            (Supervisor::RequestState, "9c 0c"),
            (Supervisor::State(state), "9c 8c 0a04"),
            (Supervisor::Arm(true), "9d 01 01"),
            (Supervisor::Arm(false), "9d 01 00"),
            (Supervisor::Recover, "9d 02"),
            (Supervisor::Stop, "9d 03"),
            (Supervisor::Watchdog, "9d 04"),
            (Supervisor::Answer { command: 1, done: true, holds: false }, "9d 81 01 00"),
        ] {
            let (bytes, mut out) = (from_hex(hex), [0; PACKET_BYTES_MAX]);
            let length = Packet::Supervisor(message).encode(&mut out).unwrap();
            assert_eq!(out[..length], bytes);
            assert_eq!(Packet::decode(&bytes), Ok(Packet::Supervisor(message)));
        }
        assert!(state.has(SupervisorState::ARMED) && !state.has(SupervisorState::LOCKED));
    }

    #[test]
    fn a_stop_is_a_stop_whatever_follows_it() {
        assert_eq!(Packet::decode(&[0x9D, 3, 1, 2, 3]), Ok(Packet::Supervisor(Supervisor::Stop)));
        assert_eq!(Packet::decode(&[0x6D, 3, 1, 2, 3]), Ok(Packet::OldEmergencyStop));
    }

    #[test]
    fn what_is_no_message_is_an_error() {
        assert_eq!(Packet::decode(&[0x9D, 1, 7]), Err(CrtpError::Value { field: "arm", value: 7 }));
        let short = CrtpError::Length { port: 9, channel: 1, bytes: 1 };
        assert_eq!(Packet::decode(&[0x9D, 1]), Err(short));
        let long = CrtpError::Length { port: 9, channel: 0, bytes: 4 };
        assert_eq!(Packet::decode(&[0x9C, 0x8C, 0, 0, 0]), Err(long));
        let other = Packet::Other { port: 9, channel: 0, data: &[5] };
        assert_eq!(Packet::decode(&[0x9C, 5]), Ok(other));
    }
}
