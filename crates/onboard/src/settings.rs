//! Every number of the firmware, with the paper's vehicle as an example.

use core::fmt;

use device::vehicle_link::ChannelMap;
use maneuver::Integral;
use quantity::{GRAVITY_M_S2, Span};

/// Ticks of the rate loop per second.
pub const LOOP_HZ: f64 = maneuver::LOOP_HZ;

/// The time between two ticks.
pub const TICK: Span = Span::from_micros(1_250);

/// Body and propulsion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airframe {
    /// Mass with battery.
    pub mass_kg: f64,
    /// Distance from the centre of mass to a propeller's axis.
    pub arm_m: f64,
    /// Moments of inertia about the body's x (roll), y (pitch) and z (yaw) axes.
    pub inertia_kg_m2: [f64; 3],
    /// Least thrust one propeller is ever commanded while motors are on.
    pub thrust_n_min: f64,
    /// Greatest thrust one propeller is ever commanded.
    pub thrust_n_max: f64,
    /// Yaw torque about +z per newton of thrust of the front and back propellers; the left and right ones
    /// turn the other way and give its opposite. Negative where front and back turn counter-clockwise seen
    /// from above.
    pub yaw_torque_per_thrust_m: f64,
    /// Thrust at motor command 200. Thrust grows with the square of the rotor speed, the command with the
    /// speed.
    pub full_command_thrust_n: f64,
    /// Per propeller (front, back, left, right), what its thrust must be multiplied by to balance the
    /// vehicle.
    pub trim_ratio: [f64; 4],
    /// Collective acceleration that, commanded, makes the vehicle hover.
    pub hover_collective_m_s2: f64,
}

/// Gains of the pitch and the roll rate loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateGains {
    /// Proportional gain P: angular acceleration per rate error.
    pub p_1_s: f64,
    /// Integral gain I: angular acceleration per integral of the rate error.
    pub i_1_s2: f64,
    /// What the integral does while a command saturates.
    pub integral: Integral,
}

impl RateGains {
    /// The paper's gains. // Lupashin 2010, Table I.
    ///
    /// Stable with the rotor lags of Table I, rising 50 1/s and falling 25 1/s, but only just: a step of the
    /// commanded rate overshoots by 80 % and rings for 0.4 s.
    pub const TABLE_I: Self = Self { p_1_s: 240.0, i_1_s2: 3600.0, integral: Integral::Literal };

    /// A choice for normal flight with the same rotors: 30 % overshoot, no ringing after 0.16 s.
    pub const CALM: Self = Self { p_1_s: 40.0, i_1_s2: 100.0, integral: Integral::Conditional };
}

/// The rate loops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateSettings {
    /// Pitch and roll in normal flight. Whatever its rule says, the integral is also limited by
    /// `integral_rad_s2_max` there, since normal flight has no end at which it would start anew.
    pub flight: RateGains,
    /// Pitch and roll in a maneuver.
    pub maneuver: RateGains,
    /// Proportional gain of the yaw loop; it has no integral.
    pub yaw_p_1_s: f64,
    /// Greatest share of a propeller's thrust the yaw loop may ask for.
    pub yaw_thrust_n_max: f64,
    /// In normal flight, the greatest angular acceleration the integral may ask for.
    pub integral_rad_s2_max: f64,
}

/// What a flip must keep to for this vehicle to fly it, whoever designed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ManeuverLimits {
    /// Least collective acceleration of any step.
    pub collective_m_s2_min: f64,
    /// Greatest collective acceleration of any step.
    pub collective_m_s2_max: f64,
    /// Greatest commanded rate, either way.
    pub rate_rad_s_max: f64,
    /// Greatest duration of the whole.
    pub duration_s_max: f64,
    /// How far the set's lever may be from this vehicle's own, as a ratio above one, either way.
    pub lever_ratio_max: f64,
}

