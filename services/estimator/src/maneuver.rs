//! What the vehicle reports of itself: whether it flies a maneuver, and whether it listens to commands.

use quantity::{Span, Time};
use schemas::{FlightMode, ManeuverPhase, VehicleTelemetry};

/// A maneuver as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Maneuver {
    id: u16,
    began_at: Time,
    ended_at: Option<Time>,
}

/// A vehicle's reports.
#[derive(Clone, Debug)]
pub(crate) struct Reports {
    maneuver_max: Span,
    fresh: Span,
    maneuver: Option<Maneuver>,
    mode: Option<(Time, FlightMode)>,
}

impl Reports {
    /// No report yet. A maneuver lasts at most `maneuver_max`; a report of the mode counts for `fresh`.
    pub fn new(maneuver_max: Span, fresh: Span) -> Self {
        Self { maneuver_max, fresh, maneuver: None, mode: None }
    }

    /// Takes a report.
    pub fn take(&mut self, now: Time, telemetry: &VehicleTelemetry) {
        self.mode = Some((now, telemetry.mode));
        let known = self.maneuver.filter(|maneuver| maneuver.id == telemetry.maneuver_id);
        match telemetry.maneuver_phase {
            ManeuverPhase::Running => {
                // A report that was overtaken by the one of the end must not begin it again.
                if known.is_none() {
                    let began_at = telemetry.began_at.min(now);
                    self.maneuver = Some(Maneuver { id: telemetry.maneuver_id, began_at, ended_at: None });
                }
            }
            ManeuverPhase::Completed | ManeuverPhase::Aborted => {
                let began_at = known.map_or(telemetry.began_at, |maneuver| maneuver.began_at);
                let ended_at = known.and_then(|maneuver| maneuver.ended_at);
                let ended_at = Some(ended_at.unwrap_or(telemetry.ended_at.min(now)));
                self.maneuver = Some(Maneuver { id: telemetry.maneuver_id, began_at, ended_at });
            }
            ManeuverPhase::None | ManeuverPhase::Refused => {}
        }
    }

    /// When the maneuver that runs at `at` began.
    pub fn running_since(&self, at: Time) -> Option<Time> {
        let maneuver = self.maneuver?;
        let over_at = maneuver.ended_at.unwrap_or(maneuver.began_at.saturating_add(self.maneuver_max));
        (at < over_at).then_some(maneuver.began_at)
    }

    /// When the last maneuver ended, by the vehicle's report.
    pub fn ended_at(&self) -> Option<Time> {
        self.maneuver?.ended_at
    }

    /// Whether the vehicle says it does not fly what it is sent.
    pub fn deaf(&self, now: Time) -> bool {
        self.mode.is_some_and(|(at, mode)| {
            now - at <= self.fresh
                && matches!(
                    mode,
                    FlightMode::Disarmed
                        | FlightMode::LevelHold
                        | FlightMode::Descend
                        | FlightMode::Landed
                        | FlightMode::Stopped
                )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    fn report(id: u16, phase: ManeuverPhase, began_ms: i64, ended_ms: i64) -> VehicleTelemetry {
        VehicleTelemetry {
            maneuver_id: id,
            maneuver_phase: phase,
            began_at: ms(began_ms),
            ended_at: ms(ended_ms),
            mode: FlightMode::Flying,
            ..VehicleTelemetry::default()
        }
    }

    fn reports() -> Reports {
        Reports::new(Span::from_secs(4), Span::from_millis(500))
    }

    #[test]
    fn runs_from_begin_to_reported_end() {
        let mut reports = reports();
        assert_eq!(reports.running_since(ms(0)), None);
        reports.take(ms(1010), &report(7, ManeuverPhase::Running, 1000, 0));
        assert_eq!(reports.running_since(ms(2000)), Some(ms(1000)));
        reports.take(ms(2010), &report(7, ManeuverPhase::Completed, 1000, 2002));
        assert_eq!(reports.running_since(ms(2001)), Some(ms(1000)));
        assert_eq!(reports.running_since(ms(2002)), None);
        reports.take(ms(2011), &report(7, ManeuverPhase::Running, 1000, 0));
        assert_eq!(reports.running_since(ms(2011)), None, "an overtaken report");
        reports.take(ms(3010), &report(8, ManeuverPhase::Running, 3000, 0));
        assert_eq!(reports.running_since(ms(3010)), Some(ms(3000)));
    }

    #[test]
    fn an_end_nobody_reports_comes_after_four_seconds() {
        let mut reports = reports();
        reports.take(ms(1010), &report(7, ManeuverPhase::Running, 1000, 0));
        assert!(reports.running_since(ms(4999)).is_some());
        assert_eq!(reports.running_since(ms(5000)), None);
    }

    #[test]
    fn only_a_fresh_report_makes_it_deaf() {
        let mut reports = reports();
        assert!(!reports.deaf(ms(0)));
        let level = VehicleTelemetry { mode: FlightMode::LevelHold, ..VehicleTelemetry::default() };
        reports.take(ms(100), &level);
        assert!(reports.deaf(ms(600)) && !reports.deaf(ms(601)));
    }
}
