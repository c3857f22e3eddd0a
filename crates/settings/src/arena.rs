//! Everything resolved: hall, network, scenario, fleet, and each service's own section.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::read::{in_range, malformed, read, read_inheriting, read_table};
use crate::{ConfigError, Hall, Network, Scenario, ScenarioVehicle, Vehicle};

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
        let hall_path = folder.join("hall.toml");
        let hall: Hall = read(&hall_path)?;
        hall.check(&hall_path.display().to_string())?;
        let network_path = folder.join("network.toml");
        let network: Network = read(&network_path)?;
        network.check(&network_path.display().to_string())?;
        let services = read_table(&folder.join("services.toml"))?;
        let scenario_path = folder.join("scenarios").join(format!("{scenario_name}.toml"));
        let mut table = read_inheriting(&scenario_path)?;
        let overrides = match table.remove("vehicles") {
            None => Table::new(),
            Some(toml::Value::Table(overrides)) => overrides,
            Some(other) => {
                return Err(ConfigError::Malformed {
                    file: scenario_path.display().to_string(),
                    reason: format!("vehicles = {other}, but it must be a table of settings laid over each vehicle"),
                });
            }
        };
        let scenario: Scenario = table.try_into().map_err(|error| malformed(&scenario_path, &error))?;
        let file = scenario_path.display().to_string();
        scenario.check(&file)?;
        let fleet = scenario
            .vehicles
            .iter()
            .map(|part| load_vehicle(folder, &file, &hall, part, &overrides))
            .collect::<Result<Vec<_>, _>>()?;
        let arena = Self { name: scenario_name.to_owned(), hall, network, scenario, fleet, services };
        arena.check_distinct(&file)?;
        Ok(arena)
    }

    /// A service's own section of `services.toml`; an absent section reads as an empty one.
    ///
    /// # Errors
    /// An unknown or missing key, or a value of the wrong type.
    pub fn section<T: DeserializeOwned>(&self, service: &str) -> Result<T, ConfigError> {
        let section = self.services.get(service).cloned().unwrap_or_else(|| toml::Value::Table(Table::new()));
        section.try_into().map_err(|error: toml::de::Error| ConfigError::Malformed {
            file: "services.toml".to_owned(),
            reason: format!("[{service}]: {error}").trim_end().to_owned(),
        })
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

fn load_vehicle(
    folder: &Path,
    scenario_file: &str,
    hall: &Hall,
    part: &ScenarioVehicle,
    overrides: &Table,
) -> Result<FleetVehicle, ConfigError> {
    let reach_x = 0.5 * hall.width_m - hall.margin_m;
    let reach_y = 0.5 * hall.depth_m - hall.margin_m;
    in_range(scenario_file, "vehicle.start_x_m", part.start_x_m, -reach_x, reach_x)?;
    in_range(scenario_file, "vehicle.start_y_m", part.start_y_m, -reach_y, reach_y)?;
    in_range(scenario_file, "vehicle.place_x_m", part.place_x_m, -reach_x, reach_x)?;
    in_range(scenario_file, "vehicle.place_y_m", part.place_y_m, -reach_y, reach_y)?;
    in_range(scenario_file, "vehicle.place_z_m", part.place_z_m, hall.margin_m, hall.height_m - hall.margin_m)?;
    in_range(scenario_file, "vehicle.heading_rad", part.heading_rad, -7.0, 7.0)?;
    let path = folder.join("vehicles").join(format!("{}.toml", part.file));
    let mut table = read_inheriting(&path)?;
    crate::read::merge(&mut table, overrides.clone());
    let vehicle: Vehicle = table.try_into().map_err(|error| malformed(&path, &error))?;
    vehicle.check(&path.display().to_string())?;
    Ok(FleetVehicle { vehicle, part: part.clone() })
}