/// What must hold for a maneuver to begin, as far as the vehicle can know it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartGate {
    /// Least battery voltage.
    pub battery_v_min: f64,
    /// Least height above the floor.
    pub height_m_min: f64,
    /// Greatest tilt.
    pub tilt_rad_max: f64,
    /// Greatest vertical speed, either way.
    pub vertical_speed_m_s_max: f64,
}

/// What ends a maneuver early when it lasts for `persistence`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ManeuverGuard {
    /// Roll or yaw rate above this.
    pub off_axis_rate_rad_s_max: f64,
    /// Pitch rate above this.
    pub pitch_rate_rad_s_max: f64,
    /// Pitch rate further than this from its command.
    pub rate_error_rad_s_max: f64,
    /// For how long.
    pub persistence: Span,
}

/// What the vehicle does when commands stop, and when it lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FailsafeSettings {
    /// Up to this age a command is fresh.
    pub fresh: Span,
    /// Over this age the vehicle levels itself.
    pub level_after: Span,
    /// Over this age it descends.
    pub descend_after: Span,
    /// The clock of the two above stands still until this long after a maneuver's planned end.
    pub maneuver_grace: Span,
    /// Frames in a row, each fresh, that bring a vehicle back from a descent nobody ordered.
    pub resume_frames: u8,
    /// Speed of a descent close to the floor,
    pub descent_m_s: f64,
    /// and the greatest on the way there.
    pub high_descent_m_s_max: f64,
    /// Motors stop once a descent has lasted its height by `descent_m_s`, and this much more,
    pub land_timer_margin: Span,
    /// but not later than this.
    pub land_timer_max: Span,
    /// Collective of a descent where the vertical speed is not known, by that of hover.
    pub blind_descent_ratio: f64,
    /// Below this height an order to disarm is obeyed; above it, it is flown as a descent.
    pub disarm_height_m_max: f64,
    /// A command whose collective is below this is a pilot's stick at rest: only after such a one may motors
    /// start.
    pub rest_collective_m_s2_max: f64,
    /// After an aborted maneuver, how long the vehicle may take to level itself before commands are flown
    /// again.
    pub recovery_max: Span,
    /// Motors stop after this long without a usable gyro reading.
    pub gyro_loss_max: Span,
}

/// The vehicle's own attitude and height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSettings {
    /// How much of the difference to the ground's hint each frame corrects, 0 to 1.
    pub hint_weight_ratio: f64,
    /// A hint further away than this is taken whole: the vehicle has lost its way.
    pub hint_snap_rad: f64,
    /// No hint is used while the vehicle turns faster than this: it would come too late.
    pub hint_rate_rad_s_max: f64,
    /// Rate per tilt of the vehicle's own levelling.
    pub level_gain_1_s: f64,
    /// Greatest rate of the vehicle's own levelling.
    pub level_rate_rad_s_max: f64,
    /// Vertical acceleration per error of vertical speed in a descent.
    pub descent_gain_1_s: f64,
    /// Horizontal speed felt by its drag.
    pub drift: DriftSettings,
}

/// How the vehicle feels its horizontal speed, and brakes it when it is left alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftSettings {
    /// Deceleration by drag per speed. Small quadrotors have 0.2 to 0.5 1/s; within a factor of two the
    /// vehicle brakes well.
    pub drag_1_s: f64,
    /// How fast the speed follows the drag felt.
    pub follow_1_s: f64,
    /// How fast the tilt follows it, while there are no hints: the square of a frequency.
    pub tilt_1_s2: f64,
    /// How fast the gyros' error follows the tilt's.
    pub gyro_bias_1_s: f64,
    /// No greater speed is believed in.
    pub speed_m_s_max: f64,
    /// Time over which the accelerometers' error across is averaged.
    pub bias_time_s: f64,
    /// Deceleration wanted per speed.
    pub brake_1_s: f64,
    /// Greatest tilt of braking,
    pub brake_rad_max: f64,
    /// and close to the floor, where the feet shall come down together.
    pub low_brake_rad_max: f64,
}

