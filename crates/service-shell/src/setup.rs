//! What a program of the arena knows before it does anything: settings, secret, identity.

use quantity::Time;
use service_core::Identity;
use settings::Arena;
use wire::{Domain, Secret};

use crate::identity::{identity, incarnation_now};
use crate::run_id::{read_run, run_file};
use crate::secret::{read_secret, secret_file};
use crate::{Options, ShellError, clock};

/// What a program of the arena knows before it does anything.
#[derive(Debug)]
pub struct Setup {
    /// The settings.
    pub arena: Arena,
    /// The secret all keys come from.
    pub secret: Secret,
    /// Who this program is.
    pub identity: Identity,
    /// When it started.
    pub started_at: Time,
    /// End some time after the starting process has died.
    pub supervised: bool,
}

impl Setup {
    /// Reads settings, secret and run id.
    ///
    /// # Errors
    /// Whatever of these cannot be used.
    pub fn load(service: &str, options: &Options) -> Result<Self, ShellError> {
        let arena = Arena::load(&options.config, &options.scenario)?;
        service_core::check_sections(&arena)?;
        let secret = read_secret(&secret_file(options.secret_file.as_deref()))?;
        let run = match options.run {
            Some(run) => run,
            None => read_run(&run_file())?,
        };
        let incarnation = options.incarnation.unwrap_or_else(incarnation_now);
        let identity = identity(service, Domain::from(options.domain), run, incarnation);
        Ok(Self { arena, secret, identity, started_at: clock::now(), supervised: options.supervised })
    }
}
