//! When the shutters were open: frame numbers fitted to arrival times.
//!
//! The stream carries no time stamp. What arrives is: exposure, plus a delay that is never below some least
//! one, plus jitter of the vendor's program, the network and the kernel. Frames are exposed at an even rate,
//! so the line of arrival over frame number that the fastest frames lie on is exposure plus the least delay,
//! and the rest of every frame's delay can be taken off. The least delay itself cannot be seen from here; it
//! is the setting `links.mocap_latency_s`.
//!
//! 1. The period starts as the median of slopes over pairs of the first frames, which stalls do not bend.
//! 2. Of every ten frames the fastest counts. Through the fastest ones of some seconds goes a least-squares
//!    line, which gives level and period; those later than jitter explains are left out. So the fit follows a
//!    drift of the vendor's clock, and a stall leaves no mark on it.
//! 3. Where arrivals break with the line for good (another frame rate, another path, another count) the fit
//!    starts over. Until it is made anew, a frame's exposure is its own arrival less the latency.

use std::collections::VecDeque;

use quantity::{Span, Time};

/// Frames before the first fit.
const START_FRAMES: usize = 40;
/// Frames of which the fastest counts.
const BLOCK_FRAMES: u32 = 10;
/// Blocks the fit looks back on.
const WINDOW_BLOCKS: usize = 48;
/// One refit changes the period at most by this part.
const PERIOD_STEP_RATIO_MAX: f64 = 2e-3;
/// Consecutive frames ahead of the line that break it: nothing arrives before the least delay.
const EARLY_FRAMES: u32 = 3;
/// Consecutive frames of one longer period that break the line: how many, and how much longer. A little longer
/// may be chance once or twice, much longer may not.
const OTHER_PERIODS: [(usize, f64); 2] = [(2, 1.5), (4, 1.1)];
/// Frames that shows in.
const RECENT_FRAMES: usize = 5;
/// Frames over which a creeping lag is looked for.
const CREEP_FRAMES: u32 = 32;

/// Whether a frame fits the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rhythm {
    /// It does, or there is no line yet.
    Steady,
    /// It breaks the line for good; the fit starts over with it.
    Broken,
}

/// Fits frame numbers to arrival times.
#[derive(Clone, Debug)]
pub(crate) struct FrameClock {
    latency: Span,
    jitter_ns: f64,
    break_ns: f64,
    start: Vec<(u64, Time)>,
    fit: Option<Fit>,
    newest_exposed: Option<Time>,
}

impl FrameClock {
    /// A clock that has seen nothing; `latency` is the least time from exposure to arrival.
    pub(crate) fn new(latency: Span, jitter: Span, broken: Span) -> Self {
        Self {
            latency,
            jitter_ns: jitter.as_nanos() as f64,
            break_ns: broken.as_nanos() as f64,
            start: Vec::with_capacity(START_FRAMES),
            fit: None,
            newest_exposed: None,
        }
    }

    /// Takes in the arrival of a frame's first datagram; frames come in rising order.
    pub(crate) fn observe(&mut self, frame: u64, arrived: Time) -> Rhythm {
        let Some(fit) = &mut self.fit else {
            self.start.push((frame, arrived));
            if self.start.len() == START_FRAMES {
                self.fit = Fit::start(&self.start, self.jitter_ns);
                self.start.clear();
            }
            return Rhythm::Steady;
        };
        if fit.observe(frame, arrived, self.break_ns, self.jitter_ns) {
            return Rhythm::Steady;
        }
        self.restart();
        self.start.push((frame, arrived));
        Rhythm::Broken
    }

    /// Forgets the fit: the vendor's count has started over.
    pub(crate) fn restart(&mut self) {
        self.fit = None;
        self.start.clear();
    }

