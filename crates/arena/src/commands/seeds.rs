//! `arena learn --seeds N`: one experiment over many seeds, on all cores, and its distribution.

use std::io::Write as _;
use std::ops::Range;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use front_door::campaign::{Summary, spread};
use front_door::experiment;
use settings::Arena;

use super::Failure;

/// Flies all seeds; exit code 1 where any of them stopped learning early.
pub fn run(arena: &Arena, seeds: Range<u64>, json: bool) -> Result<ExitCode, Failure> {
    let next = AtomicU64::new(seeds.start);
    let summaries: Mutex<Vec<Summary>> = Mutex::new(Vec::new());
    let failure: Mutex<Option<Failure>> = Mutex::new(None);
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= seeds.end {
                        return;
                    }
                    match experiment::learn(arena, seed, &mut ()) {
                        Ok(flown) => {
                            let summary = Summary::of(&flown);
                            eprintln!("{}", line(&summary));
                            hold(&summaries).push(summary);
                        }
                        Err(error) => *hold(&failure) = Some(error.into()),
                    }
                }
            });
        }
    });
    if let Some(failure) = hold(&failure).take() {
        return Err(failure);
    }
    let mut summaries = std::mem::take(&mut *hold(&summaries));
    summaries.sort_by_key(|summary| summary.seed);
    let mut out = std::io::stdout().lock();
    if json {
        writeln!(out, "{}", serde_json::to_string(&summaries).map_err(std::io::Error::from)?)?;
    } else {
        write!(out, "{}", table(&summaries))?;
    }
    let stopped = summaries.iter().any(|summary| summary.stopped.is_some());
    Ok(if stopped { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// A worker that panicked has said so already; what the others found is whole.
fn hold<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn line(summary: &Summary) -> String {
    let [x, z, vx, vz, theta] = summary.first_error;
    format!(
        "seed {:4}  {:3} flips, {} failed  first x {x:+.2} z {z:+.2} vx {vx:+.2} vz {vz:+.2} theta {theta:+.2}  norm {:.2} -> steady {:.3}, last {:.3}  settled at {}  turns {:.2}{}",
        summary.seed,
        summary.flips,
        summary.failed,
        summary.first_norm,
        summary.steady_norm,
        summary.last_norm,
        summary.settled_at.map_or("-".to_owned(), |flip| flip.to_string()),
        summary.turns,
        summary.stopped.as_ref().map_or(String::new(), |why| format!("  stopped: {why}")),
    )
}

fn table(summaries: &[Summary]) -> String {
    let mut text = format!("{} seeds                       least    median  greatest\n", summaries.len());
    let mut row = |name: &str, of: &dyn Fn(&Summary) -> f64| {
        let [least, middle, greatest] = spread(&summaries.iter().map(of).collect::<Vec<_>>());
        text.push_str(&format!("{name:<28} {least:9.4} {middle:9.4} {greatest:9.4}\n"));
    };
    let names = ["first x [m]", "first z [m]", "first vx [m/s]", "first vz [m/s]", "first theta [rad]"];
    for (index, name) in names.iter().enumerate() {
        row(name, &|summary| summary.first_error[index]);
    }
    row("first norm", &|summary| summary.first_norm);
    row("floor norm", &|summary| summary.floor_norm);
    row("steady norm", &|summary| summary.steady_norm);
    row("norm of the last five", &|summary| summary.last_norm);
    row("settled at flip", &|summary| summary.settled_at.map_or(f64::NAN, |flip| flip as f64));
    row("turns of the last flip", &|summary| summary.turns);
    row("measured: place [m]", &|summary| summary.measured_m);
    row("measured: speed [m/s]", &|summary| summary.measured_m_s);
    row("measured: angle [deg]", &|summary| summary.measured_rad.to_degrees());
    row("reach |x| [m]", &|summary| summary.extremes.x_m_max);
    row("reach |y| [m]", &|summary| summary.extremes.y_m_max);
    row("least height [m]", &|summary| summary.extremes.z_m_min);
    row("greatest height [m]", &|summary| summary.extremes.z_m_max);
    row("flips failed", &|summary| summary.failed as f64);
    let unsettled = summaries.iter().filter(|summary| summary.settled_at.is_none()).count();
    let worse = summaries.iter().filter(|summary| summary.last_norm > summary.steady_norm).count();
    let stopped = summaries.iter().filter(|summary| summary.stopped.is_some()).count();
    text.push_str(&format!(
        "settled: {} of {}; worse at the end than when steady: {worse}; stopped early: {stopped}\n",
        summaries.len() - unsettled,
        summaries.len()
    ));
    text
}
