//! Settings: TOML files in one folder, inherited once, validated once, unknown keys refused.
//!
//! [`Arena::load`] reads the folder and returns everything resolved; the simulator, the controller and the learner
//! read the same values. A wrong setting names its file, its key and both values ([`ConfigError`]).

mod arena;
mod device_url;
mod devices;
mod error;
mod hall;
mod interface;
mod network;
mod overlay;
mod places;
mod plant;
mod ports;
mod read;
mod scenario;
mod vehicle;

pub use arena::{Arena, FleetVehicle};
pub use device_url::{DeviceUrl, Framing, RadioAddress, RadioRate, SerialLine, UrlPattern};
pub use devices::{
    ChannelBits, CommandLink, CommandProtocol, Crazyflie, DataLink, Devices, MotionCapture,
    MotionCaptureProtocol, NatNet, NatNetVersion, UpAxis,
};
pub use error::ConfigError;
pub use hall::Hall;
pub use interface::Interface;
pub use network::{Endpoint, Network};
pub use overlay::{Change, Overlay};
pub use plant::{
    AccelerometerSettings, AirSettings, BatterySettings, BodySettings, CameraSettings, ClockSettings,
    FloorSettings, GyroSettings, LinkSettings, PlantSettings, RotorPlantSettings,
};
pub use ports::Ports;
pub use scenario::{FlipSettings, Scenario, ScenarioVehicle};
pub use vehicle::{Airframe, Battery, Integral, Links, Radio, RateLoop, Rotor, Vehicle};
