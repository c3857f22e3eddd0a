//! Settings for the tests of this crate: the ones that are shipped.

use std::path::Path;

use settings::{Arena, FleetVehicle};

/// The shipped arena with the double flip.
pub(crate) fn arena() -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), "double-flip")
        .expect("the shipped settings load")
}

/// The shipped arena with three vehicles.
pub(crate) fn fleet() -> Arena {
    Arena::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), "fleet")
        .expect("the shipped settings load")
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
