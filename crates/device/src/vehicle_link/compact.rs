//! The command link's compact map: what ExpressLRS carries in one packet.
//!
//! In its full-resolution mode with eight channels ("8ch"), ExpressLRS sends the upper ten bits of channels 0
//! to 3 and 5 to 8, and of channel 4 whether it is above the middle, which its modules take for *armed*.
//! Nothing else arrives, and the lowest bit of everything is lost.
//! (ExpressLRS 3, `src/lib/OTA/OTA.cpp`, `GenerateChannelData8ch12ch`.)
//!
//! | Channel | Meaning, v = raw / 2 | v to value | Range | Resolution |
//! | --- | --- | --- | --- | --- |
//! | 0 | roll rate (body x) | (v - 512)·12/511 rad/s | ±12 | 0.02348 rad/s (1.3 deg/s) |
//! | 1 | pitch rate (body y) | as channel 0 | ±12 | 0.02348 rad/s |
//! | 2 | collective acceleration | v·24/1023 m/s² | 0..24 | 0.02346 m/s² |
//! | 3 | yaw rate (body z) | as channel 0 | ±12 | 0.02348 rad/s |
//! | 4 | fly or descend: raw 1792; else 192 | raw above 992 | | |
//! | 5 | counter even: roll, a hint | (v - 512)·π/511 rad | ±π | 0.00615 rad (0.35 deg) |
//! | | counter odd: height, a hint | v·16/1023 - 1 m | -1..15 | 0.01564 m |
//! | 6 | counter even: pitch, a hint | (v - 512)·(π/2)/511 rad | ±π/2 | 0.00307 rad (0.18 deg) |
//! | | counter odd: vertical speed, a hint | (v - 512)·8/511 m/s | ±8 | 0.01566 m/s |
//! | 7 | mode·256 + counter·8 + hints valid·4 + vehicle mod 4 | | | |
//! | 8 | CRC-10/ATM over vehicle, channel 4's state, v of channels 0 to 3 and 5 to 7 | | | |
//! | 9 to 15 | not carried; sent as 992 | | | |
//!
//! Hints alternate: angles in one frame, height and vertical speed in the next. The whole vehicle id is under
//! the check, so that a frame for another vehicle does not pass.

use core::f64::consts::{FRAC_PI_2, PI};

use quantity::Vector;

use super::channels::{CHANNEL_MAX, COUNTER_VALUES};
use super::scale::Scale;
use super::{CommandFrame, CommandMode, LinkError};
use crate::crc::crc10;

/// Greatest value of ten bits.
const VALUE_MAX: u16 = CHANNEL_MAX / 2;

const RATE_RAD_S: Scale = Scale::two_sided(12.0, VALUE_MAX);
const COLLECTIVE_M_S2: Scale = Scale::range(0.0, 24.0, VALUE_MAX);
const ROLL_RAD: Scale = Scale::two_sided(PI, VALUE_MAX);
const PITCH_RAD: Scale = Scale::two_sided(FRAC_PI_2, VALUE_MAX);
const HEIGHT_M: Scale = Scale::range(-1.0, 15.0, VALUE_MAX);
const VERTICAL_SPEED_M_S: Scale = Scale::two_sided(8.0, VALUE_MAX);

/// The channel of two states, and its raw values.
const ARMED: usize = 4;
const ARMED_HIGH: u16 = 1792;
const ARMED_LOW: u16 = 192;
const MIDDLE: u16 = 992;
/// Channels of ten bits under the check, and the one that has it.
const CHECKED: [usize; 7] = [0, 1, 2, 3, 5, 6, 7];
const CHECK: usize = 8;

const HINTS_VALID: u16 = 4;
const VEHICLE_BITS: u16 = 3;

