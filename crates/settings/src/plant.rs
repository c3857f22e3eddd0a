//! How the simulated vehicle and its surroundings differ from what everybody believes. Only the plant reads
//! this.

use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::read::{at_most, in_range};
use crate::vehicle::Rotor;

/// The truth behind one simulated vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantSettings {
    /// The body.
    pub body: BodySettings,
    /// The rotors.
    pub rotor: RotorPlantSettings,
    /// The rate gyros.
    pub gyro: GyroSettings,
    /// The accelerometer.
    pub accelerometer: AccelerometerSettings,
    /// The battery.
    pub battery: BatterySettings,
    /// The air.
    pub air: AirSettings,
    /// The motion-capture cameras.
    pub camera: CameraSettings,
    /// The command link.
    pub command_link: LinkSettings,
    /// The data link.
    pub data_link: LinkSettings,
    /// The vehicle's own clock.
    pub clock: ClockSettings,
    /// The floor under it.
    pub floor: FloorSettings,
}

/// True body, relative to the believed one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySettings {
    /// True mass by believed mass.
    pub mass_ratio: f64,
    /// True moments of inertia by believed ones.
    pub inertia_ratio: f64,
    /// Linear drag by mass: deceleration by speed.
    pub drag_1_s: f64,
    /// Rotational drag: torque by rate squared.
    pub rate_drag_n_m_s2: f64,
}

/// True rotors, relative to the believed ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotorPlantSettings {
    /// True thrust by asked thrust.
    pub thrust_ratio: f64,
    /// One sigma of each rotor's own thrust factor, drawn once per seed.
    pub spread_ratio: f64,
    /// Rising gain.
    pub gain_up_1_s: f64,
    /// Falling gain.
    pub gain_down_1_s: f64,
    /// Fraction of thrust lost per speed of the rotor along its axis into its inflow.
    pub inflow_loss_s_m: f64,
    /// Radius, for the ground effect.
    pub radius_m: f64,
    /// Moment of inertia of a rotor about its axis; its changes of speed turn the body about z.
    pub spin_inertia_kg_m2: f64,
    /// Speed of a rotor at the greatest thrust the firmware asks for.
    pub speed_rad_s_max: f64,
}

/// Rate gyros.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GyroSettings {
    /// Reading by true rate.
    pub scale_ratio: f64,
    /// Readings stop here.
    pub range_rad_s: f64,
    /// One sigma of white noise per 800 Hz sample.
    pub noise_rad_s: f64,
    /// One sigma of the constant bias, drawn once per seed.
    pub bias_rad_s: f64,
    /// One sigma of the bias drawn anew for each maneuver: what makes one flip differ from the next.
    pub flip_bias_rad_s: f64,
}

/// Accelerometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccelerometerSettings {
    /// One sigma of white noise per 800 Hz sample.
    pub noise_m_s2: f64,
    /// One sigma of the constant bias, drawn once per seed.
    pub bias_m_s2: f64,
}

/// Battery.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatterySettings {
    /// Open-circuit voltage when full.
    pub full_v: f64,
    /// Open-circuit voltage when empty.
    pub empty_v: f64,
    /// Hovering time from full to empty.
    pub hover_endurance_s: f64,
    /// How much of the greatest thrust is gone when full power has been drawn for long, with a full battery.
    pub droop_ratio: f64,
    /// Time constant of that droop.
    pub droop_time_s: f64,
    /// How much of the greatest thrust is gone when the battery is empty.
    pub fade_ratio: f64,
    /// Remaining charge below which the fade sets in steeply; above, it is linear and a quarter as steep.
    pub knee_ratio: f64,
    /// Voltage lost under hover load.
    pub hover_sag_v: f64,
    /// Charge at the start.
    pub initial_charge_ratio: f64,
}

/// Air.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AirSettings {
    /// One sigma of the gusts' acceleration.
    pub gust_m_s2: f64,
    /// Correlation time of the gusts.
    pub gust_time_s: f64,
    /// Ground effect by that of Cheeseman and Bennett: 1 for theirs, 0 for none.
    pub ground_effect_ratio: f64,
}

/// Cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSettings {
    /// Frames per second.
    pub rate_hz: f64,
    /// One sigma of position noise per axis.
    pub position_noise_m: f64,
    /// One sigma of attitude noise per axis.
    pub attitude_noise_rad: f64,
    /// From exposure to the datagram leaving.
    pub latency_s: f64,
    /// Further delay, exponentially distributed with this mean.
    pub jitter_s: f64,
    /// Chance that a frame lacks the vehicle.
    pub dropout_ratio: f64,
}

/// A radio link, one way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkSettings {
    /// Fixed delay.
    pub delay_s: f64,
    /// Further delay, exponentially distributed with this mean.
    pub jitter_s: f64,
    /// Chance that a frame is lost.
    pub loss_ratio: f64,
    /// Chance that a frame arrives with flipped bits.
    pub corruption_ratio: f64,
}

/// The vehicle's clock.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSettings {
    /// Greatest deviation of the clock's rate, either way; drawn once per seed.
    pub drift_ratio_max: f64,
    /// The vehicle was switched on at most so long before the arena's start; drawn once per seed.
    pub uptime_s_max: f64,
}

/// The floor, and how a vehicle stands on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorSettings {
    /// Height of the centre of mass of a standing vehicle.
    pub gear_height_m: f64,
    /// Time constant with which a landed vehicle slides to rest and settles level.
    pub settle_time_s: f64,
    /// A vehicle that touches down faster is broken.
    pub crash_speed_m_s: f64,
    /// A vehicle that touches down tilted by more is broken.
    pub crash_tilt_rad: f64,
}

impl LinkSettings {
    fn check(&self, file: &str, key: &str) -> Result<(), ConfigError> {
        in_range(file, &format!("{key}.delay_s"), self.delay_s, 0.0, 1.0)?;
        in_range(file, &format!("{key}.jitter_s"), self.jitter_s, 0.0, 1.0)?;
        in_range(file, &format!("{key}.loss_ratio"), self.loss_ratio, 0.0, 1.0)?;
        in_range(file, &format!("{key}.corruption_ratio"), self.corruption_ratio, 0.0, 1.0)
    }
}

