//! Final errors and normalised parameters over the flips: the paper's Figs. 9 to 11.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::PictureError;
use super::style::{FONT, LABEL_PIXELS, TITLE_PIXELS, TRACES};
use crate::report::{FlipReport, Outcome, VehicleReport};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const WIDTH: u32 = 900;
const HEIGHT: u32 = 460;

/// The five components of the final error over the flips of one vehicle; measured as lines, true as dots.
///
/// # Errors
/// The drawing library refuses.
pub fn errors_over_flips(title: &str, vehicle: &VehicleReport) -> Result<String, PictureError> {
    let names = ["x [m]", "z [m]", "vx [m/s]", "vz [m/s]", "theta [rad]"];
    let measured = traces(vehicle, |flip| flip.error.to_array());
    let truth = traces(vehicle, |flip| flip.true_error.to_array());
    let range = range_of(measured.iter().chain(&truth).flatten().map(|point| point.1), 0.1);
    draw(title, vehicle, range, |chart_area, range, flips| {
        let mut chart = axes(chart_area, "final error", range, flips)?;
        for (index, name) in names.iter().enumerate() {
            let colour = TRACES[index];
            chart
                .draw_series(LineSeries::new(measured[index].iter().copied(), colour.stroke_width(2)))
                .map_err(refused)?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            chart
                .draw_series(
                    truth[index].iter().map(|point| Circle::new(*point, 2, colour.mix(0.6).filled())),
                )
                .map_err(refused)?;
        }
        legend(&mut chart)
    })
}

/// The five parameters, each relative to its first value, over the flips of one vehicle.
///
/// # Errors
/// The drawing library refuses.
pub fn parameters_over_flips(title: &str, vehicle: &VehicleReport) -> Result<String, PictureError> {
    let names = ["U1", "T1", "T3", "U5", "T5"];
    let first = vehicle.iterations.first().map_or([1.0; 5], |flip| flip.parameters.to_array());
    let normalised = traces(vehicle, |flip| {
        let mut values = flip.parameters.to_array();
        values.iter_mut().zip(first).for_each(|(value, first)| *value /= first);
        values
    });
    let range = range_of(normalised.iter().flatten().map(|point| point.1), 0.01);
    draw(title, vehicle, range, |area, range, flips| {
        let mut chart = axes(area, "parameter by its first value", range, flips)?;
        for (index, name) in names.iter().enumerate() {
            let colour = TRACES[index];
            chart
                .draw_series(LineSeries::new(normalised[index].iter().copied(), colour.stroke_width(2)))
                .map_err(refused)?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        }
        legend(&mut chart)
    })
}

type Range = (f64, f64);
type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn traces(vehicle: &VehicleReport, of: impl Fn(&FlipReport) -> [f64; 5]) -> [Vec<(f64, f64)>; 5] {
    let mut traces: [Vec<(f64, f64)>; 5] = Default::default();
    for flip in vehicle.iterations.iter().filter(|flip| flip.outcome == Outcome::Completed) {
        for (trace, value) in traces.iter_mut().zip(of(flip)) {
            trace.push((f64::from(flip.index), value));
        }
    }
    traces
}

fn range_of(values: impl Iterator<Item = f64>, least_half: f64) -> Range {
    let (low, high) =
        values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (-least_half, least_half);
    }
    let pad = (0.05 * (high - low)).max(least_half);
    (low - pad, high + pad)
}

fn draw(
    title: &str,
    vehicle: &VehicleReport,
    range: Range,
    body: impl FnOnce(&Area<'_>, Range, f64) -> Result<(), PictureError>,
) -> Result<String, PictureError> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        area.fill(&WHITE).map_err(refused)?;
        let titled = area.titled(title, (FONT, TITLE_PIXELS)).map_err(refused)?;
        let flips = vehicle.iterations.last().map_or(1.0, |flip| f64::from(flip.index).max(1.0));
        body(&titled, range, flips)?;
        area.present().map_err(refused)?;
    }
    Ok(svg)
}

fn axes<'a, 'b>(
    area: &'a Area<'b>,
    what: &str,
    range: Range,
    flips: f64,
) -> Result<Chart<'a, 'b>, PictureError> {
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(62)
        .build_cartesian_2d(0.0..flips, range.0..range.1)
        .map_err(refused)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("flip")
        .y_desc(what)
        .x_label_formatter(&|flip| format!("{flip:.0}"))
        .label_style((FONT, LABEL_PIXELS))
        .axis_desc_style((FONT, LABEL_PIXELS))
        .draw()
        .map_err(refused)?;
    Ok(chart)
}

fn legend<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>) -> Result<(), PictureError> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.2))
        .label_font((FONT, LABEL_PIXELS))
        .draw()
        .map_err(refused)
}

pub(super) fn refused(error: impl std::fmt::Display) -> PictureError {
    PictureError::Drawing(error.to_string())
}
