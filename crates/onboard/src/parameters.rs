//! The parameter store: one active set, one being received beside it.
//!
//! A set becomes active whole or not at all: announced with its length and digest, received in any order and
//! as often as it takes, and swapped in by a commit once it is complete, its digest comes out, the vehicle's
//! limits admit it and no maneuver runs. Whatever is lost, repeated, overtaken or damaged on the way, the
//! active set is one that was committed.

use device::vehicle_link::{Items, Reason, SET_LEN_MAX, UploadReply, UploadState, digest_of};

/// A set in the store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StoredSet {
    /// Identity, never zero.
    pub id: u16,
    /// Digest over the items, as computed here.
    pub digest: u64,
    count: u8,
    items: [f32; SET_LEN_MAX],
}

impl StoredSet {
    /// The items.
    pub fn items(&self) -> &[f32] {
        self.items.get(..usize::from(self.count)).unwrap_or(&[])
    }
}

/// A set being received.
#[derive(Clone, Copy, Debug)]
struct Staging {
    id: u16,
    count: u8,
    digest: u64,
    received_mask: u32,
    items: [f32; SET_LEN_MAX],
    /// Set when a commit was refused for what the items are; only a new announcement helps then.
    refused: Reason,
}

impl Staging {
    fn is_complete(&self) -> bool {
        self.received_mask.count_ones() == u32::from(self.count)
    }

    fn reply(&self, reason: Reason) -> UploadReply {
        let (state, reason) = match self.refused {
            Reason::None => (UploadState::Staging, reason),
            refused => (UploadState::Refused, refused),
        };
        UploadReply { set_id: self.id, state, received_mask: self.received_mask, digest: self.digest, reason }
    }
}

/// The store.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ParameterStore {
    active: Option<StoredSet>,
    staging: Option<Staging>,
}

impl ParameterStore {
    /// The active set.
    pub const fn active(&self) -> Option<&StoredSet> {
        self.active.as_ref()
    }

    /// A set is announced. Announcing again what is being received, or is active already, changes nothing.
    pub fn begin(&mut self, id: u16, count: u8, digest: u64) -> UploadReply {
        if id == 0 || count == 0 || usize::from(count) > SET_LEN_MAX {
            return refusal(id, digest, Reason::OutsideLimits);
        }
        if let Some(reply) = self.already_active(id, digest) {
            return reply;
        }
        match &self.staging {
            Some(staging)
                if (staging.id, staging.count, staging.digest) == (id, count, digest)
                    && staging.refused == Reason::None => {}
            _ => {
                let (received_mask, items, refused) = (0, [0.0; SET_LEN_MAX], Reason::None);
                self.staging = Some(Staging { id, count, digest, received_mask, items, refused });
            }
        }
        self.staging_reply(id, digest, Reason::None)
    }

    /// Some items arrive; those of another set than the one announced, or beyond its end, are dropped.
    pub fn items(&mut self, items: &Items) -> UploadReply {
        if let Some(staging) = self.staging_of(items.set_id) {
            let first = usize::from(items.first_index);
            for (offset, value) in items.values().iter().enumerate() {
                let index = first + offset;
                if index < usize::from(staging.count) {
                    staging.items[index] = *value;
                    staging.received_mask |= 1 << index;
                }
            }
            return staging.reply(Reason::None);
        }
        match &self.active {
            Some(active) if active.id == items.set_id => committed(active),
            _ => refusal(items.set_id, 0, Reason::NotBegun),
        }
    }

    /// The set shall become active. `admits` judges its items; `busy` says that a maneuver runs.
    pub fn commit(
        &mut self,
        id: u16,
        digest: u64,
        busy: bool,
        admits: impl FnOnce(&[f32]) -> bool,
    ) -> UploadReply {
        if let Some(reply) = self.already_active(id, digest) {
            return reply;
        }
        let Some(staging) = self.staging_of(id) else {
            return refusal(id, digest, Reason::NotBegun);
        };
        if staging.refused != Reason::None || !staging.is_complete() {
            return staging.reply(Reason::None);
        }
        if busy {
            return staging.reply(Reason::Busy);
        }
        let received = staging.items.get(..usize::from(staging.count)).unwrap_or(&[]);
        let computed = digest_of(received);
        if staging.digest != digest || computed != digest {
            staging.refused = Reason::DigestMismatch;
        } else if !admits(received) {
            staging.refused = Reason::OutsideLimits;
        } else {
            let set = StoredSet { id, digest: computed, count: staging.count, items: staging.items };
            self.active = Some(set);
            self.staging = None;
            return committed(&set);
        }
        staging.reply(Reason::None)
    }