    /// When the shutters were open for a frame whose first datagram came at `arrived`: after every frame
    /// before it, and never after its own arrival.
    pub(crate) fn exposed_at(&mut self, frame: u64, arrived: Time) -> Time {
        let fastest = self.fit.as_ref().map_or(arrived, |fit| fit.line(frame).min(arrived));
        let mut exposed = (fastest - self.latency).max(Time::ZERO);
        if let Some(newest) = self.newest_exposed {
            exposed = exposed.max(newest + Span::from_nanos(1)).min(arrived.max(newest));
        }
        self.newest_exposed = Some(exposed);
        exposed
    }

    /// Time from frame to frame; `None` until fitted.
    #[cfg(test)]
    pub(crate) fn period(&self) -> Option<Span> {
        self.fit.as_ref().map(|fit| Span::from_nanos(fit.period_ns as i64))
    }
}

/// A frame and its arrival, both counted from the fit's origin.
#[derive(Clone, Copy, Debug)]
struct Point {
    frames: f64,
    arrival_ns: f64,
}

/// The line, and what it goes through.
#[derive(Clone, Debug)]
struct Fit {
    origin_frame: u64,
    origin: Time,
    period_ns: f64,
    level_ns: f64,
    blocks: VecDeque<Point>,
    fastest: Option<Point>,
    block_frames: u32,
    watch: Watch,
}

impl Fit {
    /// The first line through frames in rising order; `None` where they show no positive period.
    fn start(frames: &[(u64, Time)], jitter_ns: f64) -> Option<Self> {
        let half = frames.len() / 2;
        let mut slopes: Vec<f64> = frames
            .iter()
            .zip(&frames[half..])
            .map(|(&(n0, t0), &(n1, t1))| (t1 - t0).as_nanos() as f64 / (n1 - n0).max(1) as f64)
            .collect();
        slopes.sort_by(f64::total_cmp);
        let period_ns = *slopes.get(slopes.len() / 2)?;
        let &(origin_frame, origin) = frames.first()?;
        if period_ns <= 0.0 {
            return None;
        }
        let mut fit = Self {
            origin_frame,
            origin,
            period_ns,
            level_ns: 0.0,
            blocks: VecDeque::with_capacity(WINDOW_BLOCKS),
            fastest: None,
            block_frames: 0,
            watch: Watch::default(),
        };
        for &(frame, arrived) in frames {
            fit.collect(fit.point(frame, arrived), jitter_ns);
        }
        Some(fit)
    }

    /// Takes a frame in; false where it breaks the line.
    fn observe(&mut self, frame: u64, arrived: Time, break_ns: f64, jitter_ns: f64) -> bool {
        let point = self.point(frame, arrived);
        let lag_ns = self.residual_ns(point) - self.level_ns;
        if !self.watch.holds(point, lag_ns, self.period_ns, break_ns) {
            return false;
        }
        self.collect(point, jitter_ns);
        true
    }

    fn point(&self, frame: u64, arrived: Time) -> Point {
        Point {
            frames: frame.wrapping_sub(self.origin_frame) as f64,
            arrival_ns: (arrived - self.origin).as_nanos() as f64,
        }
    }

    fn residual_ns(&self, point: Point) -> f64 {
        point.arrival_ns - self.period_ns * point.frames
    }

    /// Earliest arrival of a frame.
    fn line(&self, frame: u64) -> Time {
        let frames = frame.wrapping_sub(self.origin_frame) as f64;
        self.origin.saturating_add(Span::from_nanos((self.level_ns + self.period_ns * frames) as i64))
    }

    fn collect(&mut self, point: Point, jitter_ns: f64) {
        let faster = self.fastest.is_none_or(|fastest| self.residual_ns(point) < self.residual_ns(fastest));
        if faster {
            self.fastest = Some(point);
        }
        self.block_frames += 1;
        if self.block_frames < BLOCK_FRAMES {
            return;
        }
        self.block_frames = 0;
        if self.blocks.len() == WINDOW_BLOCKS {
            self.blocks.pop_front();
        }
        self.blocks.extend(self.fastest.take());
        self.refit(jitter_ns);
    }

