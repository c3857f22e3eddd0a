//! The gate: everything that must hold before a flip begins (hazard H13).

use quantity::{Time, Vector, World, math};
use schemas::{FlightMode, ManeuverPhase, Tracking, VehicleState, VehicleTelemetry};
use settings::Hall;

use crate::tuning::GateTuning;

/// Conditions not met, as in `FlipStatus::gate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unmet(pub(crate) u16);

impl Unmet {
    /// Too far from its place.
    pub(crate) const PLACE: u16 = 1;
    /// Too fast.
    pub(crate) const SPEED: u16 = 2;
    /// Too tilted, or turning too fast.
    pub(crate) const TILT: u16 = 4;
    /// No estimate, not from fresh motion capture, or too old.
    pub(crate) const AGE: u16 = 8;
    /// Battery unknown or too low.
    pub(crate) const BATTERY: u16 = 16;
    /// A wall, the net or another vehicle is too near.
    pub(crate) const CLEARANCE: u16 = 32;
    /// Too low.
    pub(crate) const HEIGHT: u16 = 64;
    /// No fresh report of the vehicle, or it is not flying commands.
    pub(crate) const TELEMETRY: u16 = 128;
    /// The predicted loss of height leaves too little, or there is no prediction because there are no
    /// parameters.
    pub(crate) const LOSS: u16 = 256;

    /// What a hover must settle before the rest is worth asking.
    const STEADINESS: u16 = Self::PLACE | Self::SPEED | Self::TILT | Self::AGE;

    /// Everything holds.
    pub(crate) fn is_open(self) -> bool {
        self.0 == 0
    }

    /// Place, speed, tilt and data age hold.
    pub(crate) fn is_steady(self) -> bool {
        self.0 & Self::STEADINESS == 0
    }
}

/// What the gate is asked about.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Situation<'a> {
    /// Now.
    pub(crate) now: Time,
    /// The newest estimate.
    pub(crate) state: Option<&'a VehicleState>,
    /// The vehicle's newest report.
    pub(crate) telemetry: Option<&'a VehicleTelemetry>,
    /// Where the flip shall begin.
    pub(crate) place_m: Vector<World>,
    /// Plane of the flip.
    pub(crate) heading_rad: f64,
    /// The hall.
    pub(crate) hall: &'a Hall,
    /// Horizontal distance to the nearest other vehicle; infinite without one.
    pub(crate) nearest_m: f64,
    /// Battery voltage at rest.
    pub(crate) rest_v: Option<f64>,
    /// No flip below.
    pub(crate) flip_v_min: f64,
    /// Loss of height predicted for the next flip.
    pub(crate) height_loss_m: Option<f64>,
}

impl GateTuning {
    /// Which conditions are not met.
    pub(crate) fn unmet(&self, situation: &Situation) -> Unmet {
        let mut bits = self.unmet_by_state(situation);
        let mut require = |bit, holds: bool| bits |= if holds { 0 } else { bit };
        require(Unmet::BATTERY, situation.rest_v.is_some_and(|volts| volts > situation.flip_v_min));
        require(
            Unmet::TELEMETRY,
            situation.telemetry.is_some_and(|report| {
                age_s(situation.now, report.received_at) < self.telemetry_age_s_max
                    && report.mode == FlightMode::Flying
                    && report.maneuver_phase != ManeuverPhase::Running
            }),
        );
        Unmet(bits)
    }

    fn unmet_by_state(&self, situation: &Situation) -> u16 {
        let Some(state) = situation.state else {
            return Unmet::STEADINESS | Unmet::CLEARANCE | Unmet::HEIGHT | Unmet::LOSS;
        };
        let at = state.estimate.position_m;
        let mut bits = 0;
        let mut require = |bit, holds: bool| bits |= if holds { 0 } else { bit };
        require(Unmet::PLACE, (at - situation.place_m).norm() <= self.place_m_max);
        require(Unmet::SPEED, state.estimate.velocity_m_s.norm() < self.speed_m_s_max);
        require(
            Unmet::TILT,
            state.estimate.orientation.tilt_rad() < self.tilt_rad_max
                && state.estimate.rate_rad_s.norm() < self.rate_rad_s_max,
        );
        require(
            Unmet::AGE,
            state.tracking == Tracking::Tracking
                && situation.now <= state.valid_until
                && age_s(situation.now, state.estimated_for) < self.state_age_s_max,
        );
        let heading = situation.heading_rad;
        let across = heading + core::f64::consts::FRAC_PI_2;
        require(
            Unmet::CLEARANCE,
            wall_distance_m(situation.hall, at, heading) >= self.wall_in_plane_m_min
                && wall_distance_m(situation.hall, at, across) >= self.wall_across_m_min
                && situation.hall.height_m - at.z >= self.ceiling_m_min
                && situation.nearest_m >= self.neighbour_m_min,
        );
        require(Unmet::HEIGHT, at.z >= self.height_m_min);
        require(
            Unmet::LOSS,
            situation.height_loss_m.is_some_and(|loss_m| at.z - loss_m >= self.floor_reserve_m_min),
        );
        bits
    }
}

/// How long ago that was.
pub(crate) fn age_s(now: Time, then: Time) -> f64 {
    (now - then).as_secs_f64()
}

/// Distance to the nearer of the two walls met by going straight ahead or straight back on that heading;
/// negative outside the hall.
fn wall_distance_m(hall: &Hall, at: Vector<World>, heading_rad: f64) -> f64 {
    let (sin, cos) = math::sin_cos(heading_rad);
    let along = |position_m: f64, extent_m: f64, slope: f64| {
        // A wall that is passed at a grazing angle is met far away, unless one is already behind it.
        let room_m = 0.5 * extent_m - position_m.abs();
        if room_m < 0.0 { room_m } else { room_m / slope.abs().max(1e-9) }
    };
    along(at.x, hall.width_m, cos).min(along(at.y, hall.depth_m, sin))
}
