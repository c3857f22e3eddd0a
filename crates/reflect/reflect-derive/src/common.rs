//! What both macros ask of their input.

use syn::{Attribute, Error, Expr, ExprLit, Generics, Lit, Meta, Result};

/// The doc comment, lines trimmed and joined by newlines; its absence is an error that says what is missing.
pub fn doc(attributes: &[Attribute], spanned: &impl quote::ToTokens, what: &str) -> Result<String> {
    let mut lines: Vec<String> = Vec::new();
    for attribute in attributes {
        if let Meta::NameValue(pair) = &attribute.meta
            && pair.path.is_ident("doc")
            && let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = &pair.value
        {
            lines.extend(text.value().split('\n').map(|line| line.trim().to_owned()));
        }
    }
    let doc = lines.join("\n").trim().to_owned();
    if doc.is_empty() {
        return Err(Error::new_spanned(
            spanned,
            format!("{what} needs a doc comment that says what it means"),
        ));
    }
    Ok(doc)
}

/// Serde's own attributes would make the bytes differ from the description.
pub fn refuse_serde_attributes(attributes: &[Attribute]) -> Result<()> {
    match attributes.iter().find(|attribute| attribute.path().is_ident("serde")) {
        Some(attribute) => {
            Err(Error::new_spanned(attribute, "serde attributes would make the bytes differ from the schema"))
        }
        None => Ok(()),
    }
}

/// A type with parameters has no single description.
pub fn refuse_generics(generics: &Generics) -> Result<()> {
    if generics.params.is_empty() {
        Ok(())
    } else {
        Err(Error::new_spanned(generics, "a type on the wire has no parameters"))
    }
}

/// `TakingOff` as `TAKING_OFF`.
pub fn upper_snake(camel: &str) -> String {
    let mut out = String::new();
    for (i, letter) in camel.char_indices() {
        if i > 0 && letter.is_ascii_uppercase() {
            out.push('_');
        }
        out.push(letter.to_ascii_uppercase());
    }
    out
}
