//! A file that can be ended properly after any of its writes has failed.

use std::io::{self, Write};

use super::StoredFile;
use super::tail::tail;
use crate::Ending;

/// A file that takes blocks of whole records, and knows up to where it is sound.
#[derive(Debug)]
pub(super) struct Sealable<F> {
    file: F,
    /// Up to here every block was written completely.
    good_bytes: u64,
    /// Up to here the disk has confirmed everything.
    synced_bytes: u64,
    /// A write or sync has failed: nothing is written as if nothing had been.
    failed: bool,
    cut_to_synced: bool,
    /// Its end was written as it should be: it needs no other.
    ended: bool,
}

impl<F: StoredFile> Sealable<F> {
    pub(super) fn new(file: F) -> Self {
        Self { file, good_bytes: 0, synced_bytes: 0, failed: false, cut_to_synced: false, ended: false }
    }

    /// Whether a sync has failed, so that the sound part is only what was confirmed before.
    pub(super) fn is_cut_to_synced(&self) -> bool {
        self.cut_to_synced
    }

    #[cfg(test)]
    pub(super) fn into_file(self) -> F {
        self.file
    }

    /// Takes note that the last block was the file's end.
    pub(super) fn mark_ended(&mut self) {
        self.ended = true;
    }

    /// Bytes of complete blocks.
    pub(super) fn good_bytes(&self) -> u64 {
        self.good_bytes
    }

    /// Waits for the disk to confirm all blocks.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.refuse_if_failed()?;
        if self.synced_bytes == self.good_bytes {
            return Ok(());
        }
        if let Err(error) = self.file.sync() {
            self.failed = true;
            // What was written since the last confirmation may be gone, whatever reading it back says now.
            self.good_bytes = self.synced_bytes;
            self.cut_to_synced = true;
            self.ended = false;
            return Err(error);
        }
        self.synced_bytes = self.good_bytes;
        Ok(())
    }

    /// Cuts the file to its sound part and ends it.
    pub(super) fn seal_torn(&mut self, ending: &Ending) -> io::Result<()> {
        self.failed = true;
        if self.ended {
            return Ok(());
        }
        self.file.truncate(self.good_bytes)?;
        if let Err(error) = write_whole(&mut self.file, &tail(ending)) {
            // A torn tail is no better than none.
            let _ = self.file.truncate(self.good_bytes);
            return Err(error);
        }
        self.file.sync()
    }

    fn refuse_if_failed(&self) -> io::Result<()> {
        if self.failed { Err(io::Error::other("the file has failed before")) } else { Ok(()) }
    }
}

impl<F: StoredFile> Write for Sealable<F> {
    /// Writes a block of whole records, all of it or an error.
    fn write(&mut self, block: &[u8]) -> io::Result<usize> {
        self.refuse_if_failed()?;
        if let Err(error) = write_whole(&mut self.file, block) {
            self.failed = true;
            return Err(error);
        }
        self.good_bytes += block.len() as u64;
        Ok(block.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn write_whole(file: &mut impl StoredFile, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match file.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => bytes = &bytes[count..],
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