    /// A least-squares line through those blocks whose delay is within `jitter_ns` of the least.
    fn refit(&mut self, jitter_ns: f64) {
        let least_ns = self.blocks.iter().map(|&point| self.residual_ns(point)).fold(f64::INFINITY, f64::min);
        let usual = || {
            self.blocks
                .iter()
                .map(|&point| (point.frames, self.residual_ns(point) - least_ns))
                .filter(|p| p.1 <= jitter_ns)
        };
        let count = usual().count() as f64;
        if count < 1.0 {
            return;
        }
        let (sum_frames, sum_ns) = usual().fold((0.0, 0.0), |(x, y), p| (x + p.0, y + p.1));
        let (mean_frames, mean_ns) = (sum_frames / count, sum_ns / count);
        let (xx, xy) = usual().fold((0.0, 0.0), |(xx, xy), p| {
            let dx = p.0 - mean_frames;
            (xx + dx * dx, xy + dx * (p.1 - mean_ns))
        });
        let step_max_ns = PERIOD_STEP_RATIO_MAX * self.period_ns;
        let step_ns = if count >= 3.0 && xx > 0.0 { (xy / xx).clamp(-step_max_ns, step_max_ns) } else { 0.0 };
        // The new line meets the old residuals' mean where the frames' mean lies.
        self.level_ns = least_ns + mean_ns - step_ns * mean_frames;
        self.period_ns += step_ns;
    }
}

/// Looks for frames that break with the line for good, as against stalls, which pass.
#[derive(Clone, Debug, Default)]
struct Watch {
    recent: VecDeque<Point>,
    early_frames: u32,
    creep_frames: u32,
    creep_least_ns: f64,
    creep_before_ns: f64,
}

impl Watch {
    fn holds(&mut self, point: Point, lag_ns: f64, period_ns: f64, break_ns: f64) -> bool {
        self.early_frames = if lag_ns < -break_ns { self.early_frames + 1 } else { 0 };
        let creeps = self.creeps(lag_ns, break_ns);
        let slower = self.slower(point, lag_ns, period_ns, break_ns);
        self.early_frames < EARLY_FRAMES && !creeps && !slower
    }

    /// Several frames in a row with one common, longer period: a stall's frames come in one bunch instead.
    fn slower(&mut self, point: Point, lag_ns: f64, period_ns: f64, break_ns: f64) -> bool {
        if self.recent.len() == RECENT_FRAMES {
            self.recent.pop_front();
        }
        self.recent.push_back(point);
        lag_ns >= break_ns
            && OTHER_PERIODS.iter().any(|&(frames, ratio)| {
                let Some(before) = self.recent.len().checked_sub(frames + 1) else {
                    return false;
                };
                let periods = self
                    .recent
                    .range(before..)
                    .zip(self.recent.range(before + 1..))
                    .map(|(a, b)| (b.arrival_ns - a.arrival_ns) / (b.frames - a.frames).max(1.0));
                let (least, most) =
                    periods.fold((f64::INFINITY, 0.0_f64), |(least, most), p| (least.min(p), most.max(p)));
                least > ratio * period_ns && most < 1.2 * least
            })
    }

    /// Even the fastest of many frames lags, and the fastest of as many after them lags further.
    fn creeps(&mut self, lag_ns: f64, break_ns: f64) -> bool {
        self.creep_least_ns = if self.creep_frames == 0 { lag_ns } else { self.creep_least_ns.min(lag_ns) };
        self.creep_frames += 1;
        if self.creep_frames < CREEP_FRAMES {
            return false;
        }
        self.creep_frames = 0;
        let creeps = self.creep_before_ns > break_ns && self.creep_least_ns - self.creep_before_ns > break_ns;
        self.creep_before_ns = self.creep_least_ns;
        creeps
    }
}

#[cfg(test)]
#[path = "clock_tests.rs"]
mod tests;
