//! The image of several blocks with different path counts.

use super::bias_correction::BiasCorrection;
use super::block::Block;
use crate::base::math::Rgb;
use crate::film::light_components::LightComponents;
use crate::film::radiance::{box_filter, luminance, total};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Weighted mean of several blocks.
#[derive(Clone, Debug)]
pub struct CombinedImage<'a> {
    blocks: &'a [Block],
    weights: Vec<f64>,
    /// Computed at the first use.
    correction: OnceLock<Option<BiasCorrection>>,
}

impl<'a> CombinedImage<'a> {
    /// Combines `blocks` with the given weight for each iteration of a block.
    ///
    /// # Panics
    /// Unless there is a positive weight for each block, and at least one block.
    pub fn new(blocks: &'a [Block], weights: Vec<f64>) -> Self {
        assert!(!blocks.is_empty() && blocks.len() == weights.len());
        assert!(weights.iter().all(|&weight| weight > 0.0 && weight.is_finite()));
        Self { blocks, weights, correction: OnceLock::new() }
    }

    /// Weight of an iteration of each block.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// All blocks.
    pub fn blocks(&self) -> &'a [Block] {
        self.blocks
    }

    /// Weight of an iteration of each block.
    pub fn into_weights(self) -> Vec<f64> {
        self.weights
    }

    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        self.blocks[0].film.resolution()
    }

    /// Iterations of all blocks.
    pub fn iterations(&self) -> u64 {
        self.blocks.iter().map(|block| block.film.iterations).sum()
    }

    fn pairs(&self) -> impl Iterator<Item = (&'a Block, f64)> {
        self.blocks.iter().zip(self.weights.iter().copied())
    }

    /// Sum of the weights of all iterations; 1 before the first, to divide by.
    fn total(&self) -> f64 {
        let total: f64 = self.pairs().map(|(block, w)| w * block.film.iterations as f64).sum();
        if total > 0.0 { total } else { 1.0 }
    }

    /// Correction of the merge bias; `None` if the blocks do not keep the outer annulus or have too
    /// few iterations.
    pub fn bias_correction(&self) -> Option<&BiasCorrection> {
        if self.blocks.iter().any(|block| block.statistics.annulus.is_none()) {
            return None;
        }
        let correction = || {
            let (width, height) = self.resolution();
            let own = |value: Rgb| [luminance(value.as_dvec3())];
            let own: Vec<_> = self.uncorrected_mean().into_par_iter().map(own).collect();
            let around: Vec<f64> =
                box_filter(&own, width, height).into_iter().map(|[l]| l).collect();
            BiasCorrection::new(self.blocks, &self.weights, &around)
        };
        self.correction.get_or_init(correction).as_ref()
    }

    /// The image in row order: the weighted mean over iterations, less the merge bias if it is
    /// corrected; black before the first iteration.
    pub fn mean(&self) -> Vec<Rgb> {
        let mut mean = self.uncorrected_mean();
        if let Some(BiasCorrection { correction, .. }) = self.bias_correction() {
            mean.par_iter_mut().zip(correction).for_each(|(mean, bias)| *mean -= *bias);
        }
        mean
    }

    /// Weighted mean over iterations in row order, with the merge bias; black before the first
    /// iteration.
    /// theory.md (74).
    pub fn uncorrected_mean(&self) -> Vec<Rgb> {
        let mut sums = vec![DVec3::ZERO; self.blocks[0].film.pixels()];
        for (block, weight) in self.pairs() {
            let pixels = &block.film.sums;
            pixels.zip_pixels(&mut sums, |sum, at| *sum += pixels.values()[at].radiance * weight);
        }
        let scale = self.total().recip();
        sums.into_par_iter().map(|sum| (sum * scale).as_vec3()).collect()
    }

    /// Weighted mean over iterations of the light components in row order; `None` unless all blocks
    /// keep them.
    pub fn light_components(&self) -> Option<Vec<LightComponents>> {
        let mut sums = vec![LightComponents::default(); self.blocks[0].film.pixels()];
        let scale = self.total().recip();
        for (block, weight) in self.pairs() {
            let light = &block.statistics.light.as_ref()?.folds()[0];
            light.zip_pixels(&mut sums, |sum, at| sum.add(&light.values()[at], weight * scale));
        }
        Some(sums)
    }

    /// Mean luminance of the image, W/(m^2 sr).
    pub fn mean_luminance(&self) -> f64 {
        let of = |(block, weight): (&Block, f64)| {
            weight * total(block.film.sums.values(), |pixel| luminance(pixel.radiance))
        };
        let sum: f64 = self.pairs().map(of).sum();
        sum / (self.total() * self.blocks[0].film.pixels() as f64)
    }

    /// Factors of the blocks' sample variances of one iteration in the variance of the mean; `None`
    /// before the second iteration of any block.
    ///
    /// Block `k` with `N` iterations of weight `w` adds `w^2 N V_k` over the squared total weight. A
    /// block of one iteration has no sample variance. Since the weights are reciprocals of variances,
    /// the mean `w V` of the other blocks replaces it.
    /// theory.md (75).
    fn variance_factors(&self) -> Option<Vec<(&'a Block, f64)>> {
        let total2 = self.total().powi(2);
        let added = |block: &Block, w: f64| w * w * block.film.iterations as f64 / total2;
        let (known, single): (Vec<_>, Vec<_>) =
            self.pairs().partition(|(block, _)| block.film.iterations >= 2);
        let known_iterations: u64 = known.iter().map(|(block, _)| block.film.iterations).sum();
        let unknown: f64 = single.iter().map(|&(block, w)| added(block, w) / w).sum();
        let factor = |(block, w): (&'a Block, f64)| {
            let part = block.film.iterations as f64 / known_iterations as f64;
            (block, added(block, w) + unknown * w * part)
        };
        (!known.is_empty()).then(|| known.into_iter().map(factor).collect())
    }

    /// Estimate of the variance of the luminance of [`Self::mean`] in each pixel, in row order; `None`
    /// before the second iteration of any block. It is unbiased if the merge bias is not corrected;
    /// otherwise it ignores the error of the shrinkage factors.
    pub fn variance_of_mean(&self) -> Option<Vec<f64>> {
        let mut variance = self.uncorrected_variance()?;
        if let Some(correction) = self.bias_correction() {
            let both = variance.par_iter_mut().zip(&correction.variance_change);
            both.for_each(|(variance, change)| *variance += change);
        }
        Some(variance)
    }

    /// Unbiased estimate of the variance of the luminance of [`Self::uncorrected_mean`] in each pixel,
    /// in row order; `None` before the second iteration of any block.
    pub fn uncorrected_variance(&self) -> Option<Vec<f64>> {
        let mut variance = vec![0.0; self.blocks[0].film.pixels()];
        for (block, factor) in self.variance_factors()? {
            let scale = factor * block.film.iterations as f64;
            let own = block.film.variance_of_mean()?;
            variance.par_iter_mut().zip(own).for_each(|(all, own)| *all += scale * own);
        }
        Some(variance)
    }

    /// RMS noise of the image, W/(m^2 sr), in row order: the root of the variance of the mean, pooled
    /// over 5 by 5 pixels. `None` before the second iteration of any block.
    pub fn rms(&self) -> Option<Vec<f32>> {
        let (width, height) = self.resolution();
        let variance: Vec<_> = self.variance_of_mean()?.into_iter().map(|v| [v]).collect();
        let pooled = box_filter(&variance, width, height);
        Some(pooled.iter().map(|[variance]| variance.sqrt() as f32).collect())
    }

    /// Pooled variance of the mean, `mean_p V_p`, and its standard error; `None` before the second
    /// iteration of any block.
    pub fn pooled_variance(&self) -> Option<(f64, f64)> {
        let (mut variance, mut error2) = (0.0, 0.0);
        for (block, factor) in self.variance_factors()? {
            let (own, error) = block.film.pooled_variance()?;
            variance += factor * own;
            error2 += (factor * error).powi(2);
        }
        let error = error2.sqrt();
        let Some(correction) = self.bias_correction() else { return Some((variance, error)) };
        let changes = &correction.variance_change;
        let change = total(changes, |change| *change) / changes.len() as f64;
        let corrected = (variance + change).max(0.0);
        // Both variances come from the same samples: they have the same relative error.
        let scale = if variance > 0.0 { corrected / variance } else { 1.0 };
        Some((corrected, scale * error))
    }
}
