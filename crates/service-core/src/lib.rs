//! What a service is: a [`Core`] without I/O, and the [`Node`] that puts it on the bus.
//!
//! A core sees decoded messages and an explicit `now`. Its node authenticates and decodes what comes, numbers,
//! encodes and seals what goes, and counts everything it drops. Neither owns a clock or a socket: a *driver* does
//! (`service-shell` live, `virtual-arena` in virtual time).

mod core;
mod journal;
mod node;
mod observer;
mod ports;
mod publisher;
mod sections;
mod stepper;

pub use crate::core::{Core, Event, Inbound, Outbound, Outbox, Seed, Start};
pub use node::{AnyNode, Identity, Node, Published, QUEUE_AGE_MAX, Sink};
pub use observer::{Announced, Observed, Observer};
pub use publisher::{Publisher, SayError, source_of};
#[doc(hidden)]
pub use schemas::Topic;
pub use sections::check_sections;
pub use stepper::{AnyCore, Said, Say, Stepper};
#[doc(hidden)]
pub use wire::{DecodeError, EncodeError, decode, encode};
