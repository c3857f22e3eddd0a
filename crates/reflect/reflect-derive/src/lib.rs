//! The derive macros of `reflect`; their documentation for users is there.

mod common;
mod enumeration;
mod message;

use proc_macro::TokenStream;
use syn::{DeriveInput, parse_macro_input};

/// Derives `reflect::Message` for a struct with named fields.
///
/// Needs `#[message(name = "package/Type")]`, a doc comment on the struct and on every field, and field types
/// with a form on the wire; a float, or a vector, needs a known unit at the end of its name.
#[proc_macro_derive(Message, attributes(message))]
pub fn derive_message(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    message::expand(&input).unwrap_or_else(|error| error.into_compile_error()).into()
}

/// Derives `reflect::Enumeration`, and serde's traits by value, for a field-less enum with explicit values.
///
/// Needs `#[repr(u8)]` or `#[repr(u32)]`, a value for every variant, and a doc comment on the enum and every
/// variant.
#[proc_macro_derive(Enumeration)]
pub fn derive_enumeration(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    enumeration::expand(&input).unwrap_or_else(|error| error.into_compile_error()).into()
}
