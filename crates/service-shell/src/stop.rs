//! When to end: SIGTERM, SIGINT, or the supervisor gone for long.

use std::task::{Context, Poll};

use quantity::{Span, Time};
use rustix::process::{Pid, getppid};
use tokio::signal::unix::{Signal, SignalKind, signal};

use crate::ShellError;
use crate::error::During;

/// How long a supervised program goes on without its supervisor: the vehicles land meanwhile.
const ORPHAN_SPAN: Span = Span::from_secs(30);

/// Why a program ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// SIGTERM.
    Terminated,
    /// SIGINT: Ctrl-C.
    Interrupted,
    /// The supervisor has died.
    Orphaned,
}

impl StopReason {
    /// The reason in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Terminated => "terminated",
            Self::Interrupted => "interrupted",
            Self::Orphaned => "the supervisor is gone",
        }
    }
}

/// Listens for orders to end.
#[derive(Debug)]
pub struct Stop {
    terminate: Signal,
    interrupt: Signal,
    supervisor: Option<Pid>,
    orphaned_at: Option<Time>,
}

impl Stop {
    /// Listens for the signals and, if `supervised`, watches the parent process. Call within a tokio runtime.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(supervised: bool) -> Result<Self, ShellError> {
        let listen = |kind| signal(kind).during(|| "listening for signals".to_owned());
        Ok(Self {
            terminate: listen(SignalKind::terminate())?,
            interrupt: listen(SignalKind::interrupt())?,
            supervisor: if supervised { getppid() } else { None },
            orphaned_at: None,
        })
    }

    /// Ready once a signal has come.
    pub fn poll_signal(&mut self, cx: &mut Context<'_>) -> Poll<StopReason> {
        if self.terminate.poll_recv(cx).is_ready() {
            return Poll::Ready(StopReason::Terminated);
        }
        if self.interrupt.poll_recv(cx).is_ready() {
            return Poll::Ready(StopReason::Interrupted);
        }
        Poll::Pending
    }

    /// Looks after the supervisor; to be called now and then.
    pub fn check_supervisor(&mut self, now: Time) -> Option<StopReason> {
        if self.supervisor.is_none() || getppid() == self.supervisor {
            return None;
        }
        let orphaned_at = *self.orphaned_at.get_or_insert_with(|| {
            tracing::warn!("the supervisor is gone: ending in {ORPHAN_SPAN}");
            now
        });
        (now - orphaned_at >= ORPHAN_SPAN).then_some(StopReason::Orphaned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orphan_lands_its_vehicles_before_it_ends() {
        crate::block_on(async {
            let start = Time::ZERO + Span::from_secs(100);
            let mut stop = Stop::new(true)?;
            assert_eq!(stop.check_supervisor(start), None, "its parent lives");
            // Its own id is certainly not its parent's.
            stop.supervisor = Some(rustix::process::getpid());
            assert_eq!(stop.check_supervisor(start), None);
            assert_eq!(stop.check_supervisor(start + ORPHAN_SPAN - Span::from_nanos(1)), None);
            assert_eq!(stop.check_supervisor(start + ORPHAN_SPAN), Some(StopReason::Orphaned));
            let mut alone = Stop::new(false)?;
            assert_eq!(alone.check_supervisor(start), None);
            Ok(())
        })
        .unwrap();
    }
}
