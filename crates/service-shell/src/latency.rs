//! A node's share of the latency budget: how long its inputs were on their way, waited and were worked on.

use quantity::{Span, Time};
use reflect::{Seq, Text};
use schemas::{LatencyHop, NodeLatency, Topic};

/// How often a node's share is published.
const WINDOW: Span = Span::from_secs(1);
/// Kinds of input told apart; a core has fewer.
const HOPS_MAX: usize = 16;
/// Samples of one kind kept in a window; a flood's later ones are counted and not kept.
const SAMPLES_MAX: usize = 4096;
/// What the hop of the core's own deadlines is called.
const DEADLINE: &str = "deadline";

/// The instants of one input.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passage {
    /// When its sender published it; for a device's bytes, when they arrived.
    pub published_at: Time,
    /// When the kernel had it.
    pub arrived_at: Time,
    /// When the core was stepped with it.
    pub begun_at: Time,
    /// When everything said to it was handed to the kernel.
    pub done_at: Time,
}

#[derive(Debug)]
struct Hop {
    topic: &'static str,
    count: u32,
    transit_ns: Vec<u32>,
    wait_ns: Vec<u32>,
    work_ns: Vec<u32>,
}

/// What is measured in the running window.
#[derive(Debug)]
pub(crate) struct Latencies {
    began_at: Time,
    hops: Vec<Hop>,
}

impl Latencies {
    pub(crate) fn new(now: Time) -> Self {
        Self { began_at: now, hops: Vec::new() }
    }

    /// Notes a message or a device's bytes.
    pub(crate) fn note(&mut self, topic: &'static Topic, passage: Passage) {
        self.note_as(topic.name, passage);
    }

    /// Notes a deadline of the core's.
    pub(crate) fn note_deadline(&mut self, due_at: Time, begun_at: Time, done_at: Time) {
        self.note_as(DEADLINE, Passage { published_at: due_at, arrived_at: due_at, begun_at, done_at });
    }

    fn note_as(&mut self, topic: &'static str, passage: Passage) {
        let place = self.hops.iter().position(|hop| hop.topic == topic);
        let place = match place {
            Some(place) => place,
            None if self.hops.len() < HOPS_MAX => {
                self.hops.push(Hop {
                    topic,
                    count: 0,
                    transit_ns: Vec::new(),
                    wait_ns: Vec::new(),
                    work_ns: Vec::new(),
                });
                self.hops.len() - 1
            }
            None => return,
        };
        let hop = &mut self.hops[place];
        hop.count = hop.count.saturating_add(1);
        if hop.transit_ns.len() < SAMPLES_MAX {
            hop.transit_ns.push(nanos(passage.arrived_at - passage.published_at));
            hop.wait_ns.push(nanos(passage.begun_at - passage.arrived_at));
            hop.work_ns.push(nanos(passage.done_at - passage.begun_at));
        }
    }

    /// The window's account once it is over; then the next begins.
    pub(crate) fn take(&mut self, now: Time, node: &str) -> Option<NodeLatency> {
        let window = now - self.began_at;
        if window < WINDOW {
            return None;
        }
        self.began_at = now;
        let hops: Vec<LatencyHop> = self.hops.iter_mut().filter(|hop| hop.count > 0).map(Hop::take).collect();
        let hops = Seq::try_from(hops).expect("no more kinds are told apart");
        Some(NodeLatency { node: Text::truncated(node), window_ns: window.as_nanos() as u64, hops })
    }
}

impl Hop {
    fn take(&mut self) -> LatencyHop {
        let [transit_ns_p50, transit_ns_p99] = percentiles(&mut self.transit_ns);
        let [wait_ns_p50, wait_ns_p99] = percentiles(&mut self.wait_ns);
        let [work_ns_p50, work_ns_p99] = percentiles(&mut self.work_ns);
        LatencyHop {
            topic: Text::truncated(self.topic),
            count: std::mem::take(&mut self.count),
            transit_ns_p50,
            transit_ns_p99,
            wait_ns_p50,
            wait_ns_p99,
            work_ns_p50,
            work_ns_p99,
        }
    }
}

/// Median and 99th percentile; the samples are forgotten and their memory kept.
fn percentiles(samples: &mut Vec<u32>) -> [u32; 2] {
    samples.sort_unstable();
    let at = |percent: usize| samples.get(samples.len().saturating_sub(1) * percent / 100).copied();
    let found = [at(50).unwrap_or_default(), at(99).unwrap_or_default()];
    samples.clear();
    found
}

/// A span in 32 bits; one below zero, of two clocks that disagree, as zero.
fn nanos(span: Span) -> u32 {
    u32::try_from(span.as_nanos().max(0)).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use schemas::topics;

    use super::*;

    const BEGIN: Time = Time::from_nanos(1_000_000_000);

    fn at(nanos: i64) -> Time {
        BEGIN + Span::from_nanos(nanos)
    }

    #[test]
    fn each_kind_of_input_is_accounted_for_by_itself() {
        let mut latencies = Latencies::new(BEGIN);
        for index in 1..=100 {
            let passage = Passage {
                published_at: BEGIN,
                arrived_at: at(index),
                begun_at: at(11 * index),
                done_at: at(111 * index),
            };
            latencies.note(&topics::VEHICLE_STATE, passage);
        }
        latencies.note_deadline(at(5), at(7), at(10));
        assert_eq!(latencies.take(at(999_999_999), "estimator"), None, "the window is not over");
        let account = latencies.take(at(1_000_000_000), "estimator").unwrap();
        assert_eq!((account.node.as_str(), account.window_ns), ("estimator", 1_000_000_000));
        let [state, deadline] = &account.hops[..] else { panic!("{:?}", account.hops) };
        assert_eq!((state.topic.as_str(), state.count), ("vehicle/state", 100));
        assert_eq!((state.transit_ns_p50, state.transit_ns_p99), (50, 99));
        assert_eq!((state.wait_ns_p50, state.wait_ns_p99), (500, 990));
        assert_eq!((state.work_ns_p50, state.work_ns_p99), (5000, 9900));
        assert_eq!((deadline.topic.as_str(), deadline.wait_ns_p50, deadline.work_ns_p50), ("deadline", 2, 3));
        let next = latencies.take(at(2_000_000_000), "estimator").unwrap();
        assert!(next.hops.is_empty(), "what was told is forgotten");
    }

    #[test]
    fn a_flood_is_counted_and_clocks_that_disagree_do_no_harm() {
        let mut latencies = Latencies::new(BEGIN);
        for _ in 0..10_000 {
            let passage = Passage { published_at: at(9), arrived_at: at(3), begun_at: at(4), done_at: at(5) };
            latencies.note(&topics::VEHICLE_STATE, passage);
        }
        let account = latencies.take(at(1_500_000_000), "estimator").unwrap();
        assert_eq!((account.hops[0].count, account.hops[0].transit_ns_p99), (10_000, 0));
    }
}
