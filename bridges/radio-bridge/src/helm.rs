//! What the bridge keeps of every vehicle, whatever its radios: who commands it, what, and whether a person has stopped
//! it.

use quantity::{Span, Time};

use crate::delay::LinkDelay;
use crate::form::Form;
use crate::lease::Lease;
use crate::slots::{CommandLink, Served, Slot};
use crate::stop::EmergencyStop;
use crate::tuning::Tuning;

/// The commanding side of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Helm {
    /// Its number on the bus and on its links.
    pub(crate) id: u8,
    /// Who commands it.
    pub(crate) lease: Lease,
    /// What it is commanded.
    pub(crate) commands: CommandLink,
    /// Whether a person has stopped it.
    pub(crate) stop: EmergencyStop,
    /// How long its command link takes.
    pub(crate) delay: LinkDelay,
}

impl Helm {
    /// A vehicle that nobody commands, whose commands take this form.
    pub(crate) fn new(member: &settings::Vehicle, form: Form, tuning: &Tuning) -> Self {
        Self {
            id: member.id,
            lease: Lease::default(),
            commands: CommandLink::new(member.id, form, Span::from_secs_f64(tuning.command_age_s_max)),
            stop: EmergencyStop::default(),
            delay: LinkDelay::new(member.links.command_delay_s, tuning.action_delay_s),
        }
    }

    /// Serves a slot.
    pub(crate) fn serve(&mut self, now: Time, slot: Slot) -> Served {
        if self.stop.holds() {
            self.commands.serve_stop(now, self.stop.speaks(now))
        } else {
            self.commands.serve(now, slot, self.delay.delay_s())
        }
    }
}
