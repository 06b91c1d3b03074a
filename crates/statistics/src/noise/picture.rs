//! Pictures of the noise: the paper's Figure 3, and the RMS in colors with a scale.

use super::image::NoiseImage;
use crate::film::radiance::box_filter;
use bdpm_base::error::Result;
use bdpm_image::{Canvas, number, quantile, tick_step};
use colorgrad::Gradient;
use std::path::Path;

/// Minimum of pixels along the longer side of a picture; smaller images are magnified.
const SIDE: u32 = 512;

const MARGIN: u32 = 12;

/// Share of the values that a scale covers, so that single bright pixels do not darken the rest.
const COVERED: f64 = 0.995;

/// Scale of the picture of the terms, and pixels it cannot show.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TermsPicture {
    /// Root of a term at full brightness, W/(m^2 sr).
    pub scale: f64,
    /// Pixels in which each of the pooled terms is negative, shown as 0.
    pub negative: [usize; 3],
}

/// Writes the roots of the three terms of (1) at the measured counts as R, G and B, on one linear
/// scale without transfer curve. Terms are pooled over 5x5 pixels before the root.
///
/// # Errors
/// If the file cannot be written; names it.
pub fn write_terms(path: &Path, noise: &NoiseImage) -> Result<TermsPicture> {
    let (n, m) = (f64::from(noise.light_paths), f64::from(noise.camera_paths));
    let terms: Vec<[f64; 3]> =
        noise.pixels.iter().map(|p| p.noise.coefficients.paper_terms(n, m)).collect();
    let pooled = box_filter(&terms, noise.width, noise.height);
    let negative = [0, 1, 2].map(|k| pooled.iter().filter(|terms| terms[k] < 0.0).count());
    let roots: Vec<_> = pooled.iter().map(|terms| terms.map(|t| t.max(0.0).sqrt())).collect();
    let largest = roots.iter().map(|r| r.iter().copied().fold(0.0, f64::max)).collect();
    let scale = quantile(largest, COVERED);
    let magnification = magnification(noise);
    let captions = [
        format!("Noise of one iteration: square roots of the terms of (1), N_F {n}, N_B {m}"),
        format!("full color: {} W/(m² sr) for each term", number(scale)),
    ];
    let names = ["C (interaction)", "B (camera paths)", "F (light paths)"];
    let width = plot_width(noise, &captions, 0);
    let height = noise.height * magnification + 2 * MARGIN + 4 * Canvas::LINE;
    let mut canvas = Canvas::new(width, height, [255; 3]);
    plot(&mut canvas, noise, |i| roots[i].map(|root| byte(root / scale)));
    let mut y = noise.height * magnification + 2 * MARGIN;
    for caption in &captions {
        canvas.text((MARGIN, y), caption);
        y += Canvas::LINE;
    }
    let mut x = MARGIN;
    for (k, name) in names.iter().enumerate() {
        let mut color = [0; 3];
        color[k] = 255;
        canvas.fill((x, y + 2), (12, 12), color);
        let label = match negative[k] {
            0 => (*name).to_owned(),
            count => format!("{name}, {count} pixels < 0"),
        };
        canvas.text((x + 18, y), &label);
        x += 18 + (label.chars().count() as u32 + 2) * Canvas::CHARACTER;
        if x + 24 * Canvas::CHARACTER > width {
            (x, y) = (MARGIN, y + Canvas::LINE);
        }
    }
    canvas.write_png(path)?;
    Ok(TermsPicture { scale, negative })
}

/// Writes the RMS of one iteration by formula (1) in the colors of viridis, with a scale.
///
/// # Errors
/// If the file cannot be written; names it.
pub fn write_rms(path: &Path, noise: &NoiseImage) -> Result<()> {
    let (n, m) = (f64::from(noise.light_paths), f64::from(noise.camera_paths));
    let rms: Vec<f64> =
        noise.pixels.iter().map(|p| p.noise.coefficients.variance(n, m).max(0.0).sqrt()).collect();
    let negative =
        noise.pixels.iter().filter(|p| p.noise.coefficients.variance(n, m) < 0.0).count();
    let scale = quantile(rms.clone(), COVERED);
    let above = rms.iter().filter(|&&x| x > scale).count();
    let viridis = colorgrad::preset::viridis();
    let color = |share: f64| {
        let [r, g, b, _] = viridis.at(share.clamp(0.0, 1.0) as f32).to_rgba8();
        [r, g, b]
    };
    let captions = [
        format!("RMS of one iteration by formula (1), N_F {n}, N_B {m}, W/(m² sr)"),
        format!(
            "from {} iterations; {above} pixels above the scale, {negative} negative",
            noise.iterations
        ),
    ];
    const BAR: u32 = 20;
    let labels = 10 * Canvas::CHARACTER;
    let width = plot_width(noise, &captions, BAR + labels + MARGIN);
    let magnification = magnification(noise);
    let side = noise.height * magnification;
    let plot_height = side.max(12 * Canvas::LINE);
    let mut canvas = Canvas::new(width, plot_height + 2 * MARGIN + 2 * Canvas::LINE, [255; 3]);
    plot(&mut canvas, noise, |i| color(rms[i] / scale));
    let left = 2 * MARGIN + noise.width * magnification;
    for y in 0..plot_height {
        let share = 1.0 - (f64::from(y) + 0.5) / f64::from(plot_height);
        canvas.fill((left, MARGIN + y), (BAR, 1), color(share));
    }
    let step = tick_step(scale, 10.0);
    for tick in 0..=(scale / step + 1e-9) as u32 {
        let value = f64::from(tick) * step;
        let y = MARGIN + ((1.0 - value / scale) * f64::from(plot_height - 1)).round() as u32;
        canvas.fill((left + BAR, y), (5, 1), [0; 3]);
        let place = (left + BAR + 9, y.saturating_sub(8));
        canvas.text(place, &number(value));
    }
    for (line, caption) in (0..).zip(&captions) {
        canvas.text((MARGIN, plot_height + 2 * MARGIN + line * Canvas::LINE), caption);
    }
    canvas.write_png(path)
}

/// Picture pixels along each side of an image pixel.
fn magnification(noise: &NoiseImage) -> u32 {
    SIDE.div_ceil(noise.width.max(noise.height))
}

/// Width for the captions, and for the image with `beside` more pixels.
fn plot_width(noise: &NoiseImage, captions: &[String], beside: u32) -> u32 {
    let text = captions.iter().map(|c| c.chars().count() as u32).max().unwrap_or(0);
    let image = noise.width * magnification(noise) + beside;
    image.max(text * Canvas::CHARACTER) + 2 * MARGIN
}

fn plot(canvas: &mut Canvas, noise: &NoiseImage, color: impl Fn(usize) -> [u8; 3]) {
    let side = magnification(noise);
    for y in 0..noise.height {
        for x in 0..noise.width {
            let index = y as usize * noise.width as usize + x as usize;
            canvas.fill((MARGIN + x * side, MARGIN + y * side), (side, side), color(index));
        }
    }
}

fn byte(share: f64) -> u8 {
    (255.0 * share.clamp(0.0, 1.0)).round() as u8
}
