//! What tests need of the host: a folder and a bus of their own, gone when the test ends.

use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU16, Ordering};

use settings::{DeviceUrl, Endpoint, Interface, Network};

pub(crate) struct Scratch(PathBuf);

impl Scratch {
    pub(crate) fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("flyarena-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A bus on loopback that no other test of this process shares, nor, by its group, another process.
pub(crate) fn network() -> Network {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let port = 20_000 + 16 * NEXT.fetch_add(1, Ordering::Relaxed);
    let process = std::process::id().to_le_bytes();
    let endpoint =
        |offset| Endpoint { group: Ipv4Addr::new(239, 193, process[0], process[1]), port: port + offset };
    let device =
        |offset| SocketAddrV4::new(Ipv4Addr::new(127, 193, process[0], process[1].max(1)), port + offset);
    Network {
        interface: Interface::at(Ipv4Addr::LOCALHOST),
        ttl: 0,
        receive_buffer_bytes: 1 << 20,
        live: endpoint(0),
        sim: endpoint(1),
        replay: endpoint(2),
        devices: toml::from_str(&format!(
            "[motion_capture]\nprotocol = \"vicon\"\nurl = \"udp://{}\"\n\
             [data_link]\nurl = \"udp://{}\"\n\
             [command_link]\nprotocol = \"sbus\"\nurl = \"udp://{}\"\n\
             [crazyflie]\nurl = \"udp://{}\"\n",
            device(3),
            device(4),
            device(5),
            device(10)
        ))
        .unwrap(),
    }
}

/// The address of a device that speaks datagrams.
pub(crate) fn udp(url: &DeviceUrl) -> SocketAddrV4 {
    match url {
        DeviceUrl::Udp(address) => *address,
        other => panic!("{other} is no datagram's"),
    }
}
