//! Settings for the tests of this crate: the ones that are shipped, with the departures these tests reckon with.

use std::path::Path;

use settings::{Arena, FleetVehicle};

/// The shipped arena with the double flip.
pub(crate) fn arena() -> Arena {
    pinned("double-flip")
}

/// The shipped arena with three vehicles.
pub(crate) fn fleet() -> Arena {
    pinned("fleet")
}

/// A shipped scenario whose vehicles depart by figures of this crate's own: the shipped ones are tuned to the paper's
/// experiments, and a tuning must not move what these tests expect.
fn pinned(scenario: &str) -> Arena {
    let mut arena = Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), scenario)
        .expect("the shipped settings load");
    for member in &mut arena.fleet {
        let plant = &mut member.vehicle.plant;
        plant.gyro.scale_ratio = 1.045;
        plant.rotor.thrust_ratio = 0.92;
        plant.rotor.inflow_loss_s_m = 0.04;
        plant.battery.hover_endurance_s = 1800.0;
        plant.battery.fade_ratio = 0.12;
    }
    arena
}

/// The shipped arena, its vehicles without departures.
pub(crate) fn ideal_arena() -> Arena {
    let mut arena = arena();
    for member in &mut arena.fleet {
        member.vehicle.plant.remove_departures(&member.vehicle.rotor);
    }
    arena
}

/// The shipped vehicle.
pub(crate) fn member() -> FleetVehicle {
    arena().fleet.remove(0)
}

/// The same without departures.
pub(crate) fn ideal() -> FleetVehicle {
    ideal_arena().fleet.remove(0)
}
