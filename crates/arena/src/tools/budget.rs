//! The latency budget: where the time goes from the cameras' datagram to the radio's frame.
//!
//! Each radio slot says what its command rests on: when the newest motion-capture frame behind it reached the host,
//! when the command had reached the bridge, when the slot was due and when it was served. The *way* of a command is
//! from that frame to the bridge, plus what the slot was late; the wait for the slot between the two is the radio's
//! 50 Hz and nobody's latency. Each node adds its own share, hop by hop (`node/latency`).

use std::collections::BTreeMap;

use quantity::{Span, Time};
use schemas::{CommandSent, LatencyHop, NodeLatency};
use serde::Serialize;

/// Commands and windows of a node that figures are of; older ones are forgotten.
const SAMPLES_MAX: usize = 1 << 20;

/// What was heard of where the time goes.
#[derive(Clone, Debug, Default)]
pub struct Budget {
    ways: Vec<Span>,
    waits: Vec<Span>,
    lateness: Vec<Span>,
    hops: BTreeMap<(String, String), Vec<LatencyHop>>,
}

/// A median and a 99th percentile, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    /// The median.
    pub p50_ms: f64,
    /// The 99th percentile.
    pub p99_ms: f64,
}

/// One kind of input at one node; medians over its windows of a second each.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HopFigures {
    /// The node.
    pub node: String,
    /// The topic; `deadline` for the node's own.
    pub topic: String,
    /// Inputs a second.
    pub rate_hz: f64,
    /// From the sender to the kernel.
    pub transit: Percentiles,
    /// From there to the step of the core.
    pub wait: Percentiles,
    /// From there until everything said to it was handed to the kernel.
    pub work: Percentiles,
}

/// The budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Radio frames that the figures are of.
    pub commands: usize,
    /// From the motion-capture datagram to the radio frame, beyond the wait for the slot.
    pub way: Option<Percentiles>,
    /// The wait for the slot.
    pub slot_wait: Option<Percentiles>,
    /// How late slots began.
    pub slot_lateness: Option<Percentiles>,
    /// Hop by hop, in the order of nodes and topics.
    pub hops: Vec<HopFigures>,
}

impl Budget {
    /// Takes what a slot carried. One whose command rests on no motion-capture frame says nothing.
    pub fn take_slot(&mut self, sent: &CommandSent) {
        if sent.frame_received_at == Time::ZERO || self.ways.len() == SAMPLES_MAX {
            return;
        }
        let late = sent.sent_at - sent.slot_at;
        self.ways.push((sent.commanded_at - sent.frame_received_at) + late);
        self.waits.push(sent.slot_at - sent.commanded_at);
        self.lateness.push(late);
    }

    /// Takes a node's share.
    pub fn take_share(&mut self, share: &NodeLatency) {
        for hop in share.hops.iter() {
            let key = (share.node.as_str().to_owned(), hop.topic.as_str().to_owned());
            let windows = self.hops.entry(key).or_default();
            if windows.len() < SAMPLES_MAX {
                windows.push(*hop);
            }
        }
    }

    /// What it comes to.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let hops = self.hops.iter().map(|((node, topic), windows)| {
            let typical = |of: fn(&LatencyHop) -> u32| {
                let spans: Vec<Span> =
                    windows.iter().map(|hop| Span::from_nanos(i64::from(of(hop)))).collect();
                percentile_ms(&spans, 50).unwrap_or_default()
            };
            let both = |p50, p99| Percentiles { p50_ms: typical(p50), p99_ms: typical(p99) };
            HopFigures {
                node: node.clone(),
                topic: topic.clone(),
                rate_hz: windows.iter().map(|hop| f64::from(hop.count)).sum::<f64>() / windows.len() as f64,
                transit: both(|hop| hop.transit_ns_p50, |hop| hop.transit_ns_p99),
                wait: both(|hop| hop.wait_ns_p50, |hop| hop.wait_ns_p99),
                work: both(|hop| hop.work_ns_p50, |hop| hop.work_ns_p99),
            }
        });
        Figures {
            commands: self.ways.len(),
            way: percentiles(&self.ways),
            slot_wait: percentiles(&self.waits),
            slot_lateness: percentiles(&self.lateness),
            hops: hops.collect(),
        }
    }
}