    fn already_active(&self, id: u16, digest: u64) -> Option<UploadReply> {
        self.active.as_ref().filter(|active| (active.id, active.digest) == (id, digest)).map(committed)
    }

    fn staging_of(&mut self, id: u16) -> Option<&mut Staging> {
        self.staging.as_mut().filter(|staging| staging.id == id)
    }

    fn staging_reply(&self, id: u16, digest: u64, reason: Reason) -> UploadReply {
        self.staging.as_ref().map_or(refusal(id, digest, Reason::NotBegun), |staging| staging.reply(reason))
    }
}

fn committed(set: &StoredSet) -> UploadReply {
    let received_mask = u32::MAX >> (32 - u32::from(set.count));
    let (state, reason) = (UploadState::Committed, Reason::None);
    UploadReply { set_id: set.id, state, received_mask, digest: set.digest, reason }
}

const fn refusal(set_id: u16, digest: u64, reason: Reason) -> UploadReply {
    UploadReply { set_id, state: UploadState::Refused, received_mask: 0, digest, reason }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn items(id: u16, first: u8, values: &[f32]) -> Items {
        Items::new(id, first, values).unwrap()
    }

    fn any_set(_: &[f32]) -> bool {
        true
    }

    #[test]
    fn a_set_arrives_in_pieces_and_is_swapped_in_at_the_end() {
        let values = [1.0, 2.0, 3.0];
        let digest = digest_of(&values);
        let mut store = ParameterStore::default();
        assert_eq!(store.begin(5, 3, digest).state, UploadState::Staging);
        assert_eq!(store.items(&items(5, 2, &values[2..])).received_mask, 0b100);
        let reply = store.commit(5, digest, false, any_set);
        assert_eq!((reply.state, reply.received_mask), (UploadState::Staging, 0b100));
        assert!(store.active().is_none());
        store.begin(5, 3, digest);
        assert_eq!(store.items(&items(5, 0, &values[..2])).received_mask, 0b111);
        let reply = store.commit(5, digest, true, any_set);
        assert_eq!((reply.state, reply.reason), (UploadState::Staging, Reason::Busy));
        let reply = store.commit(5, digest, false, any_set);
        assert_eq!((reply.state, reply.digest, reply.received_mask), (UploadState::Committed, digest, 0b111));
        assert_eq!(store.active().unwrap().items(), values);
        // The acknowledgement was lost: whatever is repeated is answered the same.
        assert_eq!(store.commit(5, digest, false, any_set), reply);
        assert_eq!(store.begin(5, 3, digest), reply);
        assert_eq!(store.items(&items(5, 0, &[9.0])), reply);
        assert_eq!(store.active().unwrap().items(), values);
    }

    #[test]
    fn a_set_that_is_not_what_was_announced_leaves_the_active_one() {
        let (good, other) = ([1.0, 2.0], [1.0, 2.5]);
        let mut store = ParameterStore::default();
        store.begin(1, 2, digest_of(&good));
        store.items(&items(1, 0, &good));
        store.commit(1, digest_of(&good), false, any_set);

        store.begin(2, 2, digest_of(&other));
        store.items(&items(2, 0, &good));
        let reply = store.commit(2, digest_of(&other), false, any_set);
        assert_eq!((reply.state, reply.reason), (UploadState::Refused, Reason::DigestMismatch));
        assert_eq!(store.commit(2, digest_of(&other), false, any_set), reply);
        assert_eq!(store.active().unwrap().id, 1);

        // Announced again, it starts afresh; the limits have their say too.
        assert_eq!(store.begin(2, 2, digest_of(&other)).received_mask, 0);
        store.items(&items(2, 0, &other));
        let reply = store.commit(2, digest_of(&other), false, |_| false);
        assert_eq!((reply.state, reply.reason), (UploadState::Refused, Reason::OutsideLimits));
        assert_eq!(store.active().unwrap().id, 1);
    }

    #[test]
    fn what_was_never_announced_is_said_so() {
        let mut store = ParameterStore::default();
        assert_eq!(store.commit(3, 9, false, any_set).reason, Reason::NotBegun);
        assert_eq!(store.items(&items(3, 0, &[1.0])).reason, Reason::NotBegun);
        assert_eq!(store.begin(0, 3, 9).state, UploadState::Refused);
        // Late items of an earlier set do not spoil the one announced since.
        store.begin(4, 1, digest_of(&[4.0]));
        store.items(&items(4, 0, &[4.0]));
        store.items(&items(3, 0, &[3.0]));
        assert_eq!(store.commit(4, digest_of(&[4.0]), false, any_set).state, UploadState::Committed);
    }

    /// What may happen to the messages of several uploads on their way.
    #[derive(Clone, Debug)]
    enum Event {
        Begin(usize),
        Item { set: usize, index: u8, damaged: bool },
        Commit { set: usize, wrong_digest: bool },
        Busy(bool),
    }

    fn any_event() -> impl Strategy<Value = Event> {
        prop_oneof![
            2 => (0usize..3).prop_map(Event::Begin),
            12 => (0usize..3, 0u8..5, prop::bool::weighted(0.1))
                .prop_map(|(set, index, damaged)| Event::Item { set, index, damaged }),
            3 => (0usize..3, prop::bool::weighted(0.2))
                .prop_map(|(set, wrong_digest)| Event::Commit { set, wrong_digest }),
            1 => any::<bool>().prop_map(Event::Busy),
        ]
    }

    const SETS: [[f32; 4]; 3] = [[1.0, 2.0, 3.0, 4.0], [1.5, 2.5, 3.5, 4.5], [9.0, 2.0, 3.0, 4.0]];

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        #[test]
        fn whatever_happens_on_the_way_the_active_set_is_one_that_was_committed(
            events in prop::collection::vec(any_event(), 0..120),
        ) {
            let mut store = ParameterStore::default();
            let mut busy = false;
            for event in events {
                let before = store.active;
                match event {
                    Event::Begin(set) => {
                        store.begin(set as u16 + 1, 4, digest_of(&SETS[set]));
                    }
                    Event::Item { set, index, damaged } => {
                        let value = SETS[set].get(usize::from(index)).copied().unwrap_or(7.0);
                        let value = if damaged { -value } else { value };
                        store.items(&items(set as u16 + 1, index, &[value]));
                    }
                    Event::Commit { set, wrong_digest } => {
                        let digest = digest_of(&SETS[set]) ^ u64::from(wrong_digest);
                        store.commit(set as u16 + 1, digest, busy, any_set);
                        if busy || wrong_digest {
                            prop_assert_eq!(store.active, before);
                        }
                    }
                    Event::Busy(now) => busy = now,
                }
                if let Some(active) = store.active() {
                    let set = SETS[usize::from(active.id) - 1];
                    prop_assert_eq!(active.items(), set);
                    prop_assert_eq!(active.digest, digest_of(&set));
                }
            }
        }

        #[test]
        fn any_order_with_repeats_and_losses_ends_committed_once_everything_was_seen(
            order in prop::collection::vec(0usize..6, 0..60),
        ) {
            let (set, id) = (SETS[0], 7);
            let digest = digest_of(&set);
            let mut store = ParameterStore::default();
            let mut state = UploadState::Staging;
            // Whatever the radio did first, a sender that repeats what the mask says is missing gets there.
            for step in order.into_iter().chain([0, 1, 2, 3, 4, 5]) {
                let reply = match step {
                    0 => store.begin(id, 4, digest),
                    5 => store.commit(id, digest, false, any_set),
                    item => store.items(&items(id, item as u8 - 1, &set[item - 1..item])),
                };
                state = reply.state;
            }
            prop_assert_eq!(state, UploadState::Committed);
            prop_assert_eq!(store.active().unwrap().items(), set);
        }
    }

    #[test]
    fn every_permutation_with_every_loss_keeps_the_store_whole() {
        // Begin, three items, commit: every order of every subset, after an earlier committed set.
        let (old, new) = ([5.0, 6.0], [1.0, 2.0, 3.0]);
        let (old_digest, new_digest) = (digest_of(&old), digest_of(&new));
        let mut orders: Vec<Vec<usize>> = std::vec![std::vec![]];
        let mut all = orders.clone();
        for _ in 0..5 {
            orders = orders
                .iter()
                .flat_map(|order| {
                    (0..5).filter(|step| !order.contains(step)).map(|step| {
                        let mut longer = order.clone();
                        longer.push(step);
                        longer
                    })
                })
                .collect();
            all.extend(orders.iter().cloned());
        }
        assert_eq!(all.len(), 326);
        for order in all {
            let mut store = ParameterStore::default();
            store.begin(1, 2, old_digest);
            store.items(&items(1, 0, &old));
            store.commit(1, old_digest, false, any_set);
            for step in &order {
                match step {
                    0 => store.begin(2, 3, new_digest),
                    4 => store.commit(2, new_digest, false, any_set),
                    item => store.items(&items(2, *item as u8 - 1, &new[item - 1..*item])),
                };
            }
            let complete = order.first() == Some(&0) && order.len() == 5 && order.last() == Some(&4);
            let expected: &[f32] = if complete { &new } else { &old };
            assert_eq!(store.active().unwrap().items(), expected, "{order:?}");
        }
    }
}
