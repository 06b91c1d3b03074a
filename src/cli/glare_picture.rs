//! `bdpm glare IMAGE --picture OUT.png`: the view in gray, with each glare source in a color.

use bdpm::base::error::Result;
use bdpm::base::math::{Rgb, luminance};
use bdpm::image_io::{Canvas, ToneMapping};
use bdpm::light::glare::{Glare, GlareSource};
use std::path::Path;

/// Colors of sources by their strength, over and over: the strongest is red.
const COLORS: [[u8; 3]; 8] = [
    [214, 39, 40],
    [255, 191, 0],
    [31, 119, 180],
    [44, 160, 44],
    [148, 103, 189],
    [0, 190, 190],
    [227, 119, 194],
    [140, 86, 75],
];
/// Sources with a line below the picture.
const LISTED: usize = 12;
const MARGIN: u32 = 12;
/// Side of the square of a color before its line, pixels.
const SQUARE: u32 = 12;

/// Writes the picture of a rated image.
///
/// # Errors
/// If the file cannot be written; names it.
pub fn write(path: &Path, size: (u32, u32), pixels: &[Rgb], glare: &Glare) -> Result<()> {
    let lines = captions(glare);
    let longest = lines.iter().map(|line| line.chars().count() as u32).max().unwrap_or(0);
    // Room for the square of a color before each line
    let left = MARGIN + SQUARE + 8;
    let width = size.0.max(left + longest * Canvas::CHARACTER + MARGIN);
    let below = MARGIN + lines.len() as u32 * Canvas::LINE + MARGIN;
    let mut canvas = Canvas::new(width, size.1 + below, [255; 3]);
    let mapping = ToneMapping::default();
    let exposure = mapping.exposure(pixels);
    for (index, (pixel, source)) in pixels.iter().zip(&glare.source_of_pixel).enumerate() {
        let gray = mapping.apply(Rgb::splat(luminance(*pixel)), exposure);
        let (x, y) = (index as u32 % size.0, index as u32 / size.0);
        canvas.set(x, y, source.map_or(gray, color));
    }
    for (row, line) in (0..).zip(&lines) {
        let top = size.1 + MARGIN + row * Canvas::LINE;
        if let Some(source) = (row as usize).checked_sub(1).filter(|own| *own < LISTED) {
            canvas.fill((MARGIN, top + 3), (SQUARE, SQUARE), color(source));
        }
        canvas.text((left, top), line);
    }
    canvas.write_png(path)
}

fn color(source: usize) -> [u8; 3] {
    COLORS[source % COLORS.len()]
}

/// The rating, a line for each of the strongest sources, and how many more there are.
fn captions(glare: &Glare) -> Vec<String> {
    let ugr = glare.ugr.map_or_else(|| "none".into(), |ugr| format!("{ugr:.1}"));
    let illuminance = glare.vertical_illuminance;
    let rating = format!("DGP {:.3}, UGR {ugr}, {illuminance:.0} lx at the eye", glare.dgp);
    let source = |source: &GlareSource| {
        let GlareSource { luminance, solid_angle, position_index, .. } = source;
        format!("{luminance:.0} cd/m2, {solid_angle:.4} sr, position index {position_index:.2}")
    };
    let listed = glare.sources.iter().take(LISTED).map(source);
    let more = glare.sources.len().saturating_sub(LISTED);
    let rest = (more > 0).then(|| format!("and {more} weaker sources"));
    [rating].into_iter().chain(listed).chain(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::light::glare::{LuminanceImage, SourceSearch};
    use bdpm::scene::FisheyeProjection;

    #[test]
    fn sources_have_colors_by_their_strength() {
        let size = (64, 64);
        // Two sources, 1000 cd/m2 around them
        let mut pixels = vec![Rgb::splat(1000.0 / 683.0); 64 * 64];
        let [weak, strong] = [(12, 32), (36, 30)];
        let at = |(x, y): (u32, u32)| (y * 64 + x) as usize;
        for (place, luminance) in [(weak, 3000.0), (strong, 30_000.0)] {
            pixels[at(place)] = Rgb::splat(luminance / 683.0);
        }
        let equidistant = FisheyeProjection::Equidistant;
        let image = LuminanceImage::new(size, &pixels, equidistant, std::f64::consts::PI);
        let glare = Glare::new(&image, &SourceSearch::default());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sources.png");
        write(&path, size, &pixels, &glare).unwrap();
        let picture = image::open(&path).unwrap().to_rgb8();
        let seen = |(x, y): (u32, u32)| picture.get_pixel(x, y).0;
        assert_eq!([seen(strong), seen(weak)], [COLORS[0], COLORS[1]]);
        let [red, green, blue] = seen((32, 10));
        assert!(red == green && green == blue, "the rest is gray");
        // The squares before the second and the third line
        let square = |row| seen((MARGIN + 2, 64 + MARGIN + row * Canvas::LINE + 6));
        assert_eq!([square(1), square(2)], [COLORS[0], COLORS[1]]);
    }
}
