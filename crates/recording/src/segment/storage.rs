//! What a recording asks of a disk.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use rustix::fs::{CWD, FallocateFlags, RenameFlags};
use rustix::io::Errno;

/// A disk.
pub trait Storage {
    /// A file of it that is open for writing.
    type File: StoredFile;

    /// Makes a file that was not there.
    ///
    /// # Errors
    /// What the system says; that it is there already is an error.
    fn create_new(&mut self, path: &Path) -> io::Result<Self::File>;

    /// Sets a file of so many bytes aside, for its room only.
    ///
    /// # Errors
    /// What the system says.
    fn reserve(&mut self, path: &Path, bytes: u64) -> io::Result<()>;

    /// Gives a file another name, which no file has.
    ///
    /// # Errors
    /// What the system says; that there is a file of that name is an error.
    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a file.
    ///
    /// # Errors
    /// What the system says.
    fn remove(&mut self, path: &Path) -> io::Result<()>;

    /// Makes names in a folder last through a power cut.
    ///
    /// # Errors
    /// What the system says.
    fn sync_folder(&mut self, folder: &Path) -> io::Result<()>;

    /// Whether there is something of that name.
    fn exists(&self, path: &Path) -> bool;

    /// Free bytes on the disk that holds a folder.
    ///
    /// # Errors
    /// What the system says.
    fn free_bytes(&self, folder: &Path) -> io::Result<u64>;
}

/// A file that is open for writing at its end.
pub trait StoredFile {
    /// Writes some of these bytes: how many.
    ///
    /// # Errors
    /// What the system says.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Cuts the file to that length; the next byte is written there.
    ///
    /// # Errors
    /// What the system says.
    fn truncate(&mut self, bytes: u64) -> io::Result<()>;

    /// Waits until everything written is on the disk.
    ///
    /// # Errors
    /// What the system says; what was written since the last success may then be lost.
    fn sync(&mut self) -> io::Result<()>;
}

/// This host's own file systems.
#[derive(Clone, Copy, Debug, Default)]
pub struct Host;

/// A file of this host.
#[derive(Debug)]
pub struct HostFile(File);

impl Storage for Host {
    type File = HostFile;

    fn create_new(&mut self, path: &Path) -> io::Result<HostFile> {
        // Appending, a write after a cut begins at the cut.
        OpenOptions::new().append(true).create_new(true).open(path).map(HostFile)
    }

    fn reserve(&mut self, path: &Path, bytes: u64) -> io::Result<()> {
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).open(path)?;
        match rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, bytes) {
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
                let zeros = [0_u8; 4096];
                let mut left = bytes;
                while left > 0 {
                    let some = left.min(zeros.len() as u64);
                    file.write_all(&zeros[..some as usize])?;
                    left -= some;
                }
                file.sync_data()
            }
            reserved => Ok(reserved?),
        }
    }

    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        match rustix::fs::renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
            // Not every file system can; then whoever makes that name in this very moment loses it.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) if !self.exists(to) => fs::rename(from, to),
            renamed => Ok(renamed?),
        }
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn sync_folder(&mut self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }

    fn exists(&self, path: &Path) -> bool {
        fs::symlink_metadata(path).is_ok()
    }

    fn free_bytes(&self, folder: &Path) -> io::Result<u64> {
        let disk = rustix::fs::statvfs(folder)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
}

impl StoredFile for HostFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        self.0.set_len(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }
}
