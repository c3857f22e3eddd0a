//! A UDP socket, read in batches with the kernel's notes.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, OwnedFd};
use std::task::{Context, Poll};

use quantity::{Span, Time};
use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::Interest;

use crate::ShellError;
use crate::clock::{self, ClockPair};
use crate::error::During;
use crate::kernel::{BATCH, Buffers, enable_notes, queue_fill};

/// A datagram that has waited longer than this in the kernel is not delivered: its reader was stopped or starved, and
/// what it says of the past must not look like news. Longer than any age limit of commands and states.
pub const QUEUE_AGE_MAX: Span = Span::from_millis(250);

/// A datagram that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram<'a> {
    /// When it reached this host.
    pub at: Time,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// A UDP socket whose datagrams are taken in batches.
pub struct DatagramSocket {
    socket: tokio::net::UdpSocket,
    buffers: Buffers,
    arrivals: [Time; BATCH],
    count: usize,
    empty_at: Time,
    filtered: bool,
    overfull: bool,
    dropped: u32,
    overflowed: u64,
}

impl DatagramSocket {
    /// Takes over a bound socket; `filtered` says whether a kernel filter is attached. Call within a tokio runtime.
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
            overfull: false,
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
    /// What the system says; a peer that is not listening is no error.
    pub fn take_batch(&mut self) -> io::Result<usize> {
        let before = clock::now();
        let (socket, buffers, mut taken) = (&self.socket, &mut self.buffers, 0);
        let result = socket.try_io(Interest::READABLE, || {
            taken = buffers.receive(socket)?;
            // A batch that is not full has emptied the queue: wait for the kernel's next word.
            if taken < BATCH { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(()) }
        });
        self.count = taken;
        if taken == BATCH && self.filtered && !self.overfull {
            // Without the answer, the sequence numbers that never came still tell.
            self.overfull = queue_fill(&self.socket).is_ok_and(|(held, allowed)| held > allowed / 2);
        }
        self.note_arrivals();
        if taken < BATCH {
            self.empty_at = before;
            self.overfull = false;
        }
        match result {
            Ok(()) => Ok(taken),
            Err(error) => match error.kind() {
                // Refused: the answer to something sent by this socket, of which the sender makes what it will.
                io::ErrorKind::WouldBlock | io::ErrorKind::ConnectionRefused | io::ErrorKind::Interrupted => Ok(taken),
                _ => Err(error),
            },
        }
    }

    /// A datagram of the batch.
    #[must_use]
    pub fn datagram(&self, index: usize) -> Datagram<'_> {
        Datagram { at: self.arrivals[index], bytes: self.buffers.datagram(index) }
    }

    /// Whether the last batch was full: there may be more.
    #[must_use]
    pub fn has_backlog(&self) -> bool {
        self.count == BATCH
    }

    /// Datagrams the kernel dropped since the last call because this socket's queue was full.
    ///
    /// Exact without a filter. With one, the kernel counts what the filter refuses as dropped too (Linux,
    /// `udp_queue_rcv_one_skb`), so its count is believed only while the queue is found more than half full.
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
                if !self.filtered || self.overfull {
                    self.overflowed += u64::from(dropped.wrapping_sub(self.dropped));
                }
                self.dropped = dropped;
            }
        }
    }
}

/// Binds a UDP socket to this address, or connects one to it.
pub(crate) fn open_udp(local: Option<SocketAddr>, peer: Option<SocketAddr>) -> Result<UdpSocket, ShellError> {
    let what = || match (local, peer) {
        (Some(local), _) => format!("listening on udp {local}"),
        (None, Some(peer)) => format!("opening a socket to udp {peer}"),
        (None, None) => "opening a udp socket".to_owned(),
    };
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP)).during(what)?;
    if let Some(local) = local {
        socket.bind(&local.into()).during(what)?;
    }
    if let Some(peer) = peer {
        socket.connect(&peer.into()).during(what)?;
    }
    socket.set_nonblocking(true).during(what)?;
    Ok(OwnedFd::from(socket).into())
}

/// Listens on a UDP address. Call within a tokio runtime.
///
/// # Errors
/// What the system says, with the address.
pub fn listen_udp(local: SocketAddr) -> Result<DatagramSocket, ShellError> {
    let socket = open_udp(Some(local), None)?;
    DatagramSocket::new(socket, false).during(|| format!("listening on udp {local}"))
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
