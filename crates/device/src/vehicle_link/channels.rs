//! The command link's full map: sixteen channels of eleven bits.
//!
//! | Channel | Meaning | Raw to value | Range | Resolution |
//! | --- | --- | --- | --- | --- |
//! | 0 | roll rate (body x) | (raw - 1024)·12/1023 rad/s | ±12 | 0.01173 rad/s (0.67 deg/s) |
//! | 1 | pitch rate (body y) | as channel 0 | ±12 | 0.01173 rad/s |
//! | 2 | collective acceleration | raw·24/2047 m/s² | 0..24 | 0.01172 m/s² |
//! | 3 | yaw rate (body z) | as channel 0 | ±12 | 0.01173 rad/s |
//! | 4 | mode and counter | raw / 16 = mode·32 + counter; sent at the middle, + 8 | 0..2047 | ±7 raw |
//! | 5 | roll angle, a hint | (raw - 1024)·π/1023 rad | ±π | 0.00307 rad (0.18 deg) |
//! | 6 | pitch angle, a hint | (raw - 1024)·(π/2)/1023 rad | ±π/2 | 0.00154 rad (0.09 deg) |
//! | 7 | height, a hint | raw·16/2047 - 1 m | -1..15 | 0.00782 m |
//! | 8 | vertical speed, a hint | (raw - 1024)·8/1023 m/s | ±8 | 0.00782 m/s |
//! | 9 | vehicle address | raw | 0..255 | 1 |
//! | 10 | low byte of the lease epoch, for the record | raw | 0..255 | 1 |
//! | 11 | flags: 1 the angles are valid, 2 height and vertical speed are | raw | 0..3 | 1 |
//! | 12, 13 | zero, for later | 0 | | |
//! | 14 | version of this map | 2 | | |
//! | 15 | CRC-11/UMTS over channels 0 to 14 | | | |
//!
//! The two-sided scales have an exact zero. Raw 0 on them is never sent and reads as the lower end. What a
//! plain eight-channel PPM encoder can carry stands first, the mode spread so that an analogue encoder's
//! jitter does not change it. SBUS has no checksum of its own, hence channel 15; sixteen channels of zero are
//! refused by their version.

use core::f64::consts::{FRAC_PI_2, PI};

use quantity::{Body, Rotation, Vector, World, math};

use super::LinkError;
use super::scale::Scale;
use crate::crc::crc11;

/// Greatest value of a channel.
pub const CHANNEL_MAX: u16 = 2047;

/// Version of the channel map, sent in channel 14.
pub const LINK_VERSION: u16 = 2;

/// The counter of a command frame runs from zero to one less than this.
pub(super) const COUNTER_VALUES: u16 = 32;

/// Raw values per value of mode and counter.
const MODE_SPREAD: u16 = 16;

const FLAG_ATTITUDE_VALID: u16 = 1;
const FLAG_HEIGHT_VALID: u16 = 2;

const RATE_RAD_S: Scale = Scale::two_sided(12.0, CHANNEL_MAX);
const COLLECTIVE_M_S2: Scale = Scale::range(0.0, 24.0, CHANNEL_MAX);
const ROLL_RAD: Scale = Scale::two_sided(PI, CHANNEL_MAX);
const PITCH_RAD: Scale = Scale::two_sided(FRAC_PI_2, CHANNEL_MAX);
const HEIGHT_M: Scale = Scale::range(-1.0, 15.0, CHANNEL_MAX);
const VERTICAL_SPEED_M_S: Scale = Scale::two_sided(8.0, CHANNEL_MAX);

/// Greatest magnitudes and smallest steps of the command link, for whoever must plan with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandResolution {
    /// Greatest body rate about each axis.
    pub rate_rad_s_max: f64,
    /// Step of a body rate.
    pub rate_rad_s_step: f64,
    /// Greatest collective acceleration.
    pub collective_m_s2_max: f64,
    /// Step of the collective acceleration.
    pub collective_m_s2_step: f64,
    /// Step of the height.
    pub height_m_step: f64,
    /// Step of the vertical speed.
    pub vertical_speed_m_s_step: f64,
}

/// What the channel map gives.
pub const COMMAND_RESOLUTION: CommandResolution = CommandResolution {
    rate_rad_s_max: RATE_RAD_S.high,
    rate_rad_s_step: RATE_RAD_S.step,
    collective_m_s2_max: COLLECTIVE_M_S2.high,
    collective_m_s2_step: COLLECTIVE_M_S2.step,
    height_m_step: HEIGHT_M.step,
    vertical_speed_m_s_step: VERTICAL_SPEED_M_S.step,
};