/// All of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirmwareSettings {
    /// The vehicle's address on both links.
    pub vehicle: u8,
    /// How command frames lie on the channels.
    pub channel_map: ChannelMap,
    /// Body and propulsion.
    pub airframe: Airframe,
    /// The rate loops.
    pub rates: RateSettings,
    /// Limits of a parameter set.
    pub limits: ManeuverLimits,
    /// Conditions of a start.
    pub gate: StartGate,
    /// Conditions of an early end.
    pub guard: ManeuverGuard,
    /// Loss of commands, landing.
    pub failsafe: FailsafeSettings,
    /// Attitude and height.
    pub attitude: AttitudeSettings,
}

/// A setting no vehicle can fly with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingsError {
    /// Which.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// What it should be.
    pub wanted: &'static str,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "firmware setting {}: {} should be {}", self.field, self.value, self.wanted)
    }
}

impl core::error::Error for SettingsError {}

impl FailsafeSettings {
    /// The default times of the failsafe ladder, and how a vehicle left alone comes down.
    pub const LADDER: Self = Self {
        fresh: Span::from_millis(60),
        level_after: Span::from_millis(100),
        descend_after: Span::from_millis(500),
        maneuver_grace: Span::from_millis(100),
        resume_frames: 3,
        descent_m_s: 1.0,
        high_descent_m_s_max: 2.0,
        land_timer_margin: Span::from_secs(2),
        land_timer_max: Span::from_secs(10),
        blind_descent_ratio: 0.97,
        disarm_height_m_max: 0.5,
        rest_collective_m_s2_max: 1.0,
        recovery_max: Span::from_millis(800),
        gyro_loss_max: Span::from_millis(500),
    };
}

impl FirmwareSettings {
    /// The paper's vehicle (Lupashin 2010, Table I) with three lithium-polymer cells and the failsafe's
    /// default times.
    #[must_use]
    pub const fn table_i(vehicle: u8) -> Self {
        Self {
            vehicle,
            channel_map: ChannelMap::Full,
            airframe: Airframe {
                mass_kg: 0.468,
                arm_m: 0.17,
                inertia_kg_m2: [0.0023, 0.0023, 0.004],
                thrust_n_min: 0.08,
                thrust_n_max: 2.8,
                yaw_torque_per_thrust_m: 0.016,
                full_command_thrust_n: 2.8,
                trim_ratio: [1.0; 4],
                hover_collective_m_s2: GRAVITY_M_S2,
            },
            rates: RateSettings {
                flight: RateGains::TABLE_I,
                maneuver: RateGains::TABLE_I,
                yaw_p_1_s: 10.0,
                yaw_thrust_n_max: 0.2,
                integral_rad_s2_max: 60.0,
            },
            limits: ManeuverLimits {
                collective_m_s2_min: 0.68,
                collective_m_s2_max: 23.9,
                rate_rad_s_max: 31.415_926_535_897_93,
                duration_s_max: 4.0,
                lever_ratio_max: 2.0,
            },
            gate: StartGate {
                battery_v_min: 10.5,
                height_m_min: 4.0,
                tilt_rad_max: 0.087_266_462_599_716_48,
                vertical_speed_m_s_max: 0.2,
            },
            guard: ManeuverGuard {
                off_axis_rate_rad_s_max: 10.0,
                pitch_rate_rad_s_max: 38.0,
                rate_error_rad_s_max: 15.0,
                persistence: Span::from_millis(100),
            },
            failsafe: FailsafeSettings::LADDER,
            attitude: AttitudeSettings {
                hint_weight_ratio: 0.3,
                hint_snap_rad: 0.35,
                hint_rate_rad_s_max: 8.0,
                level_gain_1_s: 6.0,
                level_rate_rad_s_max: 6.0,
                descent_gain_1_s: 2.0,
                drift: DriftSettings {
                    drag_1_s: 0.25,
                    follow_1_s: 2.0,
                    tilt_1_s2: 1.0,
                    gyro_bias_1_s: 0.15,
                    speed_m_s_max: 8.0,
                    bias_time_s: 30.0,
                    brake_1_s: 2.0,
                    brake_rad_max: 0.6,
                    low_brake_rad_max: 0.12,
                },
            },
        }
    }

