//! Settings laid over those of a folder: what one hall, one host or one container has otherwise.
//!
//! A layer is written as the folder is: a section for each file, with the file's own keys below it. Files in a folder are
//! sections of the folder's.
//!
//! ```toml
//! [network]                          # network.toml
//! interface = "192.168.10.7"
//!
//! [network.devices.motion_capture]
//! url = "udp://192.168.10.7:51001"
//!
//! [services.estimator]               # services.toml
//!
//! [vehicles.v01.links]               # vehicles/v01.toml
//! data_address = 0x5001
//! ```

use std::collections::BTreeMap;
use std::path::{Component, Path};
use std::str::FromStr;

use toml::{Table, Value};

use crate::ConfigError;
use crate::read::{merge, names_in, read_table};

/// The files of a folder of settings.
const FILES: [&str; 3] = ["hall", "network", "services"];
/// Its folders, of which the names of the files are free.
const FOLDERS: [&str; 3] = ["scenarios", "vehicles", "vehicles/kinds"];

/// Settings laid over those of a folder, the later ones over the earlier.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlay {
    layers: Vec<Layer>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq)]
struct Layer {
    /// What a person finds it by.
    name: String,
    table: Table,
}

/// Another value for one setting, written `FILE.KEY=VALUE`, such as `network.ttl=1`.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    keys: Vec<String>,
    value: Value,
}

/// What is laid over each file, by its name without ending.
pub(crate) type ByFile = BTreeMap<String, Table>;

impl Overlay {
    /// Lays a file over what there is.
    ///
    /// # Errors
    /// A file that is not there or is not TOML.
    pub fn add_file(&mut self, path: &Path) -> Result<(), ConfigError> {
        self.layers.push(Layer { name: path.display().to_string(), table: read_table(path)? });
        Ok(())
    }

    /// Lays a change over what there is.
    pub fn add_change(&mut self, change: &Change) {
        let leaf = (change.keys.iter().rev())
            .fold(change.value.clone(), |value, key| Value::Table(Table::from_iter([(key.clone(), value)])));
        let Value::Table(table) = leaf else { return };
        self.layers.push(Layer { name: change.to_string(), table });
    }

    /// Whether nothing is laid over anything.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// What is laid over each file of this folder.
    pub(crate) fn by_file(&self, folder: &Path) -> Result<ByFile, ConfigError> {
        let mut files = ByFile::new();
        for layer in &self.layers {
            for (section, value) in &layer.table {
                layer.sort(folder, section, value, &mut files)?;
            }
        }
        Ok(files)
    }

    /// Does what `load` does with this overlay. What it is refused for is laid to the layer that brought it about, if
    /// the settings were sound without.
    pub(crate) fn blaming<T>(
        &self,
        load: impl Fn(&Self) -> Result<T, ConfigError>,
    ) -> Result<T, ConfigError> {
        let error = match load(self) {
            Err(error) if !self.is_empty() => error,
            loaded => return loaded,
        };
        let refused_by = |count: usize| {
            let overlay = Self { layers: self.layers[..count].to_vec() };
            load(&overlay).is_err_and(|other| other == error)
        };
        let Some(count) = (0..=self.layers.len()).find(|count| refused_by(*count)) else { return Err(error) };
        match (count.checked_sub(1).map(|index| self.layers[index].name.clone()), &error) {
            (None, _) => Err(error),
            // It speaks of the layer already.
            (Some(name), ConfigError::Malformed { file, .. } | ConfigError::Unknown { file, .. })
                if *file == name =>
            {
                Err(error)
            }
            (Some(overlay), _) => Err(ConfigError::Overlaid { overlay, error: Box::new(error) }),
        }
    }
}

impl Layer {
    /// Sorts a section to its file.
    fn sort(
        &self,
        folder: &Path,
        section: &str,
        value: &Value,
        files: &mut ByFile,
    ) -> Result<(), ConfigError> {
        let Value::Table(table) = value else {
            let reason =
                format!("{} = {value}, but it must be a section of settings", section.replace('/', "."));
            return Err(ConfigError::Malformed { file: self.name.clone(), reason });
        };
        if FOLDERS.contains(&section) {
            return table
                .iter()
                .try_for_each(|(name, value)| self.sort(folder, &format!("{section}/{name}"), value, files));
        }
        if !self.is_file(folder, section)? {
            return Err(self.unknown(folder, section));
        }
        merge(files.entry(section.to_owned()).or_default(), table.clone());
        Ok(())
    }

