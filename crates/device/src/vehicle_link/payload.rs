//! What every payload of the data link has in common: type, vehicle, body, check.

use super::LinkError;
use crate::bytes::{Reader, Writer};
use crate::crc::crc16;

/// Greatest payload: what one 802.15.4 API frame carries.
pub const PAYLOAD_BYTES_MAX: usize = 100;

/// Bytes around a body: type, vehicle, and the check behind it.
pub(super) const ENVELOPE_BYTES: usize = 4;

/// Writes type, vehicle, what `body` writes, and the check; answers the length.
pub(super) fn seal(
    out: &mut [u8],
    kind: u8,
    vehicle: u8,
    body: impl FnOnce(&mut Writer<'_>),
) -> Result<usize, LinkError> {
    let mut writer = Writer::new(out);
    writer.u8(kind).u8(vehicle);
    body(&mut writer);
    let check = crc16(writer.written());
    writer.u16(check);
    writer.finish().ok_or(LinkError::NoRoom)
}

/// Verifies the check and answers type, vehicle and a reader over the body.
pub(super) fn open(bytes: &[u8]) -> Result<(u8, u8, Reader<'_>), LinkError> {
    let length = LinkError::Length { bytes: bytes.len() };
    if bytes.len() > PAYLOAD_BYTES_MAX {
        return Err(length);
    }
    let (content, check) = bytes.split_last_chunk::<2>().ok_or(length)?;
    let (received, computed) = (u16::from_le_bytes(*check), crc16(content));
    let mut reader = Reader::new(content);
    let (kind, vehicle) = (reader.u8().ok_or(length)?, reader.u8().ok_or(length)?);
    if received != computed {
        return Err(LinkError::Checksum { received, computed });
    }
    Ok((kind, vehicle, reader))
}

/// Refuses a message that has not used up its body.
pub(super) fn finish<T>(message: Option<T>, reader: &Reader<'_>, bytes: &[u8]) -> Result<T, LinkError> {
    match message {
        Some(message) if reader.rest().is_empty() => Ok(message),
        _ => Err(LinkError::Length { bytes: bytes.len() }),
    }
}
