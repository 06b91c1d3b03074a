//! File name of the preview of an image. The user does not choose this name, so a preview replaces
//! only other previews: `model.exr` may be rendered from a model whose texture is `model.png`.

use bdpm::base::error::{Error, Result};
use bdpm::base::input::read_as;
use bdpm::image_io;
use std::path::{Path, PathBuf};

/// The PNG file beside the image.
pub fn beside(exr: &Path) -> PathBuf {
    exr.with_extension("png")
}

/// Returns `png`, or `NAME.preview.png` if `NAME.png` is not a preview or was read as an input.
pub fn aside(png: &Path) -> Result<PathBuf> {
    let other = png.with_extension("preview.png");
    if is_free(png) {
        return Ok(png.to_owned());
    }
    if is_free(&other) {
        return Ok(other);
    }
    let problem =
        format!("neither this file nor {} is a preview that may be replaced", other.display());
    Err(Error::new(problem, "give --output another name, or move them away").at(png))
}

/// Returns true if the file may be replaced: it is missing, empty or a preview, and was not read.
fn is_free(path: &Path) -> bool {
    let is_nothing = path.metadata().map_or(true, |file| file.len() == 0);
    read_as(path).is_none() && (is_nothing || image_io::is_ours(path))
}