impl CommandFrame {
    /// The channels of the compact map for `vehicle`. Quantities outside their range go to its end; of the
    /// hints those are sent whose turn it is by the counter, and the epoch is not sent.
    ///
    /// # Errors
    /// As [`CommandFrame::encode`].
    pub fn encode_compact(&self, vehicle: u8) -> Result<[u16; 16], LinkError> {
        if u16::from(self.counter) >= COUNTER_VALUES {
            return Err(LinkError::UnknownValue { field: "counter" });
        }
        let (first, second, valid) = if self.brings_attitude() {
            (ROLL_RAD.encode(self.roll_rad)?, PITCH_RAD.encode(self.pitch_rad)?, self.attitude_valid)
        } else {
            let speed = VERTICAL_SPEED_M_S.encode(self.vertical_speed_m_s)?;
            (HEIGHT_M.encode(self.height_m)?, speed, self.height_valid)
        };
        let hints = if valid { HINTS_VALID } else { 0 };
        let state = self.mode as u16 * 256 + u16::from(self.counter) * 8 + hints;
        let rates = self.rate_rad_s;
        let mut channels = [MIDDLE; 16];
        let values = [
            RATE_RAD_S.encode(rates.x)?,
            RATE_RAD_S.encode(rates.y)?,
            COLLECTIVE_M_S2.encode(self.collective_m_s2)?,
            RATE_RAD_S.encode(rates.z)?,
            first,
            second,
            state | (u16::from(vehicle) & VEHICLE_BITS),
        ];
        for (channel, value) in CHECKED.into_iter().zip(values) {
            channels[channel] = raw(value);
        }
        channels[ARMED] = if self.mode.is_armed() { ARMED_HIGH } else { ARMED_LOW };
        channels[CHECK] = raw(check(&channels, vehicle));
        Ok(channels)
    }

    /// The frame for `vehicle` in the channels of the compact map.
    ///
    /// # Errors
    /// [`LinkError::Channel`]; [`LinkError::Checksum`], which a frame for another vehicle has too; or
    /// [`LinkError::UnknownValue`] where channel 4 contradicts the mode. Nothing of such a frame may be flown.
    pub fn decode_compact(channels: &[u16; 16], vehicle: u8) -> Result<Self, LinkError> {
        if let Some(index) = channels.iter().position(|raw| *raw > CHANNEL_MAX) {
            return Err(LinkError::Channel { index });
        }
        let (received, computed) = (channels[CHECK] / 2, check(channels, vehicle));
        if received != computed {
            return Err(LinkError::Checksum { received, computed });
        }
        let [x, y, collective, z, first, second, state] = CHECKED.map(|channel| channels[channel] / 2);
        let mode = CommandMode::from_bits(state / 256);
        if is_armed(channels) != mode.is_armed() || state & VEHICLE_BITS != u16::from(vehicle) & VEHICLE_BITS
        {
            return Err(LinkError::UnknownValue { field: "mode" });
        }
        let mut frame = Self {
            mode,
            counter: (state / 8 % COUNTER_VALUES) as u8,
            collective_m_s2: COLLECTIVE_M_S2.decode(collective),
            rate_rad_s: Vector::new(RATE_RAD_S.decode(x), RATE_RAD_S.decode(y), RATE_RAD_S.decode(z)),
            ..Self::default()
        };
        let valid = state & HINTS_VALID != 0;
        if frame.brings_attitude() {
            frame.attitude_valid = valid;
            (frame.roll_rad, frame.pitch_rad) = (ROLL_RAD.decode(first), PITCH_RAD.decode(second));
        } else {
            frame.height_valid = valid;
            frame.height_m = HEIGHT_M.decode(first);
            frame.vertical_speed_m_s = VERTICAL_SPEED_M_S.decode(second);
        }
        Ok(frame)
    }

    /// Whether it is the turn of the angles.
    const fn brings_attitude(&self) -> bool {
        self.counter.is_multiple_of(2)
    }
}

impl CommandMode {
    const fn is_armed(self) -> bool {
        matches!(self, Self::Fly | Self::Descend)
    }
}

/// The raw value whose upper ten bits are `value`: the middle of the two there are.
const fn raw(value: u16) -> u16 {
    2 * value + 1
}

const fn is_armed(channels: &[u16; 16]) -> bool {
    channels[ARMED] > MIDDLE
}

