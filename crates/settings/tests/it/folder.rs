//! A copy of the shipped settings to spoil.

use std::fs;
use std::path::{Path, PathBuf};

use settings::{Arena, ConfigError};

/// The shipped settings.
pub fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

/// A copy of them, which a test may spoil; gone when dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// A fresh copy; `name` is the test's.
    pub fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("settings-{name}"));
        let _ = fs::remove_dir_all(&path);
        copy(&shipped(), &path);
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn write(&self, file: &str, text: &str) -> &Self {
        fs::write(self.0.join(file), text).unwrap();
        self
    }

    pub fn append(&self, file: &str, text: &str) -> &Self {
        let old = fs::read_to_string(self.0.join(file)).unwrap();
        self.write(file, &format!("{old}\n{text}\n"))
    }

    /// Replaces the one line that sets `key`, by whatever value, in a file.
    pub fn set(&self, file: &str, key: &str, line: &str) -> &Self {
        let old = fs::read_to_string(self.0.join(file)).unwrap();
        let is_it = |line: &&str| line.split('=').next().is_some_and(|left| left.trim() == key);
        assert!(old.lines().any(|line| is_it(&line)), "{file} does not set {key}");
        let new: Vec<&str> = old.lines().map(|old| if is_it(&old) { line } else { old }).collect();
        self.write(file, &new.join("\n"))
    }

    pub fn load(&self, scenario: &str) -> Result<Arena, ConfigError> {
        Arena::load(&self.0, scenario)
    }

    /// The refusal, with the folder's path written as `config`.
    pub fn refusal(&self, scenario: &str) -> String {
        let error = self.load(scenario).expect_err("it was to be refused");
        error.to_string().replace(&self.0.display().to_string(), "config")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}
