//! Parameters are tried on models that are wrong on purpose before a vehicle flies them (hazard H14).

use maneuver::{Discretisation, FlipDesign, FlipError, Model, Parameters, stress};
use settings::{FleetVehicle, Hall};

use crate::bounds::OutOfBounds;
use crate::tuning::{BoundsTuning, CheckTuning};

/// The room a vehicle has at its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Room {
    /// Greatest loss of height.
    pub(crate) below_m: f64,
    /// Greatest gain of height.
    pub(crate) above_m: f64,
}

impl Room {
    pub(crate) fn new(hall: &Hall, member: &FleetVehicle, tuning: &CheckTuning) -> Self {
        let place_z_m = member.part.place_z_m;
        Self {
            below_m: place_z_m - tuning.place_m_max - tuning.floor_reserve_m_min,
            above_m: hall.height_m - place_z_m - tuning.place_m_max - tuning.ceiling_reserve_m_min,
        }
    }
}

/// What is expected of parameters that may be flown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Forecast {
    /// Duration of the whole.
    pub(crate) duration_s: f64,
    /// Loss of height below the start on the worst model.
    pub(crate) height_loss_m: f64,
}

/// Why parameters may not be flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Refusal {
    /// They are out of bounds.
    Bounds(OutOfBounds),
    /// The model refuses them.
    Model(FlipError),
    /// One of the models sinks too deep.
    Sinks {
        /// By how much.
        loss_m: f64,
        /// By how much it may.
        room_m: f64,
    },
    /// Every one of the models climbs too high.
    Climbs {
        /// By how much.
        apex_m: f64,
        /// By how much it may.
        room_m: f64,
    },
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bounds(out) => write!(f, "{out}"),
            Self::Model(error) => write!(f, "{error}"),
            Self::Sinks { loss_m, room_m } => {
                write!(f, "might sink {loss_m:.2} m where {room_m:.2} m are allowed")
            }
            Self::Climbs { apex_m, room_m } => {
                write!(f, "might climb {apex_m:.2} m where {room_m:.2} m are allowed")
            }
        }
    }
}

/// Judges parameters by their bounds, then by flights on the model and on models that deviate from it.
///
/// # Errors
/// Why they may not be flown.
pub(crate) fn check(
    model: &Model,
    design: &FlipDesign,
    parameters: &Parameters,
    room: &Room,
    bounds: &BoundsTuning,
    tuning: &CheckTuning,
) -> Result<Forecast, Refusal> {
    let primitive = bounds.admit(model, design, parameters).map_err(Refusal::Bounds)?;
    let report = stress(model, design, parameters, Discretisation::Hold800, tuning.spread_ratio)
        .map_err(Refusal::Model)?;
    let loss_m = report.deepest().height_loss_m;
    // Asked this way round, so that what is not a number is refused too.
    let stays_off_the_floor = loss_m <= room.below_m;
    if !stays_off_the_floor {
        return Err(Refusal::Sinks { loss_m, room_m: room.below_m });
    }
    // The weakest decides: what a weak vehicle has learned would carry the others to the net.
    let apex_m = report.cases.iter().fold(f64::INFINITY, |least, case| least.min(case.apex_m));
    let stays_off_the_net = apex_m <= room.above_m;
    if !stays_off_the_net {
        return Err(Refusal::Climbs { apex_m, room_m: room.above_m });
    }
    Ok(Forecast { duration_s: primitive.duration_s(), height_loss_m: loss_m })
}
