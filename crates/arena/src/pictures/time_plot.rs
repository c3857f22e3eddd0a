//! Quantities over time, one panel per unit.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::PictureError;
use super::evolution::refused;
use super::style::{FONT, LABEL_PIXELS, TITLE_PIXELS, TRACES};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const WIDTH: u32 = 1000;
const PANEL_HEIGHT: u32 = 300;
const TITLE_HEIGHT: u32 = 40;
/// What a line of the legend takes of a panel's height, with its share of the border.
const LEGEND_LINE_PIXELS: f64 = 28.0;
/// Stretches of time of which each trace shows the first, least, greatest and last value: finer than the
/// pixels of a sharp screen.
const BINS: usize = 2000;

/// One line of a plot. Takes any number of points, in order of time, and remembers what can be seen of them.
#[derive(Clone, Debug)]
pub struct Trace {
    label: String,
    unit: Option<String>,
    range_s: (f64, f64),
    bins: Vec<Option<Bin>>,
    points: u64,
}

/// What can be seen of a stretch of time as wide as a pixel.
#[derive(Clone, Copy, Debug)]
struct Bin {
    first: (f64, f64),
    least: (f64, f64),
    greatest: (f64, f64),
    last: (f64, f64),
}

impl Trace {
    /// A trace over this range of seconds.
    #[must_use]
    pub fn new(label: String, unit: Option<String>, range_s: (f64, f64)) -> Self {
        Self { label, unit, range_s, bins: vec![None; BINS], points: 0 }
    }

    /// Takes a point. What is no number is not drawn.
    pub fn take(&mut self, time_s: f64, value: f64) {
        let (start, end) = self.range_s;
        if !value.is_finite() || !(start..=end).contains(&time_s) {
            return;
        }
        self.points += 1;
        let place = (time_s - start) / (end - start) * BINS as f64;
        // A range of no length has all its points at its beginning.
        let place = if place.is_finite() { (place as usize).min(BINS - 1) } else { 0 };
        let point = (time_s, value);
        match &mut self.bins[place] {
            Some(bin) => {
                bin.last = point;
                if value < bin.least.1 {
                    bin.least = point;
                }
                if value > bin.greatest.1 {
                    bin.greatest = point;
                }
            }
            empty => *empty = Some(Bin { first: point, least: point, greatest: point, last: point }),
        }
    }

    /// Points taken.
    #[must_use]
    pub fn points(&self) -> u64 {
        self.points
    }

    /// What is drawn, in order of time.
    fn seen(&self) -> Vec<(f64, f64)> {
        let mut seen = Vec::new();
        for bin in self.bins.iter().flatten() {
            let mut points = [bin.first, bin.least, bin.greatest, bin.last];
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            for point in points {
                if seen.last() != Some(&point) {
                    seen.push(point);
                }
            }
        }
        seen
    }
}

/// Traces over time, those of one unit in one panel, as SVG.
///
/// # Errors
/// The drawing library refuses.
pub fn time_plot(title: &str, traces: &[Trace]) -> Result<String, PictureError> {
    let mut units: Vec<&Option<String>> = Vec::new();
    for trace in traces {
        if !units.contains(&&trace.unit) {
            units.push(&trace.unit);
        }
    }
    let mut svg = String::new();
    {
        let height = TITLE_HEIGHT + PANEL_HEIGHT * units.len().max(1) as u32;
        let area = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        area.fill(&WHITE).map_err(refused)?;
        let titled = area.titled(title, (FONT, TITLE_PIXELS)).map_err(refused)?;
        let panels = titled.split_evenly((units.len().max(1), 1));
        for (panel, unit) in panels.iter().zip(units) {
            let own: Vec<&Trace> = traces.iter().filter(|trace| trace.unit == *unit).collect();
            draw_panel(panel, unit.as_deref(), &own)?;
        }
        area.present().map_err(refused)?;
    }
    Ok(svg)
}

fn draw_panel(panel: &Area<'_>, unit: Option<&str>, traces: &[&Trace]) -> Result<(), PictureError> {
    let seen: Vec<Vec<(f64, f64)>> = traces.iter().map(|trace| trace.seen()).collect();
    let (start, end) = traces.first().map_or((0.0, 1.0), |trace| trace.range_s);
    let end = if end > start { end } else { start + 1.0 };
    let (low, high) = value_range(seen.iter().flatten().map(|point| point.1));
    // Room above the lines for the legend.
    let legend_part = (LEGEND_LINE_PIXELS * traces.len() as f64 / f64::from(PANEL_HEIGHT)).min(0.5);
    let high = high + (high - low) * legend_part / (1.0 - legend_part);
    let mut chart = ChartBuilder::on(panel)
        .margin(12)
        .x_label_area_size(38)
        .y_label_area_size(72)
        .build_cartesian_2d(start..end, low..high)
        .map_err(refused)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("time [s]")
        .y_desc(unit.map_or_else(String::new, |unit| format!("[{unit}]")))
        .label_style((FONT, LABEL_PIXELS))
        .axis_desc_style((FONT, LABEL_PIXELS))
        .draw()
        .map_err(refused)?;
    for (index, (trace, points)) in traces.iter().zip(seen).enumerate() {
        let colour = TRACES[index % TRACES.len()];
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(1)))
            .map_err(refused)?
            .label(&trace.label)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.2))
        .label_font((FONT, LABEL_PIXELS))
        .draw()
        .map_err(refused)
}

/// A little more than the values cover; never nothing.
fn value_range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) =
        values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (-1.0, 1.0);
    }
    let pad = (0.05 * (high - low)).max(1e-9 * low.abs().max(high.abs()));
    if pad > 0.0 { (low - pad, high + pad) } else { (low - 1.0, high + 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_among_many_points_is_seen_and_little_is_kept() {
        let mut trace = Trace::new("a".to_owned(), None, (0.0, 100.0));
        for index in 0..200_000_u32 {
            let value = if index == 123_457 { 9.0 } else { f64::from(index % 7) * 0.1 };
            trace.take(f64::from(index) * 0.0005, value);
        }
        trace.take(50.0, f64::NAN);
        let seen = trace.seen();
        assert!(seen.len() <= 4 * BINS, "{}", seen.len());
        assert!(seen.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        let spike = 123_457.0 * 0.0005;
        assert_eq!(seen.iter().filter(|point| point.1 > 1.0).collect::<Vec<_>>(), [&(spike, 9.0)]);
        assert_eq!((seen[0], trace.points()), ((0.0, 0.0), 200_000));
    }

    #[test]
    fn each_unit_has_a_panel_and_each_trace_a_label() {
        let trace = |label: &str, unit: Option<&str>| {
            let mut trace = Trace::new(label.to_owned(), unit.map(str::to_owned), (0.0, 1.0));
            (0..10).for_each(|index| trace.take(f64::from(index) * 0.1, f64::from(index)));
            trace
        };
        let svg = time_plot(
            "a title",
            &[trace("one", Some("m")), trace("two", Some("m/s")), trace("three", Some("m"))],
        )
        .unwrap();
        for word in ["a title", "one", "two", "three", "[m]", "[m/s]", "time [s]"] {
            assert!(svg.contains(word), "{word}");
        }
        assert_eq!(svg.matches("[m]").count(), 1);
        time_plot("nothing", &[Trace::new("none".to_owned(), None, (5.0, 5.0))]).unwrap();
    }
}
