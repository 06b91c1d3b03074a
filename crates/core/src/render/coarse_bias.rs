//! Bias of a cache in large parts of the image: theory.md (44l).
//!
//! A tenth of the light of a dark corner is below the noise of each of its squares of pixels, and
//! far above the noise of all of them together. So windows of the image, the largest first,
//! estimate what is the same in the whole window. Smaller windows estimate what is left there, and
//! after them the squares themselves.

use super::annulus_moments::{FoldEstimate, FoldWeight};
use super::bias_correction::{CACHE_EXCESS, LARGE_BIAS2, SQUARES_AROUND, shrinkage};
use crate::base::math::Rgb;
use crate::film::annulus::FOLDS;
use crate::film::cells::CellGrid;
use crate::film::radiance::{luminance, luminance_weights};
use crate::film::smoothing::{box_means, tent_sums};
use glam::DVec3;
use rayon::prelude::*;

/// Distance in squares at which the weights of the smallest window are zero. Each window is twice
/// as large as the one before.
const SMALLEST_WINDOW: usize = 2;

/// Most squares across or down. Larger images have larger squares: sums over windows take a time in
/// proportion to the number of squares times the size of the window.
const MOST_SQUARES: u32 = 256;

/// Variance of a square over the mean variance of its pixels, which are linear between the centers
/// of squares: in each direction, the mean of `u^2 + (1 - u)^2` is 2/3.
const SQUARE_VARIANCE: f64 = 9.0 / 4.0;

/// Bias of a cache in a part of the image, by the iterations of each fold.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CoarseBias {
    /// Radiance, W/(m^2 sr).
    pub mean: [Rgb; FOLDS],
    /// Variance of its luminance.
    pub variance: [f64; FOLDS],
}

/// Sums over the cells of a square.
#[derive(Clone, Copy, Default)]
struct Square {
    cells: f64,
    /// Sum of the weights of squared errors.
    weight: f64,
    /// Weight times what the cache adds.
    more: [DVec3; FOLDS],
    /// Variance of the luminance of `more`.
    variance: [f64; FOLDS],
    /// `variance` from the noise of the squares around, for where the bias seems to be large.
    around: [f64; FOLDS],
}

/// Sums over the squares of a window: cells, weights, and what is left of what the cache adds.
type WindowSums = [f64; 2 + 3 * FOLDS];

/// Variances of the luminances of the last of [`WindowSums`], from their own squares and from those
/// around.
type WindowVariances = [f64; 2 * FOLDS];

/// The bias in windows of several sizes, of each cell of an image of this size in row order. `side`
/// is that of the squares in cells, `luminance` that of each cell. The other fold
/// gives the share (71d) of the bias of a fold that is subtracted, if it `knows` its noise.
pub(super) fn coarse_bias(
    estimates: &[[FoldEstimate; FOLDS]],
    (size, side): ((u32, u32), u32),
    luminance: &[f64],
    (folds, knows): (&[FoldWeight; FOLDS], [bool; FOLDS]),
) -> Vec<CoarseBias> {
    let mut grid = CellGrid::with_side(size, side.next_power_of_two());
    while grid.size().0.max(grid.size().1) > MOST_SQUARES {
        grid = CellGrid::with_side(size, 2 * grid.side());
    }
    let shrinking = (f64::from(side) / f64::from(grid.side())).powi(2);
    let squares = squares_of(estimates, (size, grid), luminance, folds);
    let [across, down] = <[u32; 2]>::from(grid.size()).map(|count| count as usize);
    let mut coarse = vec![CoarseBias::default(); squares.len()];
    let sizes = std::iter::successors(Some(SMALLEST_WINDOW), |size| Some(2 * size));
    let sizes: Vec<_> = sizes.take_while(|size| *size < across.max(down)).collect();
    for size in sizes.into_iter().rev() {
        let left = squares.iter().zip(&coarse).map(|(own, coarse)| own.without(coarse));
        let (sums, variances): (Vec<_>, Vec<_>) = left.unzip();
        let sums = tent_sums(&sums, [across, down], size, |weight| weight);
        let variances = tent_sums(&variances, [across, down], size, |weight| weight * weight);
        let windows = coarse.par_iter_mut().zip(sums).zip(variances);
        windows.for_each(|((coarse, sums), variances)| {
            coarse.add_window(&sums, variances.map(|own| shrinking * own), knows);
        });
    }
    let mix = |parts: [(CoarseBias, f32); 4]| mixed(&parts);
    let across = size.0 as usize;
    let cell = |index: usize| {
        grid.interpolated(&coarse, ((index % across) as u32, (index / across) as u32), mix)
    };
    (0..estimates.len()).into_par_iter().map(cell).collect()
}

