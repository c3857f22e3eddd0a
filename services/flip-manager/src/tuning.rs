//! The flip manager's section of `services.toml`.

use serde::Deserialize;
use settings::ConfigError;

/// `[flip-manager]`: all of it has defaults.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// What must hold before a flip begins.
    pub gate: GateTuning,
    /// Repetitions and patience.
    pub timing: TimingTuning,
    /// What ends a flip early.
    pub watch: WatchTuning,
    /// How a flip's end is recovered from motion capture.
    pub measure: MeasureTuning,
    /// The battery's voltage at rest.
    pub battery: BatteryTuning,
    /// What a take-off asks of the recording.
    pub recording: RecordingTuning,
}

/// `[flip-manager.gate]`: what must hold before a flip begins (hazard H13 of the safety notes).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GateTuning {
    /// Greatest distance from the place of the scenario.
    pub place_m_max: f64,
    /// The speed must be under this.
    pub speed_m_s_max: f64,
    /// The tilt must be under this.
    pub tilt_rad_max: f64,
    /// The body rate must be under this.
    pub rate_rad_s_max: f64,
    /// The estimate must be younger than this.
    pub state_age_s_max: f64,
    /// The vehicle's report must be younger than this.
    pub telemetry_age_s_max: f64,
    /// Least height above the floor.
    pub height_m_min: f64,
    /// Least height left when the worst of the learner's perturbed models comes true.
    pub floor_reserve_m_min: f64,
    /// Least distance to the net above.
    pub ceiling_m_min: f64,
    /// Least distance to the walls in the plane of the flip, both ways.
    pub wall_in_plane_m_min: f64,
    /// Least distance to the walls across the plane of the flip, both ways.
    pub wall_across_m_min: f64,
    /// Least horizontal distance to every other vehicle.
    pub neighbour_m_min: f64,
    /// How long place, speed, tilt, rate and data age must have held.
    pub steady_s: f64,
}

impl Default for GateTuning {
    fn default() -> Self {
        Self {
            place_m_max: 0.10,
            speed_m_s_max: 0.2,
            tilt_rad_max: 0.087_266,
            rate_rad_s_max: 0.5,
            state_age_s_max: 0.025,
            telemetry_age_s_max: 0.5,
            height_m_min: 4.0,
            floor_reserve_m_min: 1.5,
            ceiling_m_min: 2.0,
            wall_in_plane_m_min: 3.0,
            wall_across_m_min: 1.5,
            neighbour_m_min: 3.0,
            steady_s: 0.5,
        }
    }
}

/// `[flip-manager.timing]`: repetitions and patience.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TimingTuning {
    /// How often the phases are worked through.
    pub tick_s: f64,
    /// How often goal and status are repeated.
    pub speak_s: f64,
    /// How often a result is repeated until the learner's answer is heard.
    pub result_repeat_s: f64,
    /// A standing order not repeated for this long counts as "land".
    pub order_timeout_s: f64,
    /// An upload without the vehicle's echo is repeated after this.
    pub upload_repeat_s: f64,
    /// So many uploads without an echo, and the vehicle lands.
    pub upload_attempts_max: u32,
    /// How often a start is repeated until the vehicle reports it.
    pub start_repeat_s: f64,
    /// Each start is void after this, so that none outlives the gate it was given in.
    pub start_validity_s: f64,
    /// A start is not repeated for longer.
    pub start_s_max: f64,
    /// A flip without news is given up this long after its planned end.
    pub end_grace_s: f64,
    /// A vehicle that cannot begin its next flip for this long lands.
    pub patience_s: f64,
    /// Nobody takes off who has not been tracked without a break for this long.
    pub tracked_s_min: f64,
    /// A flying vehicle that is silent for this long lands.
    pub silence_s_max: f64,
}

impl Default for TimingTuning {
    fn default() -> Self {
        Self {
            tick_s: 0.01,
            speak_s: 0.1,
            result_repeat_s: 1.0,
            order_timeout_s: 3.0,
            upload_repeat_s: 1.0,
            upload_attempts_max: 10,
            start_repeat_s: 0.05,
            start_validity_s: 0.15,
            start_s_max: 0.5,
            end_grace_s: 1.0,
            patience_s: 60.0,
            tracked_s_min: 1.0,
            silence_s_max: 10.0,
        }
    }
}

