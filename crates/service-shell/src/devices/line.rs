//! A serial line: opened, lost, found again.
//!
//! Radios hang on USB, so their device files come and go. A line that is not there, or breaks, is tried again
//! every half second; until then nothing is received, and what is sent is refused, as by a radio that is off.

use std::fmt;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::task::{Context, Poll};

use quantity::{Span, Time};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector};
use settings::{Framing, SerialLine};
use tracing::{info, warn};

use crate::clock;
use crate::kernel::Watched;
use crate::timer::Timer;

/// How often a line that is not there is looked for.
const RETRY_PERIOD: Span = Span::from_millis(500);
/// Bytes taken at a time; a radio's line brings some hundred between two looks.
pub(super) const PIECE_BYTES_MAX: usize = 4096;

/// Which line, and how it is to be set up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineAddress {
    /// A serial port.
    Serial(SerialLine),
    /// A pseudo terminal, which needs no rate.
    Pty(PathBuf),
}

impl LineAddress {
    /// Its device file.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Serial(line) => &line.path,
            Self::Pty(path) => path,
        }
    }

    /// Opens it as a raw line that never waits.
    ///
    /// # Errors
    /// What the system says; also of a file that is no terminal, and of a serial port that another program holds.
    pub fn open(&self) -> io::Result<OwnedFd> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(self.path(), flags, Mode::empty())?;
        if !rustix::termios::isatty(&fd) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no serial line"));
        }
        let mut modes = rustix::termios::tcgetattr(&fd)?;
        modes.make_raw();
        if let Self::Serial(line) = self {
            modes.set_speed(line.baud)?;
            modes.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
            modes.control_modes &= !(ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB);
            modes.control_modes &= !ControlModes::CRTSCTS;
            if line.framing == Framing::EvenParityTwoStops {
                modes.control_modes |= ControlModes::PARENB | ControlModes::CSTOPB;
            }
            rustix::termios::ioctl_tiocexcl(&fd)?;
        }
        rustix::termios::tcsetattr(&fd, OptionalActions::Now, &modes)?;
        // What came before anybody listened is of another time.
        rustix::termios::tcflush(&fd, QueueSelector::IOFlush)?;
        Ok(fd)
    }
}

impl fmt::Display for LineAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(SerialLine { path, baud, framing }) => {
                write!(f, "{} at {baud} baud, {}", path.display(), framing.name())
            }
            Self::Pty(path) => write!(f, "pseudo terminal {}", path.display()),
        }
    }
}

/// A line, open or not.
#[derive(Debug)]
pub(super) struct Line {
    name: String,
    address: LineAddress,
    open: Option<Watched>,
    retry: Timer,
    retry_at: Time,
    failures: u64,
}

impl Line {
    /// A line that is opened at the first use. Call within a tokio runtime.
    ///
    /// # Errors
    /// No timer can be had.
    pub(super) fn new(name: &str, address: LineAddress) -> io::Result<Self> {
        let mut line = Self {
            name: name.to_owned(),
            address,
            open: None,
            retry: Timer::new()?,
            retry_at: clock::now(),
            failures: 0,
        };
        line.reopen();
        Ok(line)
    }

    /// Ready once there may be something to take, or to try.
    pub(super) fn poll_readable(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &self.open {
            Some(fd) => fd.poll_readable(cx).map_ok(|_| ()),
            None => {
                self.retry.set(Some(self.retry_at))?;
                self.retry.poll_elapsed(cx)
            }
        }
    }

    /// Takes what has come, without waiting: how many bytes.
    pub(super) fn take(&mut self, cx: &mut Context<'_>, piece: &mut [u8]) -> usize {
        self.reopen();
        let Some(fd) = &self.open else { return 0 };
        let Poll::Ready(guard) = fd.poll_readable(cx) else { return 0 };
        let taken = match guard {
            Err(error) => Err(error),
            Ok(mut guard) => match rustix::io::read(fd, &mut *piece) {
                // Hung up.
                Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => Ok(count),
                Err(Errno::AGAIN) => {
                    guard.clear_ready();
                    Ok(0)
                }
                Err(Errno::INTR) => Ok(0),
                Err(error) => Err(error.into()),
            },
        };
        taken.unwrap_or_else(|error| {
            self.close(&error);
            0
        })
    }