    /// This vehicle's own alpha times L: collective acceleration by angular acceleration.
    // Lupashin 2010, section III.
    #[must_use]
    pub fn lever_m(&self) -> f64 {
        2.0 * self.airframe.inertia_kg_m2[1] / (self.airframe.mass_kg * self.airframe.arm_m)
    }

    /// Refuses what nothing can fly with.
    ///
    /// # Errors
    /// [`SettingsError`] names the first field at fault.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.check_positive()?;
        self.check_ranges()
    }

    fn check_positive(&self) -> Result<(), SettingsError> {
        let Self { airframe, rates, limits, guard, failsafe, attitude, .. } = self;
        let positive = [
            ("airframe.mass_kg", airframe.mass_kg),
            ("airframe.arm_m", airframe.arm_m),
            ("airframe.inertia_kg_m2[0]", airframe.inertia_kg_m2[0]),
            ("airframe.inertia_kg_m2[1]", airframe.inertia_kg_m2[1]),
            ("airframe.inertia_kg_m2[2]", airframe.inertia_kg_m2[2]),
            ("airframe.thrust_n_min", airframe.thrust_n_min),
            ("airframe.full_command_thrust_n", airframe.full_command_thrust_n),
            ("airframe.trim_ratio[0]", airframe.trim_ratio[0]),
            ("airframe.trim_ratio[1]", airframe.trim_ratio[1]),
            ("airframe.trim_ratio[2]", airframe.trim_ratio[2]),
            ("airframe.trim_ratio[3]", airframe.trim_ratio[3]),
            ("rates.flight.p_1_s", rates.flight.p_1_s),
            ("rates.flight.i_1_s2", rates.flight.i_1_s2),
            ("rates.maneuver.p_1_s", rates.maneuver.p_1_s),
            ("rates.maneuver.i_1_s2", rates.maneuver.i_1_s2),
            ("rates.yaw_p_1_s", rates.yaw_p_1_s),
            ("rates.yaw_thrust_n_max", rates.yaw_thrust_n_max),
            ("rates.integral_rad_s2_max", rates.integral_rad_s2_max),
            ("limits.rate_rad_s_max", limits.rate_rad_s_max),
            ("limits.duration_s_max", limits.duration_s_max),
            ("guard.off_axis_rate_rad_s_max", guard.off_axis_rate_rad_s_max),
            ("guard.pitch_rate_rad_s_max", guard.pitch_rate_rad_s_max),
            ("guard.rate_error_rad_s_max", guard.rate_error_rad_s_max),
            ("guard.persistence", guard.persistence.as_secs_f64()),
            ("failsafe.fresh", failsafe.fresh.as_secs_f64()),
            ("failsafe.descent_m_s", failsafe.descent_m_s),
            ("failsafe.land_timer_max", failsafe.land_timer_max.as_secs_f64()),
            ("failsafe.gyro_loss_max", failsafe.gyro_loss_max.as_secs_f64()),
            ("attitude.hint_weight_ratio", attitude.hint_weight_ratio),
            ("attitude.level_gain_1_s", attitude.level_gain_1_s),
            ("attitude.level_rate_rad_s_max", attitude.level_rate_rad_s_max),
            ("attitude.descent_gain_1_s", attitude.descent_gain_1_s),
            ("attitude.drift.drag_1_s", attitude.drift.drag_1_s),
            ("attitude.drift.follow_1_s", attitude.drift.follow_1_s),
            ("attitude.drift.tilt_1_s2", attitude.drift.tilt_1_s2),
            ("attitude.drift.gyro_bias_1_s", attitude.drift.gyro_bias_1_s),
            ("attitude.drift.speed_m_s_max", attitude.drift.speed_m_s_max),
            ("attitude.drift.bias_time_s", attitude.drift.bias_time_s),
            ("attitude.drift.brake_1_s", attitude.drift.brake_1_s),
            ("attitude.drift.brake_rad_max", attitude.drift.brake_rad_max),
            ("attitude.drift.low_brake_rad_max", attitude.drift.low_brake_rad_max),
        ];
        match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((field, value)) => {
                Err(SettingsError { field, value: *value, wanted: "positive and finite" })
            }
            None => Ok(()),
        }
    }

    fn check_ranges(&self) -> Result<(), SettingsError> {
        let Self { airframe, limits, failsafe, attitude, .. } = self;
        let require = |field, value, holds: bool, wanted| {
            if holds { Ok(()) } else { Err(SettingsError { field, value, wanted }) }
        };
        let (least_n, greatest_n) = (airframe.thrust_n_min, airframe.thrust_n_max);
        require(
            "airframe.thrust_n_max",
            greatest_n,
            greatest_n > least_n && greatest_n <= airframe.full_command_thrust_n * 1.000_001,
            "above thrust_n_min and not above full_command_thrust_n",
        )?;
        let hover = airframe.hover_collective_m_s2;
        let hover_n = hover * airframe.mass_kg / 4.0;
        let in_range = hover_n > least_n && hover_n < greatest_n;
        require("airframe.hover_collective_m_s2", hover, in_range, "within the thrust range")?;
        let yaw = airframe.yaw_torque_per_thrust_m;
        let turns = yaw.is_finite() && yaw != 0.0;
        require("airframe.yaw_torque_per_thrust_m", yaw, turns, "finite and not zero")?;
        let (low, high) = (limits.collective_m_s2_min, limits.collective_m_s2_max);
        require(
            "limits.collective_m_s2_max",
            high,
            high.is_finite() && high > low && low >= 0.0,
            "above a collective_m_s2_min that is not negative",
        )?;
        let lever_ratio = limits.lever_ratio_max;
        require("limits.lever_ratio_max", lever_ratio, lever_ratio >= 1.0, "at least 1")?;
        require(
            "failsafe.level_after",
            failsafe.level_after.as_secs_f64(),
            failsafe.fresh <= failsafe.level_after && failsafe.level_after <= failsafe.descend_after,
            "between fresh and descend_after",
        )?;
        let blind = failsafe.blind_descent_ratio;
        let sinks = blind > 0.5 && blind < 1.0;
        require("failsafe.blind_descent_ratio", blind, sinks, "between 0.5 and 1")?;
        let weight = attitude.hint_weight_ratio;
        require("attitude.hint_weight_ratio", weight, weight <= 1.0, "at most 1")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_vehicle_can_fly_and_a_field_at_fault_is_named() {
        let good = FirmwareSettings::table_i(1);
        assert_eq!(good.check(), Ok(()));
        assert!((good.lever_m() - 0.057_818).abs() < 5e-7);
        let mut heavy = good;
        heavy.airframe.hover_collective_m_s2 = 30.0;
        assert_eq!(heavy.check().unwrap_err().field, "airframe.hover_collective_m_s2");
        let mut unknown = good;
        unknown.airframe.mass_kg = f64::NAN;
        assert_eq!(unknown.check().unwrap_err().field, "airframe.mass_kg");
        let mut hasty = good;
        hasty.failsafe.level_after = Span::from_millis(600);
        assert_eq!(hasty.check().unwrap_err().field, "failsafe.level_after");
        let mut straight = good;
        straight.airframe.yaw_torque_per_thrust_m = 0.0;
        assert_eq!(straight.check().unwrap_err().field, "airframe.yaw_torque_per_thrust_m");
    }
}
