//! Where the bus runs and where the devices are: what changes between a simulated and a real arena.

use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};

use crate::read::in_range;
use crate::{ConfigError, Devices, Interface};

/// The bus and the devices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// The interface that multicast leaves and enters by.
    pub interface: Interface,
    /// 0 keeps datagrams on this host, 1 on this network; more is refused.
    pub ttl: u32,
    /// Receive buffer asked of the kernel.
    pub receive_buffer_bytes: u32,
    /// Group and port of the real arena.
    pub live: Endpoint,
    /// Group and port of a simulated arena.
    pub sim: Endpoint,
    /// Group and port of replayed recordings.
    pub replay: Endpoint,
    /// The vendors' equipment.
    pub devices: Devices,
}

/// A multicast group and port.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Endpoint {
    /// The group.
    pub group: Ipv4Addr,
    /// The port.
    pub port: u16,
}

impl Network {
    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        in_range(file, "ttl", f64::from(self.ttl), 0.0, 1.0)?;
        in_range(
            file,
            "receive_buffer_bytes",
            f64::from(self.receive_buffer_bytes),
            65_536.0,
            268_435_456.0,
        )?;
        for (key, port) in
            [("live.port", self.live.port), ("sim.port", self.sim.port), ("replay.port", self.replay.port)]
        {
            in_range(file, key, f64::from(port), 1.0, 65_535.0)?;
        }
        for (key, endpoint) in [("live", &self.live), ("sim", &self.sim), ("replay", &self.replay)] {
            if !endpoint.group.is_multicast() {
                return Err(ConfigError::Malformed {
                    file: file.to_owned(),
                    reason: format!(
                        "{key}.group = {} is not a multicast address (224.0.0.0/4)",
                        endpoint.group
                    ),
                });
            }
        }
        for (key, one, other_key, other) in [
            ("live", &self.live, "sim", &self.sim),
            ("live", &self.live, "replay", &self.replay),
            ("sim", &self.sim, "replay", &self.replay),
        ] {
            if one.group == other.group || one.port == other.port {
                return Err(ConfigError::Contradiction {
                    file: file.to_owned(),
                    key: key.to_owned(),
                    value: format!("{}:{}", one.group, one.port),
                    other_key: other_key.to_owned(),
                    other_value: format!("{}:{}", other.group, other.port),
                    reason: "each domain needs a group and a port of its own".to_owned(),
                });
            }
        }
        self.devices.check(file)
    }
}
