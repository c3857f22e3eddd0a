//! What the frames say.

use super::{ApiMode, DELIMITER, ESCAPE, ESCAPE_BIT, FRAME_DATA_BYTES_MAX, XbeeError};

/// One API frame.
///
/// `frame_id` ties a transmit status to its request; zero asks for none. `rssi` is the received power in
/// -dBm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame<'a> {
    /// 00: send to a 64-bit address.
    Transmit64 {
        /// Given back in the status.
        frame_id: u8,
        /// Where to.
        destination: u64,
        /// Transmit options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// 01: send to a 16-bit address.
    Transmit16 {
        /// Given back in the status.
        frame_id: u8,
        /// Where to.
        destination: u16,
        /// Transmit options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// 10: send, in the ZigBee and DigiMesh firmware.
    TransmitMesh {
        /// Given back in the status.
        frame_id: u8,
        /// Where to.
        destination: u64,
        /// Short form of it, `FFFE` for unknown.
        destination_short: u16,
        /// Greatest number of hops of a broadcast, zero for the network's own.
        radius: u8,
        /// Transmit options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// 80: received from a 64-bit address.
    Receive64 {
        /// Where from.
        source: u64,
        /// Received power, -dBm.
        rssi: u8,
        /// Receive options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// 81: received from a 16-bit address.
    Receive16 {
        /// Where from.
        source: u16,
        /// Received power, -dBm.
        rssi: u8,
        /// Receive options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// 89: what became of a request to transmit.
    TransmitStatus {
        /// The request's.
        frame_id: u8,
        /// What became of it.
        result: TransmitResult,
    },
    /// 8A: the module reports on itself (00 hardware reset, 01 watchdog reset, 02 associated, 03
    /// disassociated, ...).
    ModemStatus {
        /// The module's code.
        status: u8,
    },
    /// 90: received, in the ZigBee and DigiMesh firmware.
    ReceiveMesh {
        /// Where from.
        source: u64,
        /// Short form of it, `FFFE` for unknown.
        source_short: u16,
        /// Receive options.
        options: u8,
        /// Payload.
        data: &'a [u8],
    },
    /// Any other frame.
    Other {
        /// First byte of the frame data.
        id: u8,
        /// The rest of it.
        data: &'a [u8],
    },
}

/// What became of a request to transmit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransmitResult {
    /// 00: delivered, or sent without asking for an acknowledgement.
    Success,
    /// 01: no acknowledgement came.
    NoAck,
    /// 02: the channel was never clear.
    ChannelBusy,
    /// 03: thrown away unsent.
    Purged,
    /// 74: the payload is too large.
    TooLarge,
    /// Any other code.
    Other(u8),
}

impl TransmitResult {
    const fn from_byte(byte: u8) -> Self {
        match byte {
            0x00 => Self::Success,
            0x01 => Self::NoAck,
            0x02 => Self::ChannelBusy,
            0x03 => Self::Purged,
            0x74 => Self::TooLarge,
            other => Self::Other(other),
        }
    }

    const fn to_byte(self) -> u8 {
        match self {
            Self::Success => 0x00,
            Self::NoAck => 0x01,
            Self::ChannelBusy => 0x02,
            Self::Purged => 0x03,
            Self::TooLarge => 0x74,
            Self::Other(byte) => byte,
        }
    }
}

/// Big-endian fields off the front of frame data.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk::<N>()?;
        self.0 = tail;
        Some(*head)
    }

    fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_be_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_be_bytes)
    }
}

impl<'a> Frame<'a> {
    /// The frame that unescaped frame data (without delimiter, length and checksum) is.
    ///
    /// # Errors
    /// [`XbeeError::Empty`] or [`XbeeError::Truncated`]. An unknown id is no error but [`Frame::Other`].
    pub fn decode(frame_data: &'a [u8]) -> Result<Self, XbeeError> {
        let (id, rest) = frame_data.split_first().ok_or(XbeeError::Empty)?;
        Self::read(*id, Fields(rest)).ok_or(XbeeError::Truncated { id: *id })
    }

