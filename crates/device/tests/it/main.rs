//! The protocols against independent implementations of them, and against bytes of no protocol at all.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

mod crsf;
mod mavlink;
mod natnet;
mod natnet_descriptions;
mod page;
mod random;
mod robustness;
mod sbus;
mod shapes;
