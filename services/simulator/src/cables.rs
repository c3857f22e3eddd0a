//! The simulated devices' ends of the cables.

use std::io;
use std::net::{SocketAddrV4, UdpSocket};
use std::task::{Context, Poll};

use plant::{Device, DeviceOutput};
use service_shell::{DatagramSocket, During, ShellError, command_link, connect_udp, listen_udp, send_udp};
use settings::{Arena, Ports};
use tracing::{info, warn};

use crate::{Arrival, Simulation};

/// The simulated devices' ends of the cables.
pub(crate) struct Cables {
    vicon: UdpSocket,
    data_link_sender: UdpSocket,
    data_link_peer: Option<SocketAddrV4>,
    inputs: Vec<Input>,
    failed: u64,
}

struct Input {
    port: u16,
    name: String,
    socket: DatagramSocket,
}

impl Cables {
    /// Takes the devices' addresses. Call within a tokio runtime.
    pub(crate) fn open(arena: &Arena) -> Result<Self, ShellError> {
        let devices = &arena.network.devices;
        let data_link = listen_udp(devices.data_link)?;
        let data_link_sender = data_link.sender().during(|| format!("opening udp {}", devices.data_link))?;
        let mut inputs =
            vec![Input { port: Ports::DATA_LINK, name: "data-link".to_owned(), socket: data_link }];
        for member in &arena.fleet {
            let id = member.vehicle.id;
            let socket = listen_udp(command_link(devices.command_link, id))?;
            inputs.push(Input { port: Ports::command_link(id), name: format!("command-link-{id}"), socket });
        }
        Ok(Self {
            vicon: connect_udp(devices.vicon)?,
            data_link_sender,
            data_link_peer: None,
            inputs,
            failed: 0,
        })
    }

    /// Ready once there may be something to take.
    pub(crate) fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.inputs
            .iter()
            .map(|input| input.socket.poll_readable(cx))
            .find(Poll::is_ready)
            .unwrap_or(Poll::Pending)
    }

    /// Hands the simulation a batch of what each device was sent.
    pub(crate) fn take(&mut self, simulation: &mut Simulation) -> Result<(), ShellError> {
        for input in &mut self.inputs {
            let count = input.socket.take_batch().during(|| format!("receiving on {}", input.name))?;
            for index in 0..count {
                let datagram = input.socket.datagram(index);
                if input.port == Ports::DATA_LINK && self.data_link_peer != Some(datagram.from) {
                    info!(peer = %datagram.from, "the data link has a new user");
                    self.data_link_peer = Some(datagram.from);
                }
                simulation.receive(Arrival {
                    at: datagram.at,
                    port: input.port,
                    bytes: datagram.bytes.to_vec(),
                });
            }
        }
        Ok(())
    }

    /// Sends what a device says.
    pub(crate) fn send(&mut self, output: DeviceOutput<'_>) {
        let sent = match (output.device, self.data_link_peer) {
            (Device::Vicon, _) => send_udp(&self.vicon, output.bytes),
            (Device::DataLink, Some(peer)) => self.data_link_sender.send_to(output.bytes, peer).map(|_| ()),
            // As on a cable with nobody at its other end.
            (Device::DataLink, None) => Ok(()),
        };
        match sent {
            // The bridge has gone; it will speak again when it is back.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
            Err(error) => {
                self.failed += 1;
                if self.failed.is_power_of_two() {
                    warn!(device = ?output.device, failed = self.failed, %error, "cannot send");
                }
            }
            Ok(()) => {}
        }
    }
}
