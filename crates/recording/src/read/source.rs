//! Where a recording's bytes come from: a file read at positions, or memory.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{Defect, ReadError};

/// The longest record that is read into memory.
pub(crate) const RECORD_BYTES_MAX: u64 = 1 << 30;
/// Code and length of a record.
pub(crate) const FRAME_BYTES: u64 = 9;

/// A file's bytes, as many as it had when it was opened.
#[derive(Debug)]
pub(crate) struct Source {
    pub path: PathBuf,
    pub length: u64,
    bytes: Bytes,
}

#[derive(Debug)]
enum Bytes {
    File(File),
    Memory(Vec<u8>),
}

/// A record's code and where its body stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    pub code: u8,
    /// Where the record, with code and length, begins.
    pub at: u64,
    /// Length of its body.
    pub length: u64,
}

impl Frame {
    /// Where the next record begins.
    pub(crate) const fn end(self) -> u64 {
        self.at + FRAME_BYTES + self.length
    }
}

impl Source {
    pub(crate) fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |source| ReadError::File { path: path.to_owned(), source: Arc::new(source) };
        let file = File::open(path).map_err(failed)?;
        let facts = file.metadata().map_err(failed)?;
        if !facts.is_file() {
            return Err(failed(io::Error::other("no regular file")));
        }
        Ok(Self { path: path.to_owned(), length: facts.len(), bytes: Bytes::File(file) })
    }

    pub(crate) fn memory(name: &str, bytes: Vec<u8>) -> Self {
        Self { path: PathBuf::from(name), length: bytes.len() as u64, bytes: Bytes::Memory(bytes) }
    }

    /// Fills `buffer` with `length` bytes from `offset` on. The caller has held both against the file's
    /// length.
    pub(crate) fn read(&self, offset: u64, length: u64, buffer: &mut Vec<u8>) -> Result<(), ReadError> {
        let within = offset.checked_add(length).is_some_and(|end| end <= self.length);
        if !within || length > RECORD_BYTES_MAX {
            let limit = RECORD_BYTES_MAX.min(self.length.saturating_sub(offset));
            return Err(
                self.damaged(offset, Defect::Limit { what: "a record's length", found: length, limit })
            );
        }
        let length = length as usize;
        match &self.bytes {
            Bytes::File(file) => {
                buffer.resize(length, 0);
                file.read_exact_at(buffer, offset)
                    .map_err(|source| ReadError::File { path: self.path.clone(), source: Arc::new(source) })
            }
            Bytes::Memory(bytes) => {
                buffer.clear();
                buffer.extend_from_slice(&bytes[offset as usize..offset as usize + length]);
                Ok(())
            }
        }
    }

    /// The record at `at`, if it stands in the file as a whole.
    pub(crate) fn frame(&self, at: u64) -> Result<Option<Frame>, ReadError> {
        if at.checked_add(FRAME_BYTES).is_none_or(|body| body > self.length) {
            return Ok(None);
        }
        let mut head = Vec::with_capacity(FRAME_BYTES as usize);
        self.read(at, FRAME_BYTES, &mut head)?;
        Ok(frame_in(&head, at).filter(|frame| frame.length <= self.length - at - FRAME_BYTES))
    }

    /// The body of a record.
    pub(crate) fn body(&self, frame: Frame, buffer: &mut Vec<u8>) -> Result<(), ReadError> {
        self.read(frame.at + FRAME_BYTES, frame.length, buffer)
    }

    pub(crate) fn damaged(&self, offset: u64, defect: Defect) -> ReadError {
        ReadError::Damaged { path: self.path.clone(), offset, defect }
    }
}

/// The record whose code and length stand at the beginning of `head`, which begins at `at` in the file.
pub(crate) fn frame_in(head: &[u8], at: u64) -> Option<Frame> {
    let code = *head.first()?;
    let length = u64::from_le_bytes(head.get(1..FRAME_BYTES as usize)?.try_into().ok()?);
    Some(Frame { code, at, length })
}