/// Median and 99th percentile of these; `None` of none.
#[must_use]
pub fn percentiles(spans: &[Span]) -> Option<Percentiles> {
    Some(Percentiles { p50_ms: percentile_ms(spans, 50)?, p99_ms: percentile_ms(spans, 99)? })
}

fn percentile_ms(spans: &[Span], percent: usize) -> Option<f64> {
    let mut sorted = spans.to_vec();
    sorted.sort_unstable();
    let found = sorted.get(sorted.len().saturating_sub(1) * percent / 100)?;
    Some(found.as_nanos() as f64 * 1e-6)
}

impl Figures {
    /// As a table to read.
    #[must_use]
    pub fn table(&self) -> String {
        let line = |name: &str, figures: Option<Percentiles>| match figures {
            None => format!("{name:<46} no radio frame was heard\n"),
            Some(Percentiles { p50_ms, p99_ms }) => format!("{name:<46} {p50_ms:8.3} {p99_ms:8.3}\n"),
        };
        let mut text =
            format!("{:<46} {:>8} {:>8}   of {} radio frames\n", "ms", "p50", "p99", self.commands);
        text += &line("cameras' datagram to radio frame, slot apart", self.way);
        text += &line("wait for the slot", self.slot_wait);
        text += &line("lateness of the slot", self.slot_lateness);
        text += &format!(
            "\n{:<17} {:<20} {:>8}  {:^15} {:^15} {:^15}\n",
            "node", "input", "Hz", "transit", "wait", "work"
        );
        for hop in &self.hops {
            let pair = |figures: Percentiles| format!("{:7.3} {:7.3}", figures.p50_ms, figures.p99_ms);
            let (transit, wait, work) = (pair(hop.transit), pair(hop.wait), pair(hop.work));
            text +=
                &format!("{:<17} {:<20} {:8.1}  {transit} {wait} {work}\n", hop.node, hop.topic, hop.rate_hz);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use reflect::{Seq, Text};

    use super::*;

    fn us(microseconds: i64) -> Time {
        Time::ZERO + Span::from_secs(1) + Span::from_micros(microseconds)
    }

    #[test]
    fn the_wait_for_the_slot_is_no_part_of_the_way() {
        let mut budget = Budget::default();
        for index in 0..=100 {
            budget.take_slot(&CommandSent {
                frame_received_at: us(0),
                commanded_at: us(300 + index),
                slot_at: us(5_000),
                sent_at: us(5_020),
                ..CommandSent::default()
            });
        }
        // A vehicle that the cameras have not seen yet is commanded too.
        budget.take_slot(&CommandSent { sent_at: us(9_000), ..CommandSent::default() });
        let figures = budget.figures();
        assert_eq!(figures.commands, 101);
        let near = |found: Option<Percentiles>, p50: f64, p99: f64| {
            let found = found.unwrap();
            (found.p50_ms - p50).abs() < 1e-9 && (found.p99_ms - p99).abs() < 1e-9
        };
        assert!(near(figures.way, 0.370, 0.419), "{figures:?}");
        assert!(near(figures.slot_wait, 4.650, 4.699), "{figures:?}");
        assert!(near(figures.slot_lateness, 0.020, 0.020), "{figures:?}");
    }

    #[test]
    fn shares_are_those_of_each_node_and_input() {
        let mut budget = Budget::default();
        for window in [1, 2, 30] {
            let hop = LatencyHop {
                topic: Text::truncated("mocap/frame"),
                count: 200,
                work_ns_p50: window * 1_000_000,
                ..LatencyHop::default()
            };
            let hops = Seq::try_from(vec![hop]).unwrap();
            budget.take_share(&NodeLatency {
                node: Text::truncated("estimator"),
                window_ns: 1_000_000_000,
                hops,
            });
        }
        let figures = budget.figures();
        assert_eq!((figures.way, figures.hops.len()), (None, 1));
        assert_eq!((figures.hops[0].rate_hz, figures.hops[0].work.p50_ms), (200.0, 2.0));
        assert!(figures.table().contains("no radio frame was heard"));
    }
}
