//! Parameters: a name, and a number in the four bytes of a float.
//!
//! A PARAM_VALUE is the only acknowledgement of a PARAM_SET: the value that counts now, which need not be the
//! one asked for. How an integer stands in the four bytes is the autopilot's choice, which its
//! AUTOPILOT_VERSION tells: see [`ParamEncoding`].

use super::MavlinkError;
use crate::bytes::{Reader, Writer};

pub(super) const ID_PARAM_VALUE: u32 = 22;
pub(super) const ID_PARAM_SET: u32 = 23;

const KIND_REAL32: u8 = 9;

/// A parameter's name: up to sixteen bytes, NUL padded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParamId([u8; 16]);

impl ParamId {
    /// A name; `None` where it is empty, longer than sixteen bytes or has a NUL in it.
    #[must_use]
    pub fn new(name: &[u8]) -> Option<Self> {
        let mut bytes = [0; 16];
        bytes.get_mut(..name.len())?.copy_from_slice(name);
        (!name.is_empty() && !name.contains(&0)).then_some(Self(bytes))
    }

    /// The name without its padding.
    #[must_use]
    pub fn name(&self) -> &[u8] {
        self.0.split(|byte| *byte == 0).next().unwrap_or(&self.0)
    }
}

/// Give a parameter a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParamSet {
    /// The four bytes of the value, little-endian; see [`ParamNumber`].
    pub value_bits: u32,
    /// The system it is for.
    pub target_system: u8,
    /// The component it is for.
    pub target_component: u8,
    /// Which parameter.
    pub id: ParamId,
    /// The number's type.
    pub kind: u8,
}

/// What a parameter is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParamValue {
    /// The four bytes of the value, little-endian; see [`ParamNumber`].
    pub value_bits: u32,
    /// How many parameters there are.
    pub count: u16,
    /// Its place among them; 65 535 where it was not asked for by its place.
    pub index: u16,
    /// Which parameter.
    pub id: ParamId,
    /// The number's type.
    pub kind: u8,
}

/// How an autopilot puts an integer into the four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamEncoding {
    /// Its own bytes (PX4).
    Bytewise,
    /// As the float of that value (ArduPilot).
    CStyle,
}

/// A parameter's number. Those of eight bytes do not fit and are not sent this way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParamNumber {
    /// Type 1.
    Uint8(u8),
    /// Type 2.
    Int8(i8),
    /// Type 3.
    Uint16(u16),
    /// Type 4.
    Int16(i16),
    /// Type 5.
    Uint32(u32),
    /// Type 6.
    Int32(i32),
    /// Type 9, the same in either encoding.
    Real32(f32),
}

impl ParamNumber {
    /// The four bytes and the type, as they are sent.
    ///
    /// # Errors
    /// [`MavlinkError::Parameter`] for an integer that no float is equal to, in [`ParamEncoding::CStyle`].
    pub fn to_wire(self, encoding: ParamEncoding) -> Result<(u32, u8), MavlinkError> {
        let (value, bits) = match self {
            Self::Uint8(value) => (i64::from(value), u32::from(value)),
            Self::Int8(value) => (i64::from(value), u32::from(value.cast_unsigned())),
            Self::Uint16(value) => (i64::from(value), u32::from(value)),
            Self::Int16(value) => (i64::from(value), u32::from(value.cast_unsigned())),
            Self::Uint32(value) => (i64::from(value), value),
            Self::Int32(value) => (i64::from(value), value.cast_unsigned()),
            Self::Real32(value) => return Ok((value.to_bits(), self.kind())),
        };
        match encoding {
            ParamEncoding::Bytewise => Ok((bits, self.kind())),
            ParamEncoding::CStyle => {
                let float = value as f32;
                let error = MavlinkError::Parameter { kind: self.kind(), value_bits: float.to_bits() };
                // Every integer of 32 bits is exact as an f64, and so is every f32.
                let exact = f64::from(float) == value as f64;
                if exact { Ok((float.to_bits(), self.kind())) } else { Err(error) }
            }
        }
    }

    /// The number that these four bytes of that type stand for.
    ///
    /// # Errors
    /// [`MavlinkError::Parameter`] for a type of another length or an unknown one, and in
    /// [`ParamEncoding::CStyle`] for a float that is no integer of the type.
    pub fn from_wire(value_bits: u32, kind: u8, encoding: ParamEncoding) -> Result<Self, MavlinkError> {
        let error = MavlinkError::Parameter { kind, value_bits };
        if kind == KIND_REAL32 {
            return Ok(Self::Real32(f32::from_bits(value_bits)));
        }
        match encoding {
            ParamEncoding::Bytewise => Self::from_bytes(value_bits, kind),
            ParamEncoding::CStyle => Self::from_float(f32::from_bits(value_bits), kind),
        }
        .ok_or(error)
    }

    const fn kind(self) -> u8 {
        match self {
            Self::Uint8(_) => 1,
            Self::Int8(_) => 2,
            Self::Uint16(_) => 3,
            Self::Int16(_) => 4,
            Self::Uint32(_) => 5,
            Self::Int32(_) => 6,
            Self::Real32(_) => KIND_REAL32,
        }
    }

    /// What stands above the number's own bytes does not matter.
    const fn from_bytes(bits: u32, kind: u8) -> Option<Self> {
        Some(match kind {
            1 => Self::Uint8(bits as u8),
            2 => Self::Int8(bits as u8 as i8),
            3 => Self::Uint16(bits as u16),
            4 => Self::Int16(bits as u16 as i16),
            5 => Self::Uint32(bits),
            6 => Self::Int32(bits.cast_signed()),
            _ => return None,
        })
    }

