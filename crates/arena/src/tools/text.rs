//! Messages for people: indented as YAML is.

use std::io::{self, Write};

use recording::export::write_cell;
use reflect::Value;

use super::{Heard, name_of_source};

/// How much is shown of a message that cannot be read.
const RAW_BYTES_SHOWN: usize = 64;

/// Writes a message with its circumstances, as one YAML document.
///
/// # Errors
/// The sink refuses.
pub fn write_message(out: &mut dyn Write, heard: &Heard<'_>, seconds: f64) -> io::Result<()> {
    let sender = heard.source.map_or_else(|| "unknown".to_owned(), name_of_source);
    let unverified = if heard.verified == Some(false) { ", unverified" } else { "" };
    let type_name = heard.type_name.unwrap_or("type unknown");
    writeln!(
        out,
        "# {} at {seconds:.6} s from {sender}, number {}, {type_name}{unverified}",
        heard.topic, heard.sequence
    )?;
    let decoded = match heard.definition {
        Some(definition) => definition.decode(heard.body).map_err(|error| error.to_string()),
        None => Err("no definition".to_owned()),
    };
    match decoded {
        Ok(value) => write_value(out, &value, 0)?,
        Err(reason) => {
            let shown = &heard.body[..heard.body.len().min(RAW_BYTES_SHOWN)];
            let more = if shown.len() < heard.body.len() { " …" } else { "" };
            let hexadecimal: String = shown.iter().map(|byte| format!("{byte:02x}")).collect();
            writeln!(out, "# {reason}; {} bytes: {hexadecimal}{more}", heard.body.len())?;
        }
    }
    writeln!(out, "---")
}

fn write_value(out: &mut dyn Write, value: &Value<'_>, indent: usize) -> io::Result<()> {
    let Value::Record(fields) = value else { return writeln!(out, "{}", inline(value)) };
    for (name, value) in fields {
        write!(out, "{:indent$}{name}:", "")?;
        match value {
            Value::Record(inner) if inner.iter().any(|(_, value)| !is_plain(value)) => {
                writeln!(out)?;
                write_value(out, value, indent + 2)?;
            }
            Value::Seq(elements) if elements.iter().any(|element| !is_plain(element)) => {
                writeln!(out)?;
                for element in elements {
                    writeln!(out, "{:indent$}- {}", "", inline(element))?;
                }
            }
            plain => writeln!(out, " {}", inline(plain))?,
        }
    }
    Ok(())
}

fn is_plain(value: &Value<'_>) -> bool {
    !matches!(value, Value::Record(_) | Value::Seq(_))
}

/// The value on one line, as YAML's flow style has it.
fn inline(value: &Value<'_>) -> String {
    match value {
        Value::Record(fields) => {
            let fields: Vec<String> =
                fields.iter().map(|(name, value)| format!("{name}: {}", inline(value))).collect();
            format!("{{{}}}", fields.join(", "))
        }
        Value::Seq(elements) => {
            let elements: Vec<String> = elements.iter().map(inline).collect();
            format!("[{}]", elements.join(", "))
        }
        // JSON's quotes and escapes are YAML's, too.
        Value::Text(text) => serde_json::to_string(text).expect("text is JSON"),
        plain => {
            let mut text = Vec::new();
            write_cell(&mut text, plain);
            String::from_utf8_lossy(&text).into_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_indented_as_yaml_is() {
        let vector = Value::Record(vec![("x", Value::F64(1.0)), ("y", Value::F32(0.1))]);
        let body =
            Value::Record(vec![("at", Value::Time { sec: 1, nsec: 5 }), ("position_m", vector.clone())]);
        let value = Value::Record(vec![
            ("name", Value::Text("a: b".to_owned())),
            ("numbers", Value::Seq(vec![Value::Unsigned(1), Value::Signed(-2)])),
            ("inner", body.clone()),
            ("bodies", Value::Seq(vec![body])),
            ("none", Value::Seq(Vec::new())),
        ]);
        let mut out = Vec::new();
        write_value(&mut out, &value, 0).unwrap();
        let expected = "name: \"a: b\"\nnumbers: [1, -2]\n\
                        inner:\n  at: 1.000000005\n  position_m: {x: 1.0, y: 0.1}\n\
                        bodies:\n- {at: 1.000000005, position_m: {x: 1.0, y: 0.1}}\nnone: []\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
    }
}
