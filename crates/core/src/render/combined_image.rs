//! The image of several blocks with different path counts.

use super::accumulators::SharedStatistics;
use super::bias_correction::BiasCorrection;
use super::block::Block;
use super::set_factor::{HalfMeans, set_factor};
use crate::base::math::Rgb;
use crate::film::cells::CellGrid;
use crate::film::halves::HALVES;
use crate::film::light_components::LightComponents;
use crate::film::radiance::{BOX_RADIUS, box_filter, box_filtered, luminance, total};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Weighted mean of several blocks.
#[derive(Clone, Debug)]
pub struct CombinedImage<'a> {
    blocks: &'a [Block],
    weights: Vec<f64>,
    /// Computed at the first use.
    derived: DerivedStatistics,
}

/// Statistics of an image that take passes over all pixels, computed when they are first needed.
/// Clones share them.
#[derive(Clone, Debug, Default)]
pub struct DerivedStatistics(Arc<Derived>);

#[derive(Debug, Default)]
struct Derived {
    correction: OnceLock<Option<BiasCorrection>>,
    set_factor: OnceLock<[f64; 2]>,
    /// Of large images.
    moments: OnceLock<Vec<CellMoments>>,
}

/// Moments of the pixels of a cell: means over its pixels, before the correction of the merge bias.
#[derive(Clone, Copy, Debug)]
pub struct CellMoments {
    /// Radiance, W/(m^2 sr).
    pub radiance: DVec3,
    /// Square of the luminance.
    pub square: f64,
    /// Variance of the luminance of the mean over iterations if they are independent; `None` before
    /// the second iteration of any block.
    pub variance: Option<f64>,
}

impl<'a> CombinedImage<'a> {
    /// Combines `blocks` with the given weight for each iteration of a block.
    ///
    /// # Panics
    /// Unless there is a positive weight for each block, and at least one block.
    pub fn new(blocks: &'a [Block], weights: Vec<f64>) -> Self {
        assert!(!blocks.is_empty() && blocks.len() == weights.len());
        assert!(weights.iter().all(|&weight| weight > 0.0 && weight.is_finite()));
        Self { blocks, weights, derived: DerivedStatistics::default() }
    }

    /// The same image with statistics that an equal image has computed: of these blocks, iterations
    /// and weights.
    #[must_use]
    pub fn with_derived(self, derived: DerivedStatistics) -> Self {
        Self { derived, ..self }
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

    /// Cells whose statistics are kept.
    pub fn grid(&self) -> CellGrid {
        CellGrid::of(self.resolution())
    }

    /// Index in tile order of each pixel of a row.
    pub fn indices_of_row(&self, y: u32) -> impl Iterator<Item = usize> + use<> {
        self.blocks[0].film.sums.row(y)
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
            let grid = self.grid();
            let (width, height) = grid.size();
            let own: Vec<_> = if grid.is_single_pixels() {
                let own = |value: Rgb| [luminance(value.as_dvec3())];
                self.uncorrected_mean().into_par_iter().map(own).collect()
            } else {
                self.cell_moments()
                    .par_iter()
                    .map(|moments| [luminance(moments.radiance)])
                    .collect()
            };
            let around: Vec<f64> =
                box_filter(&own, width, height).into_iter().map(|[l]| l).collect();
            let correction = BiasCorrection::new(self.blocks, &self.weights, &around)?;
            if grid.is_single_pixels() {
                return Some(correction);
            }
            let radiance = self.cell_moments().par_iter().map(|own| own.radiance.as_vec3());
            Some(correction.with_shares(radiance))
        };
        self.derived.0.correction.get_or_init(correction).as_ref()
    }

    /// Mean luminance of the iterations of both halves, of each cell in row order, less the merge
    /// bias if it is corrected; W/(m^2 sr). Iterations with even numbers are the first half. `None`
    /// if the blocks do not keep halves, or before both have iterations.
    pub fn halves(&self) -> Option<Vec<[f64; HALVES]>> {
        if let Some(correction) = self.bias_correction() {
            return Some(correction.halves.clone());
        }
        Some(self.half_means()?.means)
    }

