//! From ROS 1 serialization to the CDR that ROS 2 speaks: the same values, aligned, texts ended by a NUL.

use reflect::{Definition, Primitive, Shape};
use thiserror::Error;

/// Little-endian plain CDR, without options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Alignment makes a body of ours at most eight times as long; only messages of others, without fields, make
/// more.
const GROWTH_MAX: usize = 16;
const GROWTH_BASE_BYTES: usize = 4096;
/// The field that ROS 2 gives a message without fields.
pub(crate) const EMPTY_FIELD: &str = "structure_needs_at_least_one_member";
/// ROS 2's header has no number, ROS 1's has.
pub(crate) const HEADER: &str = "std_msgs/Header";
/// The field that ROS 2's header lacks.
pub(crate) const HEADER_SEQUENCE: &str = "seq";

/// Why a body has no form in CDR.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CdrError {
    /// The body ends before its last field.
    #[error("a value needs {needed} bytes and {left} are left")]
    Short {
        /// Bytes a value needed.
        needed: usize,
        /// Bytes that were left.
        left: usize,
    },
    /// Bytes left after the last field.
    #[error("{left} bytes after the last field")]
    Trailing {
        /// How many.
        left: usize,
    },
    /// A `bool` neither 0 nor 1.
    #[error("{value} is no bool")]
    NotBool {
        /// The byte.
        value: u8,
    },
    /// Text that is not UTF-8, or holds the NUL that would end it.
    #[error("text that is not UTF-8, or holds a NUL")]
    Text,
    /// A body that would grow beyond all reason.
    #[error("a body of {bytes} bytes that would grow beyond all reason")]
    TooComplex {
        /// Its length.
        bytes: usize,
    },
}

/// Turns bodies of one type after another into CDR, into one buffer.
#[derive(Debug, Default)]
pub(crate) struct Transcoder {
    out: Vec<u8>,
    /// Times later than ROS 2's signed seconds reach, which stand as the last instant they do reach.
    pub clamped: u64,
}

/// One body on its way.
struct Body<'a> {
    definition: &'a Definition,
    rest: &'a [u8],
    out: &'a mut Vec<u8>,
    out_bytes_max: usize,
    body_bytes: usize,
    clamped: &'a mut u64,
}

impl Transcoder {
    /// The body in CDR.
    pub(crate) fn transcode(&mut self, definition: &Definition, body: &[u8]) -> Result<&[u8], CdrError> {
        self.out.clear();
        self.out.extend_from_slice(&ENCAPSULATION);
        let mut body = Body {
            definition,
            rest: body,
            out: &mut self.out,
            out_bytes_max: GROWTH_BASE_BYTES + body.len() * GROWTH_MAX,
            body_bytes: body.len(),
            clamped: &mut self.clamped,
        };
        body.record(0)?;
        match body.rest.len() {
            0 => Ok(&self.out),
            left => Err(CdrError::Trailing { left }),
        }
    }
}

impl<'a> Body<'a> {
    fn record(&mut self, place: usize) -> Result<(), CdrError> {
        let definition = self.definition;
        let record = &definition.records()[place];
        if record.fields.is_empty() {
            return self.put(&[0]);
        }
        for field in &record.fields {
            if record.name == HEADER && field.name == HEADER_SEQUENCE {
                self.take(4)?;
            } else {
                self.value(&field.shape)?;
            }
        }
        Ok(())
    }

    fn value(&mut self, shape: &Shape) -> Result<(), CdrError> {
        match shape {
            Shape::Primitive(primitive) => self.primitive(*primitive),
            Shape::Enumeration(choice) => self.copy(choice.width.into()),
            Shape::Text { .. } => self.text(),
            Shape::Seq { element, .. } => {
                let count = self.count()?;
                self.align(4);
                self.put(&count.to_le_bytes())?;
                (0..count).try_for_each(|_| self.value(element))
            }
            Shape::Array { element, length } => (0..*length).try_for_each(|_| self.value(element)),
            Shape::Record(place) => self.record(*place),
        }
    }

    fn primitive(&mut self, primitive: Primitive) -> Result<(), CdrError> {
        match primitive {
            Primitive::Bool => match self.take(1)? {
                [value @ (0 | 1)] => self.put(&[*value]),
                [value, ..] => Err(CdrError::NotBool { value: *value }),
                [] => Err(CdrError::Short { needed: 1, left: 0 }),
            },
            Primitive::Time => {
                let (seconds, nanos) = (self.count()?, self.count()?);
                let held = i32::try_from(seconds).map(|seconds| (seconds, nanos));
                let (seconds, nanos) = held.unwrap_or_else(|_| {
                    *self.clamped += 1;
                    (i32::MAX, 999_999_999)
                });
                self.align(4);
                self.put(&seconds.to_le_bytes())?;
                self.put(&nanos.to_le_bytes())
            }
            Primitive::Duration => {
                self.copy(4)?;
                self.copy(4)
            }
            other => self.copy(other.size() as usize),
        }
    }

