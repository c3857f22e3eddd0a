//! Everything resolved: hall, network, scenario, fleet, and each service's own section.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::read::{Files, Source, explained, holds, merge, names_in};
use crate::{ConfigError, Hall, Network, Overlay, Scenario, ScenarioVehicle, Vehicle, places};

const SERVICES_FILE: &str = "services.toml";

/// A whole arena's settings, resolved and checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arena {
    /// The scenario's name: its file's, without ending.
    pub name: String,
    /// The hall.
    pub hall: Hall,
    /// Bus and devices.
    pub network: Network,
    /// The experiment.
    pub scenario: Scenario,
    /// The vehicles of the scenario, in its order.
    pub fleet: Vec<FleetVehicle>,
    /// The services' own sections, by service name.
    pub services: Table,
}

/// A vehicle with its place in the scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FleetVehicle {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Its part.
    pub part: ScenarioVehicle,
}

impl Arena {
    /// Reads `hall.toml`, `network.toml`, `services.toml`, `scenarios/<name>.toml` and the vehicles it names.
    ///
    /// # Errors
    /// The first setting that cannot be used, with its file, its key and both values.
    pub fn load(folder: &Path, scenario_name: &str) -> Result<Self, ConfigError> {
        Self::load_over(folder, scenario_name, &Overlay::default(), |_| Ok(()))
    }

    /// As [`Arena::load`], with other settings laid over the folder's, and `check` for what only the services can judge.
    ///
    /// # Errors
    /// As [`Arena::load`] and as `check`; [`ConfigError::Overlaid`] for what is the overlay's doing.
    pub fn load_over(
        folder: &Path,
        scenario_name: &str,
        overlay: &Overlay,
        check: impl Fn(&Self) -> Result<(), ConfigError>,
    ) -> Result<Self, ConfigError> {
        overlay.blaming(|overlay| {
            let arena = Self::load_files(&Files::new(folder, overlay.by_file(folder)?), scenario_name)?;
            check(&arena)?;
            Ok(arena)
        })
    }

    fn load_files(files: &Files<'_>, scenario_name: &str) -> Result<Self, ConfigError> {
        let folder = files.folder();
        let hall_source = Source::read(files, &folder.join("hall.toml"))?;
        let hall: Hall = hall_source.parse()?;
        hall_source.checked(|file| hall.check(file))?;
        let network_source = Source::read(files, &folder.join("network.toml"))?;
        let network: Network = network_source.parse()?;
        network_source.checked(|file| network.check(file))?;
        let services = files.table(&folder.join(SERVICES_FILE))?;
        let (source, scenario, overrides) = load_scenario(files, scenario_name)?;
        let fleet = scenario
            .vehicles
            .iter()
            .map(|part| load_vehicle(files, &source.name(), part, &overrides))
            .collect::<Result<Vec<_>, _>>()?;
        let arena = Self { name: scenario_name.to_owned(), hall, network, scenario, fleet, services };
        arena.check_distinct(&source.name())?;
        places::check(&arena, &source.name())?;
        network_source.checked(|file| arena.network.devices.check_fleet(file, &arena.fleet))?;
        check_unused(files)?;
        Ok(arena)
    }

    /// The names of the scenarios in a folder of settings, in order.
    ///
    /// # Errors
    /// [`ConfigError::Unreadable`]: the folder has no scenarios.
    pub fn scenarios(folder: &Path) -> Result<Vec<String>, ConfigError> {
        names_in(&folder.join("scenarios"))
    }

    /// A number for these settings, the same on every machine: FNV-1a-64 over their canonical form, TOML with all
    /// inheritance resolved, structs in the order of their fields and tables in that of their keys. Hashed into
    /// recordings. How the files are laid out and commented makes no difference; every value does.
    #[must_use]
    pub fn digest(&self) -> u64 {
        reflect::fnv1a_64(&[self.to_toml().as_bytes()])
    }

