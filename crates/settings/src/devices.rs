//! The vendors' equipment: what it speaks and where it is.

use std::net::SocketAddrV4;

use serde::{Deserialize, Serialize};

use crate::{ConfigError, DeviceUrl, FleetVehicle, Radio, UrlPattern};

/// The vendors' equipment. The simulator plays the same equipment at the same places.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Devices {
    /// The cameras.
    pub motion_capture: MotionCapture,
    /// The encoders of the one-way command link, one per vehicle.
    pub command_link: CommandLink,
    /// The radio of the two-way data link.
    pub data_link: DataLink,
    /// The vehicles that are Crazyflies.
    pub crazyflie: Crazyflie,
}

/// The motion-capture system.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionCapture {
    /// What it speaks.
    pub protocol: MotionCaptureProtocol,
    /// `vicon`: where the bridge listens for its datagrams. `natnet`: where its server takes requests.
    pub url: DeviceUrl,
    /// What only OptiTrack's needs.
    #[serde(default)]
    pub natnet: NatNet,
}

/// What a motion-capture system speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionCaptureProtocol {
    /// Vicon Tracker's UDP object stream.
    Vicon,
    /// OptiTrack's NatNet, 3.0 to 4.1.
    Natnet,
}

/// Settings of an OptiTrack system.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NatNet {
    /// Motive's streaming setting *Up Axis*.
    pub up_axis: UpAxis,
    /// The version to ask for; the default is what the server speaks by itself. A server that streams to a
    /// group cannot be asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<NatNetVersion>,
    /// Group and port the frames are streamed to; the default is to whoever asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<SocketAddrV4>,
}

/// Which of Motive's axes points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpAxis {
    /// y, Motive's default.
    #[default]
    Y,
    /// z.
    Z,
}

/// A layout of NatNet's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NatNetVersion {
    /// 3.0.
    #[serde(rename = "3.0")]
    V3_0,
    /// 3.1, of Motive 2.
    #[serde(rename = "3.1")]
    V3_1,
    /// 4.0, of Motive 3.0.
    #[serde(rename = "4.0")]
    V4_0,
    /// 4.1, of Motive 3.1.
    #[serde(rename = "4.1")]
    V4_1,
}

/// The command link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandLink {
    /// What its encoders speak.
    pub protocol: CommandProtocol,
    /// Where a vehicle's encoder is.
    pub url: UrlPattern,
    /// Bits of a channel that survive the way through the air: 11, or 10 for ExpressLRS.
    #[serde(default)]
    pub channel_bits: ChannelBits,
}

/// What the encoders of the command link speak.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandProtocol {
    /// SBUS.
    Sbus,
    /// CRSF, of Crossfire and ExpressLRS modules.
    Crsf,
}

/// Bits of a channel that survive the way through the air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum ChannelBits {
    /// The upper ten: ExpressLRS.
    Ten,
    /// All eleven: wires, and radios that carry SBUS as it is.
    #[default]
    Eleven,
}

impl TryFrom<u8> for ChannelBits {
    type Error = String;

    fn try_from(bits: u8) -> Result<Self, String> {
        match bits {
            10 => Ok(Self::Ten),
            11 => Ok(Self::Eleven),
            other => Err(format!("a channel has 10 or 11 bits, not {other}")),
        }
    }
}

impl From<ChannelBits> for u8 {
    fn from(bits: ChannelBits) -> Self {
        match bits {
            ChannelBits::Ten => 10,
            ChannelBits::Eleven => 11,
        }
    }
}

/// The data link: an XBee module in API mode with escapes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataLink {
    /// Where it is.
    pub url: DeviceUrl,
}

/// The vehicles that are Crazyflies, or simulators of them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crazyflie {
    /// Where a vehicle is.
    pub url: UrlPattern,
}

