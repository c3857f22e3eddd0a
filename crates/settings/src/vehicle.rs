//! A vehicle as its builders believe it to be: what firmware, controllers and the learner's model use.

use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::plant::PlantSettings;
use crate::read::{at_most, in_range};

/// The greatest 16-bit address of a data-link radio: above are those for "none" and for everybody.
const ADDRESS_MAX: u16 = 0xfffd;
/// The address of a vehicle that has no data-link radio.
const NO_ADDRESS: u16 = 0xfffe;
/// Part of the greatest thrust that a Crazyflie's hover may take: the rest is what it turns and climbs with.
const HOVER_THRUST_RATIO_MAX: f64 = 0.8;
/// Standard gravity.
const GRAVITY_M_S2: f64 = 9.81;

/// One vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Its number on the bus, 1 to 254.
    pub id: u8,
    /// Its subject name at the motion-capture system.
    pub subject: String,
    /// Body.
    pub airframe: Airframe,
    /// Propulsion.
    pub rotor: Rotor,
    /// The firmware's rate loops.
    pub rate_loop: RateLoop,
    /// Radio links.
    pub links: Links,
    /// Battery limits.
    pub battery: Battery,
    /// How the simulated vehicle differs from all of the above; ignored by everything but the simulator.
    pub plant: PlantSettings,
}

/// Body, as weighed and measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Airframe {
    /// Mass, ready to fly.
    pub mass_kg: f64,
    /// Centre to rotor axis.
    pub arm_m: f64,
    /// Moments of inertia about the body's x, y and z axes.
    pub inertia_kg_m2: [f64; 3],
}

/// One rotor with its motor controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotor {
    /// Least thrust the firmware asks for.
    pub thrust_n_min: f64,
    /// Greatest thrust the firmware asks for; the motor command's full scale.
    pub thrust_n_max: f64,
    /// First-order gain of rising thrust.
    pub gain_up_1_s: f64,
    /// First-order gain of falling thrust.
    pub gain_down_1_s: f64,
    /// Drag torque by thrust.
    pub drag_torque_m: f64,
}

/// What the pitch and roll integrators do while a command saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Integral {
    /// They go on, as eq. (9) of the paper reads literally.
    Literal,
    /// They hold while the command saturates in the direction of the error.
    #[default]
    Conditional,
}

/// Gains of the firmware's rate loops.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateLoop {
    /// Proportional gain of pitch and roll in a maneuver.
    pub maneuver_p_1_s: f64,
    /// Integral gain of pitch and roll in a maneuver.
    pub maneuver_i_1_s2: f64,
    /// Proportional gain of pitch and roll in normal flight.
    pub flight_p_1_s: f64,
    /// Integral gain of pitch and roll in normal flight.
    pub flight_i_1_s2: f64,
    /// Proportional gain of yaw.
    pub yaw_p_1_s: f64,
    /// What the integrators do in saturation.
    pub integral: Integral,
    /// Propeller wear: factor on the thrust asked of front, back, left and right.
    pub trim_ratio: [f64; 4],
}

/// What a vehicle listens to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Radio {
    /// A receiver of the command link and a radio of the data link, as the paper's vehicles.
    #[default]
    Pair,
    /// A Crazyradio: it is a Crazyflie, and hovers and follows commands but flies no flips.
    Crazyradio,
}

/// Addresses and delays of the vehicle's radios, as measured on the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Links {
    /// What it listens to.
    #[serde(default)]
    pub radio: Radio,
    /// 16-bit address of the vehicle's data-link radio; a Crazyflie has none.
    #[serde(default = "no_address")]
    pub data_address: u16,
    /// From a radio slot to the vehicle acting on its frame, until the bridge has measured it.
    pub command_delay_s: f64,
    /// From the cameras' exposure to the datagram's arrival.
    pub mocap_latency_s: f64,
}

/// Battery limits, at rest voltage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// No further flip below.
    pub flip_v_min: f64,
    /// Land below.
    pub land_v_min: f64,
    /// Voltage a hover costs, as measured: what stands between the voltage reported and that at rest.
    pub hover_sag_v: f64,
}

const fn no_address() -> u16 {
    NO_ADDRESS
}

impl Vehicle {
    /// Whether it flies flips: a Crazyflie has no store for their parameters.
    #[must_use]
    pub const fn flips(&self) -> bool {
        matches!(self.links.radio, Radio::Pair)
    }

