//! Pictures of an experiment in the manner of the paper's Figs. 2 and 9 to 11, as SVG and PNG.

mod evolution;
mod raster;
mod side_view;
mod style;
mod time_plot;

use std::path::{Path, PathBuf};

use thiserror::Error;

pub use evolution::{errors_over_flips, parameters_over_flips};
pub use raster::png_of;
pub use side_view::{SidePoint, SideView, side_views};
pub use time_plot::{Trace, time_plot};

/// Why a picture was not made.
#[derive(Debug, Error)]
pub enum PictureError {
    /// The drawing library refused.
    #[error("drawing failed: {0}")]
    Drawing(String),
    /// The SVG could not be turned into pixels.
    #[error("turning the drawing into pixels failed: {0}")]
    Raster(String),
    /// The file could not be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Writes a drawing as `<stem>.svg` and `<stem>.png` into a folder and returns both paths.
///
/// # Errors
/// The raster step or the file system fails.
pub fn write(folder: &Path, stem: &str, svg: &str) -> Result<[PathBuf; 2], PictureError> {
    let png = png_of(svg)?;
    let paths = [folder.join(format!("{stem}.svg")), folder.join(format!("{stem}.png"))];
    for (path, bytes) in paths.iter().zip([svg.as_bytes(), png.as_slice()]) {
        std::fs::write(path, bytes).map_err(|source| PictureError::File { path: path.clone(), source })?;
    }
    Ok(paths)
}
