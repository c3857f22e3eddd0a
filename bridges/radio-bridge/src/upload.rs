//! The transaction that brings a parameter set to a vehicle over a link that loses frames.
//!
//! Each round says everything the vehicle is not known to have: the announcement until it is answered, the
//! items not yet acknowledged, and the commit. So over a link without loss one round is all there is, and
//! each frame lost costs one round more of less. The vehicle takes announcement, items and commit in any
//! order and as often as they come, and makes the set active only whole and with the right digest.

use device::vehicle_link::{
    FLIP_SET_LEN, FlipSet, ITEMS_PER_PAYLOAD_MAX, Items, Reason, Uplink, UploadReply, UploadState, digest_of,
};
use quantity::{Span, Time};
use schemas::ManeuverUpload;

/// A mask of all items.
const ALL_ITEMS: u32 = (1 << FLIP_SET_LEN) - 1;

/// A set on its way.
#[derive(Clone, Debug)]
pub(crate) struct Upload {
    set_id: u16,
    digest: u64,
    items: [f32; FLIP_SET_LEN],
    announced: bool,
    received_mask: u32,
    retry: Span,
    next_at: Time,
    give_up_at: Time,
    rounds: u32,
}

/// What a reply means for the transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It goes on.
    Going,
    /// The set is active.
    Committed,
    /// The vehicle will not have it.
    Refused(Reason),
}

/// A digest that is not that of the items it came with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WrongDigest {
    /// What the items come to.
    pub(crate) computed: u64,
}

impl Upload {
    /// Begins a transaction, whose first round is due now.
    ///
    /// # Errors
    /// The message's digest is not that of its items.
    pub(crate) fn new(
        now: Time,
        message: &ManeuverUpload,
        retry: Span,
        longest: Span,
    ) -> Result<Self, WrongDigest> {
        let items = FlipSet {
            u1_m_s2: message.u1_m_s2,
            t1_s: message.t1_s,
            t3_s: message.t3_s,
            u5_m_s2: message.u5_m_s2,
            t5_s: message.t5_s,
            rate_rad_s_max: message.rate_rad_s_max,
            envelope_low_m_s2: message.envelope_low_m_s2,
            envelope_high_m_s2: message.envelope_high_m_s2,
            lever_m: message.lever_m,
            flips: f32::from(message.flips),
        }
        .to_items();
        let computed = digest_of(&items);
        if computed != message.digest {
            return Err(WrongDigest { computed });
        }
        Ok(Self {
            set_id: message.set_id,
            digest: message.digest,
            items,
            announced: false,
            received_mask: 0,
            retry,
            next_at: now,
            give_up_at: now.saturating_add(longest),
            rounds: 0,
        })
    }

    /// Whether this is the transaction of that very set.
    pub(crate) fn is_of(&self, set_id: u16, digest: u64) -> bool {
        (self.set_id, self.digest) == (set_id, digest)
    }

    /// The set's identity.
    pub(crate) const fn set_id(&self) -> u16 {
        self.set_id
    }

    /// Rounds sent so far.
    pub(crate) const fn rounds(&self) -> u32 {
        self.rounds
    }

    /// When the next round is due, or the end of patience.
    pub(crate) fn due_at(&self) -> Time {
        self.next_at.min(self.give_up_at)
    }

    /// Whether patience is over.
    pub(crate) fn is_over(&self, now: Time) -> bool {
        now >= self.give_up_at
    }

    /// Sends a round if one is due.
    pub(crate) fn send_due(&mut self, now: Time, mut send: impl FnMut(Uplink)) {
        if now < self.next_at {
            return;
        }
        self.next_at = now.saturating_add(self.retry);
        self.rounds += 1;
        let (set_id, digest) = (self.set_id, self.digest);
        if !self.announced {
            send(Uplink::Begin { set_id, count: FLIP_SET_LEN as u8, digest });
        }
        let mut index = 0;
        while index < FLIP_SET_LEN {
            let run = (index..FLIP_SET_LEN)
                .take_while(|item| self.received_mask & (1 << item) == 0)
                .take(ITEMS_PER_PAYLOAD_MAX)
                .count();
            if let Some(items) = Items::new(set_id, index as u8, &self.items[index..index + run]) {
                send(Uplink::Items(items));
            }
            index += run.max(1);
        }
        send(Uplink::Commit { set_id, digest });
    }

