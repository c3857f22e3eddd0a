//! libFuzzer's way into [`shapes::crtp_packet`].

#![no_main]
#![allow(missing_docs, reason = "the macro writes an entry point for libFuzzer, nobody else")]

#[path = "../../crates/device/tests/it/shapes.rs"]
#[allow(dead_code, reason = "each of the binaries uses one of them")]
mod shapes;

libfuzzer_sys::fuzz_target!(|input: &[u8]| shapes::crtp_packet(input));