/// What a command asks of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum CommandMode {
    /// Motors off; in the air the firmware flies it as [`CommandMode::Descend`].
    #[default]
    Disarmed = 0,
    /// Fly the rates and the collective acceleration.
    Fly = 1,
    /// Descend level on the vehicle's own sensors, and switch off at touchdown.
    Descend = 2,
    /// Emergency stop: motors off now, latched.
    Stop = 3,
}

impl CommandMode {
    pub(super) const fn from_bits(bits: u16) -> Self {
        match bits & 3 {
            0 => Self::Disarmed,
            1 => Self::Fly,
            2 => Self::Descend,
            _ => Self::Stop,
        }
    }
}

/// One frame of the command link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CommandFrame {
    /// What is asked.
    pub mode: CommandMode,
    /// Counts frames, 0 to 31 and round again. A frame with the counter of the one before is the transmitter
    /// repeating itself and is not obeyed.
    pub counter: u8,
    /// Collective acceleration: total thrust by mass, along the body's z axis, 0 to 24.
    pub collective_m_s2: f64,
    /// Angular rate to hold, ±12 about each axis.
    pub rate_rad_s: Vector<Body>,
    /// Whether the frame brings roll and pitch of a valid estimate. Where it does not, the vehicle keeps to its
    /// own.
    pub attitude_valid: bool,
    /// Whether the frame brings height and vertical speed of a valid estimate.
    pub height_valid: bool,
    /// Hint: roll of the ground's attitude estimate (yaw, then pitch, then roll), ±π.
    pub roll_rad: f64,
    /// Hint: pitch of the ground's attitude estimate, ±π/2.
    pub pitch_rad: f64,
    /// Hint: height above the floor, -1 to 15.
    pub height_m: f64,
    /// Hint: vertical speed, up positive, ±8.
    pub vertical_speed_m_s: f64,
    /// Low byte of the lease epoch the command was given under; for the record, the bridge is what enforces
    /// it.
    pub epoch_low: u8,
}

impl CommandFrame {
    /// The sixteen channels for `vehicle`. Quantities outside their range go to its end.
    ///
    /// # Errors
    /// [`LinkError::NotFinite`] for a quantity that is not a number, [`LinkError::UnknownValue`] for a
    /// counter above 31.
    pub fn encode(&self, vehicle: u8) -> Result<[u16; 16], LinkError> {
        if u16::from(self.counter) >= COUNTER_VALUES {
            return Err(LinkError::UnknownValue { field: "counter" });
        }
        let mode = self.mode as u16 * COUNTER_VALUES + u16::from(self.counter);
        let mut channels = [0; 16];
        channels[0] = RATE_RAD_S.encode(self.rate_rad_s.x)?;
        channels[1] = RATE_RAD_S.encode(self.rate_rad_s.y)?;
        channels[2] = COLLECTIVE_M_S2.encode(self.collective_m_s2)?;
        channels[3] = RATE_RAD_S.encode(self.rate_rad_s.z)?;
        channels[4] = mode * MODE_SPREAD + MODE_SPREAD / 2;
        channels[5] = ROLL_RAD.encode(self.roll_rad)?;
        channels[6] = PITCH_RAD.encode(self.pitch_rad)?;
        channels[7] = HEIGHT_M.encode(self.height_m)?;
        channels[8] = VERTICAL_SPEED_M_S.encode(self.vertical_speed_m_s)?;
        channels[9] = u16::from(vehicle);
        channels[10] = u16::from(self.epoch_low);
        channels[11] =
            flag(self.attitude_valid, FLAG_ATTITUDE_VALID) | flag(self.height_valid, FLAG_HEIGHT_VALID);
        channels[14] = LINK_VERSION;
        channels[15] = crc11(&channels[..15]);
        Ok(channels)
    }

