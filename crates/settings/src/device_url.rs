//! Where a device is: one line of text that says how to reach it.
//!
//! | URL | Device |
//! | --- | --- |
//! | `udp://192.168.10.20:51001` | speaks datagrams |
//! | `serial:///dev/ttyUSB0?baud=115200` | on a serial line; `&framing=8E2` for other than 8N1 |
//! | `pty:PATH` | on a pseudo terminal that the simulator makes: PATH is a link to it |
//! | `radio://0/80/2M/E7E7E7E7E7` | behind a Crazyradio: dongle, channel, data rate, address |

use std::fmt;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// What stands for a vehicle's id in a [`UrlPattern`].
const ID_PLACE: &str = "{id}";
/// Least and greatest rate of a serial line, bits a second.
const BAUD_RANGE: std::ops::RangeInclusive<u32> = 1_200..=4_000_000;
/// Greatest channel of a Crazyradio: 2400 MHz plus so many.
const RADIO_CHANNEL_MAX: u8 = 125;
/// Bytes of an address on the air.
const RADIO_ADDRESS_BYTES: usize = 5;

/// Where one device is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum DeviceUrl {
    /// It speaks datagrams to or from this address.
    Udp(SocketAddrV4),
    /// It is on a serial line.
    Serial(SerialLine),
    /// It is on a pseudo terminal, to which this path is a link.
    Pty(PathBuf),
    /// It is behind a Crazyradio.
    Radio(RadioAddress),
}

/// A serial line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialLine {
    /// The device file.
    pub path: PathBuf,
    /// Bits a second.
    pub baud: u32,
    /// Parity and stop bits.
    pub framing: Framing,
}

/// How a byte goes over a serial line, eight data bits throughout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Framing {
    /// No parity, one stop bit: `8N1`.
    #[default]
    NoParity,
    /// Even parity, two stop bits: `8E2`, as SBUS has it.
    EvenParityTwoStops,
}

/// A vehicle's address on the air, and the dongle that reaches it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadioAddress {
    /// Which of this host's Crazyradios, from 0.
    pub dongle: u8,
    /// Channel, 2400 MHz plus so many.
    pub channel: u8,
    /// Bits a second on the air.
    pub rate: RadioRate,
    /// The address, as it is written.
    pub address: [u8; RADIO_ADDRESS_BYTES],
}

/// Data rates of a Crazyradio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioRate {
    /// 250 kbit/s.
    K250,
    /// 1 Mbit/s.
    M1,
    /// 2 Mbit/s.
    M2,
}

impl RadioRate {
    const ALL: [(Self, &'static str); 3] = [(Self::K250, "250K"), (Self::M1, "1M"), (Self::M2, "2M")];

    /// As it is written.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::K250 => "250K",
            Self::M1 => "1M",
            Self::M2 => "2M",
        }
    }
}

impl Framing {
    const ALL: [(Self, &'static str); 2] = [(Self::NoParity, "8N1"), (Self::EvenParityTwoStops, "8E2")];

    /// As it is written.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoParity => "8N1",
            Self::EvenParityTwoStops => "8E2",
        }
    }
}

impl fmt::Display for DeviceUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(f, "udp://{address}"),
            Self::Serial(SerialLine { path, baud, framing }) => {
                write!(f, "serial://{}?baud={baud}", path.display())?;
                match framing {
                    Framing::NoParity => Ok(()),
                    other => write!(f, "&framing={}", other.name()),
                }
            }
            Self::Pty(path) => write!(f, "pty:{}", path.display()),
            Self::Radio(RadioAddress { dongle, channel, rate, address }) => {
                write!(f, "radio://{dongle}/{channel}/{}/", rate.name())?;
                address.iter().try_for_each(|byte| write!(f, "{byte:02X}"))
            }
        }
    }
}

impl FromStr for DeviceUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = if let Some(rest) = text.strip_prefix("udp://") {
            parse_udp(rest).map(Self::Udp)
        } else if let Some(rest) = text.strip_prefix("serial://") {
            parse_serial(rest).map(Self::Serial)
        } else if let Some(path) = text.strip_prefix("pty:") {
            parse_path(path).map(Self::Pty)
        } else if let Some(rest) = text.strip_prefix("radio://") {
            parse_radio(rest).map(Self::Radio)
        } else {
            Err("it begins with none of udp://, serial://, pty:, radio://".to_owned())
        };
        parsed.map_err(|reason| format!("{text:?} is no device: {reason}"))
    }
}

fn parse_udp(text: &str) -> Result<SocketAddrV4, String> {
    let address: SocketAddrV4 =
        text.parse().map_err(|_| format!("{text:?} is no IPv4 address and port like 10.0.0.5:51001"))?;
    match address {
        address if address.port() == 0 => Err("port 0 is nobody's".to_owned()),
        address if *address.ip() == Ipv4Addr::BROADCAST => Err("it is everybody's address".to_owned()),
        address => Ok(address),
    }
}