    /// Sends bytes without waiting.
    ///
    /// # Errors
    /// The line is not there, or takes no more now; half a frame may have left.
    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.reopen();
        let Some(fd) = &self.open else { return Err(io::ErrorKind::NotConnected.into()) };
        match rustix::io::write(fd, bytes) {
            Ok(count) if count == bytes.len() => Ok(()),
            Ok(count) => {
                let reason = format!("the line took {count} of {} bytes", bytes.len());
                Err(io::Error::new(io::ErrorKind::WriteZero, reason))
            }
            Err(error @ (Errno::AGAIN | Errno::INTR)) => Err(error.into()),
            Err(error) => {
                self.close(&error.into());
                Err(error.into())
            }
        }
    }

    fn reopen(&mut self) {
        let now = clock::now();
        if self.open.is_some() || now < self.retry_at {
            return;
        }
        self.retry_at = now + RETRY_PERIOD;
        match self.address.open().and_then(Watched::new) {
            Ok(fd) => {
                info!(device = self.name, line = %self.address, "open");
                (self.open, self.failures) = (Some(fd), 0);
            }
            Err(error) => {
                self.failures += 1;
                // A radio that is unplugged stays so for long: log powers of two.
                if self.failures.is_power_of_two() {
                    warn!(device = self.name, line = %self.address, %error, "cannot be opened; tried again");
                }
            }
        }
    }

    fn close(&mut self, error: &io::Error) {
        warn!(device = self.name, line = %self.address, %error, "lost");
        self.open = None;
        self.retry_at = clock::now() + RETRY_PERIOD;
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;

    use super::*;
    use crate::devices::PseudoTerminal;
    use crate::run_loop::block_on;
    use crate::scratch::Scratch;

    async fn receive(line: &mut Line, wanted: usize) -> Vec<u8> {
        let (mut all, mut piece) = (Vec::new(), [0; PIECE_BYTES_MAX]);
        while all.len() < wanted {
            let count = poll_fn(|cx| match line.poll_readable(cx) {
                Poll::Ready(_) => Poll::Ready(line.take(cx, &mut piece)),
                Poll::Pending => Poll::Pending,
            })
            .await;
            all.extend_from_slice(&piece[..count]);
        }
        all
    }

    /// All 256 bytes: a line discipline that is not raw would eat or change some.
    fn every_byte() -> Vec<u8> {
        (0..=u8::MAX).collect()
    }

    #[test]
    fn every_byte_passes_both_ways_unchanged() {
        block_on(async {
            let scratch = Scratch::new("line-bytes");
            let path = scratch.path("pty/data");
            let mut far = PseudoTerminal::create(&path).unwrap();
            let mut near = Line::new("radio", LineAddress::Pty(path)).unwrap();
            near.send(&every_byte()).unwrap();
            assert_eq!(far.receive_all(256).await, every_byte());
            far.send(&every_byte()).unwrap();
            assert_eq!(receive(&mut near, 256).await, every_byte());
            Ok(())
        })
        .unwrap();
    }

    #[test]
    fn a_line_that_is_lost_is_found_again_without_what_came_meanwhile() {
        block_on(async {
            let scratch = Scratch::new("line-lost");
            let path = scratch.path("command");
            let mut near = Line::new("encoder", LineAddress::Pty(path.clone())).unwrap();
            assert_eq!(near.send(b"frame").unwrap_err().kind(), io::ErrorKind::NotConnected);
            for round in 0..2_u8 {
                let mut far = PseudoTerminal::create(&path).unwrap();
                far.send(b"too early").unwrap();
                // Tried again by itself: nobody sends.
                let (mut piece, mut greeted) = ([0; PIECE_BYTES_MAX], false);
                while !greeted {
                    poll_fn(|cx| near.poll_readable(cx)).await.unwrap();
                    poll_fn(|cx| Poll::Ready(near.take(cx, &mut piece))).await;
                    greeted = near.send(&[round]).is_ok();
                }
                assert_eq!(far.receive_all(1).await, [round]);
                far.send(b"now").unwrap();
                assert_eq!(receive(&mut near, 3).await, b"now");
                drop(far);
                // The loss shows at the next look.
                while near.open.is_some() {
                    poll_fn(|cx| near.poll_readable(cx)).await.unwrap();
                    poll_fn(|cx| Poll::Ready(near.take(cx, &mut piece))).await;
                }
            }
            Ok(())
        })
        .unwrap();
    }

    #[test]
    fn what_is_no_line_is_refused_with_its_reason() {
        let scratch = Scratch::new("line-file");
        let path = scratch.path("file");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, b"").unwrap();
        let error = LineAddress::Pty(path).open().unwrap_err();
        assert!(error.to_string().contains("no serial line"), "{error}");
        let missing = LineAddress::Pty(scratch.path("missing")).open().unwrap_err();
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_serial_port_gets_its_rate_and_framing() {
        let scratch = Scratch::new("line-rate");
        let path = scratch.path("port");
        block_on(async {
            let _far = PseudoTerminal::create(&path).unwrap();
            let framing = Framing::EvenParityTwoStops;
            // 100 000 baud, which SBUS has, is none of the rates that have a name.
            let port = LineAddress::Serial(SerialLine { path: path.clone(), baud: 100_000, framing });
            let modes = rustix::termios::tcgetattr(port.open().unwrap()).unwrap();
            assert_eq!((modes.input_speed(), modes.output_speed()), (100_000, 100_000));
            assert!(modes.control_modes.contains(ControlModes::CSTOPB | ControlModes::CREAD));
            Ok(())
        })
        .unwrap();
    }
}
