//! Who may command a vehicle.
//!
//! A controller's lease epoch is its incarnation: it rises with each start. So of two controllers the later
//! one is right, the earlier one is paused, or dying, or was never stopped. The first command under a higher
//! epoch takes over at once; commands under a lower one are never sent again, whatever becomes of the higher
//! one.

/// The lease of one vehicle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lease {
    epoch: Option<u32>,
    refused: u64,
}

/// Whether a command may be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Admission {
    /// It may: its epoch is the one that holds.
    Held,
    /// It may: its epoch is higher than the one that held until now, if one did.
    TakenOver {
        /// The epoch that held.
        from: Option<u32>,
    },
    /// It may not: a higher epoch was seen.
    Refused {
        /// That epoch.
        holder: u32,
        /// Commands refused since that epoch took over, this one included.
        refused: u64,
    },
}

impl Lease {
    /// Judges a command by its epoch.
    pub(crate) fn admit(&mut self, epoch: u32) -> Admission {
        match self.epoch {
            Some(holder) if epoch == holder => Admission::Held,
            Some(holder) if epoch < holder => {
                self.refused += 1;
                Admission::Refused { holder, refused: self.refused }
            }
            from => {
                self.epoch = Some(epoch);
                self.refused = 0;
                Admission::TakenOver { from }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_higher_epoch_takes_over_at_once_and_a_lower_one_never_acts_again() {
        let mut lease = Lease::default();
        assert_eq!(lease.admit(3), Admission::TakenOver { from: None });
        assert_eq!(lease.admit(3), Admission::Held);
        assert_eq!(lease.admit(2), Admission::Refused { holder: 3, refused: 1 });
        assert_eq!(lease.admit(5), Admission::TakenOver { from: Some(3) });
        assert_eq!(lease.admit(3), Admission::Refused { holder: 5, refused: 1 });
        assert_eq!(lease.admit(4), Admission::Refused { holder: 5, refused: 2 });
        assert_eq!(lease.admit(5), Admission::Held);
    }

    #[test]
    fn in_any_order_the_admitted_epochs_never_fall() {
        let mut state = 1u64;
        for _ in 0..200 {
            let (mut lease, mut highest) = (Lease::default(), 0);
            for _ in 0..50 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let epoch = (state >> 33) as u32 % 5;
                let admitted = !matches!(lease.admit(epoch), Admission::Refused { .. });
                assert_eq!(admitted, epoch >= highest);
                highest = highest.max(epoch);
            }
        }
    }
}
