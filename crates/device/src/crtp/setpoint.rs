//! Setpoints: what a Crazyflie shall do until it hears the next.
//!
//! | Id | Setpoint | Fields |
//! | --- | --- | --- |
//! | 0 | stop | |
//! | 7 | position | f32\[3\] m, f32 yaw deg |
//! | 10 | hover | f32 vx, vy m/s, f32 yaw rate deg/s, f32 height m |
//! | 11 | manual | f32 roll, pitch, yaw rate, u16 thrust, u8 whether roll and pitch are rates |

use quantity::{Body, Vector};

use super::{CrtpError, finite, whole};
use crate::bytes::{Reader, Writer};

const ID_STOP: u8 = 0;
const ID_POSITION: u8 = 7;
const ID_HOVER: u8 = 10;
const ID_MANUAL: u8 = 11;

const RAD_TO_DEG: f64 = 180.0 / core::f64::consts::PI;

/// What a Crazyflie shall do. Angles and rates are degrees, as the firmware has them.
///
/// Its *pitch* is positive nose up, against the right-handed turn about the vehicle's y axis that the rest of
/// our arena goes by; [`Setpoint::rates`] and [`Setpoint::rate_rad_s`] see to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setpoint {
    /// Motors off.
    Stop,
    /// Manual: turn at these rates.
    Rates {
        /// About x.
        roll_deg_s: f32,
        /// Nose up: about negative y.
        pitch_deg_s: f32,
        /// About z.
        yaw_deg_s: f32,
        /// 0 to 65 535, of the motors' full command.
        thrust: u16,
    },
    /// Manual: hold these angles, and turn at that rate.
    Angles {
        /// About x.
        roll_deg: f32,
        /// Nose up: about negative y.
        pitch_deg: f32,
        /// About z.
        yaw_deg_s: f32,
        /// 0 to 65 535, of the motors' full command.
        thrust: u16,
    },
    /// Hold a height and move over the ground.
    Hover {
        /// Forward.
        forward_m_s: f32,
        /// To the left.
        left_m_s: f32,
        /// About z.
        yaw_deg_s: f32,
        /// Above the ground.
        height_m: f32,
    },
    /// Go there and stay.
    Position {
        /// In the hall.
        position_m: [f32; 3],
        /// Heading.
        yaw_deg: f32,
    },
}

impl Setpoint {
    /// Turn at `rate_rad_s`, to the nearest `f32`.
    #[must_use]
    pub fn rates(rate_rad_s: Vector<Body>, thrust: u16) -> Self {
        Self::Rates {
            roll_deg_s: (rate_rad_s.x * RAD_TO_DEG) as f32,
            pitch_deg_s: (-rate_rad_s.y * RAD_TO_DEG) as f32,
            yaw_deg_s: (rate_rad_s.z * RAD_TO_DEG) as f32,
            thrust,
        }
    }

    /// The rate at which the vehicle shall turn; `None` where it shall do something else.
    #[must_use]
    pub fn rate_rad_s(&self) -> Option<Vector<Body>> {
        let Self::Rates { roll_deg_s, pitch_deg_s, yaw_deg_s, .. } = *self else {
            return None;
        };
        let [x, y, z] = [roll_deg_s, -pitch_deg_s, yaw_deg_s].map(|rate| f64::from(rate) / RAD_TO_DEG);
        Some(Vector::new(x, y, z))
    }

    /// The setpoint in a packet's data; `None` for one of another id.
    pub(super) fn read(data: &[u8], length: CrtpError) -> Result<Option<Self>, CrtpError> {
        let [id, fields @ ..] = data else { return Err(length) };
        match *id {
            ID_STOP => whole(fields, |_| Some(Self::Stop)).ok_or(length).map(Some),
            ID_POSITION => whole(fields, read_position).ok_or(length).map(Some),
            ID_HOVER => whole(fields, read_hover).ok_or(length).map(Some),
            ID_MANUAL => {
                let (angles, thrust, rates) = whole(fields, read_manual).ok_or(length)?;
                let [roll, pitch, yaw_deg_s] = angles;
                match rates {
                    0 => Ok(Some(Self::Angles { roll_deg: roll, pitch_deg: pitch, yaw_deg_s, thrust })),
                    1 => Ok(Some(Self::Rates { roll_deg_s: roll, pitch_deg_s: pitch, yaw_deg_s, thrust })),
                    value => Err(CrtpError::Value { field: "rate", value }),
                }
            }
            _ => Ok(None),
        }
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> Result<(), CrtpError> {
        match *self {
            Self::Stop => {
                writer.u8(ID_STOP);
            }
            Self::Rates { roll_deg_s, pitch_deg_s, yaw_deg_s, thrust } => {
                let rates = [roll_deg_s, pitch_deg_s, yaw_deg_s];
                writer.u8(ID_MANUAL).f32s(finite(&rates)?).u16(thrust).u8(1);
            }
            Self::Angles { roll_deg, pitch_deg, yaw_deg_s, thrust } => {
                let angles = [roll_deg, pitch_deg, yaw_deg_s];
                writer.u8(ID_MANUAL).f32s(finite(&angles)?).u16(thrust).u8(0);
            }
            Self::Hover { forward_m_s, left_m_s, yaw_deg_s, height_m } => {
                writer.u8(ID_HOVER).f32s(finite(&[forward_m_s, left_m_s, yaw_deg_s, height_m])?);
            }
            Self::Position { position_m, yaw_deg } => {
                writer.u8(ID_POSITION).f32s(finite(&position_m)?).f32s(finite(&[yaw_deg])?);
            }
        }
        Ok(())
    }
}

fn read_manual(reader: &mut Reader<'_>) -> Option<([f32; 3], u16, u8)> {
    Some((reader.f32s()?, reader.u16()?, reader.u8()?))
}

fn read_position(reader: &mut Reader<'_>) -> Option<Setpoint> {
    Some(Setpoint::Position { position_m: reader.f32s()?, yaw_deg: reader.f32()? })
}

fn read_hover(reader: &mut Reader<'_>) -> Option<Setpoint> {
    let [forward_m_s, left_m_s, yaw_deg_s, height_m] = reader.f32s()?;
    Some(Setpoint::Hover { forward_m_s, left_m_s, yaw_deg_s, height_m })
}

#[cfg(test)]
mod tests {
    use super::super::{PACKET_BYTES_MAX, Packet};
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;