/// Sums over the cells of each square.
fn squares_of(
    estimates: &[[FoldEstimate; FOLDS]],
    (size, grid): ((u32, u32), CellGrid),
    luminance: &[f64],
    folds: &[FoldWeight; FOLDS],
) -> Vec<Square> {
    let (width, side) = (size.0 as usize, grid.side() as usize);
    let [across, down] = <[u32; 2]>::from(grid.size()).map(|count| count as usize);
    let row_of_squares = |row: usize| {
        let mut squares = vec![Square::default(); across];
        let end = (row + 1) * side * width;
        for index in row * side * width..end.min(estimates.len()) {
            let own = &mut squares[index % width / side];
            own.cells += 1.0;
            own.weight += luminance[index];
            for (fold, estimate) in estimates[index].iter().enumerate() {
                own.more[fold] += estimate.sum.as_dvec3() / folds[fold].first;
                // Cells of a square share their noise: deviations are added.
                own.variance[fold] += estimate.variance.max(0.0).sqrt() / folds[fold].first;
            }
        }
        squares
    };
    let mut squares: Vec<Square> =
        (0..down).into_par_iter().flat_map_iter(row_of_squares).collect();
    // Weights of single squares would depend on their noise.
    let own: Vec<f64> = squares.iter().map(|own| own.weight / own.cells).collect();
    let weights = luminance_weights(&box_means(&own, across, down, 1));
    for (own, weight) in squares.iter_mut().zip(weights) {
        own.weight = own.cells * weight;
        own.more = own.more.map(|more| weight * more);
        let square = |deviation: f64| SQUARE_VARIANCE * (weight * deviation).powi(2);
        own.variance = own.variance.map(square);
    }
    for fold in 0..FOLDS {
        let own: Vec<f64> = squares.iter().map(|own| own.variance[fold] / own.weight).collect();
        let wide = box_means(&own, across, down, SQUARES_AROUND as usize);
        for (own, wide) in squares.iter_mut().zip(wide) {
            own.around[fold] = wide * own.weight;
        }
    }
    squares
}

impl Square {
    /// Its sums without the bias that larger windows have found, and their variances.
    fn without(&self, coarse: &CoarseBias) -> (WindowSums, WindowVariances) {
        let left = |fold: usize| self.more[fold] - self.weight * coarse.mean[fold].as_dvec3();
        let [one, other] = [left(0), left(1)];
        (
            [self.cells, self.weight, one.x, one.y, one.z, other.x, other.y, other.z],
            [self.variance[0], self.variance[1], self.around[0], self.around[1]],
        )
    }
}

/// Sum of four times their weights.
fn mixed(parts: &[(CoarseBias, f32); 4]) -> CoarseBias {
    let mut sum = CoarseBias::default();
    for (own, weight) in parts {
        for fold in 0..FOLDS {
            sum.mean[fold] += own.mean[fold] * *weight;
            sum.variance[fold] += own.variance[fold] * f64::from(*weight);
        }
    }
    sum
}

