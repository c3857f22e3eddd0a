//! The bus: who hears what, and what is on its way.

use std::collections::BTreeMap;
use std::rc::Rc;

use plant::random::Stream;
use quantity::Time;
use schemas::Topic;
use service_core::Published;

use crate::network::NetworkFaults;
use crate::queue::Queue;

/// Something that arrives.
#[derive(Clone, Debug)]
pub(crate) enum Arrival {
    /// A datagram at the node of that index.
    Datagram { node: usize, bytes: Rc<[u8]> },
    /// The end of a node's pause.
    Resume { node: usize },
}

/// The network between the nodes, which are numbered in the order they are started.
#[derive(Debug)]
pub(crate) struct Bus {
    names: Vec<String>,
    subscribers: BTreeMap<u32, Vec<usize>>,
    queue: Queue<Arrival>,
    faults: NetworkFaults,
    random: Stream,
}

impl Bus {
    pub(crate) fn new(names: &[&str], random: Stream) -> Self {
        Self {
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            subscribers: BTreeMap::new(),
            queue: Queue::default(),
            faults: NetworkFaults::default(),
            random,
        }
    }

    pub(crate) fn faults_mut(&mut self) -> &mut NetworkFaults {
        &mut self.faults
    }

    /// From now on a node hears these topics, but not what it writes itself: those are its devices' bytes.
    pub(crate) fn subscribe(&mut self, node: usize, name: &str, topics: &[&'static Topic]) {
        for topic in topics.iter().filter(|topic| topic.writer != name) {
            let list = self.subscribers.entry(topic.hash).or_default();
            // In the order of the nodes, whoever was restarted last.
            if let Err(place) = list.binary_search(&node) {
                list.insert(place, node);
            }
        }
    }

    /// Sends a message on its way to everyone who hears its topic. Definitions interest recorders only.
    pub(crate) fn carry(&mut self, now: Time, from: &str, published: &Published<'_>) {
        if !published.is_data() {
            return;
        }
        let Some(receivers) = self.subscribers.get(&published.topic.hash) else { return };
        let bytes: Rc<[u8]> = Rc::from(published.datagram);
        for &node in receivers {
            let Self { names, queue, faults, random, .. } = self;
            faults.deliveries(from, &names[node], &bytes, random, |delay, bytes| {
                queue.send(now + delay, Arrival::Datagram { node, bytes });
            });
        }
    }

    pub(crate) fn send(&mut self, at: Time, arrival: Arrival) {
        self.queue.send(at, arrival);
    }

    pub(crate) fn next_at(&self) -> Time {
        self.queue.next_at()
    }

    pub(crate) fn take(&mut self) -> Option<Arrival> {
        self.queue.take()
    }
}
