//! The settings of a run, in one file: what its services were started with, and what whoever joins it must use.
//!
//! The file's first line names the run, so that an old one is never taken for the newest run's.

use std::fs;
use std::path::{Path, PathBuf};

use settings::Arena;
use tracing::warn;
use wire::Domain;

use crate::error::During;
use crate::run_id::{read_run, run_file_of};
use crate::secret::create_parent;
use crate::setup::settings_file_variable;
use crate::{Options, ShellError};

/// Where the settings of a run stand: a simulated one's, or those of whatever `arena init` made.
pub const DEFAULT_SETTINGS_FILE: &str = ".flyarena/settings.toml";
/// Where those of an arena before real equipment stand.
pub const LIVE_SETTINGS_FILE: &str = ".flyarena/live-settings.toml";

fn first_line(run: u64) -> String {
    format!("# run {run:016x}")
}

/// Writes the settings of a run. Replaces the file in one step.
///
/// # Errors
/// What the system says.
pub fn write_run_settings(path: &Path, run: u64, arena: &Arena) -> Result<(), ShellError> {
    create_parent(path)?;
    let draft = path.with_extension(format!("draft-{}", std::process::id()));
    fs::write(&draft, format!("{}\n{}", first_line(run), arena.to_toml()))
        .and_then(|()| fs::rename(&draft, path))
        .during(|| format!("writing the settings {}", path.display()))
}

/// The settings of this folder's run of a domain, if they are known.
fn settings_of_run(domain: Domain) -> Option<PathBuf> {
    let run = read_run(&run_file_of(domain)).ok()?;
    [LIVE_SETTINGS_FILE, DEFAULT_SETTINGS_FILE].map(PathBuf::from).into_iter().find(|path| {
        fs::read_to_string(path).is_ok_and(|text| text.lines().next() == Some(first_line(run).as_str()))
    })
}

impl Options {
    /// The same options for a program that joins this folder's newest run: with the very settings that its services
    /// have, unless these options name a file of settings or another run.
    #[must_use]
    pub fn joining(&self) -> Self {
        let mut options = self.clone();
        if self.settings.is_some() || self.run.is_some() || settings_file_variable().is_some() {
            return options;
        }
        options.settings = settings_of_run(self.domain.into());
        let default = Self::default();
        if let Some(file) = &options.settings
            && (self.config != default.config || self.scenario != default.scenario)
        {
            warn!(settings = %file.display(), "the run has settings of its own; --config and --scenario are not used");
        }
        options
    }
}
