//! The arena in virtual time: the real cores, the real bytes, the simulated plant, and a network that can be made bad.
//!
//! [`VirtualArena`] owns the only clock. It steps whoever is due next: the plant, a datagram on its way, or a node
//! whose deadline has come; where two are due at one instant, in that order and then in the order they were sent. The
//! same seed therefore gives the same datagrams in the same order, and [`VirtualArena::digest`] is the proof.

mod arena;
mod bus;
mod network;
mod queue;

pub use arena::{Heard, NodeFactory, VirtualArena};
pub use network::NetworkFaults;
