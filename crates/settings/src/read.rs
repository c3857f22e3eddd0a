//! Reading TOML files: one step of inheritance, unknown keys refused, ranges checked.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::ConfigError;
use crate::overlay::{ByFile, name_of};

/// A folder of settings, and what is laid over its files.
pub(crate) struct Files<'a> {
    folder: &'a Path,
    over: ByFile,
}

impl<'a> Files<'a> {
    /// A folder and what is laid over its files.
    pub(crate) fn new(folder: &'a Path, over: ByFile) -> Self {
        Self { folder, over }
    }

    /// The folder.
    pub(crate) fn folder(&self) -> &'a Path {
        self.folder
    }

    /// A file's values, with what is laid over them.
    pub(crate) fn table(&self, path: &Path) -> Result<Table, ConfigError> {
        let mut table = read_table(path)?;
        if let Some(over) = name_of(self.folder, path).and_then(|name| self.over.get(&name)) {
            merge(&mut table, over.clone());
        }
        Ok(table)
    }

    /// The names of the files of a folder of this one over which something is laid.
    pub(crate) fn overlaid_in(&self, folder: &str) -> impl Iterator<Item = &str> {
        self.over.keys().filter_map(move |name| match name.rsplit_once('/') {
            Some((parent, name)) if parent == folder => Some(name),
            _ => None,
        })
    }
}

/// A file and what it inherits, kept apart so that a value is laid to the file it stands in.
pub(crate) struct Source {
    path: PathBuf,
    own: Table,
    parent: Option<(PathBuf, Table)>,
}

impl Source {
    /// Reads a file, following one `inherit = "other.toml"` (relative to the file) where there is one.
    pub(crate) fn read(files: &Files<'_>, path: &Path) -> Result<Self, ConfigError> {
        let mut own = files.table(path)?;
        let parent = match own.remove("inherit") {
            None => None,
            Some(Value::String(parent)) => {
                let parent_path = path.parent().unwrap_or(Path::new(".")).join(parent);
                let base = files.table(&parent_path)?;
                Some((parent_path, base))
            }
            Some(other) => {
                return Err(ConfigError::Malformed {
                    file: path.display().to_string(),
                    reason: format!("inherit = {other}, but it must be the text of a path"),
                });
            }
        };
        if let Some((parent_path, base)) = &parent
            && let Some(grandparent) = base.get("inherit")
        {
            return Err(ConfigError::Contradiction {
                file: parent_path.display().to_string(),
                key: "inherit".to_owned(),
                value: grandparent.to_string(),
                other_key: format!("inherit of {}", path.display()),
                other_value: parent_path.display().to_string(),
                reason: "settings are inherited once, not through a chain".to_owned(),
            });
        }
        Ok(Self { path: path.to_owned(), own, parent })
    }

    /// The file's values laid over those it inherits.
    pub(crate) fn merged(&self) -> Table {
        let mut merged = self.parent.as_ref().map(|(_, base)| base.clone()).unwrap_or_default();
        merge(&mut merged, self.own.clone());
        merged
    }

    /// The same as a type.
    pub(crate) fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        self.parse_table(self.merged())
    }

    /// A table made of this file's, as a type.
    pub(crate) fn parse_table<T: DeserializeOwned>(&self, table: Table) -> Result<T, ConfigError> {
        table.clone().try_into().map_err(|error| match found(&table, &error) {
            Some((key, reason)) => ConfigError::Malformed { file: self.file_of(&key), reason },
            None => ConfigError::Malformed { file: self.name(), reason: self.described(&error) },
        })
    }

    /// The file, as it was asked for.
    pub(crate) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// The file that a dotted key stands in.
    fn file_of(&self, key: &str) -> String {
        match &self.parent {
            Some((parent_path, base)) if !holds(&self.own, key) && holds(base, key) => {
                parent_path.display().to_string()
            }
            _ => self.name(),
        }
    }

    /// Checks what was read, and lays a refusal to the file that the key stands in.
    pub(crate) fn checked(
        &self,
        check: impl FnOnce(&str) -> Result<(), ConfigError>,
    ) -> Result<(), ConfigError> {
        check(&self.name()).map_err(|mut error| {
            if let ConfigError::OutOfRange { file, key, .. } | ConfigError::Contradiction { file, key, .. } =
                &mut error
            {
                *file = self.file_of(key);
            }
            error
        })
    }

    fn described(&self, error: &toml::de::Error) -> String {
        let reason = one_line(error);
        match &self.parent {
            Some((parent_path, _)) => format!("{reason} (it inherits {})", parent_path.display()),
            None => reason,
        }
    }
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