fn check(channels: &[u16; 16], vehicle: u8) -> u16 {
    let head = [u16::from(vehicle), u16::from(is_armed(channels))];
    crc10(head.into_iter().chain(CHECKED.map(|channel| channels[channel] / 2)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(counter: u8) -> CommandFrame {
        CommandFrame {
            mode: CommandMode::Fly,
            counter,
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

    /// What ExpressLRS leaves of channels: ten bits of eight, one of a ninth.
    fn over_the_air(sent: &[u16; 16]) -> [u16; 16] {
        core::array::from_fn(|channel| match channel {
            ARMED if sent[ARMED] > MIDDLE => 1811,
            ARMED => 172,
            0..=8 => sent[channel] / 2 * 2,
            _ => 0,
        })
    }

    /// Worked out with a separate program from the table above and the catalogue's CRC-10/ATM.
    const GOLDEN_EVEN: [u16; 16] =
        [1111, 847, 837, 1067, 1792, 1057, 895, 815, 239, 992, 992, 992, 992, 992, 992, 992];

    #[test]
    fn golden_channels_both_ways() {
        assert_eq!(frame(18).encode_compact(3).unwrap(), GOLDEN_EVEN);
        let read = CommandFrame::decode_compact(&GOLDEN_EVEN, 3).unwrap();
        assert_eq!((read.mode, read.counter), (CommandMode::Fly, 18));
        assert!(read.attitude_valid && !read.height_valid);
    }

    #[test]
    fn hints_alternate_and_a_stale_one_is_never_shown_as_fresh() {
        for counter in 0..32 {
            let channels = over_the_air(&frame(counter).encode_compact(9).unwrap());
            let read = CommandFrame::decode_compact(&channels, 9).unwrap();
            assert_eq!((read.attitude_valid, read.height_valid), (counter % 2 == 0, counter % 2 == 1));
        }
    }

    #[test]
    fn a_frame_for_another_vehicle_is_refused() {
        let channels = frame(4).encode_compact(9).unwrap();
        for vehicle in (0..=u8::MAX).filter(|vehicle| *vehicle != 9) {
            assert!(CommandFrame::decode_compact(&channels, vehicle).is_err(), "{vehicle}");
        }
    }

    #[test]
    fn every_single_bit_error_of_what_is_carried_is_refused() {
        let sent = frame(7).encode_compact(3).unwrap();
        for channel in CHECKED.into_iter().chain([CHECK]) {
            for bit in 1..11 {
                let mut channels = sent;
                channels[channel] ^= 1 << bit;
                assert!(CommandFrame::decode_compact(&channels, 3).is_err(), "{channel} {bit}");
            }
        }
        let mut disarmed = sent;
        disarmed[ARMED] = ARMED_LOW;
        assert!(CommandFrame::decode_compact(&disarmed, 3).is_err());
    }

    #[test]
    fn dead_channels_are_refused() {
        for dead in [0, 172, 992, 1024, 1811, 2047] {
            for vehicle in [1, 2, 3] {
                assert!(CommandFrame::decode_compact(&[dead; 16], vehicle).is_err(), "{dead}");
            }
        }
    }

    proptest! {
        #[test]
        fn what_arrives_is_off_by_half_a_step_at_most(
            mode in 0u16..4, counter in 0u8..32, vehicle: u8,
            collective_m_s2 in 0.0..=24.0f64, x in -12.0..=12.0f64, y in -12.0..=12.0f64,
            roll_rad in -PI..=PI, pitch_rad in -FRAC_PI_2..=FRAC_PI_2,
            height_m in -1.0..=15.0f64, vertical_speed_m_s in -8.0..=8.0f64,
        ) {
            let sent = CommandFrame {
                mode: CommandMode::from_bits(mode), collective_m_s2, rate_rad_s: Vector::new(x, y, -x),
                roll_rad, pitch_rad, height_m, vertical_speed_m_s, ..frame(counter)
            };
            let channels = over_the_air(&sent.encode_compact(vehicle).unwrap());
            let read = CommandFrame::decode_compact(&channels, vehicle).unwrap();
            prop_assert_eq!((read.mode, read.counter), (sent.mode, counter));
            let near = |a: f64, b: f64, scale: Scale| (a - b).abs() <= 0.5 * scale.step * (1.0 + 1e-9);
            prop_assert!(near(read.collective_m_s2, collective_m_s2, COLLECTIVE_M_S2));
            prop_assert!(near(read.rate_rad_s.x, x, RATE_RAD_S) && near(read.rate_rad_s.y, y, RATE_RAD_S));
            prop_assert!(near(read.rate_rad_s.z, -x, RATE_RAD_S));
            if read.attitude_valid {
                prop_assert!(near(read.roll_rad, roll_rad, ROLL_RAD));
                prop_assert!(near(read.pitch_rad, pitch_rad, PITCH_RAD));
            } else {
                prop_assert!(near(read.height_m, height_m, HEIGHT_M));
                prop_assert!(near(read.vertical_speed_m_s, vertical_speed_m_s, VERTICAL_SPEED_M_S));
            }
        }

        #[test]
        fn any_channels_decode_or_are_refused(channels: [u16; 16], vehicle: u8) {
            let _ = CommandFrame::decode_compact(&channels, vehicle);
        }
    }
}