    /// The vehicle's word on an upload.
    pub(crate) fn reply(&mut self, reply: &UploadReply) -> Outcome {
        if reply.set_id != self.set_id {
            return Outcome::Going;
        }
        match (reply.state, reply.reason) {
            (UploadState::Committed, _) if reply.digest == self.digest => Outcome::Committed,
            (UploadState::Staging, _) if reply.digest == self.digest => {
                self.announced = true;
                self.received_mask = reply.received_mask & ALL_ITEMS;
                Outcome::Going
            }
            (UploadState::Refused, reason @ (Reason::OutsideLimits | Reason::WrongSet))
                if reply.digest == self.digest =>
            {
                Outcome::Refused(reason)
            }
            // Another set was staged under this identity, or nothing is staged, or what is staged is spoilt.
            _ => {
                self.announced = false;
                self.received_mask = 0;
                Outcome::Going
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A double flip's set.
    pub(crate) fn message(set_id: u16) -> ManeuverUpload {
        let set = FlipSet {
            u1_m_s2: 20.395,
            t1_s: 0.161,
            t3_s: 0.278,
            u5_m_s2: 20.309,
            t5_s: 0.183,
            rate_rad_s_max: 27.925,
            envelope_low_m_s2: 3.59,
            envelope_high_m_s2: 21.026,
            lever_m: 0.0578,
            flips: 2.0,
        };
        ManeuverUpload {
            vehicle: 1,
            flips: 2,
            set_id,
            digest: set.digest(),
            u1_m_s2: set.u1_m_s2,
            t1_s: set.t1_s,
            t3_s: set.t3_s,
            u5_m_s2: set.u5_m_s2,
            t5_s: set.t5_s,
            rate_rad_s_max: set.rate_rad_s_max,
            envelope_low_m_s2: set.envelope_low_m_s2,
            envelope_high_m_s2: set.envelope_high_m_s2,
            lever_m: set.lever_m,
        }
    }

    fn upload() -> Upload {
        Upload::new(Time::ZERO, &message(7), Span::from_millis(40), Span::from_secs(2)).expect("right digest")
    }

    fn round(upload: &mut Upload, milliseconds: i64) -> Vec<Uplink> {
        let mut sent = Vec::new();
        upload.send_due(Time::ZERO + Span::from_millis(milliseconds), |uplink| sent.push(uplink));
        sent
    }

    fn staging(received_mask: u32) -> UploadReply {
        let digest = message(7).digest;
        UploadReply { set_id: 7, state: UploadState::Staging, received_mask, digest, reason: Reason::None }
    }

    #[test]
    fn the_first_round_says_it_all_and_rounds_keep_their_distance() {
        let mut upload = upload();
        let sent = round(&mut upload, 0);
        assert!(matches!(
            sent[..],
            [Uplink::Begin { count: 10, .. }, Uplink::Items(_), Uplink::Commit { .. }]
        ));
        assert!(round(&mut upload, 39).is_empty());
        assert_eq!(round(&mut upload, 40), sent);
        assert_eq!((upload.rounds(), upload.due_at()), (2, Time::ZERO + Span::from_millis(80)));
    }

    #[test]
    fn only_what_is_missing_is_sent_again() {
        let mut upload = upload();
        round(&mut upload, 0);
        assert_eq!(upload.reply(&staging(0b11_0111_0011)), Outcome::Going);
        let sent = round(&mut upload, 40);
        let items: Vec<(u8, usize)> = sent
            .iter()
            .filter_map(|uplink| match uplink {
                Uplink::Items(items) => Some((items.first_index, items.values().len())),
                _ => None,
            })
            .collect();
        assert_eq!(items, [(2, 2), (7, 1)]);
        assert!(!sent.iter().any(|uplink| matches!(uplink, Uplink::Begin { .. })));
        upload.reply(&staging(ALL_ITEMS));
        assert!(matches!(round(&mut upload, 80)[..], [Uplink::Commit { .. }]));
    }

    #[test]
    fn a_vehicle_that_has_forgotten_is_told_again() {
        for (digest, reason) in [(0, Reason::NotBegun), (message(7).digest, Reason::DigestMismatch)] {
            let mut upload = upload();
            upload.reply(&staging(ALL_ITEMS));
            let state = UploadState::Refused;
            let refused = UploadReply { set_id: 7, state, received_mask: 0, digest, reason };
            assert_eq!(upload.reply(&refused), Outcome::Going);
            assert_eq!(round(&mut upload, 40).len(), 3);
        }
    }

    #[test]
    fn only_the_right_digest_ends_it() {
        let mut upload = upload();
        let committed = UploadReply { state: UploadState::Committed, ..staging(ALL_ITEMS) };
        assert_eq!(upload.reply(&UploadReply { digest: 5, ..committed }), Outcome::Going);
        assert_eq!(upload.reply(&UploadReply { set_id: 6, ..committed }), Outcome::Going);
        assert_eq!(upload.reply(&committed), Outcome::Committed);
        let refused =
            UploadReply { state: UploadState::Refused, reason: Reason::OutsideLimits, ..staging(ALL_ITEMS) };
        assert_eq!(upload.reply(&refused), Outcome::Refused(Reason::OutsideLimits));
    }

    #[test]
    fn a_wrong_digest_goes_nowhere() {
        let wrong = ManeuverUpload { digest: 1, ..message(7) };
        let refused = Upload::new(Time::ZERO, &wrong, Span::from_millis(40), Span::from_secs(2));
        assert_eq!(refused.err(), Some(WrongDigest { computed: message(7).digest }));
    }
}
