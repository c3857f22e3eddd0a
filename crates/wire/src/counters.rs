//! Why datagrams are dropped, and how many were.

use core::fmt;

use crate::{DecodeError, Malformed};

/// Why a datagram was dropped; in the order of the checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DropReason {
    /// Not of our length, magic or version.
    Malformed,
    /// The tag does not hold, and nothing the header claims would explain it.
    Unauthentic,
    /// Of another domain, so of other keys.
    Domain,
    /// Of another run, so of other keys.
    Run,
    /// Seen before, too old to tell, or of an earlier incarnation.
    Replayed,
    /// A body that does not decode, or of another schema.
    Undecodable,
}

impl DropReason {
    /// Every reason, in the order of the checks.
    pub const ALL: [Self; 6] =
        [Self::Malformed, Self::Unauthentic, Self::Domain, Self::Run, Self::Replayed, Self::Undecodable];

    /// The reason's name, lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Malformed => "malformed",
            Self::Unauthentic => "unauthentic",
            Self::Domain => "domain",
            Self::Run => "run",
            Self::Replayed => "replayed",
            Self::Undecodable => "undecodable",
        }
    }
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl core::error::Error for DropReason {}

impl From<Malformed> for DropReason {
    fn from(_: Malformed) -> Self {
        Self::Malformed
    }
}

impl From<DecodeError> for DropReason {
    fn from(_: DecodeError) -> Self {
        Self::Undecodable
    }
}

/// What became of the datagrams a node received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Accepted and decoded.
    pub accepted: u64,
    dropped: [u64; DropReason::ALL.len()],
}

impl Counters {
    /// Counts a dropped datagram.
    pub fn count(&mut self, reason: DropReason) {
        self.dropped[reason as usize] += 1;
    }

    /// Datagrams dropped for this reason.
    #[must_use]
    pub const fn dropped(&self, reason: DropReason) -> u64 {
        self.dropped[reason as usize]
    }

    /// Datagrams dropped, for whatever reason.
    #[must_use]
    pub fn dropped_total(&self) -> u64 {
        self.dropped.iter().sum()
    }
}
