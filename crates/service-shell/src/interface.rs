//! This host's address on the interface of the bus.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};

use settings::Interface;

use crate::ShellError;
use crate::error::During;

/// Any port does: nothing is sent.
const DISCARD_PORT: u16 = 9;

/// This host's address on the interface that the settings name.
///
/// Of a network, it is the address from which this host would send into it: what the kernel's routes say, asked by
/// connecting a socket and sending nothing.
///
/// # Errors
/// No interface of this host is in the network.
pub fn interface_address(interface: Interface) -> Result<Ipv4Addr, ShellError> {
    if !interface.is_network() {
        return Ok(interface.address());
    }
    let what = || format!("looking for this host's address in {interface}");
    match source_towards(host_of(interface)).during(what)? {
        address if interface.holds(address) => Ok(address),
        address => {
            let reason = format!("it would be reached from {address}: no interface of this host is in it");
            Err(io::Error::new(io::ErrorKind::AddrNotAvailable, reason)).during(what)
        }
    }
}

/// An address of the network that is not the network's own, which some kernels take for a broadcast.
fn host_of(network: Interface) -> Ipv4Addr {
    let address = network.address();
    if address.octets()[3] == 0 { Ipv4Addr::from_bits(address.to_bits() | 1) } else { address }
}

fn source_towards(peer: Ipv4Addr) -> io::Result<Ipv4Addr> {
    let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0))?;
    socket.connect(SocketAddrV4::new(peer, DISCARD_PORT))?;
    match socket.local_addr()?.ip() {
        IpAddr::V4(address) => Ok(address),
        IpAddr::V6(_) => Err(io::ErrorKind::AddrNotAvailable.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_taken_as_it_is() {
        let nobodys = Ipv4Addr::new(192, 0, 2, 1);
        assert_eq!(interface_address(Interface::at(nobodys)).unwrap(), nobodys);
    }

    #[test]
    fn the_loopback_network_is_reached_from_the_loopback_interface() {
        let address = interface_address("127.0.0.0/8".parse().unwrap()).unwrap();
        assert!(address.is_loopback());
    }

    #[test]
    fn a_network_this_host_is_not_in_is_refused_by_its_name() {
        // Reserved (RFC 1112): no host is in it, whether or not there is a route that would lead there.
        let error = interface_address("240.1.2.0/24".parse().unwrap()).unwrap_err();
        assert!(error.to_string().contains("240.1.2.0/24"), "{error}");
    }
}
