//! The bus as a network: a small delay by nature, and every fault on request.

use std::collections::BTreeSet;
use std::rc::Rc;

use plant::random::Stream;
use quantity::Span;

/// What the network does to datagrams. The default is a quiet loopback: a short delay that varies a little.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkFaults {
    /// Delay of every delivery.
    pub delay: Span,
    /// Further delay, evenly distributed from zero to this.
    pub jitter: Span,
    /// Chance that a delivery does not happen.
    pub loss_ratio: f64,
    /// Chance that a delivery happens twice.
    pub duplicate_ratio: f64,
    /// Chance that a delivery is held back by `reorder_delay`.
    pub reorder_ratio: f64,
    /// How long deliveries are held back.
    pub reorder_delay: Span,
    /// Chance that one bit of a delivery is flipped.
    pub corruption_ratio: f64,
    /// Pairs (from, to) of service names between which nothing is delivered.
    pub partitions: BTreeSet<(String, String)>,
}

impl Default for NetworkFaults {
    fn default() -> Self {
        Self {
            delay: Span::from_micros(40),
            jitter: Span::from_micros(60),
            loss_ratio: 0.0,
            duplicate_ratio: 0.0,
            reorder_ratio: 0.0,
            reorder_delay: Span::from_millis(5),
            corruption_ratio: 0.0,
            partitions: BTreeSet::new(),
        }
    }
}

impl NetworkFaults {
    /// The deliveries of one datagram to one receiver: each a delay and the bytes that arrive.
    pub(crate) fn deliveries(
        &self,
        from: &str,
        to: &str,
        bytes: &Rc<[u8]>,
        random: &mut Stream,
        mut deliver: impl FnMut(Span, Rc<[u8]>),
    ) {
        let mut delay =
            self.delay + Span::from_nanos((self.jitter.as_nanos() as f64 * random.uniform()) as i64);
        if !self.is_bad() {
            deliver(delay, Rc::clone(bytes));
            return;
        }
        let cut = !self.partitions.is_empty() && self.partitions.contains(&(from.to_owned(), to.to_owned()));
        if cut || random.chance(self.loss_ratio) {
            return;
        }
        if random.chance(self.reorder_ratio) {
            delay = delay + self.reorder_delay;
        }
        let copies = if random.chance(self.duplicate_ratio) { 2 } else { 1 };
        for _ in 0..copies {
            let arriving = if random.chance(self.corruption_ratio) {
                let mut flipped = bytes.to_vec();
                let bit = (random.uniform() * (flipped.len() * 8) as f64) as usize;
                flipped[bit / 8] ^= 1 << (bit % 8);
                Rc::from(flipped)
            } else {
                Rc::clone(bytes)
            };
            deliver(delay, arriving);
            delay = delay + self.delay;
        }
    }

    fn is_bad(&self) -> bool {
        self.loss_ratio > 0.0
            || self.duplicate_ratio > 0.0
            || self.reorder_ratio > 0.0
            || self.corruption_ratio > 0.0
            || !self.partitions.is_empty()
    }
}