    #[test]
    fn setpoints_both_ways() {
        for (setpoint, hex) in [
            (Setpoint::Stop, "7c 00"),
            (
                Setpoint::Angles { roll_deg: 1.0, pitch_deg: -1.0, yaw_deg_s: 0.5, thrust: 1 },
                "7c 0b 0000803f 000080bf 0000003f 0100 00",
            ),
            (
                Setpoint::Hover { forward_m_s: 1.0, left_m_s: 2.0, yaw_deg_s: 3.0, height_m: 0.5 },
                "7c 0a 0000803f 00000040 00004040 0000003f",
            ),
            (
                Setpoint::Position { position_m: [1.0, 2.0, 3.0], yaw_deg: -1.0 },
                "7c 07 0000803f 00000040 00004040 000080bf",
            ),
        ] {
            let (bytes, mut out) = (from_hex(hex), [0; PACKET_BYTES_MAX]);
            let length = Packet::Setpoint(setpoint).encode(&mut out).unwrap();
            assert_eq!(out[..length], bytes);
            assert_eq!(Packet::decode(&bytes), Ok(Packet::Setpoint(setpoint)));
        }
    }

    #[test]
    fn pitch_is_turned_over() {
        let setpoint = Setpoint::rates(Vector::new(1.0, 2.0, 3.0), 7);
        let Setpoint::Rates { roll_deg_s, pitch_deg_s, yaw_deg_s, thrust: 7 } = setpoint else {
            panic!("{setpoint:?}")
        };
        assert_eq!((roll_deg_s, pitch_deg_s, yaw_deg_s), (57.29578, -114.59156, 171.887_34));
        assert_eq!(Setpoint::Stop.rate_rad_s(), None);
    }

    #[test]
    fn unknown_ids_pass_and_unknown_values_do_not() {
        let other = from_hex("7c 06 00");
        let expected = Packet::Other { port: 7, channel: 0, data: &other[1..] };
        assert_eq!(Packet::decode(&other), Ok(expected));
        let bytes = from_hex("7c 0b 0000c842 000048c2 00000000 a08c 02");
        assert_eq!(Packet::decode(&bytes), Err(CrtpError::Value { field: "rate", value: 2 }));
        let stop = CrtpError::Length { port: 7, channel: 0, bytes: 2 };
        assert_eq!(Packet::decode(&[0x7C, 0, 0]), Err(stop));
    }

    #[test]
    fn what_is_no_number_is_not_sent() {
        let mut out = [0; PACKET_BYTES_MAX];
        for bad in [f64::NAN, f64::INFINITY, 1e300] {
            let setpoint = Setpoint::rates(Vector::new(0.0, bad, 0.0), 1);
            assert_eq!(Packet::Setpoint(setpoint).encode(&mut out), Err(CrtpError::NotFinite));
        }
        let setpoint = Setpoint::Position { position_m: [0.0; 3], yaw_deg: f32::NAN };
        assert_eq!(Packet::Setpoint(setpoint).encode(&mut out), Err(CrtpError::NotFinite));
    }

    proptest! {
        #[test]
        fn rates_come_back(x in -40.0..40.0f64, y in -40.0..40.0f64, z in -40.0..40.0f64) {
            let rate = Vector::new(x, y, z);
            let back = Setpoint::rates(rate, 0).rate_rad_s().unwrap();
            // Half a unit in the last place of an f32 at 2292 deg/s is 1.2e-4 deg/s, per axis.
            prop_assert!((back - rate).norm() < 4e-6);
        }
    }
}
