//! Luminance of the image without its noise, and the weights of squared errors that follow from it.

use super::convergence::by_law;
use crate::adaptive::optimize::Objective;
use bdpm_core::base::math::Rgb;
use bdpm_core::film::halves::HALVES;
use bdpm_core::film::radiance::{box_filter, box_filtered, luminance, luminance_weights};
use bdpm_core::render::block::{Block, CombinedImage};
use rayon::prelude::*;

/// Minimum share of a cell's mean squared luminance that is not noise. Below it, the neighborhood
/// is the better estimate.
const MIN_SIGNAL_SHARE: f64 = 0.9;

/// Minimum share of a single pixel's squared luminance that is not noise. Rare light makes a pixel
/// bright and noisy at once: its weight would fall where its variance is known to be large, and
/// errors of rooms were reported 12 % too low.
pub const MIN_PIXEL_SIGNAL_SHARE: f64 = 0.99;

/// Share of the square below which a pixel was lit by less than two events, since `k` events of one
/// size have a variance of nearly `1/k` of the square of their mean. Such a pixel says nothing
/// about the light around it, and is no part of a neighborhood of others: discs of single photons,
/// 360 times as bright as all around them, made the errors of images of a pool look 40 times too
/// small.
pub const LIT_ONCE: f64 = 0.5;

/// Pixels to each side of a single pixel that are its neighborhood. With 2, errors of rooms were
/// reported 12 % too low where a path has few samples, with 3 9 %, and 1 % instead of 3 %
/// elsewhere.
pub const AROUND_PIXEL: usize = 3;

/// Luminance over that of the neighborhood, in both halves of the samples, from which on a pixel is
/// brighter than its neighborhood rather than noisy.
const BRIGHTER: f64 = 2.0;

/// Weights of the squared errors of the [cells](bdpm_core::film::cells), which are single pixels
/// except in large images: by their luminance for the relative objective, else 1.
pub fn importance(blocks: &[Block], objective: Objective) -> Vec<f64> {
    let image = CombinedImage::new(blocks, vec![1.0; blocks.len()]);
    if objective != Objective::Relative {
        return vec![1.0; image.grid().len()];
    }
    luminance_weights(&luminances(&image))
}

/// Luminance of each cell, W/(m^2 sr), without the contribution of noise to its square: the root of
/// the mean square over its pixels. If noise dominates a cell, the luminance of its neighborhood
/// takes its place. The merge bias is corrected where it is measured: in a dark pixel beside a
/// caustic, it can be many times the luminance.
pub fn luminances(image: &CombinedImage) -> Vec<f64> {
    let grid = image.grid();
    if !grid.is_single_pixels() {
        let moments = image.cell_moments();
        let set_factor = image.set_factor();
        let rms: Vec<f64> = moments.par_iter().map(|moments| moments.square.sqrt()).collect();
        let variance: Option<Vec<f64>> =
            moments.par_iter().map(|moments| Some(set_factor * moments.variance?)).collect();
        return match variance {
            Some(variance) => cells_without_noise(&rms, &variance, grid.size()),
            None => rms,
        };
    }
    let of = |image: Vec<Rgb>| -> Vec<f64> {
        image.into_par_iter().map(|value| luminance(value.as_dvec3())).collect()
    };
    let merged = of(image.uncorrected_mean());
    let mut clean = match image.uncorrected_variance().or_else(|| by_law(image.blocks())) {
        Some(variance) => {
            without_noise(&merged, &variance, image.halves().as_deref(), image.resolution())
        }
        None => merged,
    };
    if image.bias_correction().is_some() {
        let (width, height) = image.resolution();
        let corrected: Vec<_> = of(image.mean()).into_iter().map(|luminance| [luminance]).collect();
        let pooled = box_filter(&corrected, width, height);
        // The noise of the correction must not darken single pixels: the neighborhood bounds it.
        let pixels = clean.par_iter_mut().zip(&corrected).zip(&pooled);
        pixels.for_each(|((clean, [corrected]), [pooled])| {
            *clean = clean.min(corrected.max(*pooled)).max(0.0);
        });
    }
    clean
}

