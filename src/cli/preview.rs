//! Where the preview of an image goes. Nobody gave it a name, so it replaces nothing but a preview: `model.exr`
//! may be rendered from a model whose texture is `model.png`.

use bdpm::base::input::read_as;
use bdpm::pictures;
use std::path::{Path, PathBuf};

/// Beside the image, by its name.
pub fn beside(exr: &Path) -> PathBuf {
    exr.with_extension("png")
}

/// The same, or `NAME.preview.png` where `NAME.png` is something else, which may have been read.
pub fn aside(png: &Path) -> PathBuf {
    let is_nothing = |path: &Path| path.metadata().map_or(true, |file| file.len() == 0);
    if read_as(png).is_none() && (is_nothing(png) || pictures::is_ours(png)) {
        return png.to_owned();
    }
    png.with_extension("preview.png")
}
