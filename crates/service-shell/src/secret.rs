//! The arena's secret: 32 random bytes in a file that only its owner reads.

use std::ffi::OsString;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use wire::Secret;

use crate::ShellError;
use crate::error::{During, SECRET_BYTES};

/// Where the secret is unless said otherwise.
pub const DEFAULT_SECRET_FILE: &str = ".flyarena/secret";
/// Names another secret file; `--secret-file` overrides it.
pub const SECRET_FILE_VARIABLE: &str = "FLYARENA_SECRET_FILE";

const FORBIDDEN_MODE: u32 = 0o077;
const OWNER_ONLY: u32 = 0o600;

/// The secret file to use: the option, else the environment, else the default.
#[must_use]
pub fn secret_file(option: Option<&Path>) -> PathBuf {
    choose(option, std::env::var_os(SECRET_FILE_VARIABLE))
}

fn choose(option: Option<&Path>, variable: Option<OsString>) -> PathBuf {
    let variable = variable.filter(|value| !value.is_empty()).map(PathBuf::from);
    option.map(Path::to_owned).or(variable).unwrap_or_else(|| PathBuf::from(DEFAULT_SECRET_FILE))
}

/// Reads a secret.
///
/// # Errors
/// A file that is not there, is not 32 bytes long, or that others than its owner may touch.
pub fn read_secret(path: &Path) -> Result<Secret, ShellError> {
    let unreadable = |error: std::io::Error| ShellError::SecretUnreadable {
        path: path.to_owned(),
        reason: error.to_string(),
    };
    let file = File::open(path).map_err(unreadable)?;
    // Of the open file, not of its name: the name may point elsewhere a moment later.
    let mode = file.metadata().map_err(unreadable)?.permissions().mode() & 0o7777;
    if mode & FORBIDDEN_MODE != 0 {
        return Err(ShellError::SecretMode { path: path.to_owned(), mode });
    }
    let mut bytes = Vec::with_capacity(SECRET_BYTES + 1);
    (&file).take(SECRET_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    match <[u8; SECRET_BYTES]>::try_from(bytes.as_slice()) {
        Ok(bytes) => Ok(Secret::new(bytes)),
        Err(_) => {
            let rest = std::io::copy(&mut file.take(1 << 20), &mut std::io::sink()).unwrap_or(0);
            Err(ShellError::SecretLength { path: path.to_owned(), found: bytes.len() + rest as usize })
        }
    }
}

/// Makes a secret file of random bytes with mode 0600 unless one exists, and its folder with mode 0700;
/// whether it made one.
///
/// # Errors
/// What the system says.
pub fn create_secret_if_absent(path: &Path) -> Result<bool, ShellError> {
    if path.exists() {
        return Ok(false);
    }
    create_parent(path)?;
    let random: [u8; SECRET_BYTES] = random_bytes()?;
    // Written beside and linked into place: whoever starts at the same moment sees all of it or nothing.
    let draft = path.with_extension(format!("draft-{}", std::process::id()));
    let what = || format!("making secret file {}", path.display());
    let mut file =
        OpenOptions::new().write(true).create_new(true).mode(OWNER_ONLY).open(&draft).during(what)?;
    let written = file.write_all(&random).and_then(|()| file.sync_all()).and_then(|()| {
        match fs::hard_link(&draft, path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
            linked => linked.map(|()| true),
        }
    });
    let removed = fs::remove_file(&draft);
    let made = written.during(what)?;
    removed.during(what)?;
    Ok(made)
}

/// Random bytes from the system.
///
/// # Errors
/// What the system says.
pub(crate) fn random_bytes<const N: usize>() -> Result<[u8; N], ShellError> {
    let mut bytes = [0; N];
    File::open("/dev/urandom")
        .and_then(|mut source| source.read_exact(&mut bytes))
        .during(|| "reading /dev/urandom".to_owned())?;
    Ok(bytes)
}

pub(crate) fn create_parent(path: &Path) -> Result<(), ShellError> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)
            .during(|| format!("making folder {}", folder.display())),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::Scratch;

    fn write(path: &Path, bytes: &[u8], mode: u32) {
        fs::write(path, bytes).unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn a_made_secret_is_its_owners_alone_and_is_made_once() {
        let scratch = Scratch::new("secret-made");
        let path = scratch.path("state/secret");
        assert!(create_secret_if_absent(&path).unwrap());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o7777, 0o600);
        assert_eq!(fs::metadata(path.parent().unwrap()).unwrap().permissions().mode() & 0o7777, 0o700);
        let first = fs::read(&path).unwrap();
        assert_eq!(first.len(), SECRET_BYTES);
        assert_ne!(first, [0; SECRET_BYTES]);
        assert!(!create_secret_if_absent(&path).unwrap());
        assert_eq!(fs::read(&path).unwrap(), first);
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no draft stays behind");
        read_secret(&path).unwrap();
    }

    #[test]
    fn no_secret_is_refused_with_the_ways_to_one() {
        let scratch = Scratch::new("secret-absent");
        let error = read_secret(&scratch.path("secret")).unwrap_err();
        assert!(matches!(error, ShellError::SecretUnreadable { .. }), "{error}");
        let text = error.to_string();
        for word in ["arena up", "--secret-file", SECRET_FILE_VARIABLE] {
            assert!(text.contains(word), "{text}");
        }
        assert_eq!(error.exit_code(), std::process::ExitCode::from(2));
    }

    #[test]
    fn a_secret_of_another_length_is_refused_with_both_lengths() {
        let scratch = Scratch::new("secret-length");
        for length in [0, 31, 33, 5_000] {
            let path = scratch.path("secret");
            write(&path, &vec![7; length], 0o600);
            let text = read_secret(&path).unwrap_err().to_string();
            assert!(text.contains(&format!("{length} bytes")) && text.contains("has 32"), "{text}");
        }
    }

    #[test]
    fn a_secret_others_can_touch_is_refused_with_both_modes() {
        let scratch = Scratch::new("secret-mode");
        let path = scratch.path("secret");
        for mode in [0o640, 0o604, 0o660, 0o644, 0o610, 0o777] {
            write(&path, &[7; SECRET_BYTES], mode);
            let text = read_secret(&path).unwrap_err().to_string();
            assert!(text.contains(&format!("{mode:04o}")) && text.contains("0600"), "{text}");
        }
        for mode in [0o600, 0o400] {
            write(&path, &[7; SECRET_BYTES], mode);
            read_secret(&path).unwrap();
        }
    }

    #[test]
    fn the_option_goes_before_the_environment_and_that_before_the_default() {
        let variable = || Some(OsString::from("from/environment"));
        assert_eq!(choose(Some(Path::new("from/option")), variable()), Path::new("from/option"));
        assert_eq!(choose(None, variable()), Path::new("from/environment"));
        assert_eq!(choose(None, Some(OsString::new())), Path::new(DEFAULT_SECRET_FILE));
        assert_eq!(choose(None, None), Path::new(DEFAULT_SECRET_FILE));
    }

    #[test]
    fn an_error_never_shows_the_secret() {
        let scratch = Scratch::new("secret-shown");
        let path = scratch.path("secret");
        write(&path, b"hunter2hunter2hunter2hunter2hunter2", 0o600);
        let error = read_secret(&path).unwrap_err();
        assert!(!format!("{error} {error:?}").contains("hunter2"));
    }
}
