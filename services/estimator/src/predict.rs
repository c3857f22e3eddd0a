//! Moving a state through the queue of commands, from one instant to a later one.

use quantity::{Span, Time};

use crate::commands::{Commands, Drive};
use crate::model::{Decay, Model, Motion, Regime};

/// Everything a state's future depends on besides the state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path<'a> {
    /// The vehicle.
    pub model: &'a Model,
    /// What it was and will be told.
    pub commands: &'a Commands,
    /// Whether it listens.
    pub regime: Regime,
    /// How its disturbances fade.
    pub decay: Decay,
    /// Longest step.
    pub step: Span,
}

impl Path<'_> {
    /// Carries `motion` from one instant to another, stepping from command to command.
    pub fn carry(&self, motion: &mut Motion, from: Time, to: Time) {
        let mut at = from;
        while at < to {
            let (drive, until) = match self.regime {
                Regime::Commanded => self.commands.at(at),
                Regime::Ballistic | Regime::Unknown => (Drive::Silent, Time::FAR_FUTURE),
            };
            let end = to.min(until);
            let steps = ((end - at).as_nanos() + self.step.as_nanos() - 1) / self.step.as_nanos();
            let step_s = (end - at).as_secs_f64() / steps as f64;
            for _ in 0..steps {
                self.model.advance(motion, self.regime, drive, &self.decay, step_s);
            }
            at = end;
        }
        motion.kinematics.orientation = motion.kinematics.orientation.renormalised();
    }
}
