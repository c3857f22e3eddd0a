//! What reads a body from its beginning, believing nothing in it.

use super::{Primitive, Value, ViewError};

/// Messages within messages, at most.
pub(crate) const DEPTH_MAX: u32 = 16;
/// Values in one body, at most.
const VALUES_MAX: u32 = 65_536;

/// A place in a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    rest: &'a [u8],
    values: u32,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(body: &'a [u8]) -> Self {
        Self { rest: body, values: 0 }
    }

    /// Counts a value that is about to be built: a body of no bytes can otherwise hold any number of empty
    /// messages.
    pub(crate) fn count_value(&mut self) -> Result<(), ViewError> {
        self.values += 1;
        if self.values > VALUES_MAX { Err(ViewError::TooComplex) } else { Ok(()) }
    }

    pub(crate) fn check_depth(&self, depth: u32) -> Result<(), ViewError> {
        if depth > DEPTH_MAX { Err(ViewError::TooComplex) } else { Ok(()) }
    }

    /// Nothing may be left.
    pub(crate) fn end(self) -> Result<(), ViewError> {
        if self.rest.is_empty() { Ok(()) } else { Err(ViewError::Trailing { left: self.rest.len() }) }
    }

    pub(crate) fn bytes(&mut self, needed: usize) -> Result<&'a [u8], ViewError> {
        let left = self.rest.len();
        let (taken, rest) = self.rest.split_at_checked(needed).ok_or(ViewError::Short { needed, left })?;
        self.rest = rest;
        Ok(taken)
    }

    /// Steps over that many bytes, which may be more than there are or than fit a `usize`.
    pub(crate) fn skip(&mut self, bytes: u64) -> Result<(), ViewError> {
        self.bytes(usize::try_from(bytes).unwrap_or(usize::MAX)).map(|_| ())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ViewError> {
        let left = self.rest.len();
        let (taken, rest) = self.rest.split_first_chunk().ok_or(ViewError::Short { needed: N, left })?;
        self.rest = rest;
        Ok(*taken)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, ViewError> {
        self.array().map(|[byte]| byte)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, ViewError> {
        self.array().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Result<i32, ViewError> {
        self.array().map(i32::from_le_bytes)
    }

    /// A count of elements or bytes.
    pub(crate) fn count(&mut self, bound: u32) -> Result<u32, ViewError> {
        let length = self.u32()?;
        if length > bound { Err(ViewError::TooLong { length, bound }) } else { Ok(length) }
    }

    pub(crate) fn text(&mut self, bound: u32) -> Result<&'a str, ViewError> {
        let count = self.count(bound)?;
        core::str::from_utf8(self.bytes(count as usize)?).map_err(|_| ViewError::NotUtf8)
    }

    pub(crate) fn primitive(&mut self, primitive: Primitive) -> Result<Value<'static>, ViewError> {
        Ok(match primitive {
            Primitive::Bool => match self.u8()? {
                0 => Value::Bool(false),
                1 => Value::Bool(true),
                value => return Err(ViewError::NotBool { value }),
            },
            Primitive::I8 => Value::Signed(i8::from_le_bytes(self.array()?).into()),
            Primitive::I16 => Value::Signed(i16::from_le_bytes(self.array()?).into()),
            Primitive::I32 => Value::Signed(self.i32()?.into()),
            Primitive::I64 => Value::Signed(i64::from_le_bytes(self.array()?)),
            Primitive::U8 => Value::Unsigned(self.u8()?.into()),
            Primitive::U16 => Value::Unsigned(u16::from_le_bytes(self.array()?).into()),
            Primitive::U32 => Value::Unsigned(self.u32()?.into()),
            Primitive::U64 => Value::Unsigned(u64::from_le_bytes(self.array()?)),
            Primitive::F32 => Value::F32(f32::from_le_bytes(self.array()?)),
            Primitive::F64 => Value::F64(f64::from_le_bytes(self.array()?)),
            Primitive::Time => match (self.u32()?, self.u32()?) {
                (sec, nsec) if nsec < 1_000_000_000 => Value::Time { sec, nsec },
                (_, nsec) => return Err(ViewError::BadTime { nsec }),
            },
            Primitive::Duration => Value::Duration { sec: self.i32()?, nsec: self.i32()? },
        })
    }
}
