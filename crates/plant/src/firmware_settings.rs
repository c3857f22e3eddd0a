//! What a vehicle's builder burns into its firmware: the believed numbers, not the true ones.

use device::vehicle_link::ChannelMap;
use maneuver::Integral;
use onboard::{FirmwareSettings, RateGains};
use settings::{ChannelBits, Vehicle};

/// The firmware's settings of a vehicle; what the arena's settings do not say is the firmware's default.
#[must_use]
pub fn firmware_settings(vehicle: &Vehicle, channel_bits: ChannelBits) -> FirmwareSettings {
    let (airframe, rotor, rates) = (&vehicle.airframe, &vehicle.rotor, &vehicle.rate_loop);
    let integral = match rates.integral {
        settings::Integral::Literal => Integral::Literal,
        settings::Integral::Conditional => Integral::Conditional,
    };
    let mut firmware = FirmwareSettings::table_i(vehicle.id);
    firmware.channel_map = match channel_bits {
        ChannelBits::Ten => ChannelMap::Compact,
        ChannelBits::Eleven => ChannelMap::Full,
    };
    firmware.airframe.mass_kg = airframe.mass_kg;
    firmware.airframe.arm_m = airframe.arm_m;
    firmware.airframe.inertia_kg_m2 = airframe.inertia_kg_m2;
    firmware.airframe.thrust_n_min = rotor.thrust_n_min;
    firmware.airframe.thrust_n_max = rotor.thrust_n_max;
    firmware.airframe.full_command_thrust_n = rotor.thrust_n_max;
    // Front and back turn clockwise seen from above (`rotor::SPIN`): their drag turns the body about +z.
    firmware.airframe.yaw_torque_per_thrust_m = rotor.drag_torque_m;
    firmware.airframe.trim_ratio = rates.trim_ratio;
    firmware.rates.maneuver =
        RateGains { p_1_s: rates.maneuver_p_1_s, i_1_s2: rates.maneuver_i_1_s2, integral };
    firmware.rates.flight = RateGains { p_1_s: rates.flight_p_1_s, i_1_s2: rates.flight_i_1_s2, integral };
    firmware.rates.yaw_p_1_s = rates.yaw_p_1_s;
    // The firmware sees the voltage under load, the limit is one at rest.
    firmware.gate.battery_v_min = vehicle.battery.flip_v_min - vehicle.battery.hover_sag_v;
    firmware
}
