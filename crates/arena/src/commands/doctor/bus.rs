//! The bus: interface, lifetime, multicast there and back, receive buffer.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use service_shell::{endpoint, granted_receive_buffer, interface_address, stream_udp};
use settings::Network;
use wire::Domain;

use super::finding::Finding;

/// No datagram of the arena's: another port, and other bytes.
const TEST_BYTES: &[u8] = b"flyarena doctor: multicast test";
const PATIENCE: Duration = Duration::from_millis(500);

/// Looks at the bus of a domain, without a word on its port.
pub fn check(network: &Network, domain: Domain) -> Vec<Finding> {
    let group = endpoint(network, domain).group;
    let address = match interface_address(network.interface) {
        Ok(address) => address,
        Err(error) => {
            let advice = "set network.interface to an address of this host, or bring that interface up";
            return vec![Finding::fail("interface", error.to_string(), advice)];
        }
    };
    vec![
        judge_interface(address, UdpSocket::bind(SocketAddrV4::new(address, 0)).err()),
        judge_lifetime(network.ttl, address),
        judge_multicast(group, address, round_trip(group, address, network.ttl)),
        judge_buffer(
            network.receive_buffer_bytes,
            granted_receive_buffer(network.receive_buffer_bytes as usize),
        ),
    ]
}

fn judge_interface(address: Ipv4Addr, refused: Option<io::Error>) -> Finding {
    match refused {
        None => Finding::ok("interface", format!("{address} is this host's")),
        Some(error) => Finding::fail(
            "interface",
            format!("{address}: {error}"),
            "set network.interface to an address of this host, or bring that interface up",
        ),
    }
}

fn judge_lifetime(ttl: u32, address: Ipv4Addr) -> Finding {
    let name = "lifetime";
    match (ttl, address.is_loopback()) {
        (0, true) => Finding::ok(name, "ttl 0: the bus stays on this host"),
        (0, false) => Finding::warn(
            name,
            format!("ttl 0 on {address}: the bus stays on this host"),
            "set network.ttl = 1 if services run on other hosts or in containers with networks of their own",
        ),
        (_, true) => Finding::warn(
            name,
            format!("ttl {ttl} on {address}, which no other host sees"),
            "set network.ttl = 0, or network.interface to the laboratory's",
        ),
        (_, false) => Finding::ok(name, format!("ttl {ttl}: the bus reaches the laboratory's network")),
    }
}

/// Whether our own bytes came back.
fn round_trip(group: Ipv4Addr, address: Ipv4Addr, ttl: u32) -> io::Result<bool> {
    let receiver = UdpSocket::bind(SocketAddrV4::new(group, 0))?;
    receiver.join_multicast_v4(&group, &address)?;
    receiver.set_read_timeout(Some(PATIENCE))?;
    let SocketAddr::V4(place) = receiver.local_addr()? else { return Ok(false) };
    let sender = stream_udp(place, address, ttl).map_err(io::Error::other)?;
    sender.send(TEST_BYTES)?;
    let mut bytes = [0; 256];
    match receiver.recv(&mut bytes) {
        Ok(count) => Ok(&bytes[..count] == TEST_BYTES),
        Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
            Ok(false)
        }
        Err(error) => Err(error),
    }
}

fn judge_multicast(group: Ipv4Addr, address: Ipv4Addr, came_back: io::Result<bool>) -> Finding {
    let name = "multicast";
    match came_back {
        Ok(true) => Finding::ok(name, format!("{group} by way of {address}: sent and received")),
        Ok(false) => Finding::fail(
            name,
            format!("{group} by way of {address}: sent, and nothing came back"),
            "let the firewall pass multicast on that interface, or choose another group",
        ),
        Err(error) => Finding::fail(
            name,
            format!("{group} by way of {address}: {error}"),
            format!(
                "switch multicast on: ip link set dev NAME multicast on; ip route add {group}/32 dev NAME"
            ),
        ),
    }
}

fn judge_buffer(asked: u32, granted: io::Result<usize>) -> Finding {
    let name = "receive buffer";
    match granted {
        Ok(granted) if granted >= asked as usize => Finding::ok(name, format!("{asked} bytes granted")),
        Ok(granted) => Finding::warn(
            name,
            format!("{asked} bytes asked for, {granted} granted: a stall of some 0.1 s loses messages"),
            format!("sudo sysctl net.core.rmem_max={asked}"),
        ),
        Err(error) => Finding::fail(name, error.to_string(), "let this program open UDP sockets"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    const HOST: Ipv4Addr = Ipv4Addr::new(192, 168, 10, 7);

    #[test]
    fn a_small_buffer_warns_with_both_sizes_and_the_remedy() {
        assert_eq!(judge_buffer(4096, Ok(4096)).verdict, Verdict::Ok);
        let small = judge_buffer(4_194_304, Ok(212_992));
        assert_eq!(small.verdict, Verdict::Warn);
        assert!(small.found.contains("4194304") && small.found.contains("212992"), "{small:?}");
        assert_eq!(small.advice.as_deref(), Some("sudo sysctl net.core.rmem_max=4194304"));
    }

    #[test]
    fn what_does_not_come_back_fails() {
        let group = Ipv4Addr::new(239, 1, 2, 3);
        assert_eq!(judge_multicast(group, HOST, Ok(true)).verdict, Verdict::Ok);
        assert_eq!(judge_multicast(group, HOST, Ok(false)).verdict, Verdict::Fail);
        let refused = judge_multicast(group, HOST, Err(io::ErrorKind::NetworkUnreachable.into()));
        assert!(refused.verdict == Verdict::Fail && refused.advice.unwrap().contains("239.1.2.3"));
    }

    #[test]
    fn a_lifetime_and_an_interface_must_agree() {
        let verdict = |ttl, address| judge_lifetime(ttl, address).verdict;
        assert_eq!(verdict(0, Ipv4Addr::LOCALHOST), Verdict::Ok);
        assert_eq!(verdict(1, HOST), Verdict::Ok);
        assert_eq!(verdict(1, Ipv4Addr::LOCALHOST), Verdict::Warn);
        assert_eq!(verdict(0, HOST), Verdict::Warn);
    }

    #[test]
    fn an_address_that_is_not_ours_fails() {
        assert_eq!(judge_interface(HOST, None).verdict, Verdict::Ok);
        let refused = judge_interface(HOST, Some(io::ErrorKind::AddrNotAvailable.into()));
        assert_eq!(refused.verdict, Verdict::Fail);
        assert!(refused.found.contains("192.168.10.7"));
    }
}
