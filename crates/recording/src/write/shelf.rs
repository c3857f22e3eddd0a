//! Where the format's library puts its bytes down until they are handed to the sink as one block.

use std::io::{self, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes on their way to a sink. The library owns its stream and gives no access to it, hence the two
/// handles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shelf(Arc<Mutex<Vec<u8>>>);

/// The library's handle: writing to it cannot fail.
#[derive(Debug)]
pub(crate) struct Writing(Shelf);

impl Shelf {
    /// The library's handle.
    pub(crate) fn writing(&self) -> Writing {
        Writing(self.clone())
    }

    /// Hands everything to the sink, in one block.
    pub(crate) fn empty_into(&self, sink: &mut impl Write) -> io::Result<()> {
        let mut bytes = self.bytes();
        if bytes.is_empty() {
            return Ok(());
        }
        let written = sink.write_all(&bytes);
        bytes.clear();
        written
    }

    fn bytes(&self) -> MutexGuard<'_, Vec<u8>> {
        // Nothing that holds the lock leaves the bytes in disorder, whatever its fate.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Writing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.bytes().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