/// Roots of the squared means minus their variances, since noise adds its variance to the square.
/// If the variance exceeds `1 - MIN_PIXEL_SIGNAL_SHARE` of the square, the mean over the
/// neighborhood is used. It hardly follows the noise of the pixel.
///
/// A pixel that was lit once has that light in one of the two `halves` of the samples. The other
/// half says without it how bright the neighborhood is, with all other rare light: pixels that may
/// see a flame by a mirror are a neighborhood of flames, although few of them were lit. A pixel
/// that is far brighter than its neighborhood in both halves counts by its darker half. Without
/// halves, pixels that were lit once are left out.
pub fn without_noise(
    mean: &[f64],
    variance: &[f64],
    halves: Option<&[[f64; HALVES]]>,
    size: (u32, u32),
) -> Vec<f64> {
    let signal = |(mean, variance): (&f64, &f64)| mean * mean - variance;
    let pixels = mean.par_iter().zip(variance);
    let is_lit_once = |own: (&f64, &f64)| signal(own) < LIT_ONCE * own.0 * own.0;
    let of_lit = |own: (&f64, &f64)| if is_lit_once(own) { 0.0 } else { *own.0 };
    let lit: Vec<f64> = pixels.clone().map(of_lit).collect();
    let clean = |(index, own): (usize, (&f64, &f64))| match signal(own) {
        signal if signal > MIN_PIXEL_SIGNAL_SHARE * own.0 * own.0 => signal.sqrt(),
        _ => {
            let around = match halves {
                Some(halves) if is_lit_once(own) => mean_of_darker_half(halves, size, index),
                _ => mean_around([mean, &lit], size, index),
            };
            let [one, other] = halves.map_or([0.0; HALVES], |halves| halves[index]);
            let darker = one.min(other);
            if darker > BRIGHTER * around { darker } else { around.max(0.0) }
        }
    };
    pixels.enumerate().map(clean).collect()
}

