//! From the bridge to the vehicle: parameter sets, maneuver orders, clock probes, emergency stop.
//!
//! | Type | Message | Body |
//! | --- | --- | --- |
//! | 01 | Begin | set id u16, count u8, digest u64 |
//! | 02 | Items | set id u16, first index u8, number u8, that many f32 |
//! | 03 | Commit | set id u16, digest u64 |
//! | 04 | Start | maneuver id u16, set id u16, digest u64 |
//! | 05 | Abort | maneuver id u16 |
//! | 06 | Ping | token u16 |
//! | 07 | Stop | |
//! | 08 | Rearm | |

use super::payload::{ENVELOPE_BYTES, PAYLOAD_BYTES_MAX, finish, open, seal};
use super::{FlipSet, LinkError};
use crate::bytes::{Reader, Writer};

/// Items one payload can carry.
pub const ITEMS_PER_PAYLOAD_MAX: usize = (PAYLOAD_BYTES_MAX - ENVELOPE_BYTES - 4) / 4;

/// Items a parameter set can have: one bit each in [`UploadReply::received_mask`](super::UploadReply).
pub const SET_LEN_MAX: usize = 32;

/// Some consecutive items of a parameter set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Items {
    /// The set they belong to.
    pub set_id: u16,
    /// Index of the first of them.
    pub first_index: u8,
    count: u8,
    values: [f32; ITEMS_PER_PAYLOAD_MAX],
}

impl Items {
    /// The items from `first_index` on; `None` for no items, too many for one payload, or indices beyond a
    /// set's end.
    #[must_use]
    pub fn new(set_id: u16, first_index: u8, values: &[f32]) -> Option<Self> {
        let mut items = Self { set_id, first_index, count: 0, values: [0.0; ITEMS_PER_PAYLOAD_MAX] };
        if values.is_empty() || usize::from(first_index) + values.len() > SET_LEN_MAX {
            return None;
        }
        items.values.get_mut(..values.len())?.copy_from_slice(values);
        items.count = u8::try_from(values.len()).ok()?;
        Some(items)
    }

    /// The items' values, the first at [`first_index`](Self::first_index).
    #[must_use]
    pub fn values(&self) -> &[f32] {
        self.values.get(..usize::from(self.count)).unwrap_or(&[])
    }
}

/// A message to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Uplink {
    /// A parameter set is coming; it is staged beside the active one.
    Begin {
        /// Identity of the set; zero names no set.
        set_id: u16,
        /// Number of its items, 1 to [`SET_LEN_MAX`].
        count: u8,
        /// Digest over all of them ([`digest_of`](super::digest_of)).
        digest: u64,
    },
    /// Some of its items, in any order, as often as it takes.
    Items(Items),
    /// Make the staged set the active one, if it is complete and its digest comes out.
    Commit {
        /// Identity of the set.
        set_id: u16,
        /// Digest of the set.
        digest: u64,
    },
    /// Begin a maneuver now, with this very set. Obeyed once per `maneuver_id`, however often it arrives.
    Start {
        /// Identity of the maneuver; each must follow the one before (wrapping), zero is none.
        maneuver_id: u16,
        /// The set to fly, which must be the active one.
        set_id: u16,
        /// Digest of that set.
        digest: u64,
    },
    /// End the maneuver early.
    Abort {
        /// The maneuver to end; any other goes on.
        maneuver_id: u16,
    },
    /// Answer at once with [`Downlink::Pong`](super::Downlink::Pong).
    Ping {
        /// Given back in the answer.
        token: u16,
    },
    /// Emergency stop: motors off now, latched.
    Stop,
    /// A person has looked: release the latch of a stop or an unordered landing.
    Rearm,
}

impl Uplink {
    /// The three kinds of message that carry one flip set, in order: begin, items, commit.
    #[must_use]
    pub fn upload(set_id: u16, set: &FlipSet) -> [Self; 3] {
        let (items, digest) = (set.to_items(), set.digest());
        const { assert!(super::FLIP_SET_LEN <= ITEMS_PER_PAYLOAD_MAX) };
        let mut values = [0.0; ITEMS_PER_PAYLOAD_MAX];
        values[..items.len()].copy_from_slice(&items);
        let count = items.len() as u8;
        [
            Self::Begin { set_id, count, digest },
            Self::Items(Items { set_id, first_index: 0, count, values }),
            Self::Commit { set_id, digest },
        ]
    }

