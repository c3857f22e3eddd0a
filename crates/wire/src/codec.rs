//! The body's bytes. The one place that names bincode: its format, kept small, is ROS 1 serialization.

use bincode::config::{Configuration, Fixint, Limit, LittleEndian};
use bincode::enc::write::Writer;
use reflect::Message;
use thiserror::Error;

/// Most bytes of a body.
pub const BODY_BYTES_MAX: usize = 60_000;

/// Bounds what a decoder may read or reserve; without it one hostile length aborts the process.
const LIMIT: usize = 65_536;

const CONFIG: Configuration<LittleEndian, Fixint, Limit<LIMIT>> =
    bincode::config::standard().with_little_endian().with_fixed_int_encoding().with_limit::<LIMIT>();

/// Why a message has no body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum EncodeError {
    /// A float in it is not a finite number.
    #[error("a float of {message} is not finite")]
    NotFinite {
        /// The message's published name.
        message: &'static str,
    },
    /// More bytes than a body may have.
    #[error("the body of {message} exceeds {} bytes", BODY_BYTES_MAX)]
    TooLong {
        /// The message's published name.
        message: &'static str,
    },
    /// A value without a form on the wire, such as an instant before the clock's zero.
    #[error("a value of {message} has no form on the wire")]
    Unwritable {
        /// The message's published name.
        message: &'static str,
    },
}

/// Why a body is no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DecodeError {
    /// It is of another type, or of another version of it.
    #[error("schema id {found:016x}, that of {message} is {expected:016x}")]
    Schema {
        /// The message's published name.
        message: &'static str,
        /// Its schema id.
        expected: u64,
        /// The datagram's schema id.
        found: u64,
    },
    /// Bytes that do not read as the message: too few, a value outside its set or bound, text that is not
    /// UTF-8.
    #[error("{length} bytes do not read as {message}")]
    Unreadable {
        /// The message's published name.
        message: &'static str,
        /// The body's length.
        length: usize,
    },
    /// Bytes left when all fields are read.
    #[error("{message} takes {read} bytes of {length}")]
    Trailing {
        /// The message's published name.
        message: &'static str,
        /// Bytes its fields took.
        read: usize,
        /// The body's length.
        length: usize,
    },
    /// More bytes than a body may have.
    #[error("a body of {length} bytes, may have {}", BODY_BYTES_MAX)]
    TooLong {
        /// The body's length.
        length: usize,
    },
    /// A float in it is not a finite number.
    #[error("a float of {message} is not finite")]
    NotFinite {
        /// The message's published name.
        message: &'static str,
    },
}

/// Writes a message's body at the end of `out`, which is left as it was on error.
///
/// # Errors
/// An [`EncodeError`] for a message that has no body.
pub fn encode<M: Message>(message: &M, out: &mut Vec<u8>) -> Result<(), EncodeError> {
    let name = M::SCHEMA.name;
    if !message.all_finite() {
        return Err(EncodeError::NotFinite { message: name });
    }
    let start = out.len();
    let mut appender = Appender { out, end_max: start + BODY_BYTES_MAX };
    let result = bincode::serde::encode_into_writer(message, &mut appender, CONFIG);
    result.map_err(|error| {
        out.truncate(start);
        match error {
            bincode::error::EncodeError::UnexpectedEnd => EncodeError::TooLong { message: name },
            _ => EncodeError::Unwritable { message: name },
        }
    })
}

/// Reads a message from a body.
///
/// # Errors
/// A [`DecodeError`] for a body that is not exactly one message of that type with finite numbers.
pub fn decode<M: Message>(body: &[u8]) -> Result<M, DecodeError> {
    let (message, length) = (M::SCHEMA.name, body.len());
    if length > BODY_BYTES_MAX {
        return Err(DecodeError::TooLong { length });
    }
    let (decoded, read): (M, usize) = bincode::serde::decode_from_slice(body, CONFIG)
        .map_err(|_| DecodeError::Unreadable { message, length })?;
    if read != length {
        return Err(DecodeError::Trailing { message, read, length });
    }
    if !decoded.all_finite() {
        return Err(DecodeError::NotFinite { message });
    }
    Ok(decoded)
}

/// Appends to a vector that is kept between messages, so that sending allocates nothing.
struct Appender<'a> {
    out: &'a mut Vec<u8>,
    end_max: usize,
}

impl Writer for Appender<'_> {
    #[inline]
    fn write(&mut self, bytes: &[u8]) -> Result<(), bincode::error::EncodeError> {
        if self.out.len() + bytes.len() > self.end_max {
            return Err(bincode::error::EncodeError::UnexpectedEnd);
        }
        self.out.extend_from_slice(bytes);
        Ok(())
    }
}
