//! A UDP socket, read in batches with the kernel's notes.

use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsFd;
use std::task::{Context, Poll};

use quantity::Time;
use socket2::Socket;
use tokio::io::Interest;

use crate::ShellError;
use crate::clock::{self, ClockPair};
use crate::error::During;
use crate::kernel::{BATCH, Buffers, enable_notes, queue_fill};

/// A datagram that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram<'a> {
    /// When it reached this host.
    pub at: Time,
    /// Who sent it.
    pub from: SocketAddrV4,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// Whether a filtered socket's queue may have overflowed since it was last known not to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fill {
    Normal,
    /// Found more than half full.
    Overfull,
    /// Emptied since, but the kernel tells of drops only with the next datagram that gets through.
    JustDrained,
}

/// A UDP socket whose datagrams are taken in batches.
pub struct DatagramSocket {
    socket: tokio::net::UdpSocket,
    buffers: Buffers,
    arrivals: [Time; BATCH],
    count: usize,
    empty_at: Time,
    filtered: bool,
    fill: Fill,
    dropped: u32,
    overflowed: u64,
}

impl DatagramSocket {
    /// Takes over a bound socket; `filtered` says whether a kernel filter is attached. Call within a tokio
    /// runtime.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(socket: UdpSocket, filtered: bool) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        enable_notes(&socket)?;
        Ok(Self {
            socket: tokio::net::UdpSocket::from_std(socket)?,
            buffers: Buffers::new(),
            arrivals: [Time::ZERO; BATCH],
            count: 0,
            empty_at: clock::now(),
            filtered,
            fill: Fill::Normal,
            dropped: 0,
            overflowed: 0,
        })
    }

    /// A second handle of the socket, to send by; it never waits.
    ///
    /// # Errors
    /// What the system says.
    pub fn sender(&self) -> io::Result<UdpSocket> {
        self.socket.as_fd().try_clone_to_owned().map(UdpSocket::from)
    }

    /// Ready once there may be something to take.
    pub fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.socket.poll_recv_ready(cx)
    }

    /// Takes the next batch without waiting: how many datagrams it has.
    ///
    /// # Errors
    /// What the system says; what the network answers to something sent by this socket is no error.
    pub fn take_batch(&mut self) -> io::Result<usize> {
        let before = clock::now();
        let (socket, buffers, mut taken) = (&self.socket, &mut self.buffers, 0);
        let result = socket.try_io(Interest::READABLE, || {
            taken = buffers.receive(socket)?;
            // A batch that is not full has emptied the queue: wait for the kernel's next word.
            if taken < BATCH { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(()) }
        });
        self.count = taken;
        if taken == BATCH && self.filtered && self.fill != Fill::Overfull {
            // Without the answer, the sequence numbers that never came still tell.
            if queue_fill(&self.socket).is_ok_and(|(held, allowed)| held > allowed / 2) {
                self.fill = Fill::Overfull;
            }
        }
        self.note_arrivals();
        if taken < BATCH {
            self.empty_at = before;
        }
        if 0 < taken && taken < BATCH {
            self.fill = match self.fill {
                Fill::Overfull => Fill::JustDrained,
                Fill::JustDrained | Fill::Normal => Fill::Normal,
            };
        }
        match result {
            Err(error) if error.kind() != io::ErrorKind::WouldBlock && !is_of_the_network(&error) => {
                Err(error)
            }
            _ => Ok(taken),
        }
    }

    /// A datagram of the batch.
    #[must_use]
    pub fn datagram(&self, index: usize) -> Datagram<'_> {
        Datagram {
            at: self.arrivals[index],
            from: self.buffers.peer(index),
            bytes: self.buffers.datagram(index),
        }
    }

    /// Whether the last batch was full: there may be more.
    #[must_use]
    pub fn has_backlog(&self) -> bool {
        self.count == BATCH
    }

    /// Datagrams the kernel dropped since the last call because this socket's queue was full.
    ///
    /// Exact without a filter. With one, the kernel counts what the filter refuses as dropped too (Linux,
    /// `udp_queue_rcv_one_skb`), so its count is believed only from when the queue is found more than half
    /// full until the first batch after it was emptied: an upper bound then. The sequence numbers that never
    /// came are exact.
    pub fn take_overflowed(&mut self) -> u64 {
        std::mem::take(&mut self.overflowed)
    }

    fn note_arrivals(&mut self) {
        if self.count == 0 {
            return;
        }
        let clocks = ClockPair::read();
        for index in 0..self.count {
            let notes = self.buffers.notes(index);
            self.arrivals[index] =
                notes.stamp_ns.map_or(clocks.arena, |stamp| clocks.arena_time(stamp, self.empty_at));
            if let Some(dropped) = notes.dropped {
                if !self.filtered || self.fill != Fill::Normal {
                    self.overflowed += u64::from(dropped.wrapping_sub(self.dropped));
                }
                self.dropped = dropped;
            }
        }
    }
}

