//! The interface of the bus: an address of this host, or the network in which this host has one.

use std::fmt;
use std::net::Ipv4Addr;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The interface that multicast leaves and enters by.
///
/// Written `"192.168.10.7"`: the interface with that address. Written `"192.168.10.0/24"`: the interface that has an
/// address in that network, so that one file of settings serves hosts or containers with an address each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Interface {
    address: Ipv4Addr,
    prefix_bits: u8,
}

/// Bits of a whole address.
const ADDRESS_BITS: u8 = 32;

impl Interface {
    /// The interface with this address.
    #[must_use]
    pub const fn at(address: Ipv4Addr) -> Self {
        Self { address, prefix_bits: ADDRESS_BITS }
    }

    /// The interface by which that address is reached, whichever it is.
    #[must_use]
    pub const fn towards(address: Ipv4Addr) -> Self {
        Self { address, prefix_bits: 0 }
    }

    /// The address as it is written: the interface's own, or one of its network.
    #[must_use]
    pub const fn address(self) -> Ipv4Addr {
        self.address
    }

    /// Whether an address is the interface's, or one of its network.
    #[must_use]
    pub fn holds(self, address: Ipv4Addr) -> bool {
        let host_bits = u32::from(ADDRESS_BITS - self.prefix_bits);
        let network = |address: Ipv4Addr| u64::from(u32::from(address)) >> host_bits;
        network(address) == network(self.address)
    }

    /// Whether a network is written, of which the host's own address is still to be found.
    #[must_use]
    pub const fn is_network(self) -> bool {
        self.prefix_bits < ADDRESS_BITS
    }
}

impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_network() {
            write!(f, "{}/{}", self.address, self.prefix_bits)
        } else {
            write!(f, "{}", self.address)
        }
    }
}

impl FromStr for Interface {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("{text:?} is neither an IPv4 address nor a network like \"10.0.0.0/24\"");
        let (address, prefix_bits) = match text.split_once('/') {
            None => (text, ADDRESS_BITS),
            Some((address, bits)) => (address, bits.parse().map_err(|_| refused())?),
        };
        // No shorter prefix is one network: /0 would be "whatever interface there is".
        if !(8..=ADDRESS_BITS).contains(&prefix_bits) {
            return Err(format!("{text:?} has a prefix of {prefix_bits} bits, outside 8 to {ADDRESS_BITS}"));
        }
        Ok(Self { address: address.parse().map_err(|_| refused())?, prefix_bits })
    }
}

impl TryFrom<String> for Interface {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Interface> for String {
    fn from(interface: Interface) -> Self {
        interface.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_read_is_written_again() {
        for text in ["127.0.0.1", "10.71.0.0/24", "192.168.10.7/16"] {
            assert_eq!(text.parse::<Interface>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn an_address_holds_itself_alone_and_a_network_its_own() {
        let one: Interface = "10.71.0.2".parse().unwrap();
        assert!(one.holds(Ipv4Addr::new(10, 71, 0, 2)) && !one.holds(Ipv4Addr::new(10, 71, 0, 3)));
        assert!(!one.is_network());
        let network: Interface = "10.71.0.0/24".parse().unwrap();
        assert!(network.is_network());
        assert!(network.holds(Ipv4Addr::new(10, 71, 0, 255)) && !network.holds(Ipv4Addr::new(10, 71, 1, 0)));
    }

    #[test]
    fn what_is_neither_address_nor_network_is_refused_with_the_text_found() {
        for text in ["localhost", "", "10.71.0.0/", "10.71.0.0/33", "0.0.0.0/0", "10.71.0/24", "10.0.0.0/-8"]
        {
            let reason = text.parse::<Interface>().unwrap_err();
            assert!(reason.contains(text), "{reason}");
        }
    }
}
