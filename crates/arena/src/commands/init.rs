//! `arena init`: what programs share that make up one run: a secret, the run's id, settings.
//!
//! `arena up` does this for itself; here it is for whoever starts the services otherwise. With `--hold` the command
//! stays: containers keep a memory file system only as long as somebody uses it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use service_shell::{Options, ShellError, Stop};
use settings::{Arena, ConfigError};
use toml::{Table, Value};
use tracing::info;

use super::Failure;

/// The run's settings, in the folder of its secret and id.
const SETTINGS_FILE: &str = ".flyarena/settings.toml";
/// A folder of settings with the changes made, while it is being checked.
const DRAFT_FOLDER: &str = ".flyarena/draft";

/// Options of `arena init`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Another value for a setting: the file's name, a dot, the key; may be repeated
    #[arg(long = "set", value_name = "FILE.KEY=VALUE", value_parser = parse_change)]
    changes: Vec<Change>,
    /// Stay until told to end
    #[arg(long)]
    hold: bool,
    #[command(flatten)]
    options: Options,
}

/// Runs the command. What there is already, it keeps: others may be using it.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let options = &arguments.options;
    service_shell::init_logging(&options.log);
    let run_file = service_shell::run_file_of(options.domain.into());
    service_shell::create_secret_if_absent(&service_shell::secret_file(options.secret_file.as_deref()))?;
    if !run_file.exists() {
        let settings = PathBuf::from(SETTINGS_FILE);
        fs::write(&settings, changed(options, &arguments.changes)?.to_toml()).map_err(at(&settings))?;
        let run = match options.run {
            Some(run) => run,
            None => service_shell::new_run()?,
        };
        // Last, for whoever waits for a run to join.
        service_shell::write_run(&run_file, run)?;
    }
    let run = service_shell::read_run(&run_file)?;
    info!(run = format!("{run:016x}"), settings = SETTINGS_FILE, "a run to join");
    if arguments.hold {
        service_shell::block_on(async {
            let mut stop = Stop::new(options.supervised)?;
            let reason = std::future::poll_fn(|cx| stop.poll_signal(cx)).await;
            info!("ended: {}", reason.name());
            Ok::<(), ShellError>(())
        })?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The settings that the options name, with the changes, checked as if they stood in the files.
fn changed(options: &Options, changes: &[Change]) -> Result<Arena, Failure> {
    let arena = if changes.is_empty() {
        service_shell::load_arena(options)?
    } else {
        let draft = PathBuf::from(DRAFT_FOLDER);
        copy_settings(&options.config, &draft)?;
        let loaded = changes
            .iter()
            .try_for_each(|change| change.apply(&draft))
            .and_then(|()| Ok(Arena::load(&draft, &options.scenario)?));
        fs::remove_dir_all(&draft).map_err(at(&draft))?;
        loaded?
    };
    service_core::check_sections(&arena)?;
    Ok(arena)
}

/// A setting's other value.
#[derive(Clone, Debug, PartialEq)]
struct Change {
    file: String,
    keys: Vec<String>,
    value: Value,
}

fn parse_change(text: &str) -> Result<Change, String> {
    let refused = || format!("{text:?} is not FILE.KEY=VALUE, such as network.ttl=1");
    let (path, value) = text.split_once('=').ok_or_else(refused)?;
    let mut names = path.split('.').map(str::to_owned);
    let (file, keys) = (names.next().unwrap_or_default(), names.collect::<Vec<_>>());
    if file.is_empty() || file.starts_with('/') || keys.is_empty() || keys.iter().any(String::is_empty) {
        return Err(refused());
    }
    // What is no TOML value is a text without its quotes: addresses, names.
    let value = format!("value = {value}")
        .parse::<Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()));
    Ok(Change { file, keys, value })
}

impl Change {
    fn apply(&self, folder: &Path) -> Result<(), Failure> {
        let path = folder.join(format!("{}.toml", self.file));
        let text = fs::read_to_string(&path).map_err(at(&path))?;
        let malformed = |reason: String| ConfigError::Malformed { file: path.display().to_string(), reason };
        let mut table: Table = text.parse().map_err(|error: toml::de::Error| malformed(error.to_string()))?;
        let (last, sections) = self.keys.split_last().expect("a change has a key: it was parsed so");
        let mut section = &mut table;
        for key in sections {
            section = section
                .entry(key)
                .or_insert_with(|| Value::Table(Table::new()))
                .as_table_mut()
                .ok_or_else(|| malformed(format!("{key} is a value, not a section of settings")))?;
        }
        section.insert(last.clone(), self.value.clone());
        fs::write(&path, table.to_string()).map_err(at(&path))
    }
}

/// Copies a folder of settings, with its folders.
fn copy_settings(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::create_dir_all(to).map_err(at(to))?;
    for entry in fs::read_dir(from).map_err(at(from))? {
        let entry = entry.map_err(at(from))?;
        let (source, target) = (entry.path(), to.join(entry.file_name()));
        if source.is_dir() {
            copy_settings(&source, &target)?;
        } else {
            // Not `fs::copy`: the copy is to be changed even where the original is read-only.
            fs::read(&source).and_then(|bytes| fs::write(&target, bytes)).map_err(at(&source))?;
        }
    }
    Ok(())
}

fn at(path: &Path) -> impl FnOnce(io::Error) -> Failure {
    let path = path.to_owned();
    move |source| Failure::File { path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_names_file_key_and_value() {
        let change = |text| parse_change(text).unwrap();
        assert_eq!(
            change("network.devices.data_link.url=udp://10.71.0.10:52000"),
            Change {
                file: "network".to_owned(),
                keys: ["devices", "data_link", "url"].map(str::to_owned).to_vec(),
                value: Value::String("udp://10.71.0.10:52000".to_owned()),
            }
        );
        assert_eq!(change("network.ttl=1").value, Value::Integer(1));
        assert_eq!(change("hall.width_m=8.5").value, Value::Float(8.5));
        assert_eq!(change("network.interface=\"10.0.0.1\"").value, Value::String("10.0.0.1".to_owned()));
        assert_eq!(change("scenarios/fleet.flip.iterations=3").file, "scenarios/fleet");
    }

    #[test]
    fn what_is_no_change_is_refused_with_the_text_found() {
        for text in ["", "network", "network=1", "network.ttl", ".ttl=1", "network..ttl=1", "/etc/x.y=1"] {
            assert!(parse_change(text).unwrap_err().contains(text), "{text:?}");
        }
    }
}