    fn from_float(float: f32, kind: u8) -> Option<Self> {
        // A float beyond this range becomes an end of it, and is then unequal to it or outside every type.
        let value = float as i64;
        if f64::from(float) != value as f64 {
            return None;
        }
        Some(match kind {
            1 => Self::Uint8(value.try_into().ok()?),
            2 => Self::Int8(value.try_into().ok()?),
            3 => Self::Uint16(value.try_into().ok()?),
            4 => Self::Int16(value.try_into().ok()?),
            5 => Self::Uint32(value.try_into().ok()?),
            6 => Self::Int32(value.try_into().ok()?),
            _ => return None,
        })
    }
}

impl ParamSet {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            value_bits: reader.u32()?,
            target_system: reader.u8()?,
            target_component: reader.u8()?,
            id: ParamId(reader.array()?),
            kind: reader.u8()?,
        })
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u32 {
        writer.u32(self.value_bits).u8(self.target_system).u8(self.target_component);
        writer.bytes(&self.id.0).u8(self.kind);
        ID_PARAM_SET
    }
}

impl ParamValue {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            value_bits: reader.u32()?,
            count: reader.u16()?,
            index: reader.u16()?,
            id: ParamId(reader.array()?),
            kind: reader.u8()?,
        })
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u32 {
        writer.u32(self.value_bits).u16(self.count).u16(self.index);
        writer.bytes(&self.id.0).u8(self.kind);
        ID_PARAM_VALUE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOTH: [ParamEncoding; 2] = [ParamEncoding::Bytewise, ParamEncoding::CStyle];

    #[test]
    fn names_fill_their_field_or_end_in_a_nul() {
        assert_eq!(ParamId::new(b"FLIP_T1").unwrap().name(), b"FLIP_T1");
        assert_eq!(ParamId::new(b"SIXTEEN_BYTES_ID").unwrap().name(), b"SIXTEEN_BYTES_ID");
        for bad in [&b"SEVENTEEN_BYTES__"[..], b"", b"A\0"] {
            assert_eq!(ParamId::new(bad), None);
        }
    }

    #[test]
    fn an_integer_is_sent_by_its_bytes_or_as_a_float_of_its_value() {
        for (number, bytewise, c_style, kind) in [
            (ParamNumber::Uint8(200), 200, 200.0f32, 1),
            (ParamNumber::Int8(-1), 0xFF, -1.0, 2),
            (ParamNumber::Uint16(65_535), 65_535, 65_535.0, 3),
            (ParamNumber::Int16(-2), 0xFFFE, -2.0, 4),
            (ParamNumber::Uint32(1 << 31), 1 << 31, 2_147_483_648.0, 5),
            (ParamNumber::Int32(-3), 0xFFFF_FFFD, -3.0, 6),
        ] {
            assert_eq!(number.to_wire(ParamEncoding::Bytewise), Ok((bytewise, kind)));
            assert_eq!(number.to_wire(ParamEncoding::CStyle), Ok((c_style.to_bits(), kind)));
        }
        assert_eq!(ParamNumber::Real32(1.5).to_wire(ParamEncoding::Bytewise), Ok((0x3FC0_0000, 9)));
        assert_eq!(ParamNumber::Real32(1.5).to_wire(ParamEncoding::CStyle), Ok((0x3FC0_0000, 9)));
    }

    #[test]
    fn what_a_float_cannot_say_is_refused() {
        let big = ParamNumber::Int32(16_777_217);
        assert!(big.to_wire(ParamEncoding::Bytewise).is_ok());
        let value_bits = 16_777_216.0f32.to_bits();
        let error = MavlinkError::Parameter { kind: 6, value_bits };
        assert_eq!(big.to_wire(ParamEncoding::CStyle), Err(error));
        for (float, kind) in [
            (0.5f32, 6),
            (f32::NAN, 6),
            (f32::INFINITY, 5),
            (256.0, 1),
            (-1.0, 3),
            (4_294_967_296.0, 5),
            (9.3e18, 6),
        ] {
            let value_bits = float.to_bits();
            let read = ParamNumber::from_wire(value_bits, kind, ParamEncoding::CStyle);
            assert_eq!(read, Err(MavlinkError::Parameter { kind, value_bits }), "{float}");
        }
        for kind in [0, 7, 8, 10, 11, 255] {
            for encoding in BOTH {
                let read = ParamNumber::from_wire(1, kind, encoding);
                assert_eq!(read, Err(MavlinkError::Parameter { kind, value_bits: 1 }));
            }
        }
    }

    proptest! {
        #[test]
        fn numbers_round_trip(bits: u32, kind in prop::sample::select(std::vec![1u8, 2, 3, 4, 5, 6])) {
            for encoding in BOTH {
                let Ok(number) = ParamNumber::from_wire(bits, kind, encoding) else { continue };
                let (again, same_kind) = number.to_wire(encoding).unwrap();
                prop_assert_eq!(same_kind, kind);
                prop_assert_eq!(ParamNumber::from_wire(again, kind, encoding), Ok(number));
            }
            let whole = ParamNumber::from_wire(bits, kind, ParamEncoding::Bytewise).unwrap();
            if let Ok((float, _)) = whole.to_wire(ParamEncoding::CStyle) {
                prop_assert_eq!(ParamNumber::from_wire(float, kind, ParamEncoding::CStyle), Ok(whole));
            }
        }
    }
}
