//! Whether the places of a scenario, and what is to be flown there, go together.

use crate::read::in_range;
use crate::{Arena, ConfigError, FleetVehicle, Hall, ScenarioVehicle};

/// Least horizontal distance between two vehicles' places: a flip that goes wrong drifts by a metre or so before its
/// vehicle recovers.
const PLACES_APART_M_MIN: f64 = 3.0;
/// Least horizontal distance between two vehicles on the floor.
const STARTS_APART_M_MIN: f64 = 1.0;

/// Checks every vehicle's part against the hall, its gyros, and the other vehicles.
pub(crate) fn check(arena: &Arena, file: &str) -> Result<(), ConfigError> {
    for (index, one) in arena.fleet.iter().enumerate() {
        check_inside(&arena.hall, file, &one.part)?;
        check_gyros(arena, file, one)?;
        for other in &arena.fleet[..index] {
            let (a, b) = (&one.part, &other.part);
            let places = ["place_x_m, place_y_m", "place"];
            check_apart(
                file,
                places,
                (a, [a.place_x_m, a.place_y_m]),
                (b, [b.place_x_m, b.place_y_m]),
                PLACES_APART_M_MIN,
            )?;
            let starts = ["start_x_m, start_y_m", "start"];
            check_apart(
                file,
                starts,
                (a, [a.start_x_m, a.start_y_m]),
                (b, [b.start_x_m, b.start_y_m]),
                STARTS_APART_M_MIN,
            )?;
        }
    }
    Ok(())
}

fn check_inside(hall: &Hall, file: &str, part: &ScenarioVehicle) -> Result<(), ConfigError> {
    let reach_x = 0.5 * hall.width_m - hall.margin_m;
    let reach_y = 0.5 * hall.depth_m - hall.margin_m;
    let key = |name: &str| format!("vehicle {}.{name}", part.file);
    in_range(file, &key("start_x_m"), part.start_x_m, -reach_x, reach_x)?;
    in_range(file, &key("start_y_m"), part.start_y_m, -reach_y, reach_y)?;
    in_range(file, &key("place_x_m"), part.place_x_m, -reach_x, reach_x)?;
    in_range(file, &key("place_y_m"), part.place_y_m, -reach_y, reach_y)?;
    in_range(file, &key("place_z_m"), part.place_z_m, hall.margin_m, hall.height_m - hall.margin_m)?;
    in_range(file, &key("heading_rad"), part.heading_rad, -7.0, 7.0)
}

/// Gyros at their end of range would hide from the rate loop how fast the vehicle turns.
fn check_gyros(arena: &Arena, file: &str, member: &FleetVehicle) -> Result<(), ConfigError> {
    let gyro = &member.vehicle.plant.gyro;
    let flown = match &arena.scenario.flip {
        Some(flip) if member.vehicle.flips() => flip.flown_rate_rad_s,
        _ => return Ok(()),
    };
    if flown < gyro.range_rad_s {
        return Ok(());
    }
    Err(ConfigError::Contradiction {
        file: file.to_owned(),
        key: "flip.flown_rate_rad_s".to_owned(),
        value: flown.to_string(),
        other_key: format!("{}.plant.gyro.range_rad_s", member.part.file),
        other_value: gyro.range_rad_s.to_string(),
        reason: "the gyros must be able to read the rate".to_owned(),
    })
}

fn check_apart(
    file: &str,
    [keys, what]: [&str; 2],
    (one, [x, y]): (&ScenarioVehicle, [f64; 2]),
    (other, [other_x, other_y]): (&ScenarioVehicle, [f64; 2]),
    least_m: f64,
) -> Result<(), ConfigError> {
    let (dx, dy) = (x - other_x, y - other_y);
    if dx * dx + dy * dy >= least_m * least_m {
        return Ok(());
    }
    Err(ConfigError::Contradiction {
        file: file.to_owned(),
        key: format!("vehicle {}.{keys}", one.file),
        value: format!("({x}, {y})"),
        other_key: format!("vehicle {}.{keys}", other.file),
        other_value: format!("({other_x}, {other_y})"),
        reason: format!("two vehicles need {least_m} m between their {what}s, seen from above"),
    })
}
