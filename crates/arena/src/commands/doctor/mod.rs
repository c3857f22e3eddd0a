//! `arena doctor`: what an arena needs of this host and of its equipment, each with what to do about it.
//!
//! Measurements are taken here and there; what they mean is judged apart, by functions of what was measured. Nothing is
//! sent that could move a vehicle, and nothing at all to the devices of an arena that runs.

mod bus;
mod cable;
mod files;
mod finding;
mod host;
mod motion_capture;
mod radios;
mod running;
mod serial;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use finding::{Finding, Verdict, worst};
use front_door::profile;
use front_door::tools::neighbours;
use service_shell::{DomainOption, Options, Setup};
use settings::{Arena, Overlay};
use wire::Domain;

use super::Failure;

/// Options of `arena doctor`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Lay this file over the settings, as `arena up --hardware` does; the domain is live
    #[arg(long, value_name = "FILE", conflicts_with = "settings")]
    hardware: Option<PathBuf>,
    /// Where recordings are to go
    #[arg(long, value_name = "DIR", default_value = ".")]
    recordings: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    options: Options,
}

/// Runs the command: exit code 0 where nothing fails.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    // What others warn of is judged here.
    service_shell::init_logging("error");
    let mut options = arguments.options.clone();
    if arguments.hardware.is_some() {
        options.domain = DomainOption::Live;
    }
    let options = options.joining();
    let arena = settings(arguments, &options)?;
    let domain = Domain::from(options.domain);
    let mut findings = vec![judge_settings(&arena, &options, arguments.hardware.as_ref())];
    findings.extend(bus::check(&arena.network, domain));
    findings.extend(host::check());
    let secret = service_shell::secret_file(options.secret_file.as_deref());
    findings.extend(files::check(&arena, domain, &secret, &arguments.recordings));
    findings.extend(devices(arena, &options, domain));
    report(&findings, arguments.json)?;
    Ok(if worst(&findings) == Verdict::Fail { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn settings(arguments: &Arguments, options: &Options) -> Result<Arena, Failure> {
    if arguments.hardware.is_none() && options.settings.is_some() {
        return Ok(service_shell::load_arena(options)?);
    }
    let overlay: Overlay = profile::overlay(arguments.hardware.as_ref(), &[])?;
    Ok(profile::load(&options.config, &options.scenario, &overlay)?)
}

fn judge_settings(arena: &Arena, options: &Options, hardware: Option<&PathBuf>) -> Finding {
    let place = match (hardware, &options.settings) {
        (Some(file), _) => format!("{} over {}", file.display(), options.config.display()),
        (None, Some(file)) => file.display().to_string(),
        (None, None) => options.config.display().to_string(),
    };
    let vehicles = arena.fleet.len();
    Finding::ok("settings", format!("{place}: {}, {vehicles} vehicle(s)", arena.name))
}

/// The devices themselves, or what an arena that has them says of them.
fn devices(arena: Arena, options: &Options, domain: Domain) -> Vec<Finding> {
    let heard = service_shell::block_on(neighbours::heard(&arena.network, domain));
    match heard {
        Err(error) => vec![Finding::fail("arena", error.to_string(), "see the lines on the bus")],
        Ok(Some(topic)) => running(arena, options, &topic),
        Ok(None) if domain == Domain::Live => {
            let mut findings = vec![Finding::ok("arena", "none runs")];
            findings.push(motion_capture::check(&arena));
            findings.extend(radios::check(&arena));
            findings
        }
        Ok(None) => {
            vec![Finding::ok("arena", format!("none runs; in domain {} it has no devices", domain.name()))]
        }
    }
}

fn running(arena: Arena, options: &Options, topic: &str) -> Vec<Finding> {
    let Ok(mut setup) = Setup::load("arena", options) else { return vec![running::strangers(topic)] };
    setup.arena = arena;
    match running::listen(&setup) {
        Ok(heard) if heard == running::Heard::default() => vec![running::strangers(topic)],
        Ok(heard) => running::judge(&setup.arena, roster::SERVICES, &heard),
        Err(error) => vec![Finding::fail("arena", error.to_string(), "see the lines on the bus")],
    }
}

fn report(findings: &[Finding], json: bool) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    if json {
        let report = serde_json::json!({ "verdict": worst(findings), "checks": findings });
        writeln!(out, "{report}")?;
        return Ok(());
    }
    for finding in findings {
        writeln!(out, "{:<5} {:<20} {}", finding.verdict.name(), finding.name, finding.found)?;
        if let Some(advice) = &finding.advice {
            writeln!(out, "{:<26} -> {advice}", "")?;
        }
    }
    Ok(())
}
