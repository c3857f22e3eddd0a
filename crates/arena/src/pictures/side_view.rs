//! The side view of flips in 5 ms steps: the paper's Fig. 2.

use plotters::prelude::*;
use quantity::math;

use super::PictureError;
use super::evolution::refused;
use super::style::{FONT, LABEL_PIXELS, TITLE_PIXELS, TRACES};

/// Where the vehicle was at one instant, in the plane of the flip, relative to its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SidePoint {
    /// Since the maneuver's begin.
    pub t_s: f64,
    /// Forward.
    pub x_m: f64,
    /// Up.
    pub z_m: f64,
    /// Pitch, turns included.
    pub theta_rad: f64,
}

/// One flip seen from the side.
#[derive(Clone, Debug, PartialEq)]
pub struct SideView {
    /// What it is.
    pub label: String,
    /// In steps of 5 ms.
    pub points: Vec<SidePoint>,
}

const PANEL_WIDTH: u32 = 420;
const HEIGHT: u32 = 560;

/// Side views beside each other, all to one scale; each stroke is the vehicle, arm to arm, with a dot at its front.
///
/// # Errors
/// The drawing library refuses.
pub fn side_views(title: &str, arm_m: f64, views: &[SideView]) -> Result<String, PictureError> {
    let mut svg = String::new();
    {
        let width = PANEL_WIDTH * views.len().max(1) as u32;
        let area = SVGBackend::with_string(&mut svg, (width, HEIGHT)).into_drawing_area();
        area.fill(&WHITE).map_err(refused)?;
        let titled = area.titled(title, (FONT, TITLE_PIXELS)).map_err(refused)?;
        let panels = titled.split_evenly((1, views.len().max(1)));
        let frame = Frame::around(views, arm_m);
        for (panel, view) in panels.iter().zip(views) {
            draw_panel(panel, view, arm_m, frame)?;
        }
        area.present().map_err(refused)?;
    }
    Ok(svg)
}

#[derive(Clone, Copy)]
struct Frame {
    x_m: (f64, f64),
    z_m: (f64, f64),
}

impl Frame {
    /// One frame around all views, with equal scales on both axes.
    fn around(views: &[SideView], arm_m: f64) -> Self {
        let points = || views.iter().flat_map(|view| &view.points);
        let span = |of: fn(&SidePoint) -> f64| {
            points().fold((0.0_f64, 0.0_f64), |(low, high), point| (low.min(of(point)), high.max(of(point))))
        };
        let (x, z) = (span(|point| point.x_m), span(|point| point.z_m));
        let pad = 2.0 * arm_m;
        let (plot_width, plot_height) = (f64::from(PANEL_WIDTH) - 70.0, f64::from(HEIGHT) - 110.0);
        let metre_per_pixel =
            ((x.1 - x.0 + 2.0 * pad) / plot_width).max((z.1 - z.0 + 2.0 * pad) / plot_height);
        let around = |range: (f64, f64), pixels: f64| {
            let (middle, half) = (0.5 * (range.0 + range.1), 0.5 * pixels * metre_per_pixel);
            (middle - half, middle + half)
        };
        Self { x_m: around(x, plot_width), z_m: around(z, plot_height) }
    }
}

fn draw_panel(
    panel: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    view: &SideView,
    arm_m: f64,
    frame: Frame,
) -> Result<(), PictureError> {
    let mut chart = ChartBuilder::on(panel)
        .caption(&view.label, (FONT, LABEL_PIXELS + 1))
        .margin(8)
        .x_label_area_size(36)
        .y_label_area_size(46)
        .build_cartesian_2d(frame.x_m.0..frame.x_m.1, frame.z_m.0..frame.z_m.1)
        .map_err(refused)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_labels(5)
        .x_desc("x [m]")
        .y_desc("z [m]")
        .label_style((FONT, LABEL_PIXELS - 2))
        .axis_desc_style((FONT, LABEL_PIXELS))
        .draw()
        .map_err(refused)?;
    let count = view.points.len().max(2) - 1;
    for (index, point) in view.points.iter().enumerate() {
        // Positive pitch tips the thrust toward +x, so the front arm goes down.
        let (sin, cos) = math::sin_cos(point.theta_rad);
        let front = (point.x_m + arm_m * cos, point.z_m - arm_m * sin);
        let back = (point.x_m - arm_m * cos, point.z_m + arm_m * sin);
        let depth = 0.25 + 0.6 * index as f64 / count as f64;
        chart
            .draw_series([PathElement::new([back, front], TRACES[0].mix(depth).stroke_width(1))])
            .map_err(refused)?;
        chart.draw_series([Circle::new(front, 1, TRACES[1].mix(depth).filled())]).map_err(refused)?;
    }
    Ok(())
}