    /// Writes the payload for `vehicle` and answers its length, at most
    /// [`PAYLOAD_BYTES_MAX`].
    ///
    /// # Errors
    /// [`LinkError::NoRoom`] where `out` is too short.
    pub fn encode(&self, vehicle: u8, out: &mut [u8]) -> Result<usize, LinkError> {
        let kind = match self {
            Self::Begin { .. } => 1,
            Self::Items(_) => 2,
            Self::Commit { .. } => 3,
            Self::Start { .. } => 4,
            Self::Abort { .. } => 5,
            Self::Ping { .. } => 6,
            Self::Stop => 7,
            Self::Rearm => 8,
        };
        seal(out, kind, vehicle, |writer| self.write(writer))
    }

    fn write(&self, writer: &mut Writer<'_>) {
        match *self {
            Self::Begin { set_id, count, digest } => {
                writer.u16(set_id).u8(count).u64(digest);
            }
            Self::Items(items) => {
                writer.u16(items.set_id).u8(items.first_index).u8(items.count);
                for value in items.values() {
                    writer.f32(*value);
                }
            }
            Self::Commit { set_id, digest } => {
                writer.u16(set_id).u64(digest);
            }
            Self::Start { maneuver_id, set_id, digest } => {
                writer.u16(maneuver_id).u16(set_id).u64(digest);
            }
            Self::Abort { maneuver_id } => {
                writer.u16(maneuver_id);
            }
            Self::Ping { token } => {
                writer.u16(token);
            }
            Self::Stop | Self::Rearm => {}
        }
    }

    /// The vehicle addressed and the message.
    ///
    /// # Errors
    /// Length, checksum, unknown type, or a field out of range. Items are not judged here: a set is judged
    /// whole.
    pub fn decode(bytes: &[u8]) -> Result<(u8, Self), LinkError> {
        let (kind, vehicle, mut reader) = open(bytes)?;
        let message = match kind {
            1 => Self::read_begin(&mut reader),
            2 => Self::read_items(&mut reader)?,
            3 => Self::read_commit(&mut reader),
            4 => Self::read_start(&mut reader),
            5 => reader.u16().map(|maneuver_id| Self::Abort { maneuver_id }),
            6 => reader.u16().map(|token| Self::Ping { token }),
            7 => Some(Self::Stop),
            8 => Some(Self::Rearm),
            other => return Err(LinkError::UnknownType(other)),
        };
        let message = finish(message, &reader, bytes)?;
        match message {
            Self::Begin { count, .. } if count == 0 || usize::from(count) > SET_LEN_MAX => {
                Err(LinkError::UnknownValue { field: "count" })
            }
            message => Ok((vehicle, message)),
        }
    }

