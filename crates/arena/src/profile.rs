//! Which settings an arena is brought up with: a folder's, with other ones laid over them.

use std::path::{Path, PathBuf};

use quantity::Time;
use service_core::{Seed, Start};
use settings::{Arena, Change, ConfigError, Overlay};

use crate::experiment::{core, services};

/// What is laid over a folder's settings: a file for the equipment, and changes one by one.
///
/// # Errors
/// A file that is not there or is not TOML.
pub fn overlay(hardware: Option<&PathBuf>, changes: &[Change]) -> Result<Overlay, ConfigError> {
    let mut overlay = Overlay::default();
    if let Some(file) = hardware {
        overlay.add_file(file)?;
    }
    for change in changes {
        overlay.add_change(change);
    }
    Ok(overlay)
}

/// A folder's settings with others laid over them, judged by every service before any is started.
///
/// # Errors
/// The first setting that cannot be used, with the file it is in.
pub fn load(folder: &Path, scenario: &str, overlay: &Overlay) -> Result<Arena, ConfigError> {
    Arena::load_over(folder, scenario, overlay, |arena| {
        service_core::check_sections(arena)?;
        let start = Start { at: Time::ZERO, seed: Seed(0), incarnation: 1 };
        services().into_iter().try_for_each(|name| core(name, arena, start).map(|_| ()))
    })
}
