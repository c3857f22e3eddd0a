//! The command channel: who the server is, and what clients ask of it.

use super::{
    Fields, MESSAGE_CONNECT, MESSAGE_DISCONNECT, MESSAGE_KEEP_ALIVE, MESSAGE_REQUEST_MODEL_DEFINITION,
    MESSAGE_SERVER_INFO, NatNetError, Version, message_number, seal,
};
use crate::bytes::Reader;

/// Longest name of a program.
pub const NAME_BYTES_MAX: usize = 255;

const NAME_FIELD_BYTES: usize = 256;

/// Bytes of a server info message.
pub const SERVER_INFO_BYTES: usize = super::HEADER_BYTES + SERVER_INFO_BODY_BYTES;

const SERVER_INFO_BODY_BYTES: usize = NAME_FIELD_BYTES + 4 + 4 + 8 + 2 + 1 + 4;

/// Bytes a client says of itself before what it wants: its name and two versions.
const CLIENT_BYTES: usize = NAME_FIELD_BYTES + 8;

/// A flag (only what was subscribed to), the version, and a NUL.
const CONNECT_BODY_BYTES: usize = CLIENT_BYTES + 6;

/// What clients of the vendor's put where their name would stand.
const CONNECT_GREETING: &[u8] = b"Ping";

/// Who the server is, and where its frames go.
///
/// | Bytes | Field |
/// | --- | --- |
/// | 256 | name, NUL-padded |
/// | 4, 4 | versions of the program and of NatNet |
/// | 8 | u64 ticks per second of its clock |
/// | 2, 1, 4 | u16 data port, multicast or not, group |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerInfo<'a> {
    /// The program's name without its padding, commonly `Motive`; at most [`NAME_BYTES_MAX`], or one more of a
    /// server that leaves no room for a NUL.
    pub name: &'a [u8],
    /// The program's version: major, minor, build, revision.
    pub program_version: [u8; 4],
    /// NatNet's version: how the server lays out its frames unless asked for another.
    pub natnet_version: [u8; 4],
    /// Ticks per second of the clock that stamps frames.
    pub clock_hz: u64,
    /// UDP port its frames go to.
    pub data_port: u16,
    /// Whether they go to a group; else to each client.
    pub multicast: bool,
    /// The group.
    pub group: [u8; 4],
}

impl<'a> ServerInfo<'a> {
    /// The server info in a datagram; what follows its fields is ignored.
    ///
    /// # Errors
    /// [`NatNetError::Message`] or [`NatNetError::Truncated`]; the latter also for servers before 3.0, which
    /// say less.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, NatNetError> {
        let mut fields = Fields::open(bytes, MESSAGE_SERVER_INFO)?;
        let name = fields.get("name", |reader| reader.take(NAME_FIELD_BYTES))?;
        Ok(Self {
            name: name.split(|byte| *byte == 0).next().unwrap_or(name),
            program_version: fields.get("versions", Reader::array)?,
            natnet_version: fields.get("versions", Reader::array)?,
            clock_hz: fields.get("clock frequency", Reader::u64)?,
            data_port: fields.get("data channel", Reader::u16)?,
            multicast: fields.get("data channel", Reader::u8)? != 0,
            group: fields.get("data channel", Reader::array)?,
        })
    }

    /// Writes the message and answers its length, [`SERVER_INFO_BYTES`].
    ///
    /// # Errors
    /// [`NatNetError::Name`] or [`NatNetError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, NatNetError> {
        let mut name = [0; NAME_FIELD_BYTES];
        let (long, bytes) = (self.name.len() > NAME_BYTES_MAX, self.name.len());
        if long || self.name.contains(&0) {
            return Err(NatNetError::Name { bytes });
        }
        name[..bytes].copy_from_slice(self.name);
        seal(out, MESSAGE_SERVER_INFO, SERVER_INFO_BODY_BYTES, |writer| {
            writer.bytes(&name).bytes(&self.program_version).bytes(&self.natnet_version);
            writer.u64(self.clock_hz).u16(self.data_port).u8(u8::from(self.multicast)).bytes(&self.group);
        })
    }
}

/// What a client asks of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Say who you are, which a server answers with a [`ServerInfo`]. A unicast server sends its frames to
    /// whoever asked so.
    Connect {
        /// Lay out frames like this (major, minor, build, revision); `None` leaves it to the server. Servers
        /// of 3.0 and later do so for unicast clients.
        natnet_version: Option<[u8; 4]>,
    },
    /// Say what is tracked, which a server answers with a [`ModelDefinition`](super::ModelDefinition).
    ModelDefinition,
    /// Go on sending.
    KeepAlive,
    /// Stop sending.
    Disconnect,
}

impl Request {
    /// A request for frames of that version.
    #[must_use]
    pub const fn connect(version: Version) -> Self {
        Self::Connect { natnet_version: Some(version.to_bytes()) }
    }

