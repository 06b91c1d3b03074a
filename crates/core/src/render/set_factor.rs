//! How much less noise an image has because its camera paths start from Sobol points: theory.md,
//! section 11b.

use super::combined_image::CombinedImage;
use crate::film::cells::CellGrid;
use crate::film::halves::HALVES;
use crate::film::radiance::{box_filter, luminance_weights};
use rayon::prelude::*;

/// Minimum number of cells of an image whose factor is estimated: the standard deviation of the
/// estimate is about the root of two over this number.
const MIN_CELLS: usize = 2048;

/// Minimum number of iterations: with fewer, sets have a single point.
const MIN_ITERATIONS: u64 = 16;

/// Luminance of both halves of an image and the sums of the weights of their iterations.
pub(super) struct HalfMeans {
    /// Means of each cell in row order.
    pub means: Vec<[f64; HALVES]>,
    /// Sums of the weights.
    pub totals: [f64; HALVES],
}

/// Variance of the image over that of as many independent iterations, at most 1, and its standard
/// error; 1 and 0 where it is not known. `variance` has that of independent iterations, the mean
/// over the pixels of each cell.
/// theory.md (44g)
pub(super) fn set_factor(image: &CombinedImage, halves: &HalfMeans, variance: &[f64]) -> [f64; 2] {
    let grid = image.grid();
    if grid.len() < MIN_CELLS || image.iterations() < MIN_ITERATIONS {
        return [1.0, 0.0];
    }
    let HalfMeans { means, totals: [first, second] } = halves;
    let weights = weights(grid, means);
    let share = first * second / (first + second).powi(2);
    let sums = means.par_iter().zip(variance).zip(&weights).enumerate().map(
        |(cell, (([one, other], variance), weight))| {
            let between = grid.pixels_of(cell) * share * (one - other).powi(2);
            [weight * between, weight * variance]
        },
    );
    // Added in order: the sum does not depend on the threads.
    let sums: Vec<[f64; 2]> = sums.collect();
    let [between, independent] = sums.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    let factor = between / independent;
    if !(factor.is_finite() && factor > 0.0) {
        return [1.0, 0.0];
    }
    let residuals: f64 = sums.iter().map(|[own, other]| (own - factor * other).powi(2)).sum();
    [factor.min(1.0), residuals.sqrt() / independent]
}

/// Weights of the cells by the luminance around them.
fn weights(grid: CellGrid, means: &[[f64; HALVES]]) -> Vec<f64> {
    let (width, height) = grid.size();
    let own: Vec<[f64; 1]> = means.iter().map(|[one, other]| [0.5 * (one + other)]).collect();
    let around = box_filter(&own, width, height).into_iter().map(|[own]| own);
    luminance_weights(&around.collect::<Vec<f64>>())
}
