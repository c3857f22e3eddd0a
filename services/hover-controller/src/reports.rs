//! What the vehicle says of itself, as far as its controller must know.

use quantity::{Span, Time};
use schemas::{FlightMode, ManeuverPhase, VehicleTelemetry};

/// A vehicle's reports.
#[derive(Clone, Debug)]
pub(crate) struct Reports {
    fresh: Span,
    maneuver_max: Span,
    voltage_time_s: f64,
    sag_v: f64,
    land_v_min: f64,
    newest: Option<(Time, FlightMode)>,
    running: Option<(u16, Time)>,
    ended: Option<u16>,
    voltage_v: Option<f64>,
    low: bool,
}

impl Reports {
    /// No report yet. A report of the mode counts for `fresh`, a maneuver lasts at most `maneuver_max`; the
    /// battery is low when its average voltage plus `sag_v` falls below `land_v_min`.
    pub fn new(fresh: Span, maneuver_max: Span, voltage_time_s: f64, sag_v: f64, land_v_min: f64) -> Self {
        Self {
            fresh,
            maneuver_max,
            voltage_time_s,
            sag_v,
            land_v_min,
            newest: None,
            running: None,
            ended: None,
            voltage_v: None,
            low: false,
        }
    }

    /// Takes a report.
    pub fn take(&mut self, now: Time, telemetry: &VehicleTelemetry) {
        let id = telemetry.maneuver_id;
        match telemetry.maneuver_phase {
            ManeuverPhase::Running
                if self.ended != Some(id) && self.running.is_none_or(|(running, _)| running != id) =>
            {
                self.running = Some((id, telemetry.began_at.min(now)));
            }
            ManeuverPhase::Completed | ManeuverPhase::Aborted => {
                self.ended = Some(id);
                self.running = None;
            }
            _ => {}
        }
        self.average_voltage(now, telemetry.battery_v);
        self.newest = Some((now, telemetry.mode));
    }

    fn average_voltage(&mut self, now: Time, voltage_v: f64) {
        // A flip draws the voltage down for its while: that says nothing of the charge.
        if !(voltage_v.is_finite() && voltage_v > 0.0) || self.in_maneuver(now) {
            return;
        }
        let span_s = self.newest.map_or(0.0, |(at, _)| (now - at).as_secs_f64());
        let before = self.voltage_v.unwrap_or(voltage_v);
        let share = (span_s / self.voltage_time_s).clamp(0.0, 1.0);
        let average = before + share * (voltage_v - before);
        self.voltage_v = Some(average);
        // Latched: voltage that recovers at rest would start the flight again.
        self.low |= average + self.sag_v < self.land_v_min;
    }

    /// Whether a maneuver runs.
    pub fn in_maneuver(&self, now: Time) -> bool {
        self.running.is_some_and(|(_, began_at)| now < began_at.saturating_add(self.maneuver_max))
    }

    /// What the firmware does, if it said so lately.
    pub fn mode(&self, now: Time) -> Option<FlightMode> {
        self.newest.filter(|(at, _)| now - *at <= self.fresh).map(|(_, mode)| mode)
    }

    /// Whether the motors turn, by a report that came after `since`.
    pub fn motors_on(&self, now: Time, since: Time) -> Option<bool> {
        let (at, _) = self.newest?;
        let mode = self.mode(now).filter(|_| at > since)?;
        Some(!matches!(mode, FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped))
    }

    /// Whether the motors are off until a person releases them.
    pub fn latched(&self, now: Time) -> bool {
        matches!(self.mode(now), Some(FlightMode::Landed | FlightMode::Stopped))
    }

    /// Whether the battery was found too low to fly on.
    pub fn battery_low(&self) -> bool {
        self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    fn report(phase: ManeuverPhase, battery_v: f64) -> VehicleTelemetry {
        VehicleTelemetry {
            mode: FlightMode::Flying,
            maneuver_phase: phase,
            maneuver_id: 3,
            began_at: ms(1000),
            battery_v,
            ..VehicleTelemetry::default()
        }
    }

    fn reports() -> Reports {
        Reports::new(Span::from_millis(500), Span::from_secs(4), 2.0, 0.3, 9.9)
    }

    #[test]
    fn maneuvers_run_until_their_end_is_told_or_overdue() {
        let mut reports = reports();
        reports.take(ms(1010), &report(ManeuverPhase::Running, 11.0));
        assert!(reports.in_maneuver(ms(4999)) && !reports.in_maneuver(ms(5000)));
        reports.take(ms(2100), &report(ManeuverPhase::Completed, 11.0));
        assert!(!reports.in_maneuver(ms(2100)));
        reports.take(ms(2101), &report(ManeuverPhase::Running, 11.0));
        assert!(!reports.in_maneuver(ms(2101)), "an overtaken report");
    }

    #[test]
    fn a_dip_is_not_an_empty_battery() {
        let mut reports = reports();
        for k in 0..100 {
            reports.take(ms(50 * k), &report(ManeuverPhase::None, 10.0));
        }
        reports.take(ms(5000), &report(ManeuverPhase::None, 8.0));
        assert!(!reports.battery_low());
        for k in 101..200 {
            reports.take(ms(50 * k), &report(ManeuverPhase::None, 9.5));
        }
        assert!(reports.battery_low());
        for k in 200..300 {
            reports.take(ms(50 * k), &report(ManeuverPhase::None, 11.0));
        }
        assert!(reports.battery_low(), "latched");
    }

    #[test]
    fn modes_age() {
        let mut reports = reports();
        reports.take(ms(100), &VehicleTelemetry { mode: FlightMode::Landed, ..VehicleTelemetry::default() });
        assert!(reports.latched(ms(600)) && !reports.latched(ms(601)));
    }
}
