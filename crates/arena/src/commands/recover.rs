//! `arena recover`: a whole file of a torn one.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use recording::{Missing, Recovered, recover_file};
use serde_json::json;

use super::Failure;

/// Options of `arena recover`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The torn recording, such as `flight.mcap.part`; it is left as it is.
    file: PathBuf,
    /// The whole file to make [default: the torn one's name without `.part`, else with `.recovered.mcap`].
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command: exit code 0 wherever a file could be made, however much of it is missing.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let file = &arguments.file;
    let output = arguments.output.clone().unwrap_or_else(|| default_output(file));
    let failure = |error: recording::RecoverError| {
        let path = if matches!(error, recording::RecoverError::Write(_)) { &output } else { file };
        Failure::Recording { path: path.clone(), reason: error.to_string() }
    };
    let recovered = recover_file(file, &output).map_err(failure)?;
    let text = if arguments.json { json_of(&output, &recovered) } else { text_of(&output, &recovered) };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

fn default_output(file: &Path) -> PathBuf {
    if file.extension().is_some_and(|ending| ending == "part") {
        return file.with_extension("");
    }
    file.with_extension("recovered.mcap")
}

fn text_of(output: &Path, recovered: &Recovered) -> String {
    let Recovered { messages, channels, range, kept_bytes, total_bytes, missing } = recovered;
    let span = range.map_or_else(String::new, |(first, last)| {
        format!(
            ", {:.3} s from {:.3} s to {:.3} s",
            (last - first).as_secs_f64(),
            first.as_secs_f64(),
            last.as_secs_f64()
        )
    });
    let kept = format!(
        "kept     {messages} messages on {channels} channels{span}: {kept_bytes} of {total_bytes} bytes\n"
    );
    let missing = match missing {
        None => "missing  nothing: the file was whole\n".to_owned(),
        Some(Missing { offset, bytes, reason }) => {
            format!("missing  {bytes} bytes from byte {offset} on: {reason}\n")
        }
    };
    format!("{kept}{missing}written  {}\n", output.display())
}

fn json_of(output: &Path, recovered: &Recovered) -> String {
    let Recovered { messages, channels, range, kept_bytes, total_bytes, missing } = recovered;
    let missing = missing.as_ref().map(
        |Missing { offset, bytes, reason }| json!({ "offset": offset, "bytes": bytes, "reason": reason }),
    );
    let object = json!({
        "output": output.display().to_string(),
        "messages": messages,
        "channels": channels,
        "first_ns": range.map(|(first, _)| first.as_nanos()),
        "last_ns": range.map(|(_, last)| last.as_nanos()),
        "kept_bytes": kept_bytes,
        "total_bytes": total_bytes,
        "missing": missing,
    });
    format!("{object}\n")
}