/// `[flip-manager.watch]`: what ends a flip early, and when a vehicle counts as recovered from one.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WatchTuning {
    /// A flip that sinks below this height is ended.
    pub height_m_min: f64,
    /// A flip that leaves the hall less this margin is ended.
    pub wall_m_min: f64,
    /// A flip nobody sees for this long is ended.
    pub blind_s_max: f64,
    /// Recovered: nearer to its place than this.
    pub recovered_place_m_max: f64,
    /// Recovered: slower than this.
    pub recovered_speed_m_s_max: f64,
    /// Recovered: more level than this.
    pub recovered_tilt_rad_max: f64,
}

impl Default for WatchTuning {
    fn default() -> Self {
        Self {
            height_m_min: 1.0,
            wall_m_min: 0.5,
            blind_s_max: 0.2,
            recovered_place_m_max: 0.5,
            recovered_speed_m_s_max: 0.5,
            recovered_tilt_rad_max: 0.26,
        }
    }
}

/// `[flip-manager.measure]`: how a flip's end is recovered from motion capture.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MeasureTuning {
    /// Positions this far on either side of an instant are fitted.
    pub position_window_s: f64,
    /// Attitudes this far on either side of an instant are fitted.
    pub attitude_window_s: f64,
    /// A position further off the fit is a wrong one and left out.
    pub position_error_m_max: f64,
    /// Likewise a pitch.
    pub attitude_error_rad_max: f64,
    /// Least number of poses on each side of an instant.
    pub poses_min: u32,
    /// Poses are kept for this long.
    pub history_s: f64,
    /// So long after the end the poses must have arrived.
    pub wait_s_max: f64,
    /// Begin and end as reported may differ from the planned duration by this much.
    pub duration_error_s_max: f64,
    /// The fit of the vehicle's clock may be this uncertain.
    pub clock_uncertainty_s_max: f64,
}

impl Default for MeasureTuning {
    fn default() -> Self {
        Self {
            position_window_s: 0.06,
            attitude_window_s: 0.04,
            position_error_m_max: 0.02,
            attitude_error_rad_max: 0.15,
            poses_min: 3,
            history_s: 6.0,
            wait_s_max: 0.4,
            duration_error_s_max: 0.02,
            clock_uncertainty_s_max: 0.05,
        }
    }
}

/// `[flip-manager.battery]`: from the voltage under load to the voltage at rest.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BatteryTuning {
    /// Time constant of the smoothing.
    pub smoothing_s: f64,
}

impl Default for BatteryTuning {
    fn default() -> Self {
        Self { smoothing_s: 1.0 }
    }
}

/// `[flip-manager.recording]`: what a take-off asks of the recording, where there is one.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingTuning {
    /// Least free space on its disk, GiB.
    pub free_gib_min: f64,
    /// A word of the logger's older than this says nothing.
    pub status_age_s_max: f64,
}

impl Default for RecordingTuning {
    fn default() -> Self {
        Self { free_gib_min: 2.0, status_age_s_max: 3.0 }
    }
}

impl Tuning {
    /// Refuses what cannot be flown with.
    ///
    /// # Errors
    /// The first number outside its range.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        self.gate.check()?;
        self.timing.check()?;
        self.watch.check(&self.gate)?;
        self.measure.check()?;
        self.battery.check()?;
        self.recording.check()
    }
}

impl GateTuning {
    fn check(&self) -> Result<(), ConfigError> {
        in_ranges(
            "gate",
            &[
                ("place_m_max", self.place_m_max, 0.01, 1.0),
                ("speed_m_s_max", self.speed_m_s_max, 0.01, 1.0),
                ("tilt_rad_max", self.tilt_rad_max, 0.01, 0.5),
                ("rate_rad_s_max", self.rate_rad_s_max, 0.01, 5.0),
                ("state_age_s_max", self.state_age_s_max, 0.001, 0.1),
                ("telemetry_age_s_max", self.telemetry_age_s_max, 0.01, 5.0),
                ("height_m_min", self.height_m_min, 1.0, 100.0),
                ("floor_reserve_m_min", self.floor_reserve_m_min, 0.5, 100.0),
                ("ceiling_m_min", self.ceiling_m_min, 0.5, 100.0),
                ("wall_in_plane_m_min", self.wall_in_plane_m_min, 0.5, 100.0),
                ("wall_across_m_min", self.wall_across_m_min, 0.5, 100.0),
                ("neighbour_m_min", self.neighbour_m_min, 0.5, 100.0),
                ("steady_s", self.steady_s, 0.0, 60.0),
            ],
        )
    }
}

