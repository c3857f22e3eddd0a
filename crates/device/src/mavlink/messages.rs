//! What the frames say.

use super::{
    AttitudeTarget, ChannelsOverride, Frame, Header, ManualControl, MavlinkError, PAYLOAD_BYTES_MAX,
    ParamSet, ParamValue, parameters, setpoints,
};
use crate::bytes::{Reader, Writer};

pub(super) const ID_HEARTBEAT: u32 = 0;
pub(super) const ID_TIMESYNC: u32 = 111;

/// One message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message<'a> {
    /// 0: here I am, once a second.
    Heartbeat(Heartbeat),
    /// 22: what a parameter is; also the acknowledgement of a [`Message::ParamSet`].
    ParamValue(ParamValue),
    /// 23: give a parameter a value.
    ParamSet(ParamSet),
    /// 69: a pilot's sticks.
    ManualControl(ManualControl),
    /// 70: channels in place of those of the vehicle's own receiver.
    ChannelsOverride(ChannelsOverride),
    /// 82: attitude, or body rates, and thrust.
    SetAttitudeTarget(AttitudeTarget),
    /// 111: a clock probe, or its answer.
    TimeSync(TimeSync),
    /// Any other message whose check is known.
    Other {
        /// Its number.
        id: u32,
        /// Its payload without trailing zeros.
        payload: &'a [u8],
    },
}

/// Here I am.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heartbeat {
    /// The autopilot's own idea of its mode.
    pub custom_mode: u32,
    /// What it is: 2 a quadrotor, 6 a ground station.
    pub kind: u8,
    /// Which autopilot: 3 ArduPilot, 8 none, 12 PX4.
    pub autopilot: u8,
    /// A bit each; see [`Heartbeat::ARMED`].
    pub base_mode: u8,
    /// 3 standby, 4 active, 5 critical, 6 emergency.
    pub system_status: u8,
    /// Version of the protocol, 3.
    pub version: u8,
}

impl Heartbeat {
    /// Bit of the base mode: motors may turn.
    pub const ARMED: u8 = 128;

    /// A ground station's.
    pub const GROUND_STATION: Self =
        Self { custom_mode: 0, kind: 6, autopilot: 8, base_mode: 0, system_status: 4, version: 3 };
}

/// A clock probe, or its answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeSync {
    /// When it was answered, on the answerer's clock; zero in a probe.
    pub answered_ns: i64,
    /// When it was asked, on the asker's clock; given back in the answer.
    pub asked_ns: i64,
    /// The system it is for, zero for all. An answer without it cannot be told from another's.
    pub target_system: u8,
    /// The component it is for, zero for all.
    pub target_component: u8,
}

impl<'a> Message<'a> {
    /// The message of that number with that payload, whose trimmed zeros are put back.
    pub(super) fn read(id: u32, payload: &'a [u8]) -> Self {
        let mut whole = [0; PAYLOAD_BYTES_MAX];
        for (place, byte) in whole.iter_mut().zip(payload) {
            *place = *byte;
        }
        Self::read_whole(id, &whole).unwrap_or(Self::Other { id, payload: trimmed(payload) })
    }

    /// `None` for a message that has no form of its own here. No form is longer than what is given.
    fn read_whole(id: u32, payload: &[u8; PAYLOAD_BYTES_MAX]) -> Option<Self> {
        let reader = &mut Reader::new(payload);
        Some(match id {
            ID_HEARTBEAT => Self::Heartbeat(Heartbeat::read(reader)?),
            parameters::ID_PARAM_VALUE => Self::ParamValue(ParamValue::read(reader)?),
            parameters::ID_PARAM_SET => Self::ParamSet(ParamSet::read(reader)?),
            setpoints::ID_MANUAL_CONTROL => Self::ManualControl(ManualControl::read(reader)?),
            setpoints::ID_RC_CHANNELS_OVERRIDE => Self::ChannelsOverride(ChannelsOverride::read(reader)?),
            setpoints::ID_SET_ATTITUDE_TARGET => Self::SetAttitudeTarget(AttitudeTarget::read(reader)?),
            ID_TIMESYNC => Self::TimeSync(TimeSync::read(reader)?),
            _ => return None,
        })
    }

    /// The message as a frame of `header`'s sender, unsigned, whose payload stands in `payload`.
    ///
    /// # Errors
    /// [`MavlinkError::Value`] or [`MavlinkError::NotFinite`] for a setpoint that must not be sent,
    /// [`MavlinkError::TooLong`].
    pub fn frame<'p>(
        &self,
        header: Header,
        payload: &'p mut [u8; PAYLOAD_BYTES_MAX],
    ) -> Result<Frame<'p>, MavlinkError> {
        let mut writer = Writer::new(payload);
        let message_id = match self {
            Self::Heartbeat(heartbeat) => heartbeat.write(&mut writer),
            Self::ParamValue(value) => value.write(&mut writer),
            Self::ParamSet(set) => set.write(&mut writer),
            Self::ManualControl(control) => control.write(&mut writer),
            Self::ChannelsOverride(channels) => channels.write(&mut writer),
            Self::SetAttitudeTarget(target) => target.write(&mut writer)?,
            Self::TimeSync(sync) => sync.write(&mut writer),
            Self::Other { id, payload } => {
                // The first byte stays, whatever it is.
                writer.bytes(if payload.is_empty() { &[0] } else { payload });
                *id
            }
        };
        let length = writer.finish().ok_or(MavlinkError::TooLong { bytes: self.payload_bytes() })?;
        let sent = trimmed(&payload[..length]).len().max(1);
        let payload = &payload[..sent];
        Ok(Frame { header, compatibility_flags: 0, message_id, payload, signature: None })
    }

    /// Bytes of the payload that has no fixed length.
    const fn payload_bytes(&self) -> usize {
        match self {
            Self::Other { payload, .. } => payload.len(),
            _ => 0,
        }
    }
}

/// Without its trailing zeros.
fn trimmed(payload: &[u8]) -> &[u8] {
    let length = payload.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    &payload[..length]
}

impl Heartbeat {
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            custom_mode: reader.u32()?,
            kind: reader.u8()?,
            autopilot: reader.u8()?,
            base_mode: reader.u8()?,
            system_status: reader.u8()?,
            version: reader.u8()?,
        })
    }

    fn write(&self, writer: &mut Writer<'_>) -> u32 {
        writer.u32(self.custom_mode).u8(self.kind).u8(self.autopilot).u8(self.base_mode);
        writer.u8(self.system_status).u8(self.version);
        ID_HEARTBEAT
    }
}

impl TimeSync {
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            answered_ns: reader.i64()?,
            asked_ns: reader.i64()?,
            target_system: reader.u8()?,
            target_component: reader.u8()?,
        })
    }

    fn write(&self, writer: &mut Writer<'_>) -> u32 {
        writer.i64(self.answered_ns).i64(self.asked_ns);
        writer.u8(self.target_system).u8(self.target_component);
        ID_TIMESYNC
    }
}
