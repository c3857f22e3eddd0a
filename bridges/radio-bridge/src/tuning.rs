//! The bridge's own settings, section `[radio-bridge]`.

use serde::Deserialize;
use settings::ConfigError;

/// Settings of the radio bridge.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Time from one slot of the command link to the next; default 0.02.
    pub slot_s: f64,
    /// A command older than this is not sent; default 0.06 (three slots).
    pub command_age_s_max: f64,
    /// From a frame's arrival at the vehicle to its effect, on average: half a tick of its 800 Hz loop;
    /// default 0.000625.
    pub action_delay_s: f64,
    /// Time between two rounds of an upload; default 0.04.
    pub upload_retry_s: f64,
    /// An upload not confirmed by then has failed; default 2.0.
    pub upload_s_max: f64,
    /// Time between two repetitions of a start; default 0.03.
    pub start_retry_s: f64,
    /// Time between two repetitions of an abort; default 0.02.
    pub abort_retry_s: f64,
    /// How often an abort is sent; default 5.
    pub abort_repeats: u32,
    /// Time between two pings of a vehicle; default 0.5.
    pub ping_s: f64,
    /// Time between two pings while the fit of the vehicle's clock is young; default 0.05.
    pub ping_young_s: f64,
    /// Answers until the fit is no longer young; default 20.
    pub ping_young_answers: u32,
    /// How long an answered ping counts in the fit; default 12.0.
    pub clock_window_s: f64,
    /// Known least delay from the vehicle, less that to it; default 0.0. Differing lengths of ping and
    /// answer, and different radios, make one way slower than the other, which no exchange of stamps can
    /// show.
    pub downlink_extra_s: f64,
    /// Silence after which a vehicle's telemetry is reported lost; default 1.0.
    pub telemetry_s_max: f64,
    /// Least time between two reports of the same kind; default 1.0.
    pub report_s: f64,
    /// Whether a Crazyflie stops, locked, when the bridge is silent for a second; default false. Without it, it levels
    /// after half a second without setpoints and stops after two.
    pub crazyflie_watchdog: bool,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            slot_s: 0.02,
            command_age_s_max: 0.06,
            action_delay_s: 0.000_625,
            upload_retry_s: 0.04,
            upload_s_max: 2.0,
            start_retry_s: 0.03,
            abort_retry_s: 0.02,
            abort_repeats: 5,
            ping_s: 0.5,
            ping_young_s: 0.05,
            ping_young_answers: 20,
            clock_window_s: 12.0,
            downlink_extra_s: 0.0,
            telemetry_s_max: 1.0,
            report_s: 1.0,
            crazyflie_watchdog: false,
        }
    }
}

impl Tuning {
    /// Refuses what the bridge cannot work with.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        in_range("slot_s", self.slot_s, 0.003, 1.0)?;
        in_range("command_age_s_max", self.command_age_s_max, 0.001, 0.1)?;
        in_range("action_delay_s", self.action_delay_s, 0.0, 0.05)?;
        in_range("upload_retry_s", self.upload_retry_s, 0.005, 1.0)?;
        in_range("upload_s_max", self.upload_s_max, 0.05, 60.0)?;
        in_range("start_retry_s", self.start_retry_s, 0.005, 1.0)?;
        in_range("abort_retry_s", self.abort_retry_s, 0.005, 1.0)?;
        in_range("abort_repeats", f64::from(self.abort_repeats), 1.0, 100.0)?;
        in_range("ping_s", self.ping_s, 0.02, 10.0)?;
        in_range("ping_young_s", self.ping_young_s, 0.01, 10.0)?;
        in_range("ping_young_answers", f64::from(self.ping_young_answers), 0.0, 1000.0)?;
        in_range("clock_window_s", self.clock_window_s, 1.0, 120.0)?;
        in_range("downlink_extra_s", self.downlink_extra_s, -0.1, 0.1)?;
        in_range("telemetry_s_max", self.telemetry_s_max, 0.05, 60.0)?;
        in_range("report_s", self.report_s, 0.0, 3600.0)
    }
}

fn in_range(key: &str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    let (file, key) = ("services.toml".to_owned(), format!("[radio-bridge] {key}"));
    Err(ConfigError::OutOfRange { file, key, value, min, max })
}
