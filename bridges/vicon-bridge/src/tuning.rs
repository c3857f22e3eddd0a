//! The bridge's own settings, section `[vicon-bridge]`.

use serde::Deserialize;
use settings::ConfigError;

/// Settings of the vicon bridge.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// How long a frame waits for further datagrams after its first; default 0.002.
    pub merge_s: f64,
    /// A vehicle not reported for longer is no longer waited for; default 0.1.
    pub expect_s: f64,
    /// How often a pose may repeat bit for bit before it counts as not seen; default 0. Real cameras never
    /// repeat a pose; noise-free simulated ones do, of a vehicle at rest.
    pub identical_poses_accepted: u32,
    /// Repeats after which a pose is reported as frozen; default 5.
    pub identical_poses_reported: u32,
    /// How far outside the hall a pose may lie before it is refused; default 5.0.
    pub outside_hall_m_max: f64,
    /// Datagrams that keep coming without a new frame number for longer are reported; default 0.03.
    pub frozen_s: f64,
    /// Silence after which the stream is reported lost; default 0.1.
    pub silent_s: f64,
    /// Least time between two reports of the same kind; default 1.0.
    pub report_s: f64,
    /// Frame numbers that run on behind the newest for longer mean that the vendor's system was restarted;
    /// default 0.05.
    pub restart_s: f64,
    /// Delays up to so much above the least are taken for jitter in the fit of frame numbers to time; default
    /// 0.0005.
    pub clock_jitter_s: f64,
    /// Deviations from the fit beyond it that persist mean another frame rate or another path; default 0.001.
    pub clock_break_s: f64,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            merge_s: 0.002,
            expect_s: 0.1,
            identical_poses_accepted: 0,
            identical_poses_reported: 5,
            outside_hall_m_max: 5.0,
            frozen_s: 0.03,
            silent_s: 0.1,
            report_s: 1.0,
            restart_s: 0.05,
            clock_jitter_s: 0.0005,
            clock_break_s: 0.001,
        }
    }
}

impl Tuning {
    /// Refuses what the bridge cannot work with.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        in_range("merge_s", self.merge_s, 0.0, 0.1)?;
        in_range("expect_s", self.expect_s, 0.0, 3600.0)?;
        in_range("outside_hall_m_max", self.outside_hall_m_max, 0.0, 1000.0)?;
        in_range("frozen_s", self.frozen_s, 0.005, 10.0)?;
        in_range("silent_s", self.silent_s, 0.005, 10.0)?;
        in_range("report_s", self.report_s, 0.0, 3600.0)?;
        in_range("restart_s", self.restart_s, 0.0, 10.0)?;
        in_range("clock_jitter_s", self.clock_jitter_s, 1e-5, 0.1)?;
        in_range("clock_break_s", self.clock_break_s, 1e-4, 0.1)
    }
}

fn in_range(key: &str, value: f64, min: f64, max: f64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    let (file, key) = ("services.toml".to_owned(), format!("[vicon-bridge] {key}"));
    Err(ConfigError::OutOfRange { file, key, value, min, max })
}