    /// Collective acceleration at full thrust of all four rotors.
    #[must_use]
    pub fn collective_m_s2_max(&self) -> f64 {
        4.0 * self.rotor.thrust_n_max / self.airframe.mass_kg
    }

    /// A Crazyflie's thrust is told in parts of its greatest: a hover must leave something of it.
    fn check_crazyflie(&self, file: &str) -> Result<(), ConfigError> {
        if self.links.data_address != NO_ADDRESS {
            return Err(ConfigError::Contradiction {
                file: file.to_owned(),
                key: "links.data_address".to_owned(),
                value: self.links.data_address.to_string(),
                other_key: "links.radio".to_owned(),
                other_value: "crazyradio".to_owned(),
                reason: "a Crazyflie has no data-link radio".to_owned(),
            });
        }
        at_most(
            file,
            ("airframe.mass_kg times gravity", self.airframe.mass_kg * GRAVITY_M_S2),
            HOVER_THRUST_RATIO_MAX,
            ("rotor.thrust_n_max times four", 4.0 * self.rotor.thrust_n_max),
        )
    }

    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        in_range(file, "id", f64::from(self.id), 1.0, 254.0)?;
        in_range(file, "airframe.mass_kg", self.airframe.mass_kg, 0.01, 20.0)?;
        in_range(file, "airframe.arm_m", self.airframe.arm_m, 0.02, 2.0)?;
        for inertia in self.airframe.inertia_kg_m2 {
            in_range(file, "airframe.inertia_kg_m2", inertia, 1e-6, 5.0)?;
        }
        in_range(file, "rotor.thrust_n_max", self.rotor.thrust_n_max, 0.01, 200.0)?;
        in_range(file, "rotor.thrust_n_min", self.rotor.thrust_n_min, 0.0, 200.0)?;
        at_most(
            file,
            ("rotor.thrust_n_min", self.rotor.thrust_n_min),
            0.5,
            ("rotor.thrust_n_max", self.rotor.thrust_n_max),
        )?;
        in_range(file, "rotor.gain_up_1_s", self.rotor.gain_up_1_s, 1.0, 1000.0)?;
        in_range(file, "rotor.gain_down_1_s", self.rotor.gain_down_1_s, 1.0, 1000.0)?;
        in_range(file, "rotor.drag_torque_m", self.rotor.drag_torque_m, 1e-4, 1.0)?;
        in_range(file, "rate_loop.maneuver_p_1_s", self.rate_loop.maneuver_p_1_s, 0.0, 2000.0)?;
        in_range(file, "rate_loop.maneuver_i_1_s2", self.rate_loop.maneuver_i_1_s2, 0.0, 50_000.0)?;
        in_range(file, "rate_loop.flight_p_1_s", self.rate_loop.flight_p_1_s, 0.0, 2000.0)?;
        in_range(file, "rate_loop.flight_i_1_s2", self.rate_loop.flight_i_1_s2, 0.0, 50_000.0)?;
        in_range(file, "rate_loop.yaw_p_1_s", self.rate_loop.yaw_p_1_s, 0.0, 500.0)?;
        for trim in self.rate_loop.trim_ratio {
            in_range(file, "rate_loop.trim_ratio", trim, 0.5, 1.5)?;
        }
        match self.links.radio {
            Radio::Pair => in_range(
                file,
                "links.data_address",
                f64::from(self.links.data_address),
                0.0,
                f64::from(ADDRESS_MAX),
            )?,
            Radio::Crazyradio => self.check_crazyflie(file)?,
        }
        in_range(file, "links.command_delay_s", self.links.command_delay_s, 0.0, 0.2)?;
        in_range(file, "links.mocap_latency_s", self.links.mocap_latency_s, 0.0, 0.2)?;
        in_range(file, "battery.land_v_min", self.battery.land_v_min, 1.0, 60.0)?;
        in_range(file, "battery.flip_v_min", self.battery.flip_v_min, 1.0, 60.0)?;
        at_most(
            file,
            ("battery.land_v_min", self.battery.land_v_min),
            1.0,
            ("battery.flip_v_min", self.battery.flip_v_min),
        )?;
        in_range(file, "battery.hover_sag_v", self.battery.hover_sag_v, 0.0, 10.0)?;
        self.plant.check(file)
    }
}
