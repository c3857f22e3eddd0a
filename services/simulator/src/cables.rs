//! The simulated devices' ends of the cables: where a bridge sends to, they listen, and the other way round.

use std::io;
use std::net::{SocketAddrV4, UdpSocket};
use std::task::{Context, Poll};

use plant::DeviceOutput;
use service_shell::{
    DatagramSocket, During, PseudoTerminal, ShellError, clock, connect_udp, interface_address, listen_udp,
    send_udp, stream_udp,
};
use settings::{Arena, ConfigError, DeviceUrl, Interface, MotionCaptureProtocol, Ports, Radio};
use tracing::{info, warn};

use crate::{Arrival, Simulation};

/// The simulated devices' ends of the cables.
pub(crate) struct Cables {
    ends: Vec<End>,
    failed: u64,
}

/// One device's end.
struct End {
    name: String,
    port: u16,
    by: By,
}

/// What an end is.
enum By {
    /// Datagrams to one address.
    Sender(UdpSocket),
    /// Datagrams from anybody; answers go to whoever spoke last.
    Server { socket: Box<DatagramSocket>, sender: UdpSocket, peer: Option<SocketAddrV4> },
    /// The far end of a pseudo terminal.
    Pty(PseudoTerminal),
}

impl Cables {
    /// Takes the devices' places. Call within a tokio runtime.
    pub(crate) fn open(arena: &Arena) -> Result<Self, ShellError> {
        let mut ends = motion_capture(arena)?;
        let devices = &arena.network.devices;
        if arena.fleet.iter().any(|member| member.vehicle.links.radio == Radio::Pair) {
            let by = at("devices.data_link.url", &devices.data_link.url)?;
            ends.push(End { name: "data-link".to_owned(), port: Ports::DATA_LINK, by });
        }
        for member in &arena.fleet {
            let id = member.vehicle.id;
            let url = devices.radio_of(member).map_err(|reason| refused(&reason))?;
            let by = at("devices.command_link.url", &url)?;
            ends.push(End { name: format!("command-link-{id}"), port: Ports::command_link(id), by });
        }
        Ok(Self { ends, failed: 0 })
    }

    /// Ready once there may be something to take.
    pub(crate) fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut polls = self.ends.iter().map(|end| match &end.by {
            By::Sender(_) => Poll::Pending,
            By::Server { socket, .. } => socket.poll_readable(cx),
            By::Pty(terminal) => terminal.poll_readable(cx),
        });
        polls.find(Poll::is_ready).unwrap_or(Poll::Pending)
    }

    /// Hands the simulation what each device was sent.
    pub(crate) fn take(&mut self, simulation: &mut Simulation) -> Result<(), ShellError> {
        for end in &mut self.ends {
            end.take(&mut |arrival| simulation.receive(arrival))?;
        }
        Ok(())
    }

    /// Sends what a device says.
    pub(crate) fn send(&mut self, output: DeviceOutput<'_>) {
        let port = output.device.port();
        let Some(end) = self.ends.iter_mut().find(|end| end.port == port) else { return };
        if let Err(error) = end.send(output.bytes) {
            self.failed += 1;
            if self.failed.is_power_of_two() {
                warn!(device = end.name, failed = self.failed, %error, "cannot send");
            }
        }
    }
}

impl End {
    fn take(&mut self, receive: &mut impl FnMut(Arrival)) -> Result<(), ShellError> {
        let what = || format!("receiving on {}", self.name);
        match &mut self.by {
            By::Sender(_) => {}
            By::Server { socket, peer, .. } => {
                let count = socket.take_batch().during(what)?;
                for index in 0..count {
                    let datagram = socket.datagram(index);
                    if *peer != Some(datagram.from) {
                        info!(device = self.name, peer = %datagram.from, "has a new user");
                        *peer = Some(datagram.from);
                    }
                    receive(Arrival { at: datagram.at, port: self.port, bytes: datagram.bytes.to_vec() });
                }
            }
            By::Pty(terminal) => {
                let bytes = terminal.take().during(what)?;
                if !bytes.is_empty() {
                    receive(Arrival { at: clock::now(), port: self.port, bytes });
                }
            }
        }
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let sent = match &mut self.by {
            By::Sender(socket) => send_udp(socket, bytes),
            By::Server { sender, peer: Some(peer), .. } => sender.send_to(bytes, *peer).map(|_| ()),
            // As on a cable with nobody at its other end.
            By::Server { peer: None, .. } => Ok(()),
            By::Pty(terminal) => terminal.send(bytes),
        };
        match sent {
            // The bridge has gone; it will speak again when it is back.
            Err(error)
                if matches!(error.kind(), io::ErrorKind::ConnectionRefused | io::ErrorKind::WouldBlock) =>
            {
                Ok(())
            }
            sent => sent,
        }
    }
}

fn motion_capture(arena: &Arena) -> Result<Vec<End>, ShellError> {
    let capture = &arena.network.devices.motion_capture;
    let DeviceUrl::Udp(address) = capture.url else {
        return Err(misplaced("devices.motion_capture.url", &capture.url));
    };
    let port = Ports::MOTION_CAPTURE;
    let mut ends = match capture.protocol {
        MotionCaptureProtocol::Vicon => {
            vec![End { name: "vicon".to_owned(), port, by: By::Sender(connect_udp(address)?) }]
        }
        MotionCaptureProtocol::Natnet => {
            vec![End { name: "natnet".to_owned(), port, by: serve(address)? }]
        }
    };
    if let (MotionCaptureProtocol::Natnet, Some(group)) = (capture.protocol, capture.natnet.group) {
        let interface = interface_address(Interface::towards(*address.ip()))?;
        let socket = stream_udp(group, interface, arena.network.ttl)?;
        let name = "natnet-group".to_owned();
        ends.push(End { name, port: Ports::MOTION_CAPTURE_GROUP, by: By::Sender(socket) });
    }
    Ok(ends)
}

fn at(key: &str, url: &DeviceUrl) -> Result<By, ShellError> {
    match url {
        DeviceUrl::Udp(address) => serve(*address),
        DeviceUrl::Pty(path) => {
            let terminal = PseudoTerminal::create(path)
                .during(|| format!("making the pseudo terminal {}", path.display()))?;
            Ok(By::Pty(terminal))
        }
        DeviceUrl::Serial(_) | DeviceUrl::Radio(_) => Err(misplaced(key, url)),
    }
}

fn serve(address: SocketAddrV4) -> Result<By, ShellError> {
    let socket = listen_udp(address)?;
    let sender = socket.sender().during(|| format!("opening udp {address}"))?;
    Ok(By::Server { socket: Box::new(socket), sender, peer: None })
}

fn misplaced(key: &str, url: &DeviceUrl) -> ShellError {
    refused(&format!("{key} = \"{url}\": a simulated device is at udp:// or pty:"))
}

fn refused(reason: &str) -> ShellError {
    ConfigError::Malformed { file: "network.toml".to_owned(), reason: reason.to_owned() }.into()
}