fn parse_path(text: &str) -> Result<PathBuf, String> {
    if text.is_empty() || text.contains('\0') {
        return Err(format!("{text:?} is no path"));
    }
    Ok(PathBuf::from(text))
}

fn parse_serial(text: &str) -> Result<SerialLine, String> {
    let (path, query) = text.split_once('?').unwrap_or((text, ""));
    if !path.starts_with('/') {
        return Err(format!(
            "its path {path:?} does not begin with /, as in serial:///dev/ttyUSB0?baud=115200"
        ));
    }
    let (mut baud, mut framing) = (None, None);
    for pair in query.split('&').filter(|pair| !pair.is_empty()) {
        let repeated = match pair.split_once('=') {
            Some(("baud", value)) => {
                let rate = value.parse().ok().filter(|rate| BAUD_RANGE.contains(rate));
                let (least, greatest) = (BAUD_RANGE.start(), BAUD_RANGE.end());
                let refused = || format!("baud={value} is no number within {least} and {greatest}");
                baud.replace(rate.ok_or_else(refused)?).is_some()
            }
            Some(("framing", value)) => framing.replace(named(&Framing::ALL, "framing", value)?).is_some(),
            _ => return Err(format!("{pair:?} is neither baud=N nor framing=8N1 or 8E2")),
        };
        if repeated {
            return Err(format!("{pair:?} comes after another of its kind"));
        }
    }
    let baud = baud.ok_or("it lacks ?baud=N")?;
    Ok(SerialLine { path: parse_path(path)?, baud, framing: framing.unwrap_or_default() })
}

fn parse_radio(text: &str) -> Result<RadioAddress, String> {
    let parts: Vec<&str> = text.split('/').collect();
    let [dongle, channel, rate, address] = parts[..] else {
        return Err("it is not radio://DONGLE/CHANNEL/RATE/ADDRESS".to_owned());
    };
    let number = |what: &str, text: &str, max: u8| {
        let found = text.parse().ok().filter(|number| *number <= max);
        found.ok_or_else(|| format!("{what} {text:?} is no number within 0 and {max}"))
    };
    let dongle = number("dongle", dongle, u8::MAX)?;
    let channel = number("channel", channel, RADIO_CHANNEL_MAX)?;
    let rate = named(&RadioRate::ALL, "rate", rate)?;
    let refused = || format!("address {address:?} is not of ten hexadecimal digits");
    if address.len() != 2 * RADIO_ADDRESS_BYTES || !address.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return Err(refused());
    }
    let mut bytes = [0; RADIO_ADDRESS_BYTES];
    for (byte, at) in bytes.iter_mut().zip((0..).step_by(2)) {
        *byte = u8::from_str_radix(&address[at..at + 2], 16).map_err(|_| refused())?;
    }
    Ok(RadioAddress { dongle, channel, rate, address: bytes })
}

/// The one of these that is written so.
fn named<T: Copy>(all: &[(T, &str)], what: &str, text: &str) -> Result<T, String> {
    let known = || all.iter().map(|(_, name)| *name).collect::<Vec<_>>().join(", ");
    let found = all.iter().find(|(_, name)| *name == text).map(|(one, _)| *one);
    found.ok_or_else(|| format!("{what} {text:?} is none of {}", known()))
}

/// Where a device is of which every vehicle has one of its own.
///
/// `{id}` stands for the vehicle's id: decimal in a path, two hexadecimal digits in a radio's address. In a
/// `udp://` URL without it, vehicle n's device is n ports above the one written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct UrlPattern(String);

impl UrlPattern {
    /// Where that vehicle's device is.
    ///
    /// # Errors
    /// The text that is no URL for this vehicle, and why: a port beyond the last.
    pub fn of_vehicle(&self, id: u8) -> Result<DeviceUrl, String> {
        let text = if self.0.starts_with("radio://") { format!("{id:02X}") } else { id.to_string() };
        let url: DeviceUrl = self.0.replace(ID_PLACE, &text).parse()?;
        match url {
            DeviceUrl::Udp(base) if !self.names_vehicle() => match base.port().checked_add(u16::from(id)) {
                Some(port) => Ok(DeviceUrl::Udp(SocketAddrV4::new(*base.ip(), port))),
                None => Err(format!("{base} plus a vehicle's id of {id} is beyond port 65535")),
            },
            url => Ok(url),
        }
    }

    /// Whether each vehicle has a device of its own by this pattern.
    #[must_use]
    pub fn is_one_per_vehicle(&self) -> bool {
        self.names_vehicle() || self.0.starts_with("udp://")
    }

