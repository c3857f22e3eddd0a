//! Visiting messages on all cores: each collects from some of the chunks, and what they collected is joined
//! in order.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::error::ReadError;
use super::group::{Group, Plan};
use super::messages::{Message, endings};
use super::recording::Recording;
use crate::select::Selection;

/// What a worker may have collected before it waits for it to be joined.
const COLLECTED_AHEAD: usize = 4;
/// More workers than this read no faster from one disk.
const WORKERS_MAX: usize = 8;

impl Recording {
    /// Visits the selected messages on all cores. Chunks that do not overlap in time go to different cores;
    /// for each such stretch of time `begin` makes a collection, `each` adds to it, message after message in
    /// order of time, and `join` gets the collections in order of time, on the caller's thread. Where `join`
    /// breaks, the visit ends.
    ///
    /// `join` gets an error for each chunk that is damaged, at its place; what the chunk's stretch held
    /// besides is in the collection that comes next.
    pub fn visit<C: Send>(
        &self,
        selection: &Selection,
        begin: impl Fn() -> C + Sync,
        each: impl Fn(&mut C, Message<'_>) + Sync,
        mut join: impl FnMut(Result<C, ReadError>) -> ControlFlow<()>,
    ) {
        let plan = Plan::new(self, selection);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let workers = cores.min(WORKERS_MAX).min(plan.groups().len());
        let collect = |group: &Group| self.collect(&plan, group, &begin, &each);
        let broken = if workers <= 1 {
            plan.groups().iter().map(collect).any(|collected| hand_over(collected, &mut join).is_break())
        } else {
            std::thread::scope(|scope| {
                let mut receivers = Vec::with_capacity(workers);
                for worker in 0..workers {
                    let (sender, receiver) = sync_channel(COLLECTED_AHEAD);
                    let groups = plan.groups().iter().skip(worker).step_by(workers);
                    let collect = &collect;
                    scope.spawn(move || send_all(groups.map(collect), &sender));
                    receivers.push(receiver);
                }
                // The receivers are dropped before the scope waits for the workers, which ends those still at
                // work.
                join_all(&receivers, plan.groups().len(), &mut join)
            })
        };
        if !broken {
            let _ = hand_over(Collected { damage: endings(self), collection: None }, &mut join);
        }
    }

    fn collect<C>(
        &self,
        plan: &Plan,
        group: &Group,
        begin: &impl Fn() -> C,
        each: &impl Fn(&mut C, Message<'_>),
    ) -> Collected<C> {
        let mut collected = Collected { damage: Vec::new(), collection: None };
        let mut collection = begin();
        let mut merge = plan.merge(group);
        while let Some(message) = merge.next(self, plan) {
            match message {
                Ok(message) => each(&mut collection, message),
                Err(error) => collected.damage.push(error),
            }
        }
        collected.collection = Some(collection);
        collected
    }
}

struct Collected<C> {
    damage: Vec<ReadError>,
    collection: Option<C>,
}

fn send_all<C>(collected: impl Iterator<Item = Collected<C>>, sender: &SyncSender<Collected<C>>) {
    for collected in collected {
        if sender.send(collected).is_err() {
            return;
        }
    }
}

/// Takes from the workers in turn, as the work was dealt out. Whether the caller broke off, or a worker died.
fn join_all<C>(
    receivers: &[Receiver<Collected<C>>],
    groups: usize,
    join: &mut impl FnMut(Result<C, ReadError>) -> ControlFlow<()>,
) -> bool {
    (0..groups).any(|group| match receivers[group % receivers.len()].recv() {
        Ok(collected) => hand_over(collected, join).is_break(),
        Err(_) => true,
    })
}

fn hand_over<C>(
    collected: Collected<C>,
    join: &mut impl FnMut(Result<C, ReadError>) -> ControlFlow<()>,
) -> ControlFlow<()> {
    collected.damage.into_iter().try_for_each(|error| join(Err(error)))?;
    collected.collection.map_or(ControlFlow::Continue(()), |collection| join(Ok(collection)))
}
