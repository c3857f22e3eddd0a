//! What an autopilot shall do: sticks, channels, attitudes and rates.

use quantity::{Body, Rotation, Vector, World};

use super::{MavlinkError, attitude_to_frd_ned, body_to_frd, frd_ned_to_attitude, frd_to_body};
use crate::bytes::{Reader, Writer};

pub(super) const ID_MANUAL_CONTROL: u32 = 69;
pub(super) const ID_RC_CHANNELS_OVERRIDE: u32 = 70;
pub(super) const ID_SET_ATTITUDE_TARGET: u32 = 82;

/// A pilot's sticks, -1000 to 1000 each; 32 767 for an axis that is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ManualControl {
    /// Forward.
    pub x: i16,
    /// To the right.
    pub y: i16,
    /// Thrust; many vehicles take 0 to 1000 only.
    pub z: i16,
    /// Clockwise from above.
    pub r: i16,
    /// A bit for each button that is pressed.
    pub buttons: u16,
    /// The system it is for.
    pub target_system: u8,
}

impl ManualControl {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            x: reader.i16()?,
            y: reader.i16()?,
            z: reader.i16()?,
            r: reader.i16()?,
            buttons: reader.u16()?,
            target_system: reader.u8()?,
        })
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u32 {
        writer.i16(self.x).i16(self.y).i16(self.z).i16(self.r);
        writer.u16(self.buttons).u8(self.target_system);
        ID_MANUAL_CONTROL
    }
}

/// Channels in place of those of the vehicle's own receiver.
///
/// Of the first eight, 65 535 leaves a channel as it is and 0 gives it back to the receiver; of the others, 0
/// and 65 535 leave it, and 65 534 gives it back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChannelsOverride {
    /// Pulses, commonly 1000 to 2000 µs.
    pub channels_us: [u16; 18],
    /// The system it is for.
    pub target_system: u8,
    /// The component it is for.
    pub target_component: u8,
}

/// Channels in front of the two bytes that say whom it is for.
const CHANNELS_IN_FRONT: usize = 8;

impl ChannelsOverride {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let mut read = Self::default();
        let (front, back) = read.channels_us.split_at_mut(CHANNELS_IN_FRONT);
        for channel in front {
            *channel = reader.u16()?;
        }
        (read.target_system, read.target_component) = (reader.u8()?, reader.u8()?);
        for channel in back {
            *channel = reader.u16()?;
        }
        Some(read)
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u32 {
        let (front, back) = self.channels_us.split_at(CHANNELS_IN_FRONT);
        front.iter().for_each(|channel| {
            writer.u16(*channel);
        });
        writer.u8(self.target_system).u8(self.target_component);
        back.iter().for_each(|channel| {
            writer.u16(*channel);
        });
        ID_RC_CHANNELS_OVERRIDE
    }
}

/// An attitude or body rates, and thrust; in the autopilot's axes (see [`AttitudeTarget::rates`] for ours).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeTarget {
    /// The sender's clock.
    pub since_boot_ms: u32,
    /// From forward, right, down to north, east, down; real part first.
    pub orientation_wxyz: [f32; 4],
    /// About forward, right and down.
    pub rate_frd_rad_s: [f32; 3],
    /// Collective thrust, 0 to 1 of the most there is.
    pub thrust_ratio: f32,
    /// The system it is for.
    pub target_system: u8,
    /// The component it is for.
    pub target_component: u8,
    /// A bit for each part to take no notice of.
    pub ignored: u8,
}

impl AttitudeTarget {
    /// Bits: take no notice of one of the body rates each.
    pub const IGNORE_RATES: u8 = 0x07;
    /// Bit: take no notice of the thrust. It is never sent: with it, PX4 drops the whole message.
    pub const IGNORE_THRUST: u8 = 0x40;
    /// Bit: take no notice of the attitude.
    pub const IGNORE_ATTITUDE: u8 = 0x80;

    /// Turn at `rate_rad_s` with so much thrust, to the nearest `f32`; for everybody, at no time.
    #[must_use]
    pub fn rates(rate_rad_s: Vector<Body>, thrust_ratio: f32) -> Self {
        Self {
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
            rate_frd_rad_s: body_to_frd(rate_rad_s).map(|rate| rate as f32),
            thrust_ratio,
            ignored: Self::IGNORE_ATTITUDE,
            ..Self::default()
        }
    }

    /// Hold `attitude` with so much thrust, to the nearest `f32`; for everybody, at no time.
    #[must_use]
    pub fn attitude(attitude: Rotation<Body, World>, thrust_ratio: f32) -> Self {
        Self {
            orientation_wxyz: attitude_to_frd_ned(attitude).map(|component| component as f32),
            thrust_ratio,
            ignored: Self::IGNORE_RATES,
            ..Self::default()
        }
    }

