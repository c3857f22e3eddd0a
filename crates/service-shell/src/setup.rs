//! What a program of the arena knows before it does anything: settings, secret, identity.

use std::path::PathBuf;

use quantity::Time;
use service_core::Identity;
use settings::{Arena, ConfigError};
use wire::{Domain, Secret};

use crate::identity::{identity, incarnation_now};
use crate::run_id::{read_run, run_file_of};
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
        let arena = load_arena(options)?;
        service_core::check_sections(&arena)?;
        let secret = read_secret(&secret_file(options.secret_file.as_deref()))?;
        let run = match options.run {
            Some(run) => run,
            None => read_run(&run_file_of(options.domain.into()))?,
        };
        let incarnation = options.incarnation.unwrap_or_else(incarnation_now);
        let identity = identity(service, Domain::from(options.domain), run, incarnation);
        Ok(Self { arena, secret, identity, started_at: clock::now(), supervised: options.supervised })
    }
}

/// Names one file with all settings; `--settings` overrides it, `--config` and `--scenario` do not.
pub const SETTINGS_FILE_VARIABLE: &str = "FLYARENA_SETTINGS_FILE";

pub(crate) fn settings_file_variable() -> Option<PathBuf> {
    std::env::var_os(SETTINGS_FILE_VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// The settings that a program's options or its environment name: one file, or a folder and a scenario.
///
/// # Errors
/// Settings that cannot be read or used.
pub fn load_arena(options: &Options) -> Result<Arena, ShellError> {
    let Some(path) = options.settings.clone().or_else(settings_file_variable) else {
        return Ok(Arena::load(&options.config, &options.scenario)?);
    };
    let file = path.display().to_string();
    let text = std::fs::read_to_string(&path)
        .map_err(|error| ConfigError::Malformed { file: file.clone(), reason: error.to_string() })?;
    Ok(Arena::from_toml(&file, &text)?)
}
