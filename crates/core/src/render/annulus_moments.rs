//! Moments of the contribution of the outer annulus of the merge discs, over the iterations of all
//! blocks: they separate its bias from its noise. theory.md, section 17a.

use super::block::Block;
use crate::base::math::Rgb;
use crate::film::annulus::{AnnulusMoments, FOLDS, FoldSums};
use crate::film::cells::CellGrid;
use crate::film::radiance::{luminance, total};
use crate::film::windows::sum_of_squared_sums;
use crate::transport::kernel::ByClass;
use rayon::prelude::*;

/// Estimates for one pixel and photon class from the iterations of one fold, times the block
/// weights.
#[derive(Clone, Copy, Default)]
pub(super) struct FoldEstimate {
    /// Sum of the radiance from the annulus.
    pub sum: Rgb,
    /// Squared mean of its luminance.
    pub bias2: f64,
    /// Variance of the luminance of the sum.
    pub variance: f64,
    /// Covariance of the luminances of the sum and of the pixel's value.
    pub covariance: f64,
}

/// Sums over the iterations of a fold of their weights and of the squared weights.
#[derive(Clone, Copy, Default)]
pub(super) struct FoldWeight {
    pub first: f64,
    pub second: f64,
}

/// Moments of one pixel and photon class, times the block weights.
#[derive(Clone, Copy, Default)]
struct WeightedMoments {
    value: f64,
    sum: Rgb,
    squares: f64,
    products: f64,
}

/// Blocks of an image with the weights of their iterations.
pub(super) struct WeightedBlocks<'a> {
    pub blocks: &'a [Block],
    weights: &'a [f64],
    pub folds: [FoldWeight; FOLDS],
}

/// Squared bias of the outer annulus of each class of photons and its standard error: means over
/// cells with these weights. The error comes from the two folds. `None` if a block does not keep
/// the annulus, or before the second iteration of both folds.
pub fn annulus_bias2(
    blocks: &[Block],
    weights: &[f64],
    importance: &[f64],
) -> Option<ByClass<[f64; 2]>> {
    let weighted = WeightedBlocks::new(blocks, weights)?;
    let size = CellGrid::of(blocks[0].film.resolution()).size();
    let of_class = |class: usize| {
        let estimates = weighted.estimates(class);
        let weighted = estimates.par_iter().zip(importance);
        let terms: Vec<[f64; 2]> = weighted
            .map(|([one, other], weight)| {
                let half = 0.5 * weight;
                [half * (one.bias2 + other.bias2), half * (one.bias2 - other.bias2)]
            })
            .collect();
        let differences: Vec<f64> = terms.iter().map(|[_, difference]| *difference).collect();
        let count = terms.len() as f64;
        let sum = total(&terms, |[mean, _]| *mean);
        [sum / count, sum_of_squared_sums(&differences, size).sqrt() / count]
    };
    Some(std::array::from_fn(of_class))
}

impl<'a> WeightedBlocks<'a> {
    /// `None` if a block does not keep the annulus, or before the second iteration of both folds.
    pub fn new(blocks: &'a [Block], weights: &'a [f64]) -> Option<Self> {
        let mut folds = [FoldWeight::default(); FOLDS];
        for (block, &weight) in blocks.iter().zip(weights) {
            let iterations = block.statistics.annulus.as_ref()?.iterations();
            for (fold, n) in folds.iter_mut().zip(iterations.iter().map(|n| *n as f64)) {
                fold.first += weight * n;
                fold.second += weight * weight * n;
            }
        }
        // theory.md (71b)
        let pairs = |fold: &FoldWeight| fold.first.powi(2) - fold.second;
        let has_pairs = |fold: &FoldWeight| pairs(fold) > 1e-9 * fold.first.powi(2);
        folds.iter().all(has_pairs).then_some(Self { blocks, weights, folds })
    }

    /// Mean luminance of the iterations of each fold, of each cell in row order.
    pub fn fold_means(&self) -> Vec<[f64; FOLDS]> {
        let cells = CellGrid::of(self.blocks[0].film.resolution()).len();
        let mut means = vec![[0.0; FOLDS]; cells];
        for (block, &weight) in self.blocks.iter().zip(self.weights) {
            let annulus = block.statistics.annulus.as_ref().expect("checked for all blocks");
            for (fold, (sums, of_fold)) in annulus.folds().iter().zip(&self.folds).enumerate() {
                let factor = weight / of_fold.first;
                sums.zip_pixels(&mut means, |means, at| {
                    means[fold] += factor * f64::from(sums.values()[at].value);
                });
            }
        }
        means
    }

    /// [`BiasCorrection::squared_noise`](super::bias_correction::BiasCorrection::squared_noise) of
    /// each cell in row order.
    pub fn squared_noise(&self) -> Vec<f64> {
        let cells = CellGrid::of(self.blocks[0].film.resolution()).len();
        let mut differences = vec![0.0; cells];
        for (block, &weight) in self.blocks.iter().zip(self.weights) {
            let annulus = block.statistics.annulus.as_ref().expect("checked for all blocks");
            for (fold, (sums, of_fold)) in annulus.folds().iter().zip(&self.folds).enumerate() {
                let sign = if fold == 0 { 1.0 } else { -1.0 };
                let factor = sign * weight / of_fold.first;
                sums.zip_pixels(&mut differences, |difference, at| {
                    *difference += factor * f64::from(sums.values()[at].value);
                });
            }
        }
        // Variances of the mean and of the difference, for iterations of variance 1.
        let [one, other] = &self.folds;
        let of_mean = (one.second + other.second) / (one.first + other.first).powi(2);
        let of_half = |fold: &FoldWeight| fold.second / fold.first.powi(2);
        let scale = of_mean / (of_half(one) + of_half(other));
        differences.par_iter_mut().for_each(|own| *own = scale * *own * *own);
        differences
    }

    /// Estimates of each cell in row order, by fold.
    pub fn estimates(&self, class: usize) -> Vec<[FoldEstimate; FOLDS]> {
        let cells = CellGrid::of(self.blocks[0].film.resolution()).len();
        let mut all = vec![<[WeightedMoments; FOLDS]>::default(); cells];
        for (block, &weight) in self.blocks.iter().zip(self.weights) {
            let annulus = block.statistics.annulus.as_ref().expect("checked for all blocks");
            for (fold, sums) in annulus.folds().iter().enumerate() {
                sums.zip_pixels(&mut all, |all, at| {
                    let sums = &sums.values()[at];
                    all[fold].add(sums, &sums.classes[class], weight);
                });
            }
        }
        let estimate = |all: &[WeightedMoments; FOLDS]| {
            [0, 1].map(|fold| all[fold].estimate(&self.folds[fold]))
        };
        all.par_iter().map(estimate).collect()
    }
}

impl WeightedMoments {
    fn add(&mut self, sums: &FoldSums, moments: &AnnulusMoments, weight: f64) {
        self.value += weight * f64::from(sums.value);
        self.sum += moments.sum * weight as f32;
        self.squares += weight * weight * f64::from(moments.squares);
        self.products += weight * weight * f64::from(moments.products);
    }

    /// theory.md (71b), (71c)
    fn estimate(&self, FoldWeight { first, second }: &FoldWeight) -> FoldEstimate {
        let sum = luminance(self.sum.as_dvec3());
        let pairs = first * first - second;
        let bias2 = (sum * sum - self.squares) / pairs;
        let product = (sum * self.value - self.products) / pairs;
        FoldEstimate {
            sum: self.sum,
            bias2,
            variance: self.squares - second * bias2,
            covariance: self.products - second * product,
        }
    }
}