    /// These settings in their canonical form, one TOML file: what a recording carries.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("what was read from TOML can be written as TOML")
    }

    /// Settings from their canonical form; checked for its shape only, since it was whole when it was written.
    ///
    /// # Errors
    /// [`ConfigError::Malformed`] for a text that is no such form; `file` is how the error names it.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, ConfigError> {
        toml::from_str(text).map_err(|error: toml::de::Error| ConfigError::Malformed {
            file: file.to_owned(),
            reason: error.to_string(),
        })
    }

    /// Refuses sections of `services.toml` that belong to none of these services. A caller who knows the services gives
    /// their names; `service_core::check_sections` is the one there is.
    ///
    /// # Errors
    /// [`ConfigError::Unknown`] with the first such section.
    pub fn check_sections(&self, services: &[&str]) -> Result<(), ConfigError> {
        match self.services.keys().find(|section| !services.contains(&section.as_str())) {
            None => Ok(()),
            Some(section) => Err(ConfigError::Unknown {
                file: SERVICES_FILE.to_owned(),
                key: "section".to_owned(),
                value: section.clone(),
                known: services.join(", "),
            }),
        }
    }

    /// A service's own section of `services.toml`; an absent section reads as an empty one.
    ///
    /// # Errors
    /// An unknown or missing key, or a value of the wrong type.
    pub fn section<T: DeserializeOwned>(&self, service: &str) -> Result<T, ConfigError> {
        let refused = |reason| ConfigError::Malformed { file: SERVICES_FILE.to_owned(), reason };
        let section = match self.services.get(service) {
            None => Table::new(),
            Some(toml::Value::Table(section)) => section.clone(),
            Some(other) => {
                return Err(refused(format!("{service} = {other}, but it must be a section of settings")));
            }
        };
        section
            .clone()
            .try_into()
            .map_err(|error| refused(format!("[{service}] {}", explained(&section, &error))))
    }

    /// The vehicle with that id.
    #[must_use]
    pub fn vehicle(&self, id: u8) -> Option<&FleetVehicle> {
        self.fleet.iter().find(|member| member.vehicle.id == id)
    }

    fn check_distinct(&self, file: &str) -> Result<(), ConfigError> {
        for (index, one) in self.fleet.iter().enumerate() {
            for other in &self.fleet[..index] {
                let clash = [
                    ("id", one.vehicle.id.to_string(), other.vehicle.id.to_string()),
                    ("subject", one.vehicle.subject.clone(), other.vehicle.subject.clone()),
                    (
                        "links.data_address",
                        one.vehicle.links.data_address.to_string(),
                        other.vehicle.links.data_address.to_string(),
                    ),
                ]
                .into_iter()
                .filter(|(key, ..)| {
                    *key != "links.data_address" || one.vehicle.flips() && other.vehicle.flips()
                })
                .find(|(_, a, b)| a == b);
                if let Some((key, value, other_value)) = clash {
                    return Err(ConfigError::Contradiction {
                        file: file.to_owned(),
                        key: format!("{}.{key}", one.part.file),
                        value,
                        other_key: format!("{}.{key}", other.part.file),
                        other_value,
                        reason: "each vehicle of a scenario needs its own".to_owned(),
                    });
                }
            }
        }
        Ok(())
    }
}

/// A scenario, and the settings it lays over its vehicles'.
fn load_scenario(files: &Files<'_>, name: &str) -> Result<(Source, Scenario, Table), ConfigError> {
    let folder = files.folder();
    let known = Arena::scenarios(folder)?;
    if !known.iter().any(|candidate| candidate == name) {
        return Err(ConfigError::Unknown {
            file: folder.join("scenarios").display().to_string(),
            key: "scenario".to_owned(),
            value: name.to_owned(),
            known: known.join(", "),
        });
    }
    let source = Source::read(files, &folder.join("scenarios").join(format!("{name}.toml")))?;
    let mut table = source.merged();
    let overrides = match table.remove("vehicles") {
        None => Table::new(),
        Some(toml::Value::Table(overrides)) => overrides,
        Some(other) => {
            return Err(ConfigError::Malformed {
                file: source.name(),
                reason: format!(
                    "vehicles = {other}, but it must be a table of settings laid over each vehicle"
                ),
            });
        }
    };
    let scenario: Scenario = source.parse_table(table)?;
    source.checked(|file| scenario.check(file))?;
    Ok((source, scenario, overrides))
}

/// What is laid over a scenario or a vehicle that does not take part must be sound all the same.
fn check_unused(files: &Files<'_>) -> Result<(), ConfigError> {
    for name in files.overlaid_in("scenarios") {
        load_scenario(files, name)?;
    }
    let every = files.overlaid_in("vehicles/kinds").next().is_some();
    let names: Vec<String> = match every {
        true => names_in(&files.folder().join("vehicles"))?,
        false => files.overlaid_in("vehicles").map(str::to_owned).collect(),
    };
    names.iter().try_for_each(|name| read_vehicle(files, name).map(|_| ()))
}

fn read_vehicle(files: &Files<'_>, name: &str) -> Result<(Source, Vehicle), ConfigError> {
    let source = Source::read(files, &files.folder().join("vehicles").join(format!("{name}.toml")))?;
    let vehicle: Vehicle = source.parse()?;
    source.checked(|file| vehicle.check(file))?;
    Ok((source, vehicle))
}

fn load_vehicle(
    files: &Files<'_>,
    scenario_file: &str,
    part: &ScenarioVehicle,
    overrides: &Table,
) -> Result<FleetVehicle, ConfigError> {
    let known = names_in(&files.folder().join("vehicles"))?;
    if !known.contains(&part.file) {
        return Err(ConfigError::Unknown {
            file: scenario_file.to_owned(),
            key: "vehicle.file".to_owned(),
            value: part.file.clone(),
            known: known.join(", "),
        });
    }
    let (source, mut vehicle) = read_vehicle(files, &part.file)?;
    if !overrides.is_empty() {
        // Sound before, so whatever is refused now is the scenario's doing.
        let mut table = source.merged();
        merge(&mut table, overrides.clone());
        vehicle = table.clone().try_into().map_err(|error| ConfigError::Malformed {
            file: scenario_file.to_owned(),
            reason: format!("[vehicles] over {}: {}", source.name(), explained(&table, &error)),
        })?;
        vehicle.check(scenario_file).map_err(|error| in_overrides(error, overrides))?;
    }
    Ok(FleetVehicle { vehicle, part: part.clone() })
}

/// The keys of a refusal as they are written in a scenario.
fn in_overrides(mut error: ConfigError, overrides: &Table) -> ConfigError {
    let rename = |key: &mut String| {
        if holds(overrides, key) {
            *key = format!("vehicles.{key}");
        }
    };
    match &mut error {
        ConfigError::OutOfRange { key, .. } => rename(key),
        ConfigError::Contradiction { key, other_key, .. } => {
            rename(key);
            rename(other_key);
        }
        _ => {}
    }
    error
}
