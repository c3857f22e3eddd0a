//! How a setting is refused.

use thiserror::Error;

/// A setting that cannot be used; the program ends with exit code 2.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ConfigError {
    /// A file that is not there or cannot be read.
    #[error("{file}: cannot be read: {reason}")]
    Unreadable {
        /// The file, as it was asked for.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// Not TOML, an unknown key, a missing key, or a value of the wrong type.
    #[error("{file}: {reason}")]
    Malformed {
        /// The file.
        file: String,
        /// What the parser said, with the key.
        reason: String,
    },
    /// A name that is none of those there are.
    #[error("{file}: {key} = {value:?}, but there is only {known}")]
    Unknown {
        /// The file or folder.
        file: String,
        /// The key, dotted.
        key: String,
        /// The name found.
        value: String,
        /// The names there are, in order.
        known: String,
    },
    /// A number outside its range.
    #[error("{file}: {key} = {value}, but it must lie within {min} and {max}")]
    OutOfRange {
        /// The file.
        file: String,
        /// The key, dotted.
        key: String,
        /// The value found.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Greatest allowed.
        max: f64,
    },
    /// Two settings that contradict each other.
    #[error("{file}: {key} = {value} does not go with {other_key} = {other_value}: {reason}")]
    Contradiction {
        /// The file.
        file: String,
        /// One key.
        key: String,
        /// Its value.
        value: String,
        /// The other key.
        other_key: String,
        /// Its value.
        other_value: String,
        /// Why they do not go together.
        reason: String,
    },
    /// Settings that were sound before something was laid over them.
    #[error("{overlay}, laid over the settings: {error}")]
    Overlaid {
        /// The file or change that was laid over them.
        overlay: String,
        /// What is wrong since.
        error: Box<ConfigError>,
    },
}
