//! Warns about black images.

use super::progress::Progress;
use bdpm::base::math::Rgb;
use bdpm::image_io::{auto_exposure, tone_map};

/// Minimum share of black pixels for a warning.
const MIN_BLACK_SHARE: f64 = 0.97;

/// Largest 8-bit value of a preview that looks black.
const MAX_BLACK: u8 = 12;

/// Number of pixels that are examined in a larger image, at least.
const MAX_PIXELS: usize = 1 << 20;

/// Warns if the preview of an image is black or nearly black.
pub fn warn(pixels: &[Rgb], progress: &Progress) {
    let exposure = auto_exposure(pixels);
    let pixels: Vec<Rgb> =
        pixels.iter().step_by((pixels.len() / MAX_PIXELS).max(1)).copied().collect();
    let is_black = |pixel: &&_| tone_map(**pixel, exposure).iter().all(|code| *code <= MAX_BLACK);
    let share = pixels.iter().filter(is_black).count() as f64 / pixels.len() as f64;
    let problem = match share {
        1.0 => "the image is black".to_owned(),
        share if share >= MIN_BLACK_SHARE => format!("{:.1}% of the image is black", 100.0 * share),
        _ => return,
    };
    progress.note(&format!(
        "warning: {problem}\nhelp: add an environment by --environment 1 or a file, or move the camera: it may be inside an object"
    ));
}