impl PlantSettings {
    /// Makes the vehicle exactly what everybody believes it to be, in still air, with perfect sensors and
    /// links that lose nothing. Delays, battery capacity, floor and the cameras' rate stay.
    pub fn remove_departures(&mut self, rotor: &Rotor) {
        self.body =
            BodySettings { mass_ratio: 1.0, inertia_ratio: 1.0, drag_1_s: 0.0, rate_drag_n_m_s2: 0.0 };
        self.rotor.thrust_ratio = 1.0;
        self.rotor.spread_ratio = 0.0;
        self.rotor.gain_up_1_s = rotor.gain_up_1_s;
        self.rotor.gain_down_1_s = rotor.gain_down_1_s;
        self.rotor.inflow_loss_s_m = 0.0;
        self.rotor.spin_inertia_kg_m2 = 0.0;
        self.gyro = GyroSettings {
            scale_ratio: 1.0,
            range_rad_s: 200.0,
            noise_rad_s: 0.0,
            bias_rad_s: 0.0,
            flip_bias_rad_s: 0.0,
        };
        self.accelerometer = AccelerometerSettings { noise_m_s2: 0.0, bias_m_s2: 0.0 };
        self.battery.droop_ratio = 0.0;
        self.battery.fade_ratio = 0.0;
        self.battery.hover_sag_v = 0.0;
        self.air.gust_m_s2 = 0.0;
        self.air.ground_effect_ratio = 0.0;
        self.camera.position_noise_m = 0.0;
        self.camera.attitude_noise_rad = 0.0;
        self.camera.jitter_s = 0.0;
        self.camera.dropout_ratio = 0.0;
        for link in [&mut self.command_link, &mut self.data_link] {
            link.jitter_s = 0.0;
            link.loss_ratio = 0.0;
            link.corruption_ratio = 0.0;
        }
        self.clock.drift_ratio_max = 0.0;
    }

    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        for (key, value, min, max) in [
            ("plant.body.mass_ratio", self.body.mass_ratio, 0.2, 5.0),
            ("plant.body.inertia_ratio", self.body.inertia_ratio, 0.2, 5.0),
            ("plant.body.drag_1_s", self.body.drag_1_s, 0.0, 10.0),
            ("plant.body.rate_drag_n_m_s2", self.body.rate_drag_n_m_s2, 0.0, 1e-2),
            ("plant.rotor.thrust_ratio", self.rotor.thrust_ratio, 0.2, 3.0),
            ("plant.rotor.spread_ratio", self.rotor.spread_ratio, 0.0, 0.2),
            ("plant.rotor.gain_up_1_s", self.rotor.gain_up_1_s, 1.0, 1000.0),
            ("plant.rotor.gain_down_1_s", self.rotor.gain_down_1_s, 1.0, 1000.0),
            ("plant.rotor.inflow_loss_s_m", self.rotor.inflow_loss_s_m, 0.0, 0.5),
            ("plant.rotor.radius_m", self.rotor.radius_m, 0.01, 1.0),
            ("plant.rotor.spin_inertia_kg_m2", self.rotor.spin_inertia_kg_m2, 0.0, 1e-3),
            ("plant.rotor.speed_rad_s_max", self.rotor.speed_rad_s_max, 10.0, 10_000.0),
            ("plant.gyro.scale_ratio", self.gyro.scale_ratio, 0.5, 2.0),
            ("plant.gyro.range_rad_s", self.gyro.range_rad_s, 1.0, 200.0),
            ("plant.gyro.noise_rad_s", self.gyro.noise_rad_s, 0.0, 5.0),
            ("plant.gyro.bias_rad_s", self.gyro.bias_rad_s, 0.0, 1.0),
            ("plant.gyro.flip_bias_rad_s", self.gyro.flip_bias_rad_s, 0.0, 1.0),
            ("plant.accelerometer.noise_m_s2", self.accelerometer.noise_m_s2, 0.0, 50.0),
            ("plant.accelerometer.bias_m_s2", self.accelerometer.bias_m_s2, 0.0, 5.0),
            ("plant.battery.full_v", self.battery.full_v, 1.0, 60.0),
            ("plant.battery.empty_v", self.battery.empty_v, 1.0, 60.0),
            ("plant.battery.hover_endurance_s", self.battery.hover_endurance_s, 1.0, 1e6),
            ("plant.battery.droop_ratio", self.battery.droop_ratio, 0.0, 0.9),
            ("plant.battery.droop_time_s", self.battery.droop_time_s, 0.001, 100.0),
            ("plant.battery.fade_ratio", self.battery.fade_ratio, 0.0, 0.9),
            ("plant.battery.knee_ratio", self.battery.knee_ratio, 0.0, 1.0),
            ("plant.battery.hover_sag_v", self.battery.hover_sag_v, 0.0, 10.0),
            ("plant.battery.initial_charge_ratio", self.battery.initial_charge_ratio, 0.0, 1.0),
            ("plant.air.gust_m_s2", self.air.gust_m_s2, 0.0, 50.0),
            ("plant.air.gust_time_s", self.air.gust_time_s, 0.001, 100.0),
            ("plant.air.ground_effect_ratio", self.air.ground_effect_ratio, 0.0, 5.0),
            ("plant.camera.rate_hz", self.camera.rate_hz, 1.0, 2000.0),
            ("plant.camera.position_noise_m", self.camera.position_noise_m, 0.0, 0.5),
            ("plant.camera.attitude_noise_rad", self.camera.attitude_noise_rad, 0.0, 1.0),
            ("plant.camera.latency_s", self.camera.latency_s, 0.0, 0.5),
            ("plant.camera.jitter_s", self.camera.jitter_s, 0.0, 0.5),
            ("plant.camera.dropout_ratio", self.camera.dropout_ratio, 0.0, 1.0),
            ("plant.clock.drift_ratio_max", self.clock.drift_ratio_max, 0.0, 1e-2),
            ("plant.clock.uptime_s_max", self.clock.uptime_s_max, 0.0, 1e6),
            ("plant.floor.gear_height_m", self.floor.gear_height_m, 0.0, 1.0),
            ("plant.floor.settle_time_s", self.floor.settle_time_s, 0.005, 10.0),
            ("plant.floor.crash_speed_m_s", self.floor.crash_speed_m_s, 0.01, 100.0),
            ("plant.floor.crash_tilt_rad", self.floor.crash_tilt_rad, 0.01, 4.0),
        ] {
            in_range(file, key, value, min, max)?;
        }
        at_most(
            file,
            ("plant.battery.empty_v", self.battery.empty_v),
            1.0,
            ("plant.battery.full_v", self.battery.full_v),
        )?;
        self.command_link.check(file, "plant.command_link")?;
        self.data_link.check(file, "plant.data_link")
    }
}