    fn is_file(&self, folder: &Path, section: &str) -> Result<bool, ConfigError> {
        let Some((parent, name)) = section.rsplit_once('/') else { return Ok(FILES.contains(&section)) };
        Ok(FOLDERS.contains(&parent)
            && folder.join(parent).is_dir()
            && names_in(&folder.join(parent))?.iter().any(|known| known == name))
    }

    fn unknown(&self, folder: &Path, section: &str) -> ConfigError {
        let (key, name, known) = match section.rsplit_once('/') {
            Some((parent, name)) if FOLDERS.contains(&parent) => {
                let known = names_in(&folder.join(parent)).unwrap_or_default();
                (format!("section of {}", parent.replace('/', ".")), name, known.join(", "))
            }
            _ => ("section".to_owned(), section, [&FILES[..], &FOLDERS[..2]].concat().join(", ")),
        };
        ConfigError::Unknown { file: self.name.clone(), key, value: name.to_owned(), known }
    }
}

/// The name by which a file of the folder is overlaid: its path within, without ending.
pub(crate) fn name_of(folder: &Path, file: &Path) -> Option<String> {
    let mut parts: Vec<&str> = Vec::new();
    for component in file.strip_prefix(folder).ok()?.components() {
        match component {
            Component::Normal(part) => parts.push(part.to_str()?),
            Component::ParentDir => {
                parts.pop()?;
            }
            _ => {}
        }
    }
    Some(parts.join("/").strip_suffix(".toml")?.to_owned())
}

impl FromStr for Change {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("{text:?} is not FILE.KEY=VALUE, such as network.ttl=1");
        let (path, value) = text.split_once('=').ok_or_else(refused)?;
        // The name of a file in a folder may be written as a path: scenarios/fleet.flip.iterations.
        let (file, rest) = path.split_once('.').ok_or_else(refused)?;
        let keys: Vec<String> = file.split('/').chain(rest.split('.')).map(str::to_owned).collect();
        if keys.iter().any(String::is_empty) {
            return Err(refused());
        }
        // What is no TOML value is a text without its quotes: addresses, names.
        let value = format!("value = {value}")
            .parse::<Table>()
            .ok()
            .filter(|table| table.len() == 1)
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| Value::String(value.to_owned()));
        Ok(Self { keys, value })
    }
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.keys.join("."), self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_names_file_key_and_value() {
        let change = |text: &str| text.parse::<Change>().unwrap();
        let url = change("network.devices.data_link.url=udp://10.71.0.10:52000");
        assert_eq!(url.keys, ["network", "devices", "data_link", "url"]);
        assert_eq!(url.value, Value::String("udp://10.71.0.10:52000".to_owned()));
        assert_eq!(change("network.ttl=1").value, Value::Integer(1));
        assert_eq!(change("hall.width_m=8.5").value, Value::Float(8.5));
        assert_eq!(change("network.interface=\"10.0.0.1\"").value, Value::String("10.0.0.1".to_owned()));
        assert_eq!(
            change("scenarios/fleet.flip.iterations=3").keys,
            change("scenarios.fleet.flip.iterations=3").keys
        );
    }

    #[test]
    fn what_is_no_change_is_refused_with_the_text_found() {
        for text in ["", "network", "network=1", "network.ttl", ".ttl=1", "network..ttl=1", "/etc/x.y=1"] {
            assert!(text.parse::<Change>().unwrap_err().contains(text), "{text:?}");
        }
    }

    #[test]
    fn a_file_is_named_by_its_path_within_the_folder() {
        let name = |file| name_of(Path::new("some/config"), Path::new(file));
        assert_eq!(name("some/config/hall.toml").as_deref(), Some("hall"));
        assert_eq!(name("some/config/vehicles/kinds/../kinds/x.toml").as_deref(), Some("vehicles/kinds/x"));
        assert_eq!(name("elsewhere/hall.toml"), None);
        assert_eq!(name("some/config/../../hall.toml"), None);
    }
}
