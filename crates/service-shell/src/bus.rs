//! The bus: one multicast group and port per domain.
//!
//! The receiving socket is bound to the group's address, never to the wildcard, and takes no other group that
//! some program on this host has joined: nothing but the domain's own datagrams can come in.

use std::net::{SocketAddrV4, UdpSocket};
use std::os::fd::OwnedFd;
use std::task::{Context, Poll};

use settings::{Endpoint, Network};
use socket2::{Protocol, Socket, Type};
use tracing::warn;
use wire::Domain;

use crate::ShellError;
use crate::datagrams::{Datagram, DatagramSocket, grow_receive_buffer};
use crate::error::During;
use crate::filter::{Listen, program};
use crate::interface::interface_address;

/// The group and port of a domain.
#[must_use]
pub fn endpoint(network: &Network, domain: Domain) -> &Endpoint {
    match domain {
        Domain::Live => &network.live,
        Domain::Sim => &network.sim,
        Domain::Replay => &network.replay,
    }
}

/// The sending side of the bus.
#[derive(Debug)]
pub struct BusSender {
    socket: UdpSocket,
    failed: u64,
}

impl BusSender {
    /// Opens the bus for sending.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(network: &Network, domain: Domain) -> Result<Self, ShellError> {
        let target = endpoint(network, domain);
        let what =
            || format!("opening the bus at {}:{} via {}", target.group, target.port, network.interface);
        let interface = interface_address(network.interface)?;
        let socket = Socket::new(socket2::Domain::IPV4, Type::DGRAM, Some(Protocol::UDP)).during(what)?;
        socket.set_multicast_if_v4(&interface).during(what)?;
        socket.set_multicast_ttl_v4(network.ttl.min(1)).during(what)?;
        socket.set_multicast_loop_v4(true).during(what)?;
        socket.set_nonblocking(true).during(what)?;
        socket.bind(&SocketAddrV4::new(interface, 0).into()).during(what)?;
        // Connected, the kernel looks up the route once instead of per datagram.
        socket.connect(&SocketAddrV4::new(target.group, target.port).into()).during(what)?;
        Ok(Self { socket: OwnedFd::from(socket).into(), failed: 0 })
    }

    /// Sends a datagram; never waits. A datagram the kernel has no room for is lost, as on any bus, and
    /// counted.
    pub fn send(&mut self, datagram: &[u8]) {
        if let Err(error) = self.socket.send(datagram) {
            // Powers of two: the first is seen at once, a million more do not fill the log.
            self.failed += 1;
            if self.failed.is_power_of_two() {
                warn!(failed = self.failed, bytes = datagram.len(), %error, "cannot send on the bus");
            }
        }
    }

    /// Datagrams that could not be sent.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.failed
    }
}

/// The receiving side of the bus.
pub struct BusReceiver {
    socket: DatagramSocket,
}

impl BusReceiver {
    /// Joins the domain's group. Call within a tokio runtime.
    ///
    /// # Errors
    /// What the system says.
    pub fn join(network: &Network, domain: Domain, listen: Listen<'_>) -> Result<Self, ShellError> {
        let target = endpoint(network, domain);
        let what =
            || format!("joining the bus at {}:{} via {}", target.group, target.port, network.interface);
        let socket = Socket::new(socket2::Domain::IPV4, Type::DGRAM, Some(Protocol::UDP)).during(what)?;
        socket.set_reuse_address(true).during(what)?;
        socket.set_multicast_all_v4(false).during(what)?;
        let filter = program(listen);
        if let Some(filter) = &filter {
            // Before binding, so that nothing unasked-for is ever queued.
            socket.attach_filter(filter).during(what)?;
        }
        let asked = network.receive_buffer_bytes as usize;
        let granted = grow_receive_buffer(&socket, asked).during(what)?;
        if granted < asked {
            warn!(asked, granted, "receive buffer is smaller than asked for: raise net.core.rmem_max");
        }
        socket.bind(&SocketAddrV4::new(target.group, target.port).into()).during(what)?;
        socket.join_multicast_v4(&target.group, &interface_address(network.interface)?).during(what)?;
        let socket = DatagramSocket::new(OwnedFd::from(socket).into(), filter.is_some()).during(what)?;
        Ok(Self { socket })
    }

    /// Ready once there may be something to take.
    pub fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        self.socket.poll_readable(cx)
    }

    /// Takes the next batch without waiting: how many datagrams it has.
    ///
    /// # Errors
    /// What the system says.
    pub fn take_batch(&mut self) -> Result<usize, ShellError> {
        self.socket.take_batch().during(|| "receiving from the bus".to_owned())
    }

    /// Waits for the next batch: how many datagrams it has, at least one.
    ///
    /// # Errors
    /// What the system says.
    pub async fn next_batch(&mut self) -> Result<usize, ShellError> {
        loop {
            std::future::poll_fn(|cx| self.poll_readable(cx))
                .await
                .during(|| "waiting for the bus".to_owned())?;
            match self.take_batch()? {
                0 => {}
                count => return Ok(count),
            }
        }
    }

    /// A datagram of the batch.
    #[must_use]
    pub fn datagram(&self, index: usize) -> Datagram<'_> {
        self.socket.datagram(index)
    }

    /// Whether there may be more than this batch.
    #[must_use]
    pub fn has_backlog(&self) -> bool {
        self.socket.has_backlog()
    }

    /// Datagrams the kernel dropped since the last call because this reader was slow.
    pub fn take_overflowed(&mut self) -> u64 {
        self.socket.take_overflowed()
    }
}

#[cfg(test)]
mod tests;