    /// The vehicle addressed and its frame.
    ///
    /// # Errors
    /// [`LinkError::Channel`], [`LinkError::Checksum`], [`LinkError::Version`] or [`LinkError::UnknownValue`]
    /// (address, epoch or flags out of range); nothing of such a frame may be flown.
    pub fn decode(channels: &[u16; 16]) -> Result<(u8, Self), LinkError> {
        if let Some(index) = channels.iter().position(|raw| *raw > CHANNEL_MAX) {
            return Err(LinkError::Channel { index });
        }
        let (received, computed) = (channels[15], crc11(&channels[..15]));
        if received != computed {
            return Err(LinkError::Checksum { received, computed });
        }
        if channels[14] != LINK_VERSION {
            return Err(LinkError::Version { received: channels[14] });
        }
        let byte = |index: usize, field| {
            u8::try_from(channels[index]).map_err(|_| LinkError::UnknownValue { field })
        };
        let mode = channels[4] / MODE_SPREAD;
        if channels[11] > FLAG_ATTITUDE_VALID | FLAG_HEIGHT_VALID {
            return Err(LinkError::UnknownValue { field: "flags" });
        }
        let frame = Self {
            mode: CommandMode::from_bits(mode / COUNTER_VALUES),
            counter: (mode % COUNTER_VALUES) as u8,
            collective_m_s2: COLLECTIVE_M_S2.decode(channels[2]),
            rate_rad_s: Vector::new(
                RATE_RAD_S.decode(channels[0]),
                RATE_RAD_S.decode(channels[1]),
                RATE_RAD_S.decode(channels[3]),
            ),
            attitude_valid: channels[11] & FLAG_ATTITUDE_VALID != 0,
            height_valid: channels[11] & FLAG_HEIGHT_VALID != 0,
            roll_rad: ROLL_RAD.decode(channels[5]),
            pitch_rad: PITCH_RAD.decode(channels[6]),
            height_m: HEIGHT_M.decode(channels[7]),
            vertical_speed_m_s: VERTICAL_SPEED_M_S.decode(channels[8]),
            epoch_low: byte(10, "epoch")?,
        };
        Ok((byte(9, "vehicle")?, frame))
    }

    /// The frame as the vehicle will read it: what a sender must reckon with instead of what it asked for.
    ///
    /// # Errors
    /// As [`CommandFrame::encode`].
    pub fn quantise(&self) -> Result<Self, LinkError> {
        Self::decode(&self.encode(0)?).map(|(_, frame)| frame)
    }

    /// The counter that follows `counter`.
    #[must_use]
    pub const fn next_counter(counter: u8) -> u8 {
        (counter + 1) % COUNTER_VALUES as u8
    }
}

const fn flag(set: bool, bit: u16) -> u16 {
    if set { bit } else { 0 }
}

