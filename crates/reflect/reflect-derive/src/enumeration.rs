//! `derive(Enumeration)`.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{Data, DeriveInput, Error, Expr, ExprLit, Fields, Ident, Lit, Result, Variant};

use crate::common;

struct Value<'a> {
    ident: &'a Ident,
    name: String,
    doc: String,
    value: u32,
}

pub fn expand(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Enum(data) = &input.data else {
        return Err(Error::new_spanned(&input.ident, "only an enum is an enumeration"));
    };
    common::refuse_generics(&input.generics)?;
    common::refuse_serde_attributes(&input.attrs)?;
    let doc = common::doc(&input.attrs, &input.ident, "an enumeration")?;
    let width = width(input)?;
    if data.variants.is_empty() {
        return Err(Error::new_spanned(&input.ident, "an enumeration has at least one value"));
    }
    let values = data.variants.iter().map(|variant| value(variant, width)).collect::<Result<Vec<_>>>()?;
    let traits = enumeration_impl(&input.ident, &doc, width, &values);
    let serde = serde_impl(&input.ident, width);
    Ok(quote! { #traits #serde })
}

fn width(input: &DeriveInput) -> Result<u8> {
    for attribute in input.attrs.iter().filter(|attribute| attribute.path().is_ident("repr")) {
        let repr: Ident = attribute.parse_args()?;
        if repr == "u8" {
            return Ok(1);
        }
        if repr == "u32" {
            return Ok(4);
        }
    }
    Err(Error::new_spanned(
        &input.ident,
        "an enumeration says its size on the wire: #[repr(u8)] or #[repr(u32)]",
    ))
}

fn value(variant: &Variant, width: u8) -> Result<Value<'_>> {
    if !matches!(variant.fields, Fields::Unit) {
        return Err(Error::new_spanned(variant, "a value of an enumeration carries no data"));
    }
    common::refuse_serde_attributes(&variant.attrs)?;
    let doc = common::doc(&variant.attrs, variant, "a value of an enumeration")?;
    let value = match &variant.discriminant {
        Some((_, Expr::Lit(ExprLit { lit: Lit::Int(literal), .. }))) => literal.base10_parse::<u32>()?,
        Some((_, other)) => {
            return Err(Error::new_spanned(other, "the value on the wire is a plain number"));
        }
        None => {
            return Err(Error::new_spanned(
                variant,
                "the value on the wire stands beside the name: `Name = 3`",
            ));
        }
    };
    if width == 1 && value > u32::from(u8::MAX) {
        return Err(Error::new_spanned(variant, "the value exceeds #[repr(u8)]"));
    }
    Ok(Value { ident: &variant.ident, name: common::upper_snake(&variant.ident.to_string()), doc, value })
}

fn enumeration_impl(ident: &Ident, doc: &str, width: u8, values: &[Value<'_>]) -> TokenStream {
    let text = ident.to_string();
    let idents: Vec<_> = values.iter().map(|value| value.ident).collect();
    let names: Vec<_> = values.iter().map(|value| &value.name).collect();
    let docs: Vec<_> = values.iter().map(|value| &value.doc).collect();
    let numbers: Vec<_> = values.iter().map(|value| value.value).collect();
    quote! {
        impl #ident {
            /// The value's name, upper case, as in the schema.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    #(Self::#idents => #names,)*
                }
            }
        }

        #[automatically_derived]
        impl ::reflect::Enumeration for #ident {
            const SCHEMA: &'static ::reflect::EnumSchema = &::reflect::EnumSchema {
                name: #text,
                doc: #doc,
                width: #width,
                constants: &[
                    #(::reflect::Constant { name: #names, doc: #docs, value: #numbers },)*
                ],
            };

            fn value(self) -> u32 {
                match self {
                    #(Self::#idents => #numbers,)*
                }
            }

            fn from_value(value: u32) -> ::core::option::Option<Self> {
                match value {
                    #(#numbers => ::core::option::Option::Some(Self::#idents),)*
                    _ => ::core::option::Option::None,
                }
            }
        }

        #[automatically_derived]
        impl ::reflect::FieldType for #ident {
            const KIND: ::reflect::Kind =
                ::reflect::Kind::Enumeration(<Self as ::reflect::Enumeration>::SCHEMA);
        }
    }
}

fn serde_impl(ident: &Ident, width: u8) -> TokenStream {
    let repr = if width == 1 { format_ident!("u8") } else { format_ident!("u32") };
    let serialize = format_ident!("serialize_{repr}");
    quote! {
        #[automatically_derived]
        impl ::reflect::private::serde::Serialize for #ident {
            fn serialize<S: ::reflect::private::serde::Serializer>(
                &self,
                serializer: S,
            ) -> ::core::result::Result<S::Ok, S::Error> {
                serializer.#serialize(::reflect::Enumeration::value(*self) as #repr)
            }
        }

        #[automatically_derived]
        impl<'de> ::reflect::private::serde::Deserialize<'de> for #ident {
            fn deserialize<D: ::reflect::private::serde::Deserializer<'de>>(
                deserializer: D,
            ) -> ::core::result::Result<Self, D::Error> {
                let value = <#repr as ::reflect::private::serde::Deserialize>::deserialize(deserializer)?;
                <Self as ::reflect::Enumeration>::from_value(u32::from(value)).ok_or_else(|| {
                    <D::Error as ::reflect::private::serde::de::Error>::custom(::core::format_args!(
                        "{value} is no value of {}",
                        <Self as ::reflect::Enumeration>::SCHEMA.name,
                    ))
                })
            }
        }
    }
}