/// Indices of the pixels within [`AROUND_PIXEL`].
fn around((width, height): (u32, u32), index: usize) -> impl Iterator<Item = usize> {
    let [width, height] = [width, height].map(|side| side as usize);
    let near = |center: usize, end: usize| {
        center.saturating_sub(AROUND_PIXEL)..(center + AROUND_PIXEL + 1).min(end)
    };
    let (columns, rows) = (near(index % width, width), near(index / width, height));
    rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

/// Mean around a pixel of the half in which it is darker.
fn mean_of_darker_half(halves: &[[f64; HALVES]], size: (u32, u32), index: usize) -> f64 {
    let [first, second] = halves[index];
    let darker = usize::from(second < first);
    let (mut sum, mut count) = (0.0, 0.0);
    for at in around(size, index) {
        (sum, count) = (sum + halves[at][darker], count + 1.0);
    }
    sum / count
}

/// Mean over the pixels within [`AROUND_PIXEL`]. Those that were lit once are 0 in `lit`, and left
/// out if more than half of all were lit more often: else rare light may be all there is.
fn mean_around([mean, lit]: [&[f64]; 2], size: (u32, u32), index: usize) -> f64 {
    let (mut sum, mut count, mut often, mut light) = (0.0, 0.0, 0.0, 0.0);
    for at in around(size, index) {
        (sum, count) = (sum + mean[at], count + 1.0);
        if lit[at] > 0.0 {
            (often, light) = (often + 1.0, light + lit[at]);
        }
    }
    if often > 0.5 * count { light / often } else { sum / count }
}

/// Roots of the mean squares of cells minus their variances. The mean over the neighborhood is used
/// if the variance exceeds `1 - MIN_SIGNAL_SHARE` of the square.
fn cells_without_noise(rms: &[f64], variance: &[f64], (width, height): (u32, u32)) -> Vec<f64> {
    let squares: Vec<_> = rms.par_iter().zip(variance).map(|(l, v)| [l * l - v]).collect();
    let clean = |(index, rms): (usize, &f64)| {
        let [cell] = squares[index];
        let is_clean = cell > MIN_SIGNAL_SHARE * rms * rms;
        let [square] = if is_clean { [cell] } else { box_filtered(&squares, index, width, height) };
        square.max(0.0).sqrt()
    };
    rms.par_iter().enumerate().map(clean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Rare light makes a pixel bright and noisy at once. With its own luminance in the weight, the
    /// pooled relative variance is 17 % too low here.
    #[test]
    fn weights_do_not_follow_rare_light() {
        let (side, samples, share, light) = (64, 256, 0.005, 40.0);
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let pixel = |_: usize| {
            let seen = (0..samples).filter(|_| rng.next_f64() < share).count();
            let found = seen as f64 / f64::from(samples);
            // All pixels have the luminance 1.
            let mean = 1.0 - light * share + light * found;
            let variance = light * light * found * (1.0 - found) / f64::from(samples - 1);
            (mean, variance)
        };
        let (mean, variance): (Vec<f64>, Vec<f64>) = (0..side * side).map(pixel).unzip();
        let own = without_noise(&mean, &variance, None, (side as u32, side as u32));
        let pooled = |weights: Vec<f64>| -> f64 {
            weights.iter().zip(&variance).map(|(weight, variance)| weight * variance).sum()
        };
        let ratio = pooled(luminance_weights(&own)) / pooled(vec![1.0 / 1.01; side * side]);
        // Five standard deviations, by images of other seeds
        assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    }

    /// Discs that one photon of 100 made 400 times too bright have the weight of their
    /// neighborhood.
    #[test]
    fn pixels_lit_once_do_not_weigh_by_their_light() {
        let (side, center) = (15, 15 * 7 + 7);
        let (mut mean, mut variance) = (vec![1.0; side * side], vec![1e-4; side * side]);
        let disc = [center, center + 1, center + 15, center + 16];
        let mut light = |share: f64| {
            for at in disc {
                (mean[at], variance[at]) = (400.0, 400.0 * 400.0 * share);
            }
            without_noise(&mean, &variance, None, (side as u32, side as u32))[center]
        };
        let clean = light(0.99);
        assert!((clean - 1.0).abs() < 1e-12, "{clean}");
        // Four events: the disc is a part of the neighborhood.
        let clean = light(0.24);
        assert!((clean - (45.0 + 4.0 * 400.0) / 49.0).abs() < 1e-12, "{clean}");
        // No pixel was lit more often.
        let all = without_noise(&[4.0, 0.0, 0.0, 0.0], &[15.0, 0.0, 0.0, 0.0], None, (2, 2));
        assert_eq!(all[0], 1.0);
    }

    /// Pixels that see flames by a mirror: bright if a path takes it, which each pixel's does with
    /// a probability of its own. Few are lit more than once. The relative variance is nearly that
    /// by the true weights; without halves it is 17 times as much.
    #[test]
    fn flames_by_mirrors_weigh_by_all_that_may_see_them() {
        let (side, samples, share, light, dark) = (64u32, 16, 0.03, 60.0, 0.05);
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        let pixels = (side * side) as usize;
        let (mut halves, mut mean, mut variance) =
            (vec![[dark; HALVES]; pixels], vec![0.0; pixels], vec![0.0; pixels]);
        for at in 0..pixels {
            for sample in 0..samples {
                if rng.next_f64() < share {
                    halves[at][sample % 2] += light * 2.0 / samples as f64;
                }
            }
            mean[at] = 0.5 * (halves[at][0] + halves[at][1]);
            let found = (mean[at] - dark) / light;
            variance[at] = light * light * found * (1.0 - found) / (samples - 1) as f64;
        }
        let stated = |halves: Option<&[[f64; HALVES]]>| -> f64 {
            let weights = luminance_weights(&without_noise(&mean, &variance, halves, (side, side)));
            weights.iter().zip(&variance).map(|(w, v)| w * v).sum::<f64>() / pixels as f64
        };
        let of_pixel = light * light * share * (1.0 - share) / samples as f64;
        let expected = of_pixel / (1.01 * (dark + light * share).powi(2));
        let (with, without) = (stated(Some(&halves)) / expected, stated(None) / expected);
        println!("{with} {without}");
        // A half has 12 events around a pixel, and 3 to 6 at the border. Inverse squares of a mean
        // of k events have a mean of 1 + 3/k and more of that of the expected value.
        assert!((1.0..1.8).contains(&with) && without > 8.0, "{with} {without}");
    }

    /// A pixel that alone is bright, in both halves, counts by its darker half.
    #[test]
    fn a_bright_pixel_counts_by_its_darker_half() {
        let (side, center) = (15, 15 * 7 + 7);
        let (mut mean, mut variance) = (vec![1.0; side * side], vec![1e-4; side * side]);
        let mut halves = vec![[1.0; HALVES]; side * side];
        (mean[center], variance[center], halves[center]) = (100.0, 5000.0, [60.0, 140.0]);
        let size = (side as u32, side as u32);
        let clean = without_noise(&mean, &variance, Some(&halves), size);
        assert_eq!(clean[center], 60.0);
        // Its light is in one half: the other one says how bright its neighborhood is.
        (variance[center], halves[center]) = (9000.0, [199.0, 1.0]);
        let clean = without_noise(&mean, &variance, Some(&halves), size);
        assert!((clean[center] - 1.0).abs() < 1e-12, "{}", clean[center]);
    }
}