/// Roll and pitch of an attitude as the hints carry them: yaw first, then pitch about the new y, then roll
/// about the new x.
#[must_use]
pub fn roll_pitch_rad(attitude: Rotation<Body, World>) -> (f64, f64) {
    let up = attitude.inverse() * Vector::<World>::Z;
    let roll = math::atan2(up.y, up.z);
    let pitch = math::atan2(-up.x, math::sqrt(up.y * up.y + up.z * up.z));
    (roll, pitch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame() -> CommandFrame {
        CommandFrame {
            mode: CommandMode::Fly,
            counter: 19,
            collective_m_s2: 9.81,
            rate_rad_s: Vector::new(1.0, -2.1, 0.5),
            attitude_valid: true,
            height_valid: true,
            roll_rad: 0.1,
            pitch_rad: -0.2,
            height_m: 4.0,
            vertical_speed_m_s: -0.3,
            epoch_low: 7,
        }
    }

    /// Worked out with a separate program from the table above and the catalogue's CRC-11/UMTS.
    const GOLDEN: [u16; 16] = [1109, 845, 837, 1067, 824, 1057, 894, 640, 986, 3, 7, 3, 0, 0, 2, 1854];

    #[test]
    fn golden_channels_both_ways() {
        assert_eq!(frame().encode(3).unwrap(), GOLDEN);
        let (vehicle, read) = CommandFrame::decode(&GOLDEN).unwrap();
        assert_eq!((vehicle, read.mode, read.counter), (3, CommandMode::Fly, 19));
        assert_eq!(read, frame().quantise().unwrap());
    }

    #[test]
    fn zero_is_exact_and_dead_bytes_are_refused() {
        let hover =
            CommandFrame { rate_rad_s: Vector::ZERO, vertical_speed_m_s: 0.0, ..frame() }.quantise().unwrap();
        assert_eq!(hover.rate_rad_s, Vector::ZERO);
        assert_eq!(hover.vertical_speed_m_s, 0.0);
        for dead in [0, 992, 1024, 2047] {
            assert!(CommandFrame::decode(&[dead; 16]).is_err());
        }
    }

    #[test]
    fn every_single_bit_error_is_refused() {
        for index in 0..16 {
            for bit in 0..16 {
                let mut channels = GOLDEN;
                channels[index] ^= 1 << bit;
                assert!(CommandFrame::decode(&channels).is_err());
            }
        }
    }

    #[test]
    fn what_is_no_number_is_not_sent() {
        let bad = CommandFrame { collective_m_s2: f64::NAN, ..frame() };
        assert_eq!(bad.encode(1), Err(LinkError::NotFinite));
        assert!(CommandFrame { counter: 32, ..frame() }.encode(1).is_err());
        let wild = CommandFrame { collective_m_s2: 1e300, height_m: -50.0, ..frame() }.quantise().unwrap();
        assert_eq!((wild.collective_m_s2, wild.height_m), (24.0, -1.0));
    }

    #[test]
    fn another_version_is_refused() {
        let mut channels = GOLDEN;
        channels[14] = 1;
        channels[15] = crc11(&channels[..15]);
        assert_eq!(CommandFrame::decode(&channels), Err(LinkError::Version { received: 1 }));
    }

    fn rates() -> impl Strategy<Value = f64> {
        -12.0..=12.0f64
    }

    proptest! {
        #[test]
        fn reading_back_is_off_by_half_a_step_at_most(
            mode in 0u16..4, counter in 0u8..32, vehicle: u8, epoch_low: u8,
            attitude_valid: bool, height_valid: bool,
            collective_m_s2 in 0.0..=24.0f64, x in rates(), y in rates(), z in rates(),
            roll_rad in -PI..=PI, pitch_rad in -FRAC_PI_2..=FRAC_PI_2,
            height_m in -1.0..=15.0f64, vertical_speed_m_s in -8.0..=8.0f64,
        ) {
            let sent = CommandFrame {
                mode: CommandMode::from_bits(mode), counter, collective_m_s2,
                rate_rad_s: Vector::new(x, y, z),
                attitude_valid, height_valid, roll_rad, pitch_rad, height_m, vertical_speed_m_s, epoch_low,
            };
            let (address, read) = CommandFrame::decode(&sent.encode(vehicle).unwrap()).unwrap();
            prop_assert_eq!(address, vehicle);
            prop_assert_eq!((read.mode, read.counter, read.epoch_low), (sent.mode, counter, epoch_low));
            prop_assert_eq!((read.attitude_valid, read.height_valid), (attitude_valid, height_valid));
            for (a, b, scale) in [
                (read.collective_m_s2, collective_m_s2, COLLECTIVE_M_S2),
                (read.rate_rad_s.x, x, RATE_RAD_S), (read.rate_rad_s.y, y, RATE_RAD_S),
                (read.rate_rad_s.z, z, RATE_RAD_S), (read.roll_rad, roll_rad, ROLL_RAD),
                (read.pitch_rad, pitch_rad, PITCH_RAD), (read.height_m, height_m, HEIGHT_M),
                (read.vertical_speed_m_s, vertical_speed_m_s, VERTICAL_SPEED_M_S),
            ] {
                prop_assert!((a - b).abs() <= 0.5 * scale.step * (1.0 + 1e-9));
            }
            prop_assert_eq!(read.quantise().unwrap(), read, "a second time changes nothing");
        }

        #[test]
        fn any_channels_decode_or_are_refused(channels: [u16; 16]) {
            let _ = CommandFrame::decode(&channels);
        }

        #[test]
        fn jitter_of_an_analogue_encoder_keeps_mode_and_counter(
            counter in 0u8..32, mode in 0u16..4, jitter in -7i32..=7,
        ) {
            let sent = CommandFrame { mode: CommandMode::from_bits(mode), counter, ..frame() };
            let mut channels = sent.encode(1).unwrap();
            channels[4] = u16::try_from(i32::from(channels[4]) + jitter).unwrap();
            channels[15] = crc11(&channels[..15]);
            let (_, read) = CommandFrame::decode(&channels).unwrap();
            prop_assert_eq!((read.mode, read.counter), (sent.mode, counter));
        }

        #[test]
        fn hints_rebuild_the_tilt(x in -3.0..3.0f64, y in -3.0..3.0f64, z in -3.0..3.0f64) {
            let attitude = Rotation::<Body, World>::from_rotation_vector(Vector::new(x, y, z));
            let (roll, pitch) = roll_pitch_rad(attitude);
            let rebuilt = Rotation::<Body, World>::from_yaw_pitch_roll(0.3, pitch, roll);
            let up = |r: Rotation<Body, World>| r.inverse() * Vector::<World>::Z;
            prop_assert!((up(attitude) - up(rebuilt)).norm() < 1e-9);
        }
    }
}
