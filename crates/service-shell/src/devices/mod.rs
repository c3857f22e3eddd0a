//! Devices: the vendors' cables, at the two bridges.
//!
//! What arrives on a cable is handed to the bridge's core as [`DeviceBytes`]; what the core says on its
//! device topic is handed to the cable of that port. A cable is a UDP socket or a serial [`line`], and to a Crazyradio a
//! socket with a thread at its other end.

#[cfg(any(test, feature = "crazyradio"))]
#[cfg_attr(
    not(feature = "crazyradio"),
    allow(dead_code, reason = "without the driver only its tests use it")
)]
mod crazyradio;
mod line;
mod pty;

use std::cell::RefCell;
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::rc::Rc;
use std::task::{Context, Poll};

use quantity::Time;
use schemas::{DeviceBytes, Topic, topics};
use service_core::Published;
use settings::{
    Arena, CommandProtocol, ConfigError, DeviceUrl, MotionCaptureProtocol, Ports, Radio, RadioAddress,
};
use tracing::warn;

use crate::datagrams::{DatagramSocket, bind_udp, connect_udp, join_udp, send_udp};
use crate::error::During;
use crate::interface::interface_address;
use crate::{ShellError, clock};

use line::{Line, PIECE_BYTES_MAX};

pub use line::LineAddress;
pub use pty::PseudoTerminal;

/// How to reach a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// It sends datagrams to this address of ours.
    UdpFrom(SocketAddrV4),
    /// Datagrams go to this address of its, and come back from there.
    UdpTo(SocketAddrV4),
    /// It sends datagrams to this group.
    Group {
        /// Group and port.
        group: SocketAddrV4,
        /// Our interface towards it.
        interface: Ipv4Addr,
    },
    /// It is on a serial line.
    Line(LineAddress),
    /// It is behind a Crazyradio.
    Radio(RadioAddress),
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
///
/// # Errors
/// A URL that is none for a vehicle's id, or a network in which this host is not.
pub fn endpoints(service: &str, arena: &Arena) -> Result<Vec<Endpoint>, ShellError> {
    match service {
        "vicon-bridge" => motion_capture(arena),
        "radio-bridge" => radios(arena),
        _ => Ok(Vec::new()),
    }
}

fn motion_capture(arena: &Arena) -> Result<Vec<Endpoint>, ShellError> {
    let capture = &arena.network.devices.motion_capture;
    let DeviceUrl::Udp(at) = capture.url else {
        return Err(misplaced("devices.motion_capture.url", &capture.url));
    };
    let endpoint = |name: &str, port, address, transmits| Endpoint {
        name: name.to_owned(),
        port,
        address,
        receives: Some(&topics::VICON_RX),
        transmits,
    };
    let tracker = match capture.protocol {
        MotionCaptureProtocol::Vicon => {
            return Ok(vec![endpoint("vicon", Ports::MOTION_CAPTURE, Address::UdpFrom(at), None)]);
        }
        MotionCaptureProtocol::Natnet => {
            endpoint("natnet", Ports::MOTION_CAPTURE, Address::UdpTo(at), Some(&topics::VICON_TX))
        }
    };
    let Some(group) = capture.natnet.group else { return Ok(vec![tracker]) };
    // The server is asked by way of the same interface that its frames come by.
    let interface = interface_towards(at)?;
    let stream = Address::Group { group, interface };
    Ok(vec![tracker, endpoint("natnet-group", Ports::MOTION_CAPTURE_GROUP, stream, None)])
}

fn interface_towards(peer: SocketAddrV4) -> Result<Ipv4Addr, ShellError> {
    interface_address(settings::Interface::towards(*peer.ip()))
}

fn radios(arena: &Arena) -> Result<Vec<Endpoint>, ShellError> {
    let devices = &arena.network.devices;
    let mut endpoints = Vec::with_capacity(1 + arena.fleet.len());
    if arena.fleet.iter().any(|member| member.vehicle.links.radio == Radio::Pair) {
        endpoints.push(Endpoint {
            name: "data-link".to_owned(),
            port: Ports::DATA_LINK,
            address: address("devices.data_link.url", &devices.data_link.url)?,
            receives: Some(&topics::RADIO_RX),
            transmits: Some(&topics::RADIO_TX),
        });
    }
    for member in &arena.fleet {
        let id = member.vehicle.id;
        let url = devices
            .radio_of(member)
            .map_err(|reason| ConfigError::Malformed { file: "network.toml".to_owned(), reason })?;
        // An SBUS encoder has nothing to say.
        let answers = member.vehicle.links.radio == Radio::Crazyradio
            || devices.command_link.protocol == CommandProtocol::Crsf;
        endpoints.push(Endpoint {
            name: format!("command-link-{id}"),
            port: Ports::command_link(id),
            address: match (member.vehicle.links.radio, &url) {
                (Radio::Crazyradio, DeviceUrl::Radio(radio)) => Address::Radio(*radio),
                _ => address("devices.command_link.url", &url)?,
            },
            receives: answers.then_some(&topics::RADIO_RX),
            transmits: Some(&topics::RADIO_TX),
        });
    }
    Ok(endpoints)
}

fn address(key: &str, url: &DeviceUrl) -> Result<Address, ShellError> {
    match url {
        DeviceUrl::Udp(peer) => Ok(Address::UdpTo(*peer)),
        DeviceUrl::Serial(line) => Ok(Address::Line(LineAddress::Serial(line.clone()))),
        DeviceUrl::Pty(path) => Ok(Address::Line(LineAddress::Pty(path.clone()))),
        DeviceUrl::Radio(_) => Err(misplaced(key, url)),
    }
}

