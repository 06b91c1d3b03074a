//! A word about images that show nothing.

use super::progress::Progress;
use bdpm::image_io::{auto_exposure, tone_map};
use bdpm::render::block::CombinedImage;

/// Share of the pixels from which on an image is nearly black.
const NEARLY: f64 = 0.97;

/// Codes of a preview up to this one are black to eyes.
const BLACK: u8 = 12;

/// Warns of an image that is black or nearly so in its preview, with advice.
pub fn warn(image: &CombinedImage, progress: &Progress) {
    let pixels = image.mean();
    let exposure = auto_exposure(&pixels);
    let is_black = |pixel: &&_| tone_map(**pixel, exposure).iter().all(|code| *code <= BLACK);
    let share = pixels.iter().filter(is_black).count() as f64 / pixels.len() as f64;
    let problem = match share {
        1.0 => "the image is black".to_owned(),
        share if share >= NEARLY => format!("{:.1}% of the image is black", 100.0 * share),
        _ => return,
    };
    progress.note(&format!(
        "warning: {problem}\nhelp: give light from all around by --environment 1 or a file, or look from \
         another place: the camera may be inside of something"
    ));
}
