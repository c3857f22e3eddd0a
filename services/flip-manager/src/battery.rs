//! Battery voltage at rest, from what is reported under load.

use quantity::{Time, math};
use schemas::FlightMode;
use settings::Battery;

use crate::tuning::BatteryTuning;

/// How a vehicle draws on its battery at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Load {
    /// Motors off.
    None,
    /// A steady hover.
    Hover,
    /// Anything else: no voltage at rest follows from it.
    Other,
}

impl Load {
    /// The load of a vehicle in that mode, hovering steadily or not.
    pub(crate) fn of(mode: FlightMode, hovers: bool) -> Self {
        match mode {
            FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped => Self::None,
            FlightMode::Flying if hovers => Self::Hover,
            FlightMode::Flying | FlightMode::Maneuver | FlightMode::LevelHold | FlightMode::Descend => {
                Self::Other
            }
        }
    }
}

/// Voltage at rest, smoothed over the reports made under a known load.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RestVoltage {
    smoothed: Option<(Time, f64)>,
}

impl RestVoltage {
    /// Takes a report.
    pub(crate) fn take(
        &mut self,
        at: Time,
        battery_v: f64,
        load: Load,
        battery: &Battery,
        tuning: &BatteryTuning,
    ) {
        let at_rest_v = match load {
            Load::None => battery_v,
            Load::Hover => battery_v + battery.hover_sag_v,
            Load::Other => return,
        };
        let value_v = match self.smoothed {
            None => at_rest_v,
            Some((before, _)) if at <= before => return,
            Some((before, value_v)) => {
                let kept = math::exp(-(at - before).as_secs_f64() / tuning.smoothing_s);
                at_rest_v + (value_v - at_rest_v) * kept
            }
        };
        self.smoothed = Some((at, value_v));
    }

    /// The voltage; `None` before the first report.
    pub(crate) fn volts(&self) -> Option<f64> {
        self.smoothed.map(|(_, volts)| volts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quantity::Span;

    #[test]
    fn a_hover_is_compensated_and_other_loads_are_not_believed() {
        let tuning = BatteryTuning { smoothing_s: 1.0 };
        let battery = Battery { flip_v_min: 10.0, land_v_min: 9.7, hover_sag_v: 0.3 };
        let at = |millis| Time::ZERO + Span::from_millis(millis);
        let mut rest = RestVoltage::default();
        rest.take(at(0), 9.0, Load::Other, &battery, &tuning);
        assert_eq!(rest.volts(), None);
        rest.take(at(0), 12.0, Load::None, &battery, &tuning);
        for millis in (50..10_000).step_by(50) {
            rest.take(at(millis), 11.7, Load::Hover, &battery, &tuning);
        }
        assert!((rest.volts().unwrap() - 12.0).abs() < 1e-9);
        rest.take(at(10_000), 9.0, Load::Other, &battery, &tuning);
        assert!((rest.volts().unwrap() - 12.0).abs() < 1e-9);
        rest.take(at(11_000), 10.7, Load::Hover, &battery, &tuning);
        assert!((rest.volts().unwrap() - (11.0 + math::exp(-1.05))).abs() < 1e-6);
    }
}
