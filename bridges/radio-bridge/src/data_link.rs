//! The data link's radio: payloads into XBee frames and out of them.
//!
//! The module at this end is in API mode with escapes (AP=2) and talks to each vehicle's by its 16-bit
//! address. It repeats a frame on the air by itself until the other module acknowledges it, and then tells
//! how that went; what is lost all the same is the business of whoever sent it.

use device::vehicle_link::{PAYLOAD_BYTES_MAX, Uplink};
use device::xbee::{ApiMode, Decoder, Frame, TransmitResult};
use quantity::Time;
use schemas::DeviceBytes;
use settings::Ports;

/// A TX frame of the largest payload with every byte escaped.
const LINE_BYTES_MAX: usize = 2 * (PAYLOAD_BYTES_MAX + 9);

/// The radio at this end.
#[derive(Clone, Debug)]
pub(crate) struct DataLink {
    decoder: Decoder,
    frame_id: u8,
    /// The vehicle's place in the fleet, by frame id of a request not yet answered.
    requests: [Option<u8>; 256],
}

/// What the radio says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Heard<'a> {
    /// A payload came.
    Payload {
        /// The sender's 16-bit address.
        source: u16,
        /// What it sent.
        data: &'a [u8],
    },
    /// What became of a payload to the vehicle at this place in the fleet.
    Transmitted {
        /// The vehicle's place in the fleet.
        index: u8,
        /// What became of it.
        result: TransmitResult,
    },
    /// The module reports on itself.
    Modem(u8),
}

impl DataLink {
    /// A radio nothing was sent to yet.
    pub(crate) const fn new() -> Self {
        Self { decoder: Decoder::new(ApiMode::Escaped), frame_id: 0, requests: [None; 256] }
    }

    /// The bytes for the radio that send `message` to the vehicle with number `vehicle` at `address`, which
    /// has place `index` in the fleet.
    pub(crate) fn transmit(
        &mut self,
        now: Time,
        message: &Uplink,
        vehicle: u8,
        address: u16,
        index: u8,
    ) -> Option<DeviceBytes> {
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let length = message.encode(vehicle, &mut payload).ok()?;
        // Zero would ask for no status.
        self.frame_id = if self.frame_id == u8::MAX { 1 } else { self.frame_id + 1 };
        self.requests[usize::from(self.frame_id)] = Some(index);
        let frame = Frame::Transmit16 {
            frame_id: self.frame_id,
            destination: address,
            options: 0,
            data: &payload[..length],
        };
        let mut line = [0; LINE_BYTES_MAX];
        let length = frame.encode(ApiMode::Escaped, &mut line).ok()?;
        let bytes = line[..length].try_into().ok()?;
        Some(DeviceBytes { port: Ports::DATA_LINK, at: now, bytes })
    }

    /// Bytes from the radio, in any portions.
    pub(crate) fn receive(&mut self, bytes: &[u8], mut on_heard: impl FnMut(Heard<'_>)) {
        let Self { decoder, requests, .. } = self;
        decoder.receive(bytes, |frame| match frame {
            Frame::Receive16 { source, data, .. } => on_heard(Heard::Payload { source, data }),
            Frame::ReceiveMesh { source_short, data, .. } => {
                on_heard(Heard::Payload { source: source_short, data });
            }
            Frame::TransmitStatus { frame_id, result } => {
                if let Some(index) = requests[usize::from(frame_id)].take() {
                    on_heard(Heard::Transmitted { index, result });
                }
            }
            Frame::ModemStatus { status } => on_heard(Heard::Modem(status)),
            _ => {}
        });
    }

    /// Bytes that belonged to no frame so far.
    pub(crate) const fn bytes_skipped(&self) -> u64 {
        self.decoder.errors().skipped_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(link: &mut DataLink, line: &[u8]) -> Vec<String> {
        let mut all = Vec::new();
        link.receive(line, |heard| all.push(format!("{heard:?}")));
        all
    }

    #[test]
    fn a_ping_is_the_frame_of_the_specification() {
        let mut link = DataLink::new();
        let bytes = link.transmit(Time::ZERO, &Uplink::Ping { token: 0x7E13 }, 3, 0x5001, 0).expect("fits");
        // 7E, length 11, TX16, frame id 1, address, no options; then type 6, vehicle 3, token little-endian
        // with both its bytes escaped, and the two bytes of the check.
        let head = [0x7E, 0x00, 0x0B, 0x01, 0x01, 0x50, 0x01, 0x00, 0x06, 0x03, 0x7D, 0x33, 0x7D, 0x5E];
        assert_eq!(bytes.port, Ports::DATA_LINK);
        assert_eq!(bytes.bytes[..head.len()], head);
        // CRC-16/IBM-3740 over 06 03 13 7E, by a separate program; the checksum is FF less the sum.
        let (crc, tail) = ([0x70, 0x33], &bytes.bytes[head.len()..]);
        let sum = [0x01, 0x01, 0x50, 0x01, 0x00, 0x06, 0x03, 0x13, 0x7E, crc[0], crc[1]];
        let checksum = 0xFF - sum.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        assert_eq!(tail, [crc[0], crc[1], checksum]);
    }

    #[test]
    fn received_frames_come_out_of_any_portions() {
        let mut link = DataLink::new();
        // The specification's vector: "Hi" from 5001 at -40 dBm.
        let line = [0x7E, 0x00, 0x07, 0x81, 0x50, 0x01, 0x28, 0x00, 0x48, 0x69, 0x54];
        assert!(heard(&mut link, &line[..4]).is_empty());
        assert_eq!(heard(&mut link, &line[4..]), ["Payload { source: 20481, data: [72, 105] }"]);
        assert_eq!(heard(&mut link, &[0x7E, 0x00, 0x02, 0x8A, 0x06, 0x6F]), ["Modem(6)"]);
        assert_eq!(link.bytes_skipped(), 0);
        heard(&mut link, &[1, 2, 3]);
        assert_eq!(link.bytes_skipped(), 3);
    }

    #[test]
    fn a_status_finds_its_request_once() {
        let mut link = DataLink::new();
        for index in 0..5 {
            link.transmit(Time::ZERO, &Uplink::Stop, 1, 0x5001, index).expect("fits");
        }
        let status = [0x7E, 0x00, 0x03, 0x89, 0x05, 0x01, 0x70];
        assert_eq!(heard(&mut link, &status), ["Transmitted { index: 4, result: NoAck }"]);
        assert!(heard(&mut link, &status).is_empty());
    }

    #[test]
    fn frame_ids_skip_zero() {
        let mut link = DataLink::new();
        for number in 0..600u32 {
            let bytes = link.transmit(Time::ZERO, &Uplink::Stop, 1, 0x5001, 0).expect("fits");
            let frame_id = link.frame_id;
            assert_eq!(u32::from(frame_id), number % 255 + 1);
            assert!(bytes.bytes.len() >= 13);
        }
    }
}
