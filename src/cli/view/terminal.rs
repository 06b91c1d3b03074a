//! A small picture in the terminal. Each character shows two pixels: a half block in one color on a
//! background of another. The terminal must support 24-bit colors.

use crate::cli::progress::Progress;
use bdpm::base::math::Rgb;
use bdpm::image_io::{auto_exposure, tone_map};
use bdpm::output::denoise::Denoised;
use bdpm::render::block::CombinedImage;
use std::fmt::Write;

/// Maximum number of characters in a line.
const COLUMNS: u32 = 72;

/// Lines of the terminal that the picture leaves free.
const SPARE: u32 = 5;

/// Shows the image above the progress bar.
pub fn show(progress: &Progress, image: &CombinedImage, denoised: Option<&Denoised>) {
    let (rows, columns) = console::Term::stderr().size();
    let rows = u32::from(rows).saturating_sub(SPARE);
    let columns = u32::from(columns).saturating_sub(1).min(COLUMNS);
    let size = image.resolution();
    let Some(small) = fitting(size, (columns, 2 * rows)) else { return };
    let mean;
    let pixels = match denoised {
        Some(denoised) => &denoised.image,
        None => {
            mean = image.mean();
            &mean
        }
    };
    let exposure = auto_exposure(pixels);
    let pixels = shrunk(pixels, size, small);
    let bytes: Vec<_> = pixels.iter().map(|&pixel| tone_map(pixel, exposure)).collect();
    progress.picture(&lines(&bytes, small.0 as usize));
}

/// The largest size with this aspect ratio and an even height that fits; `None` if there is too
/// little room.
fn fitting((width, height): (u32, u32), (columns, rows): (u32, u32)) -> Option<(u32, u32)> {
    let scale = (f64::from(columns) / f64::from(width)).min(f64::from(rows) / f64::from(height));
    let along = |pixels: u32| (f64::from(pixels) * scale.min(1.0)).round() as u32;
    let small = (along(width), along(height) / 2 * 2);
    (small.0 >= 4 && small.1 >= 4).then_some(small)
}

/// Shrinks an image: means over the pixels that become one.
fn shrunk(pixels: &[Rgb], (width, height): (u32, u32), (across, down): (u32, u32)) -> Vec<Rgb> {
    let span = |index: u32, parts: u32, whole: u32| {
        let end = |index: u32| (u64::from(index) * u64::from(whole) / u64::from(parts)) as usize;
        end(index)..end(index + 1).max(end(index) + 1)
    };
    let mean = |x: u32, y: u32| {
        let (rows, columns) = (span(y, down, height), span(x, across, width));
        let count = (rows.len() * columns.len()) as f32;
        let of_row = |row: usize| &pixels[row * width as usize..][columns.clone()];
        rows.flat_map(of_row).copied().sum::<Rgb>() / count
    };
    (0..down).flat_map(|y| (0..across).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect()
}

/// Lines of characters, the colors of two rows of pixels in each.
fn lines(pixels: &[[u8; 3]], width: usize) -> Vec<String> {
    let line = |rows: &[[u8; 3]]| {
        let (upper, lower) = rows.split_at(width);
        let mut line = String::new();
        for ([r, g, b], [s, h, c]) in upper.iter().zip(lower) {
            write!(line, "\x1b[38;2;{r};{g};{b}m\x1b[48;2;{s};{h};{c}m\u{2580}")
                .expect("memory takes everything");
        }
        line + "\x1b[0m"
    };
    pixels.chunks_exact(2 * width).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fitted_picture_keeps_its_aspect_ratio() {
        assert_eq!(fitting((400, 300), (72, 200)), Some((72, 54)));
        assert_eq!(fitting((400, 300), (72, 30)), Some((40, 30)));
        assert_eq!(fitting((16, 12), (72, 80)), Some((16, 12)));
        assert_eq!(fitting((400, 300), (72, 0)), None);
        assert_eq!(fitting((4000, 8), (72, 40)), None);
    }

    #[test]
    fn character_shows_two_pixels_and_shrinking_keeps_means() {
        let pixels: Vec<Rgb> = (0..24).map(|i| Rgb::splat(i as f32)).collect();
        assert_eq!(shrunk(&pixels, (6, 4), (3, 2))[0], Rgb::splat(3.5));
        assert_eq!(shrunk(&pixels, (6, 4), (6, 4)), pixels);
        let found = lines(&[[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]], 2);
        let character =
            |above: &str, below: &str| format!("\x1b[38;2;{above}m\x1b[48;2;{below}m\u{2580}");
        let expected = character("1;2;3", "7;8;9") + &character("4;5;6", "10;11;12") + "\x1b[0m";
        assert_eq!(found, [expected]);
    }
}