/// Settings are checked when they are read; here they may come from a recording.
fn misplaced(key: &str, url: &DeviceUrl) -> ShellError {
    let reason = format!("{key} = \"{url}\": no such device can be there");
    ConfigError::Malformed { file: "network.toml".to_owned(), reason }.into()
}

/// The transmitting side of a bridge's devices.
pub(crate) struct Transmitters {
    cables: Vec<(Endpoint, Cable)>,
    failed: u64,
}

/// The Crazyradios of a service.
#[derive(Default)]
struct Dongles {
    #[cfg(feature = "crazyradio")]
    plugged: crazyradio::Dongles,
}

#[cfg(feature = "crazyradio")]
impl Dongles {
    fn plug(&mut self, address: RadioAddress) -> io::Result<UdpSocket> {
        self.plugged.plug(address)
    }

    fn start(self) -> io::Result<()> {
        self.plugged.start(crazyradio::driver::open)
    }
}

#[cfg(not(feature = "crazyradio"))]
impl Dongles {
    fn plug(&mut self, _address: RadioAddress) -> io::Result<UdpSocket> {
        let reason = "radio:// needs a build with Crazyradio's driver: cargo build --features crazyradio";
        Err(io::Error::new(io::ErrorKind::Unsupported, reason))
    }

    fn start(self) -> io::Result<()> {
        Ok(())
    }
}

/// What bytes leave by.
enum Cable {
    Socket(UdpSocket),
    Line(Rc<RefCell<Line>>),
}

/// The receiving side of one device.
pub(crate) struct Receiver {
    pub port: u16,
    pub topic: &'static Topic,
    source: Source,
    name: String,
}

/// What bytes come by.
enum Source {
    Socket(Box<DatagramSocket>),
    Line { line: Rc<RefCell<Line>>, piece: Box<[u8]>, length: usize, at: Time },
}

/// What came from a device at once: a datagram, or a piece of a serial stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Piece<'a> {
    /// When it reached this host.
    pub at: Time,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// Opens cables. Call within a tokio runtime.
pub(crate) fn open(endpoints: Vec<Endpoint>) -> Result<(Transmitters, Vec<Receiver>), ShellError> {
    let (mut cables, mut receivers) = (Vec::new(), Vec::new());
    let mut dongles = Dongles::default();
    for endpoint in endpoints {
        let (cable, source) = open_one(&endpoint, &mut dongles)?;
        if let (Some(topic), Some(source)) = (endpoint.receives, source) {
            receivers.push(Receiver { port: endpoint.port, topic, source, name: endpoint.name.clone() });
        }
        if endpoint.transmits.is_some() {
            cables.push((endpoint, cable));
        }
    }
    dongles.start().during(|| "starting the threads of Crazyradios".to_owned())?;
    Ok((Transmitters { cables, failed: 0 }, receivers))
}

fn open_one(endpoint: &Endpoint, dongles: &mut Dongles) -> Result<(Cable, Option<Source>), ShellError> {
    let what = || format!("opening {}", endpoint.name);
    let socket = match &endpoint.address {
        Address::UdpFrom(local) => bind_udp(*local),
        Address::UdpTo(peer) => connect_udp(*peer),
        Address::Group { group, interface } => join_udp(*group, *interface),
        Address::Radio(address) => Ok(dongles.plug(*address).during(what)?),
        Address::Line(address) => {
            let line = Line::new(&endpoint.name, address.clone()).during(what)?;
            let line = Rc::new(RefCell::new(line));
            let piece = vec![0; PIECE_BYTES_MAX].into_boxed_slice();
            let source = Source::Line { line: Rc::clone(&line), piece, length: 0, at: clock::now() };
            return Ok((Cable::Line(line), Some(source)));
        }
    }?;
    if endpoint.receives.is_none() {
        return Ok((Cable::Socket(socket), None));
    }
    let socket = Box::new(DatagramSocket::new(socket, false).during(what)?);
    Ok((Cable::Socket(socket.sender().during(what)?), Some(Source::Socket(socket))))
}

impl Cable {
    fn send(&self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Socket(socket) => send_udp(socket, bytes),
            Self::Line(line) => line.borrow_mut().send(bytes),
        }
    }
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
        let Some((endpoint, cable)) = cable else {
            warn!(port = message.port, "bytes for a device that is not there");
            return;
        };
        if let Err(error) = cable.send(&message.bytes) {
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
        match &self.source {
            Source::Socket(socket) => socket.poll_readable(cx),
            Source::Line { line, .. } => line.borrow_mut().poll_readable(cx),
        }
    }

    /// Takes what has come, without waiting: how many pieces.
    pub(crate) fn take_batch(&mut self) -> Result<usize, ShellError> {
        match &mut self.source {
            Source::Socket(socket) => socket.take_batch().during(|| format!("receiving from {}", self.name)),
            Source::Line { line, piece, length, at } => {
                // Whoever waits for the line polls it before it sleeps.
                let mut cx = Context::from_waker(std::task::Waker::noop());
                *length = line.borrow_mut().take(&mut cx, piece);
                *at = clock::now();
                Ok(usize::from(*length > 0))
            }
        }
    }

    pub(crate) fn piece(&self, index: usize) -> Piece<'_> {
        match &self.source {
            Source::Socket(socket) => {
                let datagram = socket.datagram(index);
                Piece { at: datagram.at, bytes: datagram.bytes }
            }
            Source::Line { piece, length, at, .. } => Piece { at: *at, bytes: &piece[..*length] },
        }
    }

    pub(crate) fn take_overflowed(&mut self) -> u64 {
        match &mut self.source {
            Source::Socket(socket) => socket.take_overflowed(),
            Source::Line { .. } => 0,
        }
    }
}
