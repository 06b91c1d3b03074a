//! Luminance of the image without its noise, and the weights of squared errors that follow from it.

use crate::adaptive::optimize::Objective;
use bdpm_core::base::math::Rgb;
use bdpm_core::film::radiance::{box_filter, box_filtered, luminance, luminance_weights};
use bdpm_core::render::block::{Block, CombinedImage};
use rayon::prelude::*;

/// Minimum share of a pixel's squared luminance that is not noise. Below it, the luminance of the
/// neighborhood is the better estimate.
const MIN_SIGNAL_SHARE: f64 = 0.9;

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
        let rms: Vec<f64> = moments.par_iter().map(|moments| moments.square.sqrt()).collect();
        let variance: Option<Vec<f64>> =
            moments.par_iter().map(|moments| moments.variance).collect();
        return match variance {
            Some(variance) => without_noise(&rms, &variance, grid.size()),
            None => rms,
        };
    }
    let of = |image: Vec<Rgb>| -> Vec<f64> {
        image.into_par_iter().map(|value| luminance(value.as_dvec3())).collect()
    };
    let merged = of(image.uncorrected_mean());
    let mut clean = match image.uncorrected_variance() {
        Some(variance) => without_noise(&merged, &variance, image.resolution()),
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
/// The neighborhood is used if the variance exceeds `1 - MIN_SIGNAL_SHARE` of the square.
pub fn without_noise(mean: &[f64], variance: &[f64], (width, height): (u32, u32)) -> Vec<f64> {
    let squares: Vec<_> = mean.par_iter().zip(variance).map(|(l, v)| [l * l - v]).collect();
    let clean = |(index, luminance): (usize, &f64)| {
        let [pixel] = squares[index];
        let is_clean = pixel > MIN_SIGNAL_SHARE * luminance * luminance;
        let [square] =
            if is_clean { [pixel] } else { box_filtered(&squares, index, width, height) };
        square.max(0.0).sqrt()
    };
    mean.par_iter().enumerate().map(clean).collect()
}