    /// The halves of an image whose bias is not corrected.
    fn half_means(&self) -> Option<HalfMeans> {
        let mut means = vec![[0.0; HALVES]; self.grid().len()];
        let mut totals = [0.0; HALVES];
        for (block, weight) in self.pairs() {
            let halves = block.statistics.halves.as_ref()?;
            for (half, sums) in halves.folds().iter().enumerate() {
                totals[half] += weight * halves.iterations()[half] as f64;
                sums.zip_pixels(&mut means, |means, at| {
                    means[half] += weight * f64::from(sums.values()[at].0);
                });
            }
        }
        means.iter_mut().for_each(|own| {
            own.iter_mut().zip(totals).for_each(|(mean, total)| *mean /= total);
        });
        totals.iter().all(|total| *total > 0.0).then_some(HalfMeans { means, totals })
    }

    /// Variance of the image over that of as many independent iterations: less than 1 if camera
    /// paths start from Sobol points. theory.md (44g)
    pub fn set_factor(&self) -> f64 {
        self.set_factor_and_error()[0]
    }

    /// [`Self::set_factor`] and its standard error.
    fn set_factor_and_error(&self) -> [f64; 2] {
        if !self.blocks.iter().all(|block| block.starts_from_points) {
            return [1.0, 0.0];
        }
        let factor = || {
            let (halves, variance) = (self.half_means()?, self.independent_cell_variance()?);
            Some(set_factor(self, &halves, &variance))
        };
        *self.derived.0.set_factor.get_or_init(|| factor().unwrap_or([1.0, 0.0]))
    }

    /// Moments of the cells, in row order.
    pub fn cell_moments(&self) -> &[CellMoments] {
        self.derived.0.moments.get_or_init(|| {
            let (grid, scale) = (self.grid(), self.total().recip());
            let factors = self.independent_scales();
            let add = |sums: &mut (DVec3, f64, f64), at: usize| {
                let own =
                    |(block, weight): (&Block, f64)| block.film.sums.values()[at].radiance * weight;
                let radiance = scale * self.pairs().map(own).sum::<DVec3>();
                sums.0 += radiance;
                sums.1 += luminance(radiance).powi(2);
                sums.2 += factors.as_deref().map_or(0.0, |factors| variance(factors, at));
            };
            let sums = self.blocks[0].film.sums.fold_cells(grid, Default::default(), add);
            let moments = |(cell, &(radiance, square, variance)): (usize, &(DVec3, f64, f64))| {
                let each = grid.pixels_of(cell).recip();
                CellMoments {
                    radiance: radiance * each,
                    square: square * each,
                    variance: factors.is_some().then_some(variance * each),
                }
            };
            sums.par_iter().enumerate().map(moments).collect()
        })
    }

