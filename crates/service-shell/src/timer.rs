//! Waking at an instant of the arena's clock.
//!
//! A timerfd on an absolute schedule, since tokio's own timer counts in milliseconds: at 1 kHz its median is
//! a millisecond late, the kernel's timer some tens of microseconds.

use std::io;
use std::task::{Context, Poll, ready};

use quantity::Time;
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create, timerfd_settime,
};

use crate::clock;
use crate::kernel::Watched;

const NEVER: Timespec = Timespec { tv_sec: 0, tv_nsec: 0 };

/// One alarm.
#[derive(Debug)]
pub struct Timer {
    fd: Watched,
    set_to: Option<Time>,
}

impl Timer {
    /// An alarm that is not set. Call within a tokio runtime.
    ///
    /// # Errors
    /// What the system says.
    pub fn new() -> io::Result<Self> {
        let fd = timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC)?;
        Ok(Self { fd: Watched::new(fd)?, set_to: None })
    }

    /// Sets or clears the alarm; an instant that has passed rings at once.
    ///
    /// # Errors
    /// What the system says.
    pub fn set(&mut self, at: Option<Time>) -> io::Result<()> {
        if self.set_to == at {
            return Ok(());
        }
        let value = at.map_or(NEVER, clock::timespec);
        let setting = Itimerspec { it_interval: NEVER, it_value: value };
        timerfd_settime(&self.fd, TimerfdTimerFlags::ABSTIME, &setting)?;
        self.set_to = at;
        Ok(())
    }

    /// Ready once the alarm has rung; it is then no longer set.
    pub fn poll_elapsed(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        loop {
            let mut guard = ready!(self.fd.poll_readable(cx))?;
            let mut expirations = [0; 8];
            match rustix::io::read(&self.fd, &mut expirations) {
                Ok(_) => {
                    guard.clear_ready();
                    self.set_to = None;
                    return Poll::Ready(Ok(()));
                }
                Err(rustix::io::Errno::AGAIN) => guard.clear_ready(),
                Err(rustix::io::Errno::INTR) => {}
                Err(error) => return Poll::Ready(Err(error.into())),
            }
        }
    }
}
