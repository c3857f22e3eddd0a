//! The form in which a command goes to a vehicle: channels for an encoder, or a Crazyflie's setpoints.

use device::vehicle_link::{CommandFrame, CommandMode as LinkMode, roll_pitch_rad};
use quantity::{Body, Time, Vector};
use schemas::{CommandMode, VehicleCommand};

use crate::crazyflie::Setpoints;
use crate::encoder::Encoder;

/// The form of a vehicle's commands.
#[derive(Clone, Debug)]
pub(crate) enum Form {
    /// Sixteen channels, as an encoder takes them.
    Channels(Encoder),
    /// A Crazyflie's setpoints.
    Setpoints(Setpoints),
}

/// A command in its form.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Framed {
    /// What goes to the device.
    pub(crate) bytes: Vec<u8>,
    /// What is asked, as it is sent.
    pub(crate) mode: CommandMode,
    /// Collective acceleration, as the vehicle reads it.
    pub(crate) collective_m_s2: f64,
    /// Rate, as the vehicle reads it.
    pub(crate) rate_rad_s: Vector<Body>,
}

impl Form {
    /// The command in this form, with the counter it is to have.
    ///
    /// # Errors
    /// Why nothing is to be sent.
    pub(crate) fn frame(
        &mut self,
        now: Time,
        command: &VehicleCommand,
        counter: u8,
    ) -> Result<Framed, &'static str> {
        match self {
            Self::Channels(encoder) => {
                channels(*encoder, command, counter).ok_or("the newest command is not finite")
            }
            Self::Setpoints(setpoints) => setpoints.frame(now, command),
        }
    }

    /// The emergency stop in this form.
    pub(crate) fn stop(&self, vehicle: u8, counter: u8) -> Option<Vec<u8>> {
        match self {
            Self::Channels(encoder) => {
                let stop = CommandFrame { mode: LinkMode::Stop, counter, ..CommandFrame::default() };
                encoder.map.encode(&stop, vehicle).ok().map(|channels| encoder.bytes(channels))
            }
            Self::Setpoints(_) => Some(Setpoints::stop()),
        }
    }
}

/// The frame as the vehicle will read it.
fn channels(encoder: Encoder, command: &VehicleCommand, counter: u8) -> Option<Framed> {
    // A controller that orders the emergency descent has no estimate left to hint at.
    let estimated = command.mode != CommandMode::Descend;
    let (roll_rad, pitch_rad) = roll_pitch_rad(command.orientation);
    let frame = CommandFrame {
        mode: match command.mode {
            CommandMode::Disarmed => LinkMode::Disarmed,
            CommandMode::Fly => LinkMode::Fly,
            CommandMode::Descend => LinkMode::Descend,
        },
        counter,
        collective_m_s2: command.collective_m_s2,
        rate_rad_s: command.rate_rad_s,
        attitude_valid: estimated,
        height_valid: estimated,
        roll_rad,
        pitch_rad,
        height_m: command.height_m,
        vertical_speed_m_s: command.vertical_speed_m_s,
        epoch_low: command.lease_epoch as u8,
    };
    let channels = encoder.map.encode(&frame, command.vehicle).ok()?;
    let (_, as_sent) = encoder.map.decode(&channels, command.vehicle).ok()?;
    Some(Framed {
        bytes: encoder.bytes(channels),
        mode: command.mode,
        collective_m_s2: as_sent.collective_m_s2,
        rate_rad_s: as_sent.rate_rad_s,
    })
}
