//! A device's cable for a moment: bytes there, bytes back.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use quantity::{Span, Time};
use service_shell::{LineAddress, clock};
use settings::DeviceUrl;

/// Between two looks.
const LOOK_PERIOD: Duration = Duration::from_millis(2);
const BYTES_MAX: usize = 65_536;

/// A device's cable.
pub enum Cable {
    /// Datagrams.
    Udp(UdpSocket),
    /// A serial line or pseudo terminal.
    Line(File),
}

impl Cable {
    /// Opens the cable to a device that is spoken to.
    pub fn to(url: &DeviceUrl) -> io::Result<Self> {
        match url {
            DeviceUrl::Udp(peer) => {
                let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0))?;
                socket.connect(*peer)?;
                Self::datagrams(socket)
            }
            DeviceUrl::Serial(line) => {
                Ok(Self::Line(LineAddress::Serial(line.clone()).open().map(File::from)?))
            }
            DeviceUrl::Pty(path) => Ok(Self::Line(LineAddress::Pty(path.clone()).open().map(File::from)?)),
            DeviceUrl::Radio(_) => Err(io::Error::other("a Crazyradio is not looked at from here")),
        }
    }

    /// Opens the cable of a device that speaks to an address of this host.
    pub fn from(local: SocketAddrV4) -> io::Result<Self> {
        Self::datagrams(UdpSocket::bind(local)?)
    }

    fn datagrams(socket: UdpSocket) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self::Udp(socket))
    }

    /// Sends bytes.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Udp(socket) => socket.send(bytes).map(|_| ()),
            Self::Line(line) => line.write_all(bytes),
        }
    }

    /// Hands over what comes, until then or until `each` says that it is enough.
    pub fn listen(&mut self, span: Span, mut each: impl FnMut(&[u8]) -> bool) -> io::Result<()> {
        let until: Time = clock::now() + span;
        let mut bytes = vec![0; BYTES_MAX];
        while clock::now() < until {
            let taken = match self {
                Self::Udp(socket) => socket.recv(&mut bytes),
                Self::Line(line) => line.read(&mut bytes),
            };
            match taken {
                Ok(0) => std::thread::sleep(LOOK_PERIOD),
                Ok(count) if each(&bytes[..count]) => return Ok(()),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(LOOK_PERIOD),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