    /// As it is written.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn names_vehicle(&self) -> bool {
        self.0.contains(ID_PLACE)
    }
}

impl FromStr for UrlPattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pattern = Self(text.to_owned());
        // Whatever the id, the rest must be a URL.
        pattern.of_vehicle(1)?;
        Ok(pattern)
    }
}

impl fmt::Display for UrlPattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

macro_rules! as_text {
    ($($name:ident),*) => {$(
        impl TryFrom<String> for $name {
            type Error = String;

            fn try_from(text: String) -> Result<Self, String> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(value: $name) -> Self {
                value.to_string()
            }
        }
    )*};
}

as_text!(DeviceUrl, UrlPattern);

#[cfg(test)]
mod tests {
    use super::*;

    fn url(text: &str) -> DeviceUrl {
        text.parse().unwrap()
    }

    #[test]
    fn every_kind_is_read_and_written_back() {
        for text in [
            "udp://127.0.0.1:51001",
            "serial:///dev/ttyUSB0?baud=115200",
            "serial:///dev/serial/by-id/usb-x?baud=100000&framing=8E2",
            "pty:.flyarena/pty/command-1",
            "radio://0/80/2M/E7E7E7E7E7",
            "radio://1/125/250K/00FF00FF01",
        ] {
            assert_eq!(url(text).to_string(), text);
        }
        let line =
            SerialLine { path: "/dev/ttyACM0".into(), baud: 57_600, framing: Framing::EvenParityTwoStops };
        assert_eq!(url("serial:///dev/ttyACM0?framing=8E2&baud=57600"), DeviceUrl::Serial(line));
    }

    #[test]
    fn what_is_no_device_is_refused_with_the_text_and_the_reason() {
        for (text, reason) in [
            ("127.0.0.1:51001", "none of udp://"),
            ("tcp://127.0.0.1:1", "none of udp://"),
            ("udp://localhost:1", "no IPv4 address and port"),
            ("udp://127.0.0.1", "no IPv4 address and port"),
            ("udp://127.0.0.1:0", "port 0"),
            ("udp://255.255.255.255:9", "everybody's"),
            ("serial://dev/ttyUSB0?baud=9600", "does not begin with /"),
            ("serial:///dev/ttyUSB0", "lacks ?baud=N"),
            ("serial:///dev/ttyUSB0?baud=fast", "baud=fast"),
            ("serial:///dev/ttyUSB0?baud=100", "within 1200 and 4000000"),
            ("serial:///dev/ttyUSB0?baud=9600&baud=9600", "after another of its kind"),
            ("serial:///dev/ttyUSB0?baud=9600&framing=7E1", "none of 8N1, 8E2"),
            ("serial:///dev/ttyUSB0?baud=9600&parity=even", "parity=even"),
            ("pty:", "no path"),
            ("radio://0/80/2M", "DONGLE/CHANNEL/RATE/ADDRESS"),
            ("radio://0/126/2M/E7E7E7E7E7", "within 0 and 125"),
            ("radio://0/80/3M/E7E7E7E7E7", "none of 250K, 1M, 2M"),
            ("radio://0/80/2M/E7E7E7E7", "ten hexadecimal digits"),
            ("radio://0/80/2M/E7E7E7E7\u{e9}", "ten hexadecimal digits"),
        ] {
            let refused = text.parse::<DeviceUrl>().unwrap_err();
            assert!(refused.contains(reason) && refused.contains(&format!("{text:?}")), "{refused}");
        }
    }

    #[test]
    fn a_pattern_gives_each_vehicle_a_device_of_its_own() {
        let of = |text: &str, id| text.parse::<UrlPattern>().unwrap().of_vehicle(id);
        assert_eq!(of("udp://10.0.0.1:52100", 7), Ok(url("udp://10.0.0.1:52107")));
        assert_eq!(of("udp://10.0.0.{id}:52100", 7), Ok(url("udp://10.0.0.7:52100")));
        assert_eq!(of("pty:run/command-{id}", 12), Ok(url("pty:run/command-12")));
        assert_eq!(of("radio://0/80/2M/E7E7E7E7{id}", 12), Ok(url("radio://0/80/2M/E7E7E7E70C")));
        assert!(of("udp://10.0.0.1:65534", 2).unwrap_err().contains("65535"));
        let alone = "serial:///dev/ttyUSB0?baud=100000".parse::<UrlPattern>().unwrap();
        assert!(!alone.is_one_per_vehicle());
        assert!("pty:x{id}".parse::<UrlPattern>().unwrap().is_one_per_vehicle());
        assert!("file:x".parse::<UrlPattern>().is_err());
    }
}
