//! A vehicle's report of itself, in the arena's units and on the arena's clock.

use device::vehicle_link::{FlightMode as LinkMode, ManeuverPhase as LinkPhase, Status};
use quantity::Time;
use schemas::{FlightMode, ManeuverPhase, VehicleTelemetry};

use crate::clock::VehicleClock;

/// The report as it goes on the bus.
pub(crate) fn report(
    vehicle: u8,
    status: &Status,
    received_at: Time,
    clock: &VehicleClock,
    link_delay_s: f64,
) -> VehicleTelemetry {
    // Zero stands for "never" on the vehicle's clock and on ours.
    let at = |vehicle_us| {
        if vehicle_us == 0 { Time::ZERO } else { clock.at(vehicle_us).unwrap_or(Time::ZERO) }
    };
    VehicleTelemetry {
        vehicle,
        mode: mode(status.mode),
        maneuver_phase: phase(status.maneuver_phase),
        reason: status.reason as u8,
        maneuver_id: status.maneuver_id,
        set_id: status.set_id,
        set_digest: status.set_digest,
        received_at,
        began_at: at(status.began_us),
        ended_at: at(status.ended_us),
        clock_uncertainty_s: clock.uncertainty_s(received_at),
        battery_v: f64::from(status.battery_mv) * 1e-3,
        command_age_s: f64::from(status.command_age_ms) * 1e-3,
        link_delay_s,
    }
}

const fn mode(mode: LinkMode) -> FlightMode {
    match mode {
        LinkMode::Disarmed => FlightMode::Disarmed,
        LinkMode::Flying => FlightMode::Flying,
        LinkMode::Maneuver => FlightMode::Maneuver,
        LinkMode::LevelHold => FlightMode::LevelHold,
        LinkMode::Descend => FlightMode::Descend,
        LinkMode::Landed => FlightMode::Landed,
        LinkMode::Stopped => FlightMode::Stopped,
    }
}

const fn phase(phase: LinkPhase) -> ManeuverPhase {
    match phase {
        LinkPhase::None => ManeuverPhase::None,
        LinkPhase::Running => ManeuverPhase::Running,
        LinkPhase::Completed => ManeuverPhase::Completed,
        LinkPhase::Aborted => ManeuverPhase::Aborted,
        LinkPhase::Refused => ManeuverPhase::Refused,
    }
}
