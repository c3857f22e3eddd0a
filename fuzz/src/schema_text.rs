//! libFuzzer's way into [`targets::schema_text`].

#![no_main]
#![allow(missing_docs, reason = "the macro writes an entry point for libFuzzer, nobody else")]

mod targets;

libfuzzer_sys::fuzz_target!(|input: &[u8]| targets::schema_text(input));
