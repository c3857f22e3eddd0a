//! From SVG to PNG, with fonts carried along so that every machine draws the same.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::PictureError;

/// Pixels of the PNG per unit of the drawing: sharp on a dense screen, small enough for a report.
const SCALE: f32 = 1.5;

static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    fonts.set_sans_serif_family("Ubuntu");
    Arc::new(fonts)
});

/// The drawing as a PNG file's bytes.
///
/// # Errors
/// The SVG does not parse, or has no area.
pub fn png_of(svg: &str) -> Result<Vec<u8>, PictureError> {
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|error| PictureError::Raster(error.to_string()))?;
    let size = tree.size().to_int_size();
    let (width, height) = ((size.width() as f32 * SCALE) as u32, (size.height() as f32 * SCALE) as u32);
    let mut pixmap = Pixmap::new(width, height)
        .ok_or_else(|| PictureError::Raster(format!("a picture of {width} by {height} pixels")))?;
    resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut pixmap.as_mut());
    pixmap.encode_png().map_err(|error| PictureError::Raster(error.to_string()))
}
