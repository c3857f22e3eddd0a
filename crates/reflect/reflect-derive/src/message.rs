//! `derive(Message)`.

use proc_macro2::TokenStream;
use quote::{quote, quote_spanned};
use syn::spanned::Spanned;
use syn::{Data, DeriveInput, Error, Fields, GenericArgument, Ident, LitStr, PathArguments, Result, Type};

use crate::common;

/// Words that a generator of Python or C++ from the definition would choke on.
const RESERVED: &[&str] = &[
    "and",
    "as",
    "assert",
    "async",
    "auto",
    "await",
    "bool",
    "break",
    "case",
    "catch",
    "char",
    "class",
    "const",
    "continue",
    "def",
    "default",
    "del",
    "delete",
    "do",
    "double",
    "elif",
    "else",
    "enum",
    "except",
    "explicit",
    "export",
    "extern",
    "false",
    "finally",
    "float",
    "for",
    "friend",
    "from",
    "global",
    "goto",
    "if",
    "import",
    "in",
    "inline",
    "int",
    "is",
    "lambda",
    "long",
    "namespace",
    "new",
    "nonlocal",
    "not",
    "operator",
    "or",
    "pass",
    "private",
    "protected",
    "public",
    "raise",
    "register",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "string",
    "struct",
    "switch",
    "template",
    "this",
    "throw",
    "time",
    "true",
    "try",
    "typedef",
    "typename",
    "union",
    "unsigned",
    "using",
    "virtual",
    "void",
    "volatile",
    "while",
    "with",
    "xor",
    "yield",
];

/// Types that are often reached for and have no form on the wire, with what to use instead.
const REFUSED: &[(&str, &str)] = &[
    (
        "Option",
        "has no form on the wire: say in the doc comment which value stands for none, or use an enumeration",
    ),
    ("usize", "differs between machines: use u32 or u64"),
    ("isize", "differs between machines: use i32 or i64"),
    ("u128", "has no ROS 1 type: use [u8; 16]"),
    ("i128", "has no ROS 1 type: use [u8; 16]"),
    ("char", "has no ROS 1 type: use Text"),
    ("str", "has no bound: use Text<N>"),
    ("String", "has no bound: use Text<N>"),
    ("Vec", "has no bound: use Seq<T, N>"),
    ("Box", "has no form on the wire"),
    ("HashMap", "has no order: use a Seq of a message with key and value"),
    ("HashSet", "has no order: use Seq<T, N>"),
    ("BTreeMap", "has no ROS 1 type: use a Seq of a message with key and value"),
    ("BTreeSet", "has no ROS 1 type: use Seq<T, N>"),
    ("Duration", "is a length of time without a unit in its name: use a number named `..._s` or `..._ns`"),
    ("Instant", "means nothing on another machine: use quantity::Time"),
    ("SystemTime", "is a clock that jumps: use quantity::Time"),
    ("Span", "has no ROS 1 type: use a number named `..._s` or `..._ns`"),
];