    fn text(&mut self) -> Result<(), CdrError> {
        let count = self.count()?;
        let bytes = self.take(count as usize)?;
        if bytes.contains(&0) || std::str::from_utf8(bytes).is_err() {
            return Err(CdrError::Text);
        }
        self.align(4);
        self.put(&count.saturating_add(1).to_le_bytes())?;
        self.put(bytes)?;
        self.put(&[0])
    }

    fn copy(&mut self, size: usize) -> Result<(), CdrError> {
        let bytes = self.take(size)?;
        self.align(size);
        self.put(bytes)
    }

    fn count(&mut self) -> Result<u32, CdrError> {
        let left = self.rest.len();
        let (bytes, rest) = self.rest.split_first_chunk().ok_or(CdrError::Short { needed: 4, left })?;
        self.rest = rest;
        Ok(u32::from_le_bytes(*bytes))
    }

    fn take(&mut self, needed: usize) -> Result<&'a [u8], CdrError> {
        let left = self.rest.len();
        let (taken, rest) = self.rest.split_at_checked(needed).ok_or(CdrError::Short { needed, left })?;
        self.rest = rest;
        Ok(taken)
    }

    /// Alignment counts from behind the encapsulation.
    fn align(&mut self, to: usize) {
        let length = (self.out.len() - ENCAPSULATION.len()).next_multiple_of(to) + ENCAPSULATION.len();
        self.out.resize(length, 0);
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), CdrError> {
        if self.out.len() + bytes.len() > self.out_bytes_max {
            return Err(CdrError::TooComplex { bytes: self.body_bytes });
        }
        self.out.extend_from_slice(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cdr(text: &str, body: &[u8]) -> Result<Vec<u8>, CdrError> {
        let definition = Definition::parse("p/T", text).unwrap();
        Transcoder::default().transcode(&definition, body).map(<[u8]>::to_vec)
    }

    #[test]
    fn values_are_aligned_from_behind_the_encapsulation() {
        let out = cdr("uint8 a\nfloat64 b\nuint8 c\nuint16 d\nuint8 e\ntime f", &{
            let mut body = vec![1];
            body.extend(2.5_f64.to_le_bytes());
            body.extend([3, 4, 0, 5, 6, 0, 0, 0, 7, 0, 0, 0]);
            body
        });
        let mut expected = vec![0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0];
        expected.extend(2.5_f64.to_le_bytes());
        expected.extend([3, 0, 4, 0, 5, 0, 0, 0, 6, 0, 0, 0, 7, 0, 0, 0]);
        assert_eq!(out, Ok(expected));
    }

    #[test]
    fn texts_end_in_nul_and_empty_sequences_need_no_alignment() {
        let out = cdr(
            "string a\nfloat64[] b\nuint8 c\nEmpty d\n===\nMSG: p/Empty",
            &[1, 0, 0, 0, b'x', 0, 0, 0, 0, 9],
        );
        let expected = [0, 1, 0, 0, 2, 0, 0, 0, b'x', 0, 0, 0, 0, 0, 0, 0, 9, 0];
        assert_eq!(out, Ok(expected.to_vec()));
    }

    #[test]
    fn a_header_loses_its_number() {
        let out = cdr(
            "Header a\n===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id",
            &[9, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0],
        );
        assert_eq!(out, Ok(vec![0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 0]));
    }

    #[test]
    fn what_ros_2_cannot_say_is_counted_or_refused() {
        let definition = Definition::parse("p/T", "time a").unwrap();
        let mut transcoder = Transcoder::default();
        let late = transcoder.transcode(&definition, &[255; 8]).unwrap();
        assert_eq!(late[4..], [255, 255, 255, 127, 255, 201, 154, 59]);
        assert_eq!(transcoder.clamped, 1);
        assert_eq!(cdr("bool a", &[2]), Err(CdrError::NotBool { value: 2 }));
        assert_eq!(cdr("string a", &[1, 0, 0, 0, 0]), Err(CdrError::Text));
        assert_eq!(cdr("uint16 a", &[1]), Err(CdrError::Short { needed: 2, left: 1 }));
        assert_eq!(cdr("uint8 a", &[1, 2]), Err(CdrError::Trailing { left: 1 }));
        let empty = "Empty[] a\n===\nMSG: p/Empty";
        assert_eq!(cdr(empty, &[255; 4]), Err(CdrError::TooComplex { bytes: 4 }));
    }
}
