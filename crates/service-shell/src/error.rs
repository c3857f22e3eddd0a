//! Why a program of the arena does not start, or ends.

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use settings::ConfigError;
use thiserror::Error;

/// Bytes of a secret.
pub(crate) const SECRET_BYTES: usize = 32;

/// Why a program does not start, or ends.
#[derive(Debug, Error)]
pub enum ShellError {
    /// A setting that cannot be used.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// The secret cannot be read. Nothing starts without one.
    #[error(
        "secret file {}: {reason}; nothing starts without a secret: `arena up` makes one, --secret-file and \
         FLYARENA_SECRET_FILE name another", path.display()
    )]
    SecretUnreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A secret of the wrong length.
    #[error("secret file {}: {found} bytes, but a secret has {SECRET_BYTES}", path.display())]
    SecretLength {
        /// The file.
        path: PathBuf,
        /// Bytes found.
        found: usize,
    },
    /// A secret that others than its owner may read or change.
    #[error(
        "secret file {}: mode {mode:04o}, but only its owner may read it: 0400 or 0600", path.display()
    )]
    SecretMode {
        /// The file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// The run's id cannot be read.
    #[error("run file {}: {reason}; `arena up` writes it, and --run HEX says otherwise", path.display())]
    Run {
        /// The file.
        path: PathBuf,
        /// What the system said, or what was found.
        reason: String,
    },
    /// A program that must not run in this domain.
    #[error("the {service} refuses domain {found}: it runs in domain {allowed} only")]
    Domain {
        /// The program.
        service: &'static str,
        /// The domain asked for.
        found: &'static str,
        /// The domain it is for.
        allowed: &'static str,
    },
    /// The operating system refused something.
    #[error("{what}: {source}")]
    System {
        /// What was tried, with addresses and values.
        what: String,
        /// What the system said.
        source: io::Error,
    },
}

impl ShellError {
    /// 2 for what was asked wrongly, 1 for what failed.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::System { .. } => 1,
            _ => 2,
        })
    }
}

impl From<ConfigError> for ShellError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}

/// Adds to an error of the system what was tried.
pub trait During<T> {
    /// Names what was tried.
    ///
    /// # Errors
    /// The same failure, with its circumstances.
    fn during(self, what: impl FnOnce() -> String) -> Result<T, ShellError>;
}

impl<T, E: Into<io::Error>> During<T> for Result<T, E> {
    fn during(self, what: impl FnOnce() -> String) -> Result<T, ShellError> {
        self.map_err(|error| ShellError::System { what: what(), source: error.into() })
    }
}
