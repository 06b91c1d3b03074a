//! Where the preview of an image goes. Nobody gave it a name, so it replaces nothing but a preview: `model.exr`
//! may be rendered from a model whose texture is `model.png`.

use bdpm::base::error::{Error, Result};
use bdpm::base::input::read_as;
use bdpm::image_io;
use std::path::{Path, PathBuf};

/// Beside the image, by its name.
pub fn beside(exr: &Path) -> PathBuf {
    exr.with_extension("png")
}

/// The same, or `NAME.preview.png` where `NAME.png` is another picture, which may have been read.
pub fn aside(png: &Path) -> Result<PathBuf> {
    let other = png.with_extension("preview.png");
    if is_free(png) {
        return Ok(png.to_owned());
    }
    if is_free(&other) {
        return Ok(other);
    }
    let problem = format!("neither this nor {} is a preview, to be replaced", other.display());
    Err(Error::new(problem, "give --output another name, or move them away").at(png))
}

/// Whether there is nothing of worth.
fn is_free(path: &Path) -> bool {
    let is_nothing = path.metadata().map_or(true, |file| file.len() == 0);
    read_as(path).is_none() && (is_nothing || image_io::is_ours(path))
}
