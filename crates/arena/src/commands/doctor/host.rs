//! The host: its clocks, how late it wakes a program, and who goes first.

use std::fs;
use std::time::Duration;

use quantity::Span;
use rustix::process::{Resource, getpriority_process, getrlimit};
use service_shell::clock::{self, ClockPair};

use super::finding::Finding;

/// Clock sources that are read without a system call or a slow bus.
const FAST_SOURCES: [&str; 5] =
    ["tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter", "xen"];
/// Clocks that are disciplined differ by less over a second.
const STEP_MAX: Span = Span::from_millis(1);
const LATENESS_MAX: Span = Span::from_millis(1);
/// A nap, how often.
const NAP: Duration = Duration::from_millis(2);
const NAPS: usize = 250;

/// Looks at the host; takes about half a second.
pub fn check() -> Vec<Finding> {
    let before = ClockPair::read();
    let lateness = naps();
    let after = ClockPair::read();
    let wall = Span::from_nanos(after.wall_ns - before.wall_ns);
    let source = fs::read_to_string("/sys/devices/system/clocksource/clocksource0/current_clocksource").ok();
    vec![
        judge_source(source.as_deref().map(str::trim)),
        judge_wall_clock(clock::synchronised().ok(), wall - (after.arena - before.arena)),
        judge_wakes(lateness),
        judge_priority(getpriority_process(None).unwrap_or(0), getrlimit(Resource::Rtprio).maximum),
        judge_governors(&governors()),
    ]
}

/// How late each nap ended.
fn naps() -> Vec<Span> {
    let nap = Span::from_nanos(NAP.as_nanos() as i64);
    (0..NAPS)
        .map(|_| {
            let before = clock::now();
            std::thread::sleep(NAP);
            clock::now() - before - nap
        })
        .collect()
}

fn governors() -> Vec<String> {
    let Ok(entries) = fs::read_dir("/sys/devices/system/cpu") else { return Vec::new() };
    let mut found: Vec<String> = entries
        .flatten()
        .filter_map(|entry| fs::read_to_string(entry.path().join("cpufreq/scaling_governor")).ok())
        .map(|text| text.trim().to_owned())
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

fn judge_source(source: Option<&str>) -> Finding {
    let name = "clock source";
    match source {
        Some(source) if FAST_SOURCES.contains(&source) => Finding::ok(name, source),
        Some(source) => Finding::warn(
            name,
            format!("{source}, which is slow to read"),
            "find out why the kernel gave the CPU's counter up (dmesg | grep clocksource)",
        ),
        None => Finding::ok(name, "this host does not tell"),
    }
}

/// The arena itself lives by the monotonic clock.
fn judge_wall_clock(synchronised: Option<bool>, step: Span) -> Finding {
    let name = "wall clock";
    let apart_ms = step.as_nanos() as f64 / 1e6;
    if step > STEP_MAX || step < -STEP_MAX {
        return Finding::warn(
            name,
            format!("it stepped by {apart_ms:.1} ms within half a second"),
            "let it be slewed instead (chronyd without makestep): kernel stamps of datagrams are in wall time",
        );
    }
    match synchronised {
        Some(true) => Finding::ok(name, "synchronised, no step"),
        Some(false) => Finding::warn(
            name,
            "not synchronised",
            "start chronyd or systemd-timesyncd: dates in recordings may be wrong (flight is not concerned)",
        ),
        None => Finding::ok(name, "no step; this host does not tell whether it is synchronised"),
    }
}

fn judge_wakes(mut lateness: Vec<Span>) -> Finding {
    lateness.sort_unstable();
    let at = |ratio: f64| lateness.get(((lateness.len() as f64 - 1.0) * ratio) as usize).copied();
    let (Some(middle), Some(high), Some(highest)) = (at(0.5), at(0.99), at(1.0)) else {
        return Finding::warn("wake-ups", "not measured", "run it again");
    };
    let ms = |span: Span| span.as_nanos() as f64 / 1e6;
    let found = format!(
        "late by {:.2} ms (median), {:.2} ms (99 %), {:.2} ms (most)",
        ms(middle),
        ms(high),
        ms(highest)
    );
    if high <= LATENESS_MAX {
        return Finding::ok("wake-ups", found);
    }
    let advice = "give the arena a host of its own: slots of the command link come as late as that";
    Finding::warn("wake-ups", found, advice)
}

fn judge_priority(niceness: i32, real_time_max: Option<u64>) -> Finding {
    let real_time = match real_time_max {
        None => "real-time priority allowed".to_owned(),
        Some(0) => "no real-time priority allowed, and none is needed".to_owned(),
        Some(max) => format!("real-time priority up to {max} allowed"),
    };
    let found = format!("niceness {niceness}, {real_time}");
    if niceness <= 0 {
        return Finding::ok("priority", found);
    }
    Finding::warn("priority", found, "start the arena without nice: everybody else goes first")
}

fn judge_governors(governors: &[String]) -> Finding {
    let name = "CPU frequency";
    if governors.is_empty() {
        return Finding::ok(name, "this host does not tell");
    }
    let found = format!("governor {}", governors.join(", "));
    if governors.iter().all(|governor| governor == "performance") {
        return Finding::ok(name, found);
    }
    Finding::warn(name, found, "sudo cpupower frequency-set --governor performance")
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn late_wake_ups_warn_and_a_single_late_one_does_not() {
        let mut spans = vec![Span::from_micros(60); 250];
        spans[7] = Span::from_millis(9);
        let one = judge_wakes(spans.clone());
        assert_eq!(one.verdict, Verdict::Ok);
        assert!(one.found.contains("9.00 ms (most)"), "{}", one.found);
        spans.iter_mut().step_by(20).for_each(|span| *span = Span::from_millis(2));
        assert_eq!(judge_wakes(spans).verdict, Verdict::Warn);
        assert_eq!(judge_wakes(Vec::new()).verdict, Verdict::Warn);
    }

    #[test]
    fn a_slow_source_a_step_and_no_discipline_warn() {
        assert_eq!(judge_source(Some("tsc")).verdict, Verdict::Ok);
        assert_eq!(judge_source(Some("hpet")).verdict, Verdict::Warn);
        assert_eq!(judge_source(None).verdict, Verdict::Ok);
        assert_eq!(judge_wall_clock(Some(true), Span::from_micros(20)).verdict, Verdict::Ok);
        assert_eq!(judge_wall_clock(Some(false), Span::ZERO).verdict, Verdict::Warn);
        let stepped = judge_wall_clock(Some(true), Span::from_millis(-1_500));
        assert!(stepped.verdict == Verdict::Warn && stepped.found.contains("-1500.0 ms"), "{stepped:?}");
    }

    #[test]
    fn whoever_is_nice_and_whoever_saves_power_is_warned() {
        assert_eq!(judge_priority(0, Some(0)).verdict, Verdict::Ok);
        assert_eq!(judge_priority(5, None).verdict, Verdict::Warn);
        let governors = |names: &[&str]| {
            judge_governors(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>()).verdict
        };
        assert_eq!(governors(&[]), Verdict::Ok);
        assert_eq!(governors(&["performance"]), Verdict::Ok);
        assert_eq!(governors(&["performance", "powersave"]), Verdict::Warn);
    }
}