/// Whether a dotted key has a value in the table.
pub(crate) fn holds(table: &Table, key: &str) -> bool {
    value_at(table, key).is_some()
}

fn value_at<'t>(table: &'t Table, key: &str) -> Option<&'t Value> {
    match key.split_once('.') {
        None => table.get(key),
        Some((first, rest)) => value_at(table.get(first)?.as_table()?, rest),
    }
}

/// Refuses a number outside its range, naming file, key and all three values; NaN is outside every range.
pub(crate) fn in_range(file: &str, key: &str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(ConfigError::OutOfRange { file: file.to_owned(), key: key.to_owned(), value, min, max })
}

/// Refuses a number above `ratio` of another setting's. Both are known to be numbers.
pub(crate) fn at_most(
    file: &str,
    (key, value): (&str, f64),
    ratio: f64,
    (other_key, other): (&str, f64),
) -> Result<(), ConfigError> {
    if value <= ratio * other {
        return Ok(());
    }
    let reason = if ratio == 1.0 {
        "it must not be above it".to_owned()
    } else {
        format!("it must not be above {ratio} of it")
    };
    Err(ConfigError::Contradiction {
        file: file.to_owned(),
        key: key.to_owned(),
        value: value.to_string(),
        other_key: other_key.to_owned(),
        other_value: other.to_string(),
        reason,
    })
}

pub(crate) fn read_table(path: &Path) -> Result<Table, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|error| unreadable(path, &error))?;
    text.parse::<Table>().map_err(|error: toml::de::Error| ConfigError::Malformed {
        file: path.display().to_string(),
        reason: error.to_string().trim_end().to_owned(),
    })
}

/// The TOML files of a folder, without their ending, in order.
pub(crate) fn names_in(folder: &Path) -> Result<Vec<String>, ConfigError> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let path = entry.map_err(|error| unreadable(folder, &error))?.path();
        if path.extension().is_some_and(|ending| ending == "toml")
            && let Some(name) = path.file_stem().and_then(|name| name.to_str())
        {
            names.push(name.to_owned());
        }
    }
    names.sort_unstable();
    Ok(names)
}

/// What the parser says of a table, in one line, with the value it found wherever that is a single one.
pub(crate) fn explained(table: &Table, error: &toml::de::Error) -> String {
    found(table, error).map_or_else(|| one_line(error), |(_, reason)| reason)
}

/// The key of the single value that the parser refused, and what it says of it.
fn found(table: &Table, error: &toml::de::Error) -> Option<(String, String)> {
    // The parser tells the key in its text only.
    let text = error.to_string();
    let key = text.trim_end().rsplit_once("in `")?.1.strip_suffix('`')?;
    let value = value_at(table, key).filter(|value| !value.is_table() && !value.is_array())?;
    Some((key.to_owned(), format!("{key} = {value}: {}", error.message())))
}

fn one_line(error: &toml::de::Error) -> String {
    error.to_string().trim_end().replace('\n', " ")
}

fn unreadable(path: &Path, error: &std::io::Error) -> ConfigError {
    ConfigError::Unreadable { file: path.display().to_string(), reason: error.to_string() }
}
