//! The battery: charge, voltage under load, and how much of the greatest thrust is left.

use quantity::math;
use settings::BatterySettings;

use crate::rotor::power;

/// A battery under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Battery {
    settings: BatterySettings,
    charge_ratio: f64,
    /// Power drawn by full power, averaged over the droop's time constant.
    strain_ratio: f64,
    /// Power drawn by full power in a hover.
    hover_power_ratio: f64,
    /// Slope of the fade below the knee; above, it is a quarter.
    fade_slope: f64,
    /// Loss at the knee.
    knee_loss_ratio: f64,
    /// Decay of the strain, and the step it holds for.
    decay: f64,
    decay_step_s: f64,
}

impl Battery {
    /// A battery charged as the settings say, in a vehicle whose hover takes `hover_thrust_ratio` of the
    /// greatest thrust.
    #[must_use]
    pub fn new(settings: &BatterySettings, hover_thrust_ratio: f64) -> Self {
        let fade_slope = settings.fade_ratio / (settings.knee_ratio + 0.25 * (1.0 - settings.knee_ratio));
        Self {
            charge_ratio: settings.initial_charge_ratio,
            strain_ratio: 0.0,
            hover_power_ratio: power(hover_thrust_ratio),
            fade_slope,
            knee_loss_ratio: 0.25 * fade_slope * (1.0 - settings.knee_ratio),
            decay: 1.0,
            decay_step_s: 0.0,
            settings: settings.clone(),
        }
    }

    /// Draws power for a while; `power_ratio` is the power by that of four rotors at full scale.
    pub fn draw(&mut self, power_ratio: f64, span_s: f64) {
        if span_s != self.decay_step_s {
            self.decay = math::exp(-span_s / self.settings.droop_time_s);
            self.decay_step_s = span_s;
        }
        let used = power_ratio / self.hover_power_ratio * span_s / self.settings.hover_endurance_s;
        self.charge_ratio = (self.charge_ratio - used).max(0.0);
        self.strain_ratio = power_ratio + (self.strain_ratio - power_ratio) * self.decay;
    }

    /// Charge left, 1 when full.
    #[must_use]
    pub fn charge_ratio(&self) -> f64 {
        self.charge_ratio
    }

    /// Sets the charge, for tests and for starting an experiment late.
    pub fn set_charge_ratio(&mut self, charge_ratio: f64) {
        self.charge_ratio = charge_ratio.clamp(0.0, 1.0);
    }

    /// How much of the greatest thrust can be had: less after hard work, less as the charge goes.
    #[must_use]
    pub fn thrust_limit_ratio(&self) -> f64 {
        let knee = self.settings.knee_ratio;
        let fade = if self.charge_ratio >= knee {
            0.25 * self.fade_slope * (1.0 - self.charge_ratio)
        } else {
            self.knee_loss_ratio + self.fade_slope * (knee - self.charge_ratio)
        };
        (1.0 - self.settings.droop_ratio * self.strain_ratio - fade).max(0.0)
    }

    /// Voltage at the terminals under the power of `power_ratio`.
    #[must_use]
    pub fn voltage_v(&self, power_ratio: f64) -> f64 {
        let settings = &self.settings;
        let open_v = settings.empty_v + (settings.full_v - settings.empty_v) * self.charge_ratio;
        (open_v - settings.hover_sag_v * power_ratio / self.hover_power_ratio).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::member;

    const HOVER: f64 = 0.41;

    fn battery() -> Battery {
        Battery::new(&member().vehicle.plant.battery, HOVER)
    }

    #[test]
    fn hovering_empties_it_in_the_stated_time() {
        let mut battery = battery();
        for _ in 0..900 {
            battery.draw(power(HOVER), 1.0);
        }
        assert!((battery.charge_ratio() - 0.5).abs() < 1e-9);
        for _ in 0..1_000 {
            battery.draw(power(HOVER), 1.0);
        }
        assert_eq!(battery.charge_ratio(), 0.0);
    }

    #[test]
    fn full_power_droops_with_its_time_constant() {
        let mut battery = battery();
        let full = battery.thrust_limit_ratio();
        assert!((full - 1.0).abs() < 1e-12);
        for _ in 0..320 {
            battery.draw(1.0, 1.25e-3);
        }
        let fade = 0.25 * battery.fade_slope * (1.0 - battery.charge_ratio());
        let expected = 1.0 - 0.08 * (1.0 - math::exp(-1.0)) - fade;
        assert!((battery.thrust_limit_ratio() - expected).abs() < 1e-12);
        // And recovers when relieved.
        for _ in 0..4_000 {
            battery.draw(0.0, 1.25e-3);
        }
        assert!(battery.thrust_limit_ratio() > 1.0 - fade - 1e-5);
    }

    #[test]
    fn fade_is_whole_when_empty_continuous_at_the_knee_and_steeper_below() {
        let mut battery = battery();
        let mut at = |charge: f64| {
            battery.set_charge_ratio(charge);
            battery.thrust_limit_ratio()
        };
        assert!((at(0.0) - 0.88).abs() < 1e-12);
        assert!((at(0.2) - at(0.2 - 1e-12)).abs() < 1e-9);
        let (above, below) = (at(0.5) - at(0.4), at(0.15) - at(0.05));
        assert!((below / above - 4.0).abs() < 1e-9);
    }

    #[test]
    fn voltage_sags_under_load_and_sinks_with_charge() {
        let mut battery = battery();
        assert!((battery.voltage_v(0.0) - 12.6).abs() < 1e-12);
        assert!((battery.voltage_v(power(HOVER)) - 12.3).abs() < 1e-12);
        battery.set_charge_ratio(0.5);
        assert!((battery.voltage_v(0.0) - 11.1).abs() < 1e-12);
    }
}