    /// The image in row order: the weighted mean over iterations, less the merge bias if it is
    /// corrected; black before the first iteration.
    pub fn mean(&self) -> Vec<Rgb> {
        let mut mean = self.uncorrected_mean();
        let (width, _) = self.resolution();
        if let Some(correction) = self.bias_correction() {
            mean.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
                for (x, mean) in row.iter_mut().enumerate() {
                    *mean -= correction.at(self.grid(), (x as u32, y as u32), *mean);
                }
            });
        }
        mean
    }

    /// Some rows of [`Self::mean`].
    pub fn mean_rows(&self, rows: Range<u32>) -> Vec<Rgb> {
        let scale = self.total().recip();
        let correction = self.bias_correction();
        let grid = self.grid();
        let row = |y: u32| {
            let pixel = move |(x, at): (usize, usize)| {
                let mut sum = DVec3::ZERO;
                for (block, weight) in self.pairs() {
                    sum += block.film.sums.values()[at].radiance * weight;
                }
                let mean = (sum * scale).as_vec3();
                correction.map_or(mean, |own| mean - own.at(grid, (x as u32, y), mean))
            };
            self.blocks[0].film.sums.row(y).enumerate().map(pixel)
        };
        rows.flat_map(row).collect()
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

    /// Weighted mean over iterations of the light components of some rows; `None` unless all blocks
    /// or, in large images, `shared` keep them.
    pub fn light_rows(
        &self,
        shared: &SharedStatistics,
        rows: Range<u32>,
    ) -> Option<Vec<LightComponents>> {
        let scale = self.total().recip();
        let indices = rows.flat_map(|y| self.blocks[0].film.sums.row(y));
        let SharedStatistics { compact_emission, compact_direct, compact_caustics, .. } = shared;
        if let (Some(emission), Some(direct), Some(caustics)) =
            (compact_emission, compact_direct, compact_caustics)
        {
            let (emission, direct) = (&emission.folds()[0], &direct.folds()[0]);
            let caustics = &caustics.folds()[0];
            let components = |at: usize| {
                let (mut sum, mut weighted) = (DVec3::ZERO, DVec3::ZERO);
                for (block, weight) in self.pairs() {
                    let own = block.film.sums.values()[at].radiance;
                    sum += own;
                    weighted += own * weight;
                }
                let mean = weighted * scale;
                LightComponents {
                    emission: emission.values()[at].component(sum, mean),
                    direct: direct.values()[at].component(sum, mean),
                    caustics: caustics.values()[at].component(sum, mean),
                }
            };
            return Some(indices.map(components).collect());
        }
        let light: Option<Vec<_>> =
            self.blocks.iter().map(|block| block.statistics.light.as_ref()).collect();
        let light = light?;
        let components = |at: usize| {
            let mut sum = LightComponents::default();
            for (light, weight) in light.iter().zip(&self.weights) {
                sum.add(&light.folds()[0].values()[at], weight * scale);
            }
            sum
        };
        Some(indices.map(components).collect())
    }

    /// Mean luminance of the image, W/(m^2 sr).
    pub fn mean_luminance(&self) -> f64 {
        let grid = self.grid();
        if !grid.is_single_pixels() {
            let moments = self.cell_moments().iter().enumerate();
            let sum = moments
                .map(|(cell, own)| luminance(own.radiance) * grid.pixels_of(cell))
                .sum::<f64>();
            return sum / grid.pixels() as f64;
        }
        let of = |(block, weight): (&Block, f64)| {
            weight * total(block.film.sums.values(), |pixel| luminance(pixel.radiance))
        };
        let sum: f64 = self.pairs().map(of).sum();
        sum / (self.total() * self.blocks[0].film.pixels() as f64)
    }

    /// Factors of the blocks' sample variances of one iteration in the variance of the mean; `None`
    /// before the second iteration of any block.
    ///
    /// Block `k` with `N` iterations of weight `w` adds `w^2 N V_k` over the squared total weight.
    /// A block of one iteration has no sample variance. Since the weights are reciprocals of
    /// variances, the mean `w V` of the other blocks replaces it. theory.md (75).
    fn variance_factors(&self) -> Option<Vec<(&'a Block, f64)>> {
        let set_factor = self.set_factor();
        let own = |(block, factor): (&'a Block, f64)| (block, set_factor * factor);
        Some(self.independent_factors()?.into_iter().map(own).collect())
    }

    /// [`Self::variance_factors`] if iterations are independent.
    fn independent_factors(&self) -> Option<Vec<(&'a Block, f64)>> {
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

    /// Factors of the variances of the means of the blocks in the variance of the mean; `None`
    /// before the second iteration of any block.
    fn variance_scales(&self) -> Option<Vec<(&'a Block, f64)>> {
        Some(self.variance_factors()?.into_iter().map(of_mean).collect())
    }

    /// [`Self::variance_scales`] if iterations are independent.
    fn independent_scales(&self) -> Option<Vec<(&'a Block, f64)>> {
        Some(self.independent_factors()?.into_iter().map(of_mean).collect())
    }

    /// Estimate of the variance of the luminance of [`Self::mean`] in each pixel, in row order;
    /// `None` before the second iteration of any block. It is unbiased if the merge bias is not
    /// corrected; otherwise it ignores the error of the shrinkage factors.
    pub fn variance_of_mean(&self) -> Option<Vec<f64>> {
        let (_, height) = self.resolution();
        self.variance_of_rows(0..height)
    }

    /// Some rows of [`Self::variance_of_mean`].
    pub fn variance_of_rows(&self, rows: Range<u32>) -> Option<Vec<f64>> {
        Some(self.variance_rows(rows)?.into_iter().map(|[corrected, _]| corrected).collect())
    }

    /// Variance of some rows of [`Self::mean`], and of [`Self::uncorrected_mean`].
    fn variance_rows(&self, rows: Range<u32>) -> Option<Vec<[f64; 2]>> {
        let scales = self.variance_scales()?;
        let (grid, correction) = (self.grid(), self.bias_correction());
        let (width, _) = self.resolution();
        let mut all = vec![[0.0; 2]; rows.len() * width as usize];
        let lines = all.par_chunks_mut(width as usize).zip(rows.into_par_iter());
        lines.for_each(|(line, y)| {
            let cells = grid.row_of(y);
            let pixels = line.iter_mut().zip(self.blocks[0].film.sums.row(y)).enumerate();
            for (x, (all, at)) in pixels {
                let change =
                    correction.map(|own| own.variance_change[cells + x / grid.side() as usize]);
                let own = variance(&scales, at);
                *all = [own + change.unwrap_or(0.0), own];
            }
        });
        Some(all)
    }

    /// Unbiased estimate of the variance of the luminance of [`Self::uncorrected_mean`] in each
    /// pixel, in row order; `None` before the second iteration of any block.
    pub fn uncorrected_variance(&self) -> Option<Vec<f64>> {
        Some(self.pixel_variance(&self.variance_scales()?))
    }

    fn pixel_variance(&self, scales: &[(&Block, f64)]) -> Vec<f64> {
        let mut all = vec![0.0; self.blocks[0].film.pixels()];
        self.blocks[0].film.sums.zip_pixels(&mut all, |all, at| *all = variance(scales, at));
        all
    }

    /// Mean over each cell of [`Self::variance_of_mean`], in row order.
    pub fn cell_variance(&self) -> Option<Vec<f64>> {
        let mut variance = self.uncorrected_cell_variance()?;
        if let Some(correction) = self.bias_correction() {
            let both = variance.par_iter_mut().zip(&correction.variance_change);
            both.for_each(|(variance, change)| *variance += change);
        }
        Some(variance)
    }

    /// Mean over each cell of [`Self::uncorrected_variance`], in row order.
    pub fn uncorrected_cell_variance(&self) -> Option<Vec<f64>> {
        let set_factor = self.set_factor();
        let mut variance = self.independent_cell_variance()?;
        variance.par_iter_mut().for_each(|variance| *variance *= set_factor);
        Some(variance)
    }

    /// [`Self::uncorrected_cell_variance`] if iterations are independent.
    fn independent_cell_variance(&self) -> Option<Vec<f64>> {
        if self.grid().is_single_pixels() {
            return Some(self.pixel_variance(&self.independent_scales()?));
        }
        self.cell_moments().par_iter().map(|moments| moments.variance).collect()
    }

    /// RMS noise of the image, W/(m^2 sr), in row order: the root of the variance of the mean,
    /// pooled over 5 by 5 pixels. `None` before the second iteration of any block.
    pub fn rms(&self) -> Option<Vec<f32>> {
        let (_, height) = self.resolution();
        self.rms_rows(0..height)
    }

    /// Some rows of [`Self::rms`].
    pub fn rms_rows(&self, rows: Range<u32>) -> Option<Vec<f32>> {
        let (width, height) = self.resolution();
        let around = rows.start.saturating_sub(BOX_RADIUS)..(rows.end + BOX_RADIUS).min(height);
        let variance = self.variance_rows(around.clone())?;
        // The rows around are complete, so that a pixel has the neighbors that it has in the image.
        let pixels = rows.start - around.start..rows.end - around.start;
        let pixels = (pixels.start * width) as usize..(pixels.end * width) as usize;
        let rms = |index| {
            let variances = box_filtered(&variance, index, width, around.len() as u32);
            positive_variance(variances).sqrt() as f32
        };
        Some(pixels.map(rms).collect())
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
        let [factor, factor_error] = self.set_factor_and_error();
        let error = error2.sqrt().hypot(variance * factor_error / factor);
        let Some(correction) = self.bias_correction() else { return Some((variance, error)) };
        let changes = &correction.variance_change;
        let change = total(changes, |change| *change) / changes.len() as f64;
        let corrected = (variance + change).max(0.0);
        // Both variances come from the same samples: they have the same relative error.
        let scale = if variance > 0.0 { corrected / variance } else { 1.0 };
        Some((corrected, scale * error))
    }
}

/// The factor of a block in the variance of the mean of its iterations, from that in the variance
/// of one.
fn of_mean((block, factor): (&Block, f64)) -> (&Block, f64) {
    (block, factor * block.film.iterations as f64)
}

/// The variance with the correction of the bias, or that without it. The change by the correction
/// is an estimate, which may exceed the variance.
fn positive_variance([corrected, uncorrected]: [f64; 2]) -> f64 {
    if corrected > 0.0 { corrected } else { uncorrected.max(0.0) }
}

/// Variance of the mean of a pixel, from those of the blocks times their factors; `at` is its index
/// in tile order.
fn variance(scales: &[(&Block, f64)], at: usize) -> f64 {
    let mut all = 0.0;
    for (block, scale) in scales {
        all += scale * block.film.sums.values()[at].variance_of_mean(block.film.iterations);
    }
    all
}

#[cfg(test)]
mod tests;