/// Binds a UDP socket.
pub(crate) fn bind_udp(local: SocketAddrV4) -> Result<UdpSocket, ShellError> {
    let bind = || {
        let socket = UdpSocket::bind(local)?;
        socket.set_nonblocking(true)?;
        Ok::<_, io::Error>(socket)
    };
    bind().during(|| format!("listening on udp {local}"))
}

/// Listens to a multicast group by way of the interface with that address; other programs of this host may too.
pub(crate) fn join_udp(group: SocketAddrV4, interface: Ipv4Addr) -> Result<UdpSocket, ShellError> {
    let join = || {
        let socket = Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, Some(socket2::Protocol::UDP))?;
        socket.set_reuse_address(true)?;
        socket.set_multicast_all_v4(false)?;
        socket.bind(&group.into())?;
        socket.join_multicast_v4(group.ip(), &interface)?;
        socket.set_nonblocking(true)?;
        Ok::<_, io::Error>(UdpSocket::from(socket))
    };
    join().during(|| format!("joining {group} by way of {interface}"))
}

/// Opens a UDP socket that sends to one address; it never waits.
///
/// # Errors
/// What the system says, with the address.
pub fn connect_udp(peer: SocketAddrV4) -> Result<UdpSocket, ShellError> {
    let connect = || {
        let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0))?;
        socket.connect(peer)?;
        socket.set_nonblocking(true)?;
        Ok::<_, io::Error>(socket)
    };
    connect().during(|| format!("opening a socket to udp {peer}"))
}

/// Opens a UDP socket that sends to a multicast group by way of the interface with that address, at most `ttl`
/// networks far; it never waits.
///
/// # Errors
/// What the system says, with group and interface.
pub fn stream_udp(group: SocketAddrV4, interface: Ipv4Addr, ttl: u32) -> Result<UdpSocket, ShellError> {
    let open = || {
        let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0))?;
        // Before connecting: there may be no other way to the group.
        let options = socket2::SockRef::from(&socket);
        options.set_multicast_if_v4(&interface)?;
        options.set_multicast_ttl_v4(ttl)?;
        socket.connect(group)?;
        socket.set_nonblocking(true)?;
        Ok::<_, io::Error>(socket)
    };
    open().during(|| format!("sending to {group} by way of {interface}"))
}

/// Sends a datagram to a connected peer; one that is not listening or reachable is no error, as with any
/// radio.
///
/// # Errors
/// What the system says.
pub fn send_udp(socket: &UdpSocket, bytes: &[u8]) -> io::Result<()> {
    match socket.send(bytes) {
        // The kernel reports what became of an earlier datagram instead of sending this one.
        Err(error) if is_of_the_network(&error) => match socket.send(bytes) {
            Err(error) if !is_of_the_network(&error) => Err(error),
            _ => Ok(()),
        },
        sent => sent.map(|_| ()),
    }
}

/// Whether an error is the network's answer to an earlier datagram: it passes.
fn is_of_the_network(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::ConnectionRefused
            | io::ErrorKind::ConnectionReset
            | io::ErrorKind::HostUnreachable
            | io::ErrorKind::NetworkUnreachable
            | io::ErrorKind::NetworkDown
            | io::ErrorKind::Interrupted
    )
}

/// Listens on a UDP address. Call within a tokio runtime.
///
/// # Errors
/// What the system says, with the address.
pub fn listen_udp(local: SocketAddrV4) -> Result<DatagramSocket, ShellError> {
    DatagramSocket::new(bind_udp(local)?, false).during(|| format!("listening on udp {local}"))
}

/// How large a receive buffer this program would be granted, in bytes.
///
/// # Errors
/// What the system says.
pub fn granted_receive_buffer(asked: usize) -> io::Result<usize> {
    let socket = Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, Some(socket2::Protocol::UDP))?;
    grow_receive_buffer(&socket, asked)
}

/// Asks for a receive buffer and says what was granted, in bytes of payload and bookkeeping.
pub(crate) fn grow_receive_buffer(socket: &Socket, asked: usize) -> io::Result<usize> {
    socket.set_recv_buffer_size(asked)?;
    // Linux reports twice what it set, having doubled it for its bookkeeping.
    let granted = socket.recv_buffer_size()? / 2;
    if granted >= asked {
        return Ok(granted);
    }
    // Above the system's limit only the privileged are served.
    match rustix::net::sockopt::set_socket_recv_buffer_size_force(socket, asked) {
        Ok(()) => Ok(socket.recv_buffer_size()? / 2),
        Err(_) => Ok(granted),
    }
}