impl Devices {
    /// Refuses equipment that cannot be where it is said to be.
    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        let misplaced = |key: &str, value: &str, reason: &str| {
            Err(ConfigError::Malformed {
                file: file.to_owned(),
                reason: format!("{key} = {value:?}: {reason}"),
            })
        };
        let capture = &self.motion_capture;
        let group = capture.natnet.group;
        if !matches!(capture.url, DeviceUrl::Udp(_)) {
            let reason = "motion capture comes in datagrams, so it needs udp://";
            return misplaced("devices.motion_capture.url", &capture.url.to_string(), reason);
        }
        if let Some(group) = group.filter(|group| !group.ip().is_multicast() || group.port() == 0) {
            let reason = "that is no multicast address (224.0.0.0/4) and port";
            return misplaced("devices.motion_capture.natnet.group", &group.to_string(), reason);
        }
        if matches!(self.data_link.url, DeviceUrl::Radio(_)) {
            let reason = "the data link is an XBee module: udp://, serial:// or pty:";
            return misplaced("devices.data_link.url", &self.data_link.url.to_string(), reason);
        }
        let encoders = &self.command_link.url;
        if matches!(encoders.of_vehicle(1), Ok(DeviceUrl::Radio(_))) {
            let reason = "the command link has encoders: udp://, serial:// or pty:";
            return misplaced("devices.command_link.url", encoders.as_str(), reason);
        }
        let crazyflies = &self.crazyflie.url;
        if !matches!(crazyflies.of_vehicle(1), Ok(DeviceUrl::Radio(_) | DeviceUrl::Udp(_))) {
            let reason = "a Crazyflie is reached by radio:// or, simulated, by udp://";
            return misplaced("devices.crazyflie.url", crazyflies.as_str(), reason);
        }
        Ok(())
    }

    /// Where the radios of a vehicle are: the encoder of its command link, or the vehicle itself where it is a
    /// Crazyflie.
    ///
    /// # Errors
    /// As [`UrlPattern::of_vehicle`].
    pub fn radio_of(&self, member: &FleetVehicle) -> Result<DeviceUrl, String> {
        self.pattern_of(member.vehicle.links.radio).1.of_vehicle(member.vehicle.id)
    }

    fn pattern_of(&self, radio: Radio) -> (&'static str, &UrlPattern) {
        match radio {
            Radio::Pair => ("devices.command_link.url", &self.command_link.url),
            Radio::Crazyradio => ("devices.crazyflie.url", &self.crazyflie.url),
        }
    }

    /// Refuses a fleet of which two devices would be in one place.
    pub(crate) fn check_fleet(&self, file: &str, fleet: &[FleetVehicle]) -> Result<(), ConfigError> {
        let clash =
            |(key, value): (&str, String), (other_key, other_value): (&str, String), reason: String| {
                let (file, key, other_key) = (file.to_owned(), key.to_owned(), other_key.to_owned());
                Err(ConfigError::Contradiction { file, key, value, other_key, other_value, reason })
            };
        let capture = ("devices.motion_capture.url".to_owned(), self.motion_capture.url.clone());
        let data_link = ("devices.data_link.url".to_owned(), self.data_link.url.clone());
        if capture.1 == data_link.1 {
            let (one, other) = (data_link.1.to_string(), capture.1.to_string());
            let reason = "two devices cannot be in one place".to_owned();
            return clash((&data_link.0, one), (&capture.0, other), reason);
        }
        let mut taken = vec![capture, data_link];
        for member in fleet {
            let id = member.vehicle.id;
            let (key, pattern) = self.pattern_of(member.vehicle.links.radio);
            let url = match pattern.of_vehicle(id) {
                Ok(url) => url,
                Err(reason) => {
                    return clash((key, pattern.to_string()), ("a vehicle's id", id.to_string()), reason);
                }
            };
            if let Some((other, place)) = taken.iter().find(|(_, place)| *place == url) {
                let advice =
                    if pattern.is_one_per_vehicle() { "" } else { "; {id} stands for a vehicle's id" };
                let reason = format!("that is where vehicle {id}'s radio is{advice}");
                return clash((key, pattern.to_string()), (other, place.to_string()), reason);
            }
            taken.push((format!("the radio of vehicle {id}"), url));
        }
        Ok(())
    }
}