    /// The rate asked for; `None` where any of the three is ignored or no number.
    #[must_use]
    pub fn rate_rad_s(&self) -> Option<Vector<Body>> {
        let rate = frd_to_body(self.rate_frd_rad_s.map(f64::from));
        (self.ignored & Self::IGNORE_RATES == 0 && rate.is_finite()).then_some(rate)
    }

    /// The attitude asked for; `None` where it is ignored or none.
    #[must_use]
    pub fn orientation(&self) -> Option<Rotation<Body, World>> {
        match self.ignored & Self::IGNORE_ATTITUDE {
            0 => frd_ned_to_attitude(self.orientation_wxyz.map(f64::from)),
            _ => None,
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            since_boot_ms: reader.u32()?,
            orientation_wxyz: reader.f32s()?,
            rate_frd_rad_s: reader.f32s()?,
            thrust_ratio: reader.f32()?,
            target_system: reader.u8()?,
            target_component: reader.u8()?,
            ignored: reader.u8()?,
        })
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> Result<u32, MavlinkError> {
        if self.ignored & Self::IGNORE_THRUST != 0 {
            return Err(MavlinkError::Value { field: "type mask", value: i64::from(self.ignored) });
        }
        writer.u32(self.since_boot_ms).f32s(finite("attitude", &self.orientation_wxyz)?);
        writer.f32s(finite("body rate", &self.rate_frd_rad_s)?).f32s(finite("thrust", &[self.thrust_ratio])?);
        writer.u8(self.target_system).u8(self.target_component).u8(self.ignored);
        Ok(ID_SET_ATTITUDE_TARGET)
    }
}

/// The numbers, if all of them are.
fn finite<'n>(field: &'static str, numbers: &'n [f32]) -> Result<&'n [f32], MavlinkError> {
    let all = numbers.iter().all(|number| number.is_finite());
    if all { Ok(numbers) } else { Err(MavlinkError::NotFinite { field }) }
}

#[cfg(test)]
mod tests {
    use super::super::{Header, Message, PAYLOAD_BYTES_MAX};
    use super::*;

    fn sent(target: AttitudeTarget) -> Result<(), MavlinkError> {
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        Message::SetAttitudeTarget(target).frame(Header::default(), &mut payload).map(|_| ())
    }

    #[test]
    fn rates_are_turned_to_the_autopilots_axes_and_back() {
        let target = AttitudeTarget::rates(Vector::new(0.5, 0.25, -2.0), 0.5);
        assert_eq!(target.rate_frd_rad_s, [0.5, -0.25, 2.0]);
        assert_eq!(target.ignored, 0x80);
        assert_eq!(target.rate_rad_s(), Some(Vector::new(0.5, 0.25, -2.0)));
        assert_eq!(target.orientation(), None);
    }

    #[test]
    fn attitudes_are_turned_to_the_autopilots_axes_and_back() {
        let attitude = Rotation::from_yaw_pitch_roll(0.5, -0.25, 1.0);
        let target = AttitudeTarget::attitude(attitude, 0.5);
        assert_eq!(target.ignored, 0x07);
        assert!(target.orientation().unwrap().angle_to(attitude) < 1e-6);
        assert_eq!(target.rate_rad_s(), None);
    }

    #[test]
    fn what_must_not_be_sent_is_an_error() {
        let good = AttitudeTarget::rates(Vector::ZERO, 0.5);
        assert_eq!(sent(good), Ok(()));
        let error = MavlinkError::Value { field: "type mask", value: 0xC0 };
        assert_eq!(sent(AttitudeTarget { ignored: 0xC0, ..good }), Err(error));
        for bad in [f32::NAN, f32::INFINITY] {
            let field = "thrust";
            assert_eq!(
                sent(AttitudeTarget { thrust_ratio: bad, ..good }),
                Err(MavlinkError::NotFinite { field })
            );
            let rate_frd_rad_s = [0.0, bad, 0.0];
            assert_eq!(AttitudeTarget { rate_frd_rad_s, ..good }.rate_rad_s(), None);
            let field = "body rate";
            assert_eq!(
                sent(AttitudeTarget { rate_frd_rad_s, ..good }),
                Err(MavlinkError::NotFinite { field })
            );
            let orientation_wxyz = [bad; 4];
            let field = "attitude";
            assert_eq!(
                sent(AttitudeTarget { orientation_wxyz, ..good }),
                Err(MavlinkError::NotFinite { field })
            );
        }
    }
}