impl CoarseBias {
    /// Adds what a window finds beyond larger ones.
    fn add_window(&mut self, sums: &WindowSums, variances: WindowVariances, knows: [bool; FOLDS]) {
        let [cells, weight, ax, ay, az, bx, by, bz] = *sums;
        let means = [DVec3::new(ax, ay, az), DVec3::new(bx, by, bz)].map(|own| own / weight);
        let variances = variances.map(|own| own / (weight * weight));
        for fold in 0..FOLDS {
            let other = 1 - fold;
            let bias2 = luminance(means[other]).powi(2);
            let [own, around] = [variances[other], variances[FOLDS + other]];
            let is_large = bias2 * weight > LARGE_BIAS2 * cells;
            let share = match knows[other] {
                true if is_large => {
                    let variance = own.max(around);
                    shrinkage(bias2 - variance, variance, CACHE_EXCESS)
                }
                true => shrinkage(bias2 - own, own, 0.0),
                false => 0.0,
            };
            self.mean[fold] += means[fold].as_vec3() * share as f32;
            // A mean and that of a part of it have the variance of the first in common.
            let square = share * share;
            self.variance[fold] = (1.0 - square) * self.variance[fold] + square * variances[fold];
        }
    }

    /// Takes this bias from the estimates of a cell.
    pub fn subtract_from(&self, estimates: &mut [FoldEstimate; FOLDS], folds: &[FoldWeight; 2]) {
        let own = self.mean.map(|mean| luminance(mean.as_dvec3()));
        for fold in 0..FOLDS {
            let (estimate, first) = (&mut estimates[fold], folds[fold].first);
            let mean = luminance(estimate.sum.as_dvec3()) / first;
            // The square of the difference, without the noise of any of its terms.
            estimate.bias2 += own[0] * own[1] - 2.0 * mean * own[1 - fold];
            estimate.sum -= self.mean[fold] * first as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};

    const SIDE: usize = 64;
    const SQUARE: usize = 4;
    const CELLS: usize = SIDE * SIDE;
    const FOLD: FoldWeight = FoldWeight { first: 20.0, second: 20.0 };

    /// Estimates of an image of luminance 1 that a cache makes brighter by `bias` at a column and
    /// row. The mean of a square deviates by `noise`.
    fn estimates(
        bias: impl Fn(usize, usize) -> f64,
        noise: f64,
        seed: u64,
    ) -> Vec<[FoldEstimate; FOLDS]> {
        let mut rng: Rng = StreamKey::new(seed, Stream::Test, 0).rng(0);
        let mut gauss = || (0..12).map(|_| rng.next_f64()).sum::<f64>() - 6.0;
        let across = SIDE / SQUARE;
        let own: Vec<_> = (0..across * across).map(|_| [gauss(), gauss()]).collect();
        let variance = noise * noise / SQUARE_VARIANCE;
        let cell = |index: usize| {
            let (x, y) = (index % SIDE, index / SIDE);
            own[y / SQUARE * across + x / SQUARE].map(|own| {
                let mean = bias(x, y) + noise * own;
                FoldEstimate {
                    sum: Rgb::splat((FOLD.first * mean) as f32),
                    bias2: mean * mean - noise * noise,
                    variance: FOLD.first.powi(2) * variance,
                    covariance: 0.0,
                }
            })
        };
        (0..CELLS).map(cell).collect()
    }

    fn coarse_of(estimates: &[[FoldEstimate; FOLDS]], knows: [bool; FOLDS]) -> Vec<CoarseBias> {
        let size = ((SIDE as u32, SIDE as u32), SQUARE as u32);
        coarse_bias(estimates, size, &[1.0; CELLS], (&[FOLD; FOLDS], knows))
    }

    /// Mean of some values and its standard error.
    fn mean_and_error(values: &[f64]) -> (f64, f64) {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let square = values.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
        (mean, (square / (count * (count - 1.0))).sqrt())
    }

    /// A quarter of the image.
    fn in_a_quarter(x: usize, y: usize) -> f64 {
        if x < SIDE / 2 && y < SIDE / 2 { 0.1 } else { 0.0 }
    }

    #[test]
    fn bias_of_a_quarter_is_found_below_the_noise_of_its_squares() {
        // Windows blur the step: a tenth of the squared bias may be left without any noise.
        let exact = coarse_of(&estimates(in_a_quarter, 0.0, 0), [true; FOLDS]);
        let square = |coarse: &[CoarseBias]| {
            let left = coarse.iter().enumerate().map(|(index, own)| {
                let mean = 0.5 * (own.mean[0].x + own.mean[1].x);
                (in_a_quarter(index % SIDE, index / SIDE) - f64::from(mean)).powi(2)
            });
            left.sum::<f64>() / CELLS as f64
        };
        assert!(square(&exact) < 0.1 * 0.01 / 4.0, "{}", square(&exact));
        // The noise of a square is as large as the bias.
        let of_seed = |seed| square(&coarse_of(&estimates(in_a_quarter, 0.1, seed), [true; FOLDS]));
        let squares: Vec<f64> = (1..20).map(of_seed).collect();
        let (mean, error) = mean_and_error(&squares);
        assert!(mean + 4.0 * error < 0.5 * 0.01 / 4.0, "{mean} +- {error}");
    }

    #[test]
    fn without_bias_the_mean_stays_and_the_noise_is_stated() {
        let (mut sums, mut excess) = (Vec::new(), Vec::new());
        for seed in 0..200 {
            let coarse = coarse_of(&estimates(|_, _| 0.0, 0.3, seed), [true; FOLDS]);
            let sum: f32 = coarse.iter().flat_map(|own| own.mean.map(|mean| mean.x)).sum();
            sums.push(f64::from(sum) / (2 * CELLS) as f64);
            let square = |own: &CoarseBias| {
                own.mean.map(|mean| f64::from(mean.x).powi(2)).iter().sum::<f64>()
            };
            let stated = coarse.iter().flat_map(|own| own.variance).sum::<f64>();
            excess.push(coarse.iter().map(square).sum::<f64>() / stated);
        }
        let (mean, error) = mean_and_error(&sums);
        assert!(mean.abs() < 4.0 * error, "{mean} +- {error}");
        let (excess, error) = mean_and_error(&excess);
        // The variance is that of centers of squares, and the mean is linear between them.
        assert!(excess - 4.0 * error > 0.5 && excess + 4.0 * error < 1.0, "{excess} +- {error}");
    }

    #[test]
    fn bias_that_is_left_is_estimated_without_that_of_its_noise() {
        let difference = |seed: u64| {
            let mut own = estimates(in_a_quarter, 0.1, 1000 + seed);
            let coarse = coarse_of(&own, [true; FOLDS]);
            let mut sum = 0.0;
            for (index, (own, coarse)) in own.iter_mut().zip(&coarse).enumerate() {
                coarse.subtract_from(own, &[FOLD; FOLDS]);
                let bias = in_a_quarter(index % SIDE, index / SIDE);
                let [one, other] = coarse.mean.map(|mean| bias - f64::from(mean.x));
                sum += 0.5 * (own[0].bias2 + own[1].bias2) - one * other;
            }
            sum / CELLS as f64
        };
        let (mean, error) = mean_and_error(&(0..100).map(difference).collect::<Vec<_>>());
        assert!(mean.abs() < 4.0 * error, "{mean} +- {error}");
    }

    #[test]
    fn folds_that_do_not_know_their_noise_subtract_nothing() {
        let coarse = coarse_of(&estimates(in_a_quarter, 0.01, 3), [true, false]);
        // The second fold gives the share of the first that is subtracted.
        assert!(coarse.iter().all(|own| own.mean[0] == Rgb::ZERO));
        assert!(coarse.iter().any(|own| own.mean[1] != Rgb::ZERO));
    }
}
