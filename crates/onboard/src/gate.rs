//! What must hold for a maneuver to begin, as far as the vehicle itself can know it.

use device::vehicle_link::{CommandMode, FlightMode, Reason};
use maneuver::Primitive;
use quantity::Time;

use crate::attitude::OwnState;
use crate::command_generator::{StartOrder, admit};
use crate::failsafe::Supervisor;
use crate::parameters::ParameterStore;
use crate::sensors::Sensors;
use crate::settings::FirmwareSettings;

/// The vehicle at the moment of an order.
pub(crate) struct Moment<'a> {
    /// On the vehicle's clock.
    pub now: Time,
    /// Mode and commands.
    pub supervisor: &'a Supervisor,
    /// The active set.
    pub store: &'a ParameterStore,
    /// Battery, gyros.
    pub sensors: &'a Sensors,
    /// Attitude and height.
    pub own: &'a OwnState,
}

impl Moment<'_> {
    /// The flip to begin, or why not.
    pub fn judge(&self, order: &StartOrder, settings: &FirmwareSettings) -> Result<Primitive, Reason> {
        let command = self.supervisor.command().map(|received| received.frame.mode);
        if self.supervisor.mode() != FlightMode::Flying || command != Some(CommandMode::Fly) {
            return Err(Reason::NotFlying);
        }
        if !self.supervisor.command_fresh(self.now, &settings.failsafe) {
            return Err(Reason::CommandStale);
        }
        let active = self.store.active().ok_or(Reason::WrongSet)?;
        if (active.id, active.digest) != (order.set_id, order.digest) {
            return Err(Reason::WrongSet);
        }
        let primitive = admit(active.items(), settings).ok_or(Reason::OutsideLimits)?;
        self.judge_state(settings)?;
        Ok(primitive)
    }

    fn judge_state(&self, settings: &FirmwareSettings) -> Result<(), Reason> {
        let gate = &settings.gate;
        if self.sensors.gyro_lost_for(self.now).is_some() {
            return Err(Reason::SensorFault);
        }
        // Written so that what is no number is refused.
        let require = |holds: bool, reason| if holds { Ok(()) } else { Err(reason) };
        require(self.sensors.battery_v() >= gate.battery_v_min, Reason::BatteryLow)?;
        let tilt_rad = self.own.tilt_rad().ok_or(Reason::StateUnknown)?;
        let vertical = self.own.vertical().ok_or(Reason::StateUnknown)?;
        require(vertical.height_m >= gate.height_m_min, Reason::Height)?;
        require(tilt_rad <= gate.tilt_rad_max, Reason::Tilt)?;
        require(vertical.speed_m_s.abs() <= gate.vertical_speed_m_s_max, Reason::VerticalSpeed)
    }
}
