//! Where the time goes between the stations of a message's way.

use reflect::{Message, Seq, Text};
use serde::{Deserialize, Serialize};

/// What one kind of input took at a node during the window; medians and 99th percentiles.
///
/// From the sender's publish time the datagram is in *transit* until the kernel has it, *waits* until the node's core is
/// stepped with it, and is *work* until everything said to it is handed to the kernel. For a deadline, *wait* is how late
/// it was met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/LatencyHop")]
pub struct LatencyHop {
    /// The topic; `deadline` for the core's own.
    pub topic: Text<64>,
    /// Inputs of this kind in the window.
    pub count: u32,
    /// Transit, median.
    pub transit_ns_p50: u32,
    /// Transit, 99th percentile.
    pub transit_ns_p99: u32,
    /// Wait, median.
    pub wait_ns_p50: u32,
    /// Wait, 99th percentile.
    pub wait_ns_p99: u32,
    /// Work, median.
    pub work_ns_p50: u32,
    /// Work, 99th percentile.
    pub work_ns_p99: u32,
}

/// A live node's share of the latency budget, once a second.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/NodeLatency")]
pub struct NodeLatency {
    /// The node.
    pub node: Text<24>,
    /// Length of the window.
    pub window_ns: u64,
    /// One for each kind of input that came.
    pub hops: Seq<LatencyHop, 16>,
}