    fn read_begin(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self::Begin { set_id: reader.u16()?, count: reader.u8()?, digest: reader.u64()? })
    }

    fn read_commit(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self::Commit { set_id: reader.u16()?, digest: reader.u64()? })
    }

    fn read_start(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self::Start { maneuver_id: reader.u16()?, set_id: reader.u16()?, digest: reader.u64()? })
    }

    fn read_items(reader: &mut Reader<'_>) -> Result<Option<Self>, LinkError> {
        let (Some(set_id), Some(first_index), Some(count)) = (reader.u16(), reader.u8(), reader.u8()) else {
            return Ok(None);
        };
        let mut values = [0.0; ITEMS_PER_PAYLOAD_MAX];
        let wanted = values
            .get_mut(..usize::from(count))
            .ok_or(LinkError::UnknownValue { field: "number of items" })?;
        for value in &mut *wanted {
            match reader.f32() {
                Some(read) => *value = read,
                None => return Ok(None),
            }
        }
        Items::new(set_id, first_index, wanted)
            .map(|items| Some(Self::Items(items)))
            .ok_or(LinkError::UnknownValue { field: "index of items" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn any_uplink() -> impl Strategy<Value = Uplink> {
        prop_oneof![
            (any::<u16>(), 1u8..=32, any::<u64>()).prop_map(|(set_id, count, digest)| Uplink::Begin {
                set_id,
                count,
                digest
            }),
            (any::<u16>(), 0u8..10, prop::collection::vec(-1e6f32..1e6, 1..=22)).prop_map(
                |(set_id, first, values)| Uplink::Items(Items::new(set_id, first, &values).unwrap())
            ),
            any::<(u16, u64)>().prop_map(|(set_id, digest)| Uplink::Commit { set_id, digest }),
            any::<(u16, u16, u64)>().prop_map(|(maneuver_id, set_id, digest)| Uplink::Start {
                maneuver_id,
                set_id,
                digest
            }),
            any::<u16>().prop_map(|maneuver_id| Uplink::Abort { maneuver_id }),
            any::<u16>().prop_map(|token| Uplink::Ping { token }),
            Just(Uplink::Stop),
            Just(Uplink::Rearm),
        ]
    }

    fn encoded(message: &Uplink, vehicle: u8) -> Vec<u8> {
        let mut out = [0; PAYLOAD_BYTES_MAX];
        let length = message.encode(vehicle, &mut out).unwrap();
        out[..length].to_vec()
    }

    /// Worked out with a separate program from the table above and the catalogue's CRC-16/IBM-3740.
    #[test]
    fn golden_payloads_both_ways() {
        let digest = 0x1122_3344_5566_7788;
        let golden = [
            (Uplink::Begin { set_id: 513, count: 10, digest }, "010301020a88776655443322114541"),
            (Uplink::Items(Items::new(513, 4, &[0.5, -2.0]).unwrap()), "0203010204020000003f000000c0c2e8"),
            (Uplink::Commit { set_id: 513, digest }, "0303010288776655443322115090"),
            (Uplink::Start { maneuver_id: 7, set_id: 513, digest }, "0403070001028877665544332211edfa"),
            (Uplink::Abort { maneuver_id: 7 }, "0503070042f8"),
            (Uplink::Ping { token: 0xBEEF }, "0603efbe90bc"),
            (Uplink::Stop, "0703fbb4"),
            (Uplink::Rearm, "0803c5a4"),
        ];
        for (message, hex) in golden {
            let bytes = crate::bytes::from_hex(hex);
            assert_eq!(encoded(&message, 3), bytes);
            assert_eq!(Uplink::decode(&bytes), Ok((3, message)));
        }
    }

    #[test]
    fn empty_or_overlong_sets_are_refused() {
        assert_eq!(Items::new(1, 0, &[]), None);
        assert_eq!(Items::new(1, 31, &[1.0, 2.0]), None);
        assert_eq!(Items::new(1, 0, &[1.0; ITEMS_PER_PAYLOAD_MAX + 1]), None);
        for count in [0, 33] {
            let bytes = encoded(&Uplink::Begin { set_id: 1, count, digest: 2 }, 1);
            assert_eq!(Uplink::decode(&bytes), Err(LinkError::UnknownValue { field: "count" }));
        }
    }

    #[test]
    fn a_short_buffer_is_an_error() {
        assert_eq!(Uplink::Ping { token: 1 }.encode(1, &mut [0; 5]), Err(LinkError::NoRoom));
    }

    proptest! {
        #[test]
        fn round_trip_in_bounds(message in any_uplink(), vehicle: u8) {
            let bytes = encoded(&message, vehicle);
            prop_assert!(bytes.len() <= PAYLOAD_BYTES_MAX);
            prop_assert_eq!(Uplink::decode(&bytes), Ok((vehicle, message)));
        }

        #[test]
        fn a_wrong_byte_is_refused(message in any_uplink(), at: prop::sample::Index, flip in 1u8..=255) {
            let mut bytes = encoded(&message, 9);
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            prop_assert!(Uplink::decode(&bytes).is_err());
        }

        #[test]
        fn a_cut_or_padded_payload_is_refused(message in any_uplink(), extra in 1usize..4) {
            let mut bytes = encoded(&message, 9);
            prop_assert!(Uplink::decode(&bytes[..bytes.len() - 1]).is_err());
            bytes.resize(bytes.len() + extra, 0);
            prop_assert!(Uplink::decode(&bytes).is_err());
        }

        #[test]
        fn any_bytes_decode_or_are_refused(
            mut bytes in prop::collection::vec(any::<u8>(), 0..120), seal: bool,
        ) {
            if seal && bytes.len() >= 2 {
                let end = bytes.len() - 2;
                let check = crate::crc::crc16(&bytes[..end]).to_le_bytes();
                bytes[0] %= 10;
                bytes[end..].copy_from_slice(&check);
            }
            let _ = Uplink::decode(&bytes);
        }
    }
}