impl TimingTuning {
    fn check(&self) -> Result<(), ConfigError> {
        in_ranges(
            "timing",
            &[
                ("tick_s", self.tick_s, 0.001, 0.05),
                ("speak_s", self.speak_s, 0.01, 1.0),
                ("result_repeat_s", self.result_repeat_s, 0.05, 60.0),
                ("order_timeout_s", self.order_timeout_s, 0.5, 60.0),
                ("upload_repeat_s", self.upload_repeat_s, 0.05, 60.0),
                ("upload_attempts_max", f64::from(self.upload_attempts_max), 1.0, 1000.0),
                ("start_repeat_s", self.start_repeat_s, 0.01, 1.0),
                ("start_validity_s", self.start_validity_s, 0.02, 1.0),
                ("start_s_max", self.start_s_max, 0.02, 5.0),
                ("end_grace_s", self.end_grace_s, 0.1, 60.0),
                ("patience_s", self.patience_s, 1.0, 3600.0),
                ("tracked_s_min", self.tracked_s_min, 0.0, 60.0),
                ("silence_s_max", self.silence_s_max, 0.5, 3600.0),
            ],
        )
    }
}

impl WatchTuning {
    fn check(&self, gate: &GateTuning) -> Result<(), ConfigError> {
        in_ranges(
            "watch",
            &[
                ("height_m_min", self.height_m_min, 0.2, 100.0),
                ("wall_m_min", self.wall_m_min, 0.0, 50.0),
                ("blind_s_max", self.blind_s_max, 0.02, 5.0),
                ("recovered_place_m_max", self.recovered_place_m_max, gate.place_m_max, 10.0),
                ("recovered_speed_m_s_max", self.recovered_speed_m_s_max, gate.speed_m_s_max, 5.0),
                ("recovered_tilt_rad_max", self.recovered_tilt_rad_max, gate.tilt_rad_max, 1.5),
            ],
        )
    }
}

impl MeasureTuning {
    fn check(&self) -> Result<(), ConfigError> {
        in_ranges(
            "measure",
            &[
                ("position_window_s", self.position_window_s, 0.01, 0.5),
                ("attitude_window_s", self.attitude_window_s, 0.01, 0.5),
                ("position_error_m_max", self.position_error_m_max, 0.001, 1.0),
                ("attitude_error_rad_max", self.attitude_error_rad_max, 0.01, 1.0),
                ("poses_min", f64::from(self.poses_min), 3.0, 100.0),
                ("history_s", self.history_s, 3.0, 60.0),
                ("wait_s_max", self.wait_s_max, self.position_window_s, 5.0),
                ("duration_error_s_max", self.duration_error_s_max, 0.001, 1.0),
                ("clock_uncertainty_s_max", self.clock_uncertainty_s_max, 0.001, 1.0),
            ],
        )
    }
}

impl BatteryTuning {
    fn check(&self) -> Result<(), ConfigError> {
        in_ranges("battery", &[("smoothing_s", self.smoothing_s, 0.01, 100.0)])
    }
}

impl RecordingTuning {
    fn check(&self) -> Result<(), ConfigError> {
        in_ranges(
            "recording",
            &[
                ("free_gib_min", self.free_gib_min, 0.0, 1_000_000.0),
                ("status_age_s_max", self.status_age_s_max, 0.5, 60.0),
            ],
        )
    }
}

/// Refuses the first number outside its range; one that is not a number is outside every range.
fn in_ranges(section: &str, rows: &[(&str, f64, f64, f64)]) -> Result<(), ConfigError> {
    match rows.iter().find(|(_, value, min, max)| !(*min..=*max).contains(value)) {
        None => Ok(()),
        Some(&(key, value, min, max)) => Err(ConfigError::OutOfRange {
            file: "services.toml".to_owned(),
            key: format!("[flip-manager.{section}] {key}"),
            value,
            min,
            max,
        }),
    }
}
