//! What a person at the terminal sees of a live arena.

use std::fmt::Write as _;
use std::io::{IsTerminal as _, Write as _};

use quantity::{Span, Time};
use schemas::{FlipOutcome, FlipPhase, NodeEvent, Severity};

use super::{Console, Standing, Supervised, VehicleView};

/// Without a terminal a line per vehicle comes this often.
const PLAIN_PERIOD: Span = Span::from_secs(2);

/// One live line per vehicle at a terminal; lines from time to time into a file or pipe.
#[derive(Debug)]
pub struct Screen {
    terminal: bool,
    lines_up: usize,
    plain_at: Time,
    flips: Vec<(u8, u32)>,
    standings: Vec<Standing>,
}

impl Default for Screen {
    fn default() -> Self {
        Self {
            terminal: std::io::stdout().is_terminal(),
            lines_up: 0,
            plain_at: Time::ZERO,
            flips: Vec::new(),
            standings: Vec::new(),
        }
    }
}

impl Screen {
    /// Says something once.
    pub fn say(&mut self, text: &str) {
        self.lines_up = 0;
        self.put(&format!("{text}\n"));
    }

    /// Shows how the arena fares now.
    pub fn show(&mut self, now: Time, console: &mut Console, processes: &[Supervised]) {
        let events: Vec<NodeEvent> = console.take_events().collect();
        let mut once = String::new();
        for event in events.iter().filter(|event| event.severity != Severity::Info) {
            let _ = writeln!(
                once,
                "{}: {} ({})",
                event.node.as_str(),
                event.name.as_str(),
                event.detail.as_str()
            );
        }
        self.note_processes(processes, &mut once);
        for (vehicle, view) in console.vehicles() {
            self.note_flip(*vehicle, view, &mut once);
        }
        let lines: Vec<String> =
            console.vehicles().iter().map(|(vehicle, view)| vehicle_line(*vehicle, view)).collect();
        if self.terminal {
            self.redraw(&once, &lines);
        } else {
            if now >= self.plain_at {
                self.plain_at = now + PLAIN_PERIOD;
                once.extend(lines.iter().map(|line| format!("{line}\n")));
            }
            self.put(&once);
        }
    }

    fn note_processes(&mut self, processes: &[Supervised], once: &mut String) {
        self.standings.resize(processes.len(), Standing::Running);
        for (known, process) in self.standings.iter_mut().zip(processes) {
            let standing = process.standing();
            if *known == standing {
                continue;
            }
            let word = match standing {
                Standing::Running => "runs again",
                Standing::Waiting(_) => "ended; it will be restarted",
                Standing::Down => "ended too often; it stays down",
            };
            let _ = writeln!(once, "{} {word}", process.service());
            *known = standing;
        }
    }

    fn note_flip(&mut self, vehicle: u8, view: &VehicleView, once: &mut String) {
        let Some(result) = view.result else { return };
        if self.flips.contains(&(vehicle, result.iteration)) {
            return;
        }
        self.flips.retain(|(id, _)| *id != vehicle);
        self.flips.push((vehicle, result.iteration));
        let outcome = match result.outcome {
            FlipOutcome::Completed => "completed",
            FlipOutcome::Aborted => "aborted",
            FlipOutcome::Unmeasured => "unmeasured",
        };
        let error = result.error;
        let _ = writeln!(
            once,
            "vehicle {vehicle}  flip {:3} {outcome}  x {:+.3} m  z {:+.3} m  vx {:+.3} m/s  vz {:+.3} m/s  theta {:+.3} rad",
            result.iteration, error.x_m, error.z_m, error.vx_m_s, error.vz_m_s, error.theta_rad
        );
    }

    fn redraw(&mut self, once: &str, lines: &[String]) {
        let mut text = String::new();
        if self.lines_up > 0 {
            // Up over the old lines, and everything below away.
            let _ = write!(text, "\x1b[{}A\x1b[J", self.lines_up);
        }
        text.push_str(once);
        for line in lines {
            let _ = writeln!(text, "{line}");
        }
        self.lines_up = lines.len();
        self.put(&text);
    }

    fn put(&self, text: &str) {
        let mut out = std::io::stdout().lock();
        // Whoever closed the pipe does not want to know; the vehicles still fly.
        let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    }
}

fn vehicle_line(vehicle: u8, view: &VehicleView) -> String {
    let state = &view.state.estimate;
    format!(
        "vehicle {vehicle}  {:<9} {:<9} flip {:3}  at ({:+.2}, {:+.2}, {:.2}) m  {:4.2} m/s  battery {:.2} V{}",
        format!("{:?}", view.status.phase),
        format!("{:?}", view.state.tracking),
        view.status.iteration,
        state.position_m.x,
        state.position_m.y,
        state.position_m.z,
        state.velocity_m_s.norm(),
        view.status.battery_v,
        waits_for(view),
    )
}

/// What the gate waits for, in the order of the bits of `FlipStatus::gate`.
const GATE_WORDS: [&str; 9] =
    ["place", "speed", "tilt", "data", "battery", "clearance", "height", "telemetry", "parameters"];

fn waits_for(view: &VehicleView) -> String {
    // Only on the way to a flip does the gate keep anybody waiting.
    if !matches!(view.status.phase, FlipPhase::Approach | FlipPhase::Gate) || view.status.gate == 0 {
        return String::new();
    }
    let words: Vec<&str> = GATE_WORDS
        .iter()
        .enumerate()
        .filter(|(bit, _)| view.status.gate & (1 << bit) != 0)
        .map(|(_, word)| *word)
        .collect();
    format!("  waits for {}", words.join(", "))
}
