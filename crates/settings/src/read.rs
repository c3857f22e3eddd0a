//! Reading TOML files: one step of inheritance, unknown keys refused, ranges checked.

use std::path::Path;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::ConfigError;

/// Reads a file into a type, following one `inherit = "other.toml"` (relative to the file) where there is one.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    let table = read_inheriting(path)?;
    table.try_into().map_err(|error: toml::de::Error| malformed(path, &error))
}

/// Reads a file as a table, with what it inherits.
pub(crate) fn read_inheriting(path: &Path) -> Result<Table, ConfigError> {
    let mut own = read_table(path)?;
    let Some(parent) = own.remove("inherit") else { return Ok(own) };
    let Value::String(parent) = parent else {
        return Err(ConfigError::Malformed {
            file: path.display().to_string(),
            reason: format!("inherit = {parent}, but it must be the text of a path"),
        });
    };
    let parent_path = path.parent().unwrap_or(Path::new(".")).join(parent);
    let mut base = read_table(&parent_path)?;
    if let Some(grandparent) = base.get("inherit") {
        return Err(ConfigError::Contradiction {
            file: parent_path.display().to_string(),
            key: "inherit".to_owned(),
            value: grandparent.to_string(),
            other_key: format!("inherit of {}", path.display()),
            other_value: parent_path.display().to_string(),
            reason: "settings are inherited once, not through a chain".to_owned(),
        });
    }
    merge(&mut base, own);
    Ok(base)
}

/// Lays `over` on `base`, table by table.
pub(crate) fn merge(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(value)) => merge(inner, value),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// Refuses a number outside its range, naming file, key and all three values; NaN is outside every range.
pub(crate) fn in_range(file: &str, key: &str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(ConfigError::OutOfRange { file: file.to_owned(), key: key.to_owned(), value, min, max })
}

pub(crate) fn read_table(path: &Path) -> Result<Table, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|error| ConfigError::Unreadable {
        file: path.display().to_string(),
        reason: error.to_string(),
    })?;
    text.parse::<Table>().map_err(|error| malformed(path, &error))
}

pub(crate) fn malformed(path: &Path, error: &toml::de::Error) -> ConfigError {
    ConfigError::Malformed { file: path.display().to_string(), reason: error.to_string().trim_end().to_owned() }
}