pub fn expand(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Struct(data) = &input.data else {
        return Err(Error::new_spanned(
            &input.ident,
            "only a struct is a message; a field-less enum derives Enumeration, and an enum with data has no \
             form on the wire",
        ));
    };
    let Fields::Named(fields) = &data.fields else {
        return Err(Error::new_spanned(&input.ident, "the fields of a message have names"));
    };
    common::refuse_generics(&input.generics)?;
    common::refuse_serde_attributes(&input.attrs)?;
    let ident = &input.ident;
    let doc = common::doc(&input.attrs, ident, "a message")?;
    let name = published_name(input)?;
    let well_known =
        ["geometry_msgs/", "std_msgs/", "sensor_msgs/"].iter().any(|known| name.starts_with(known));

    let mut descriptions = Vec::new();
    let mut checks = Vec::new();
    let mut finite = Vec::new();
    for field in &fields.named {
        let field_ident = field.ident.as_ref().expect("fields of a named struct have names");
        check_name(field_ident)?;
        common::refuse_serde_attributes(&field.attrs)?;
        check_type(&field.ty)?;
        let field_doc = common::doc(&field.attrs, field, "a field of a message")?;
        let text = field_ident.to_string();
        let ty = &field.ty;
        descriptions.push(quote_spanned! {ty.span()=>
            ::reflect::Field {
                name: #text,
                doc: #field_doc,
                kind: <#ty as ::reflect::FieldType>::KIND,
                unit: ::reflect::Unit::of_field(#text),
                axes: <#ty as ::reflect::FieldType>::AXES,
            }
        });
        checks.push(constant_checks(ident, field_ident, ty, well_known));
        finite.push(quote! { ::reflect::FieldType::all_finite(&self.#field_ident) });
    }
    Ok(quote! {
        #[automatically_derived]
        impl ::reflect::Message for #ident {
            const SCHEMA: &'static ::reflect::Schema =
                &::reflect::Schema { name: #name, doc: #doc, fields: &[#(#descriptions),*] };

            fn all_finite(&self) -> bool {
                true #(&& #finite)*
            }
        }

        #[automatically_derived]
        impl ::reflect::FieldType for #ident {
            const KIND: ::reflect::Kind = ::reflect::Kind::Message(<Self as ::reflect::Message>::SCHEMA);

            fn all_finite(&self) -> bool {
                ::reflect::Message::all_finite(self)
            }
        }

        #(#checks)*
    })
}

/// Checks on the types themselves, past aliases; a failure is an error at the field.
fn constant_checks(message: &Ident, field: &Ident, ty: &Type, well_known: bool) -> TokenStream {
    let unit = format!(
        "`{message}.{field}` is a float and its name ends in no known unit: \
         `<quantity>_<unit>[_<qualifier>]`, see reflect::UNITS"
    );
    let flat = format!("`{message}.{field}` is a sequence of sequences, which ROS 1 has no type for");
    let text = field.to_string();
    let unit_check = (!well_known).then(|| {
        quote_spanned! {field.span()=>
            const _: () = ::core::assert!(
                !<#ty as ::reflect::FieldType>::NEEDS_UNIT || ::reflect::Unit::of_field(#text).is_some(),
                #unit
            );
        }
    });
    quote_spanned! {field.span()=>
        #unit_check
        const _: () = ::core::assert!(<#ty as ::reflect::FieldType>::KIND.has_ros1_type(), #flat);
    }
}

fn published_name(input: &DeriveInput) -> Result<String> {
    let mut name: Option<LitStr> = None;
    for attribute in input.attrs.iter().filter(|attribute| attribute.path().is_ident("message")) {
        attribute.parse_nested_meta(|meta| {
            if !meta.path.is_ident("name") {
                return Err(meta.error("the only attribute is #[message(name = \"package/Type\")]"));
            }
            name = Some(meta.value()?.parse()?);
            Ok(())
        })?;
    }
    let Some(name) = name else {
        return Err(Error::new_spanned(
            &input.ident,
            "a message has a published name: #[message(name = \"package/Type\")]",
        ));
    };
    let text = name.value();
    let valid = text.split_once('/').is_some_and(|(package, ty)| is_lower_snake(package) && is_camel(ty));
    if valid { Ok(text) } else { Err(Error::new_spanned(name, "a published name reads `package/Type`")) }
}

fn is_lower_snake(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(|letter| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_')
        && !name.ends_with('_')
        && !name.contains("__")
}

fn is_camel(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_uppercase())
        && name.chars().all(|letter| letter.is_ascii_alphanumeric())
}

fn check_name(ident: &Ident) -> Result<()> {
    let name = ident.to_string();
    let bare = name.strip_prefix("r#").unwrap_or(&name);
    if name != bare || RESERVED.contains(&bare) {
        return Err(Error::new_spanned(
            ident,
            format!("`{bare}` is a reserved word where definitions are read"),
        ));
    }
    if !is_lower_snake(bare) {
        return Err(Error::new_spanned(ident, "names of fields are lower snake case"));
    }
    Ok(())
}

/// A better word than "trait not implemented" for what people try first.
fn check_type(ty: &Type) -> Result<()> {
    match ty {
        Type::Path(path) => {
            let Some(last) = path.path.segments.last() else {
                return Ok(());
            };
            if let Some((name, why)) = REFUSED.iter().find(|(name, _)| last.ident == name) {
                return Err(Error::new_spanned(ty, format!("`{name}` {why}")));
            }
            if let PathArguments::AngleBracketed(arguments) = &last.arguments {
                for argument in &arguments.args {
                    if let GenericArgument::Type(inner) = argument {
                        check_type(inner)?;
                    }
                }
            }
            Ok(())
        }
        Type::Array(array) => check_type(&array.elem),
        Type::Tuple(_) => {
            Err(Error::new_spanned(ty, "a tuple has no ROS 1 type: use a message with named fields"))
        }
        Type::Reference(_) => Err(Error::new_spanned(ty, "a message owns what it says")),
        _ => Ok(()),
    }
}
