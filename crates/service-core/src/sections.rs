//! Whose settings there can be.

use schemas::topics;
use settings::{Arena, ConfigError};

/// Writers that are no cores: every node, and the simulator, whose settings are those of the vehicles' `plant`.
const WITHOUT_SECTION: [&str; 2] = ["*", "simulator"];

/// Refuses sections of `services.toml` that are no service's: a misspelt one would change nothing, silently. The services
/// are the writers in the topic table.
///
/// # Errors
/// [`ConfigError::Unknown`] with the first such section.
pub fn check_sections(arena: &Arena) -> Result<(), ConfigError> {
    let mut services: Vec<&str> = topics::ALL
        .iter()
        .map(|topic| topic.writer)
        .filter(|writer| !WITHOUT_SECTION.contains(writer))
        .collect();
    services.sort_unstable();
    services.dedup();
    arena.check_sections(&services)
}