    fn read(id: u8, mut fields: Fields<'a>) -> Option<Self> {
        let f = &mut fields;
        Some(match id {
            0x00 => {
                let (frame_id, destination, options) = (f.u8()?, f.u64()?, f.u8()?);
                Self::Transmit64 { frame_id, destination, options, data: f.0 }
            }
            0x01 => {
                let (frame_id, destination, options) = (f.u8()?, f.u16()?, f.u8()?);
                Self::Transmit16 { frame_id, destination, options, data: f.0 }
            }
            0x10 => {
                let (frame_id, destination, destination_short) = (f.u8()?, f.u64()?, f.u16()?);
                let (radius, options) = (f.u8()?, f.u8()?);
                Self::TransmitMesh { frame_id, destination, destination_short, radius, options, data: f.0 }
            }
            0x80 => {
                let (source, rssi, options) = (f.u64()?, f.u8()?, f.u8()?);
                Self::Receive64 { source, rssi, options, data: f.0 }
            }
            0x81 => {
                let (source, rssi, options) = (f.u16()?, f.u8()?, f.u8()?);
                Self::Receive16 { source, rssi, options, data: f.0 }
            }
            0x89 => Self::TransmitStatus { frame_id: f.u8()?, result: TransmitResult::from_byte(f.u8()?) },
            0x8A => Self::ModemStatus { status: f.u8()? },
            0x90 => {
                let (source, source_short, options) = (f.u64()?, f.u16()?, f.u8()?);
                Self::ReceiveMesh { source, source_short, options, data: f.0 }
            }
            id => Self::Other { id, data: f.0 },
        })
    }

    /// Writes the whole frame, delimiter to checksum, as it goes on the serial line, and answers its length.
    ///
    /// # Errors
    /// [`XbeeError::TooLong`] or [`XbeeError::NoRoom`]; a buffer of twice the frame's length and four is
    /// always enough.
    pub fn encode(&self, mode: ApiMode, out: &mut [u8]) -> Result<usize, XbeeError> {
        let mut data = Collected { bytes: [0; FRAME_DATA_BYTES_MAX], length: 0 };
        self.write(&mut data);
        let too_long = XbeeError::TooLong { bytes: data.length };
        let frame_data = data.bytes.get(..data.length).ok_or(too_long)?;
        let length = u16::try_from(frame_data.len()).map_err(|_| too_long)?;
        let sum = frame_data.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        let mut line = Line { out, length: 0, mode };
        line.raw(DELIMITER)?;
        for byte in length.to_be_bytes().iter().chain(frame_data).chain(&[0xFF - sum]) {
            line.byte(*byte)?;
        }
        Ok(line.length)
    }

    fn write(&self, out: &mut Collected) {
        match *self {
            Self::Transmit64 { frame_id, destination, options, data } => {
                out.put(&[0x00, frame_id]).put(&destination.to_be_bytes()).put(&[options]).put(data);
            }
            Self::Transmit16 { frame_id, destination, options, data } => {
                out.put(&[0x01, frame_id]).put(&destination.to_be_bytes()).put(&[options]).put(data);
            }
            Self::TransmitMesh { frame_id, destination, destination_short, radius, options, data } => {
                out.put(&[0x10, frame_id]).put(&destination.to_be_bytes());
                out.put(&destination_short.to_be_bytes()).put(&[radius, options]).put(data);
            }
            Self::Receive64 { source, rssi, options, data } => {
                out.put(&[0x80]).put(&source.to_be_bytes()).put(&[rssi, options]).put(data);
            }
            Self::Receive16 { source, rssi, options, data } => {
                out.put(&[0x81]).put(&source.to_be_bytes()).put(&[rssi, options]).put(data);
            }
            Self::TransmitStatus { frame_id, result } => {
                out.put(&[0x89, frame_id, result.to_byte()]);
            }
            Self::ModemStatus { status } => {
                out.put(&[0x8A, status]);
            }
            Self::ReceiveMesh { source, source_short, options, data } => {
                out.put(&[0x90]).put(&source.to_be_bytes()).put(&source_short.to_be_bytes());
                out.put(&[options]).put(data);
            }
            Self::Other { id, data } => {
                out.put(&[id]).put(data);
            }
        }
    }
}

/// Frame data being put together; `length` goes on counting what no longer fits.
struct Collected {
    bytes: [u8; FRAME_DATA_BYTES_MAX],
    length: usize,
}

impl Collected {
    fn put(&mut self, bytes: &[u8]) -> &mut Self {
        if let Some(place) = self.bytes.get_mut(self.length..).and_then(|free| free.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
        }
        self.length += bytes.len();
        self
    }
}

/// The serial line being written to.
struct Line<'o> {
    out: &'o mut [u8],
    length: usize,
    mode: ApiMode,
}

impl Line<'_> {
    fn raw(&mut self, byte: u8) -> Result<(), XbeeError> {
        *self.out.get_mut(self.length).ok_or(XbeeError::NoRoom)? = byte;
        self.length += 1;
        Ok(())
    }

    fn byte(&mut self, byte: u8) -> Result<(), XbeeError> {
        match (self.mode, byte) {
            (ApiMode::Escaped, DELIMITER | ESCAPE | 0x11 | 0x13) => {
                self.raw(ESCAPE)?;
                self.raw(byte ^ ESCAPE_BIT)
            }
            _ => self.raw(byte),
        }
    }
}