    /// Writes the message and answers its length.
    ///
    /// # Errors
    /// [`NatNetError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, NatNetError> {
        let version = match self {
            Self::Connect { natnet_version } => natnet_version.unwrap_or_default(),
            Self::ModelDefinition => return seal(out, MESSAGE_REQUEST_MODEL_DEFINITION, 0, |_| {}),
            Self::KeepAlive => return seal(out, MESSAGE_KEEP_ALIVE, 0, |_| {}),
            Self::Disconnect => return seal(out, MESSAGE_DISCONNECT, 0, |_| {}),
        };
        let mut client = [0; CLIENT_BYTES];
        client[..CONNECT_GREETING.len()].copy_from_slice(CONNECT_GREETING);
        seal(out, MESSAGE_CONNECT, CONNECT_BODY_BYTES, |writer| {
            writer.bytes(&client).u8(0).bytes(&version).u8(0);
        })
    }

    /// The request in a datagram. Whatever follows its fields is ignored, since the vendor's clients add a
    /// NUL; a connect without a version, or with version zero, wants none in particular.
    ///
    /// # Errors
    /// [`NatNetError::Truncated`] for no message at all, [`NatNetError::Message`] for any that is no request.
    pub fn decode(bytes: &[u8]) -> Result<Self, NatNetError> {
        let found =
            message_number(bytes).ok_or(NatNetError::Truncated { bytes: bytes.len(), part: "header" })?;
        let mut fields = Fields::open(bytes, found)?;
        match found {
            MESSAGE_CONNECT => {
                let version = fields.reader.take(CLIENT_BYTES + 1).and_then(|_| fields.reader.array());
                Ok(Self::Connect { natnet_version: version.filter(|version| *version != [0; 4]) })
            }
            MESSAGE_REQUEST_MODEL_DEFINITION => Ok(Self::ModelDefinition),
            MESSAGE_KEEP_ALIVE => Ok(Self::KeepAlive),
            MESSAGE_DISCONNECT => Ok(Self::Disconnect),
            _ => Err(NatNetError::Message { found, expected: MESSAGE_CONNECT }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use std::vec::Vec;

    const INFO: ServerInfo<'_> = ServerInfo {
        name: b"Motive",
        program_version: [3, 1, 2, 1],
        natnet_version: [4, 1, 0, 0],
        clock_hz: 10_000_000,
        data_port: 1511,
        multicast: true,
        group: [239, 255, 42, 99],
    };

    /// Motive 3.1.2.1 by the layout table: 10 MHz, port 1511, multicast 239.255.42.99.
    fn golden() -> Vec<u8> {
        let mut bytes = from_hex("0100 1701 4d6f74697665");
        bytes.resize(4 + 256, 0);
        bytes.extend(from_hex("03010201 04010000 8096980000000000 e705 01 efff2a63"));
        bytes
    }

    #[test]
    fn server_info_both_ways() {
        let mut out = [0xEE; SERVER_INFO_BYTES];
        assert_eq!(INFO.encode(&mut out), Ok(283));
        assert_eq!(out[..], golden());
        assert_eq!(ServerInfo::decode(&out), Ok(INFO));
        assert_eq!(Version::from_bytes(INFO.natnet_version), Ok(Version::V4_1));
    }

    #[test]
    fn server_info_cut_or_longer() {
        let mut bytes = golden();
        for length in 0..bytes.len() {
            assert!(matches!(
                ServerInfo::decode(&bytes[..length]),
                Err(NatNetError::Truncated { bytes, .. }) if bytes == length
            ));
        }
        bytes.extend([1, 2, 3]);
        assert_eq!(ServerInfo::decode(&bytes), Ok(INFO));
        bytes[4..260].fill(b'x');
        assert_eq!(ServerInfo::decode(&bytes).unwrap().name.len(), 256);
    }

    #[test]
    fn names_that_do_not_fit_are_errors() {
        let mut out = [0; SERVER_INFO_BYTES];
        let full = [b'x'; 256];
        assert!(ServerInfo { name: &full[..255], ..INFO }.encode(&mut out).is_ok());
        for (name, bytes) in [(&full[..], 256), (b"a\0b", 3)] {
            assert_eq!(ServerInfo { name, ..INFO }.encode(&mut out), Err(NatNetError::Name { bytes }));
        }
        assert_eq!(INFO.encode(&mut out[1..]), Err(NatNetError::NoRoom));
    }

    #[test]
    fn requests_both_ways() {
        let mut out = [0xEE; 300];
        for (request, hex) in [
            (Request::ModelDefinition, "0400 0000"),
            (Request::Disconnect, "0900 0000"),
            (Request::KeepAlive, "0a00 0000"),
        ] {
            assert_eq!(request.encode(&mut out), Ok(4));
            assert_eq!(out[..4], from_hex(hex));
            assert_eq!(Request::decode(&out[..4]), Ok(request));
        }
        // What the vendor's Python client sends: 270 bytes, "Ping" first and the version from 265 on.
        let mut golden = from_hex("0000 0e01 50696e67");
        golden.resize(4 + 265, 0);
        golden.extend([4, 1, 0, 0, 0]);
        let connect = Request::connect(Version::V4_1);
        assert_eq!(connect.encode(&mut out), Ok(golden.len()));
        assert_eq!(out[..golden.len()], golden);
        assert_eq!(Request::decode(&golden), Ok(connect));
        golden.push(0);
        assert_eq!(Request::decode(&golden), Ok(connect));
        let any = Request::Connect { natnet_version: None };
        let length = any.encode(&mut out).unwrap();
        for sent in [&out[..length], &from_hex("0000 0000"), &from_hex("0000 0500 50696e6700")] {
            assert_eq!(Request::decode(sent), Ok(any));
        }
    }

    #[test]
    fn what_is_no_request_is_an_error() {
        assert!(matches!(Request::decode(&[]), Err(NatNetError::Truncated { bytes: 0, .. })));
        assert!(matches!(Request::decode(&[4, 0, 0]), Err(NatNetError::Truncated { bytes: 3, .. })));
        let error = NatNetError::Message { found: 7, expected: 0 };
        assert_eq!(Request::decode(&[7, 0, 0, 0]), Err(error));
        assert_eq!(Request::KeepAlive.encode(&mut [0; 3]), Err(NatNetError::NoRoom));
    }
}
