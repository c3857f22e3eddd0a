//! The far end of a pseudo terminal: what a simulated device has where a real one has a serial line.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::task::{Context, Poll};

use rustix::io::Errno;
use rustix::pty::OpenptFlags;

use super::line::{LineAddress, PIECE_BYTES_MAX};
use crate::kernel::Watched;

/// The far end of a pseudo terminal, with a link to the near end where a program looks for its serial line.
#[derive(Debug)]
pub struct PseudoTerminal {
    far: Watched,
    /// Held open so that the far end lives on while no program has the near one.
    _near: OwnedFd,
    link: PathBuf,
    target: PathBuf,
}

impl PseudoTerminal {
    /// Makes a pseudo terminal to which `link` leads from now on, and the folders above it. Call within a tokio
    /// runtime.
    ///
    /// # Errors
    /// What the system says; also of something else than a link in that place.
    pub fn create(link: &Path) -> io::Result<Self> {
        let far = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::pty::grantpt(&far)?;
        rustix::pty::unlockpt(&far)?;
        rustix::io::ioctl_fionbio(&far, true)?;
        let name = rustix::pty::ptsname(&far, Vec::new())?;
        let target = PathBuf::from(name.to_string_lossy().into_owned());
        let near = LineAddress::Pty(target.clone()).open()?;
        lead(link, &target)?;
        Ok(Self { far: Watched::new(far)?, _near: near, link: link.to_owned(), target })
    }

    /// Ready once there may be something to take.
    pub fn poll_readable(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.far.poll_readable(cx).map_ok(|_| ())
    }

    /// Takes what the near end has sent, without waiting.
    ///
    /// # Errors
    /// What the system says.
    pub fn take(&mut self) -> io::Result<Vec<u8>> {
        let mut piece = vec![0; PIECE_BYTES_MAX];
        let count = match rustix::io::read(&self.far, &mut piece) {
            Ok(count) => count,
            Err(Errno::AGAIN) => {
                // Only a poll tells the runtime that there is nothing left.
                let mut cx = Context::from_waker(std::task::Waker::noop());
                if let Poll::Ready(Ok(mut guard)) = self.far.poll_readable(&mut cx) {
                    guard.clear_ready();
                }
                0
            }
            Err(Errno::INTR) => 0,
            Err(error) => return Err(error.into()),
        };
        piece.truncate(count);
        Ok(piece)
    }

    /// Sends bytes to the near end without waiting. What nobody takes there fills the line up and is then refused.
    ///
    /// # Errors
    /// What the system says.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match rustix::io::write(&self.far, bytes)? {
            count if count == bytes.len() => Ok(()),
            _ => Err(io::ErrorKind::WriteZero.into()),
        }
    }

    /// Waits for so many bytes.
    #[cfg(test)]
    pub(super) async fn receive_all(&mut self, wanted: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < wanted {
            std::future::poll_fn(|cx| self.poll_readable(cx)).await.unwrap();
            all.extend(self.take().unwrap());
        }
        all
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // Another one may have taken its place.
        if std::fs::read_link(&self.link).is_ok_and(|target| target == self.target) {
            let _ = std::fs::remove_file(&self.link);
        }
    }
}

/// Makes `link` lead to `target`, in one step.
fn lead(link: &Path, target: &Path) -> io::Result<()> {
    if let Some(folder) = link.parent() {
        std::fs::create_dir_all(folder)?;
    }
    if std::fs::symlink_metadata(link).is_ok_and(|found| !found.is_symlink()) {
        let reason = format!("{} is there and is no link", link.display());
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, reason));
    }
    let draft = link.with_extension(format!("draft-{}", std::process::id()));
    std::os::unix::fs::symlink(target, &draft)?;
    std::fs::rename(&draft, link)
}
