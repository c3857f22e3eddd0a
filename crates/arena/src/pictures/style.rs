//! The look the pictures share.

use plotters::style::RGBColor;

/// Five colours that stay apart in print and for colour-blind eyes (Wong, Nature Methods 2011).
pub(super) const TRACES: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 86, 86),
];

/// The font family every text names; the raster step carries it.
pub(super) const FONT: &str = "sans-serif";

/// Text beside axes and in legends.
pub(super) const LABEL_PIXELS: u32 = 14;

/// Text above a drawing.
pub(super) const TITLE_PIXELS: u32 = 18;
