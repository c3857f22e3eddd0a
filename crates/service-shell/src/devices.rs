//! Devices: the vendors' cables, at the two bridges.
//!
//! What arrives on a cable is handed to the bridge's core as [`DeviceBytes`]; what the core says on its
//! device topic is handed to the cable of that port. All cables are UDP so far.

use std::io;
use std::net::{SocketAddrV4, UdpSocket};
use std::task::{Context, Poll};

use schemas::{DeviceBytes, Topic, topics};
use service_core::Published;
use settings::{Arena, Ports};
use tracing::warn;

use crate::ShellError;
use crate::datagrams::{Datagram, DatagramSocket, bind_udp, connect_udp, send_udp};
use crate::error::During;

/// How to reach a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Address {
    /// It sends datagrams to this address of ours.
    UdpFrom(SocketAddrV4),
    /// Datagrams go to this address of its, and come back from there.
    UdpTo(SocketAddrV4),
}

/// One end of a cable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// The device's name in logs.
    pub name: String,
    /// Its number in [`DeviceBytes`].
    pub port: u16,
    /// Where it is.
    pub address: Address,
    /// The topic of what comes from it; `None` for a device that only listens.
    pub receives: Option<&'static Topic>,
    /// The topic of what goes to it; `None` for a device that only talks.
    pub transmits: Option<&'static Topic>,
}

/// The devices of a service: none for all but the bridges.
#[must_use]
pub fn endpoints(service: &str, arena: &Arena) -> Vec<Endpoint> {
    let devices = &arena.network.devices;
    match service {
        "vicon-bridge" => vec![Endpoint {
            name: "vicon".to_owned(),
            port: Ports::VICON,
            address: Address::UdpFrom(devices.vicon),
            receives: Some(&topics::VICON_RX),
            transmits: None,
        }],
        "radio-bridge" => {
            let data_link = Endpoint {
                name: "data-link".to_owned(),
                port: Ports::DATA_LINK,
                address: Address::UdpTo(devices.data_link),
                receives: Some(&topics::RADIO_RX),
                transmits: Some(&topics::RADIO_TX),
            };
            let command_links = arena.fleet.iter().map(|member| Endpoint {
                name: format!("command-link-{}", member.vehicle.id),
                port: Ports::command_link(member.vehicle.id),
                address: Address::UdpTo(command_link(devices.command_link, member.vehicle.id)),
                receives: None,
                transmits: Some(&topics::RADIO_TX),
            });
            std::iter::once(data_link).chain(command_links).collect()
        }
        _ => Vec::new(),
    }
}

/// The address of a vehicle's command-link encoder.
#[must_use]
pub fn command_link(base: SocketAddrV4, vehicle: u8) -> SocketAddrV4 {
    SocketAddrV4::new(*base.ip(), base.port().saturating_add(u16::from(vehicle)))
}

/// The transmitting side of a bridge's devices.
pub(crate) struct Transmitters {
    cables: Vec<(Endpoint, UdpSocket)>,
    failed: u64,
}

/// The receiving side of one device.
pub(crate) struct Receiver {
    pub port: u16,
    pub topic: &'static Topic,
    socket: DatagramSocket,
    name: String,
}

/// Opens cables. Call within a tokio runtime.
pub(crate) fn open(endpoints: Vec<Endpoint>) -> Result<(Transmitters, Vec<Receiver>), ShellError> {
    let (mut cables, mut receivers) = (Vec::new(), Vec::new());
    for endpoint in endpoints {
        let socket = match endpoint.address {
            Address::UdpFrom(local) => bind_udp(local),
            Address::UdpTo(peer) => connect_udp(peer),
        }?;
        let socket = match endpoint.receives {
            Some(topic) => {
                let what = || format!("opening {}", endpoint.name);
                let socket = DatagramSocket::new(socket, false).during(what)?;
                let sender = socket.sender().during(what)?;
                receivers.push(Receiver { port: endpoint.port, topic, socket, name: endpoint.name.clone() });
                sender
            }
            None => socket,
        };
        if endpoint.transmits.is_some() {
            cables.push((endpoint, socket));
        }
    }
    Ok((Transmitters { cables, failed: 0 }, receivers))
}

impl Transmitters {
    /// Hands a core's device bytes to their device; other messages pass.
    pub(crate) fn transmit(&mut self, published: &Published<'_>) {
        let ours = |endpoint: &Endpoint| endpoint.transmits.is_some_and(|topic| *topic == *published.topic);
        if !published.is_data() || !self.cables.iter().any(|(endpoint, _)| ours(endpoint)) {
            return;
        }
        let Ok(message) = wire::decode::<DeviceBytes>(published.body) else {
            return;
        };
        let cable = self.cables.iter().find(|(endpoint, _)| ours(endpoint) && endpoint.port == message.port);
        let Some((endpoint, socket)) = cable else {
            warn!(port = message.port, "bytes for a device that is not there");
            return;
        };
        if let Err(error) = send_udp(socket, &message.bytes) {
            // A dead radio says so once per frame: log powers of two.
            self.failed += 1;
            if self.failed.is_power_of_two() {
                warn!(device = endpoint.name, failed = self.failed, %error, "cannot send to a device");
            }
        }
    }
}

impl Receiver {
    pub(crate) fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.socket.poll_readable(cx)
    }

    pub(crate) fn take_batch(&mut self) -> Result<usize, ShellError> {
        self.socket.take_batch().during(|| format!("receiving from {}", self.name))
    }

    pub(crate) fn datagram(&self, index: usize) -> Datagram<'_> {
        self.socket.datagram(index)
    }

    pub(crate) fn take_overflowed(&mut self) -> u64 {
        self.socket.take_overflowed()
    }
}
