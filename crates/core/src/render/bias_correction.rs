//! Correction of the merge bias where it is larger than its noise: theory.md, section 17a.
//!
//! The contribution of the outer annulus of the merge discs to a pixel consists of bias and noise.
//! Its moments over the iterations separate both. Around each pixel, the fraction that minimizes
//! the squared error is subtracted. The fraction for one fold of the iterations is estimated from
//! the other fold, so that it is independent of the noise that it scales.

use super::annulus_moments::{FoldEstimate, FoldWeight, WeightedBlocks};
use super::block::Block;
use super::coarse_bias::coarse_bias;
use super::suffixes::square_side;
use crate::base::math::Rgb;
use crate::film::annulus::{FOLDS, left_at_half};
use crate::film::cells::CellGrid;
use crate::film::radiance::{luminance, luminance_weights};
use crate::film::smoothing::{box_means, smooth};
use crate::transport::photon::PhotonClass;
use rayon::prelude::*;

/// Minimum ratio of the squared bias of the annulus to the variance of its estimate: below it
/// nothing is subtracted, since both are noisy. Fixed by experiment.
const BIAS_EXCESS: f64 = 1.0;

/// [`BIAS_EXCESS`] of a cache after many iterations. What a cache adds is the same in whole squares
/// of pixels: noise in its place is seen as stains.
pub(super) const CACHE_EXCESS: f64 = 8.0;

/// Number of iterations of a fold that doubles [`CACHE_EXCESS`]. With fewer nothing is subtracted:
/// they hardly know their noise, which is larger than the bias of a cache anyway.
const FEW_ITERATIONS: f64 = 8.0;

/// Squares of suffix paths, to each side, over which the noise of what a cache adds is averaged.
/// Where light is found by few paths, most squares have none of them: they look dark, and hardly
/// noisy.
pub(super) const SQUARES_AROUND: u32 = 8;

/// Squared relative bias of a cache from which on its noise is that of [`SQUARES_AROUND`]. Squares
/// that lack rare light seem to have all of the cache's light as bias. Smaller ones are told from
/// the noise of their own surroundings: those of a lamp are noisier than others.
pub(super) const LARGE_BIAS2: f64 = 0.09;

/// Correction of the merge bias of an image, for each [cell](CellGrid) in row order.
#[derive(Clone, Debug)]
pub struct BiasCorrection {
    /// Radiance to be subtracted, W/(m^2 sr).
    pub correction: Vec<Rgb>,
    /// Share of `correction` in the radiance of each cell, if cells have several pixels; else
    /// empty.
    shares: Vec<Rgb>,
    /// Change of the variance of the mean's luminance. It is often negative: the noise of the
    /// annulus is subtracted with the bias.
    pub variance_change: Vec<f64>,
    /// Estimate of the squared luminance of the remaining bias; negative values are noise.
    pub bias2: Vec<f64>,
    /// Half of the difference between the estimates of `bias2` from both folds.
    pub bias2_difference: Vec<f64>,
    /// Square of the noise that one half of the iterations has beside the other, scaled to the
    /// noise of the image: a sample of its squared error, before the correction.
    pub squared_noise: Vec<f64>,
    /// Mean luminance of the iterations of each fold, less its own correction.
    pub halves: Vec<[f64; FOLDS]>,
}

impl BiasCorrection {
    /// Memory per cell of the correction and of its intermediate results. The bias in large parts
    /// of the image takes less, and is gone before.
    pub const BYTES: usize = size_of::<[FoldEstimate; FOLDS]>()
        + 3 * size_of::<[f64; 2 * FOLDS]>()
        + 2 * size_of::<Rgb>()
        + size_of::<[f64; FOLDS]>()
        + 6 * size_of::<f64>();

    /// Correction of the image that `blocks` form with these weights of their iterations;
    /// `luminance` is a smoothed estimate of the luminance of each cell. `None` if a block does not
    /// keep the annulus, or before the second iteration of both folds.
    pub fn new(blocks: &[Block], weights: &[f64], luminance: &[f64]) -> Option<Self> {
        let weighted = WeightedBlocks::new(blocks, weights)?;
        let importance = luminance_weights(luminance);
        let pixels = importance.len();
        let mut all = Self {
            correction: vec![Rgb::ZERO; pixels],
            shares: Vec::new(),
            variance_change: vec![0.0; pixels],
            bias2: vec![0.0; pixels],
            bias2_difference: vec![0.0; pixels],
            squared_noise: weighted.squared_noise(),
            halves: weighted.fold_means(),
        };
        let has_cache = blocks[0].has_cache;
        let left_at_half = left_at_half(blocks[0].kernel, has_cache);
        for (class, left_at_half) in left_at_half.into_iter().enumerate() {
            let of_cache = has_cache && class == PhotonClass::Diffuse as usize;
            let excess = weighted.folds.map(|FoldWeight { first, second }| {
                let few = FEW_ITERATIONS * second / (first * first);
                match of_cache {
                    true => (few < 1.0 + 1e-9).then_some(CACHE_EXCESS * (1.0 + few)),
                    false => Some(BIAS_EXCESS),
                }
            });
            let mut estimates = weighted.estimates(class);
            if estimates.par_iter().flatten().any(|fold| fold.variance > 0.0 || fold.bias2 > 0.0) {
                let noise_around = of_cache.then(|| SQUARES_AROUND * largest_square(blocks));
                if of_cache {
                    let knows = excess.map(|excess| excess.is_some());
                    all.add_coarse(&weighted, &mut estimates, knows, luminance);
                }
                let typical = (left_at_half, excess, noise_around);
                all.add(&weighted, &estimates, typical, luminance, &importance);
            }
        }
        Some(all)
    }

    /// Corrects pixels of cells of these radiances in proportion to their own. The bias of a cell
    /// is that of its bright pixels: it would darken the others, beyond an edge or in a texture.
    #[must_use]
    pub fn with_shares(self, radiance: impl IndexedParallelIterator<Item = Rgb>) -> Self {
        let share = |(correction, radiance): (&Rgb, Rgb)| {
            let is_lit = radiance.cmpgt(Rgb::ZERO);
            Rgb::select(is_lit, *correction / radiance, Rgb::ZERO).clamp(-Rgb::ONE, Rgb::ONE)
        };
        let shares = self.correction.par_iter().zip(radiance).map(share).collect();
        Self { shares, ..self }
    }

    /// Correction of a pixel of this mean radiance, at a column and row. Shares are linear between
    /// the centers of cells.
    #[inline]
    pub fn at(&self, grid: CellGrid, pixel: (u32, u32), radiance: Rgb) -> Rgb {
        let mix =
            |parts: [(Rgb, f32); 4]| parts.map(|(own, weight)| own * weight).into_iter().sum();
        match self.shares.is_empty() {
            true => grid.interpolated(&self.correction, pixel, mix),
            false => radiance * grid.interpolated::<Rgb>(&self.shares, pixel, mix),
        }
    }

    /// Adds the bias of a cache in large parts of the image, and takes it from the estimates. Folds
    /// that do not know their noise subtract nothing.
    fn add_coarse(
        &mut self,
        blocks: &WeightedBlocks,
        estimates: &mut [[FoldEstimate; FOLDS]],
        knows: [bool; FOLDS],
        luminance: &[f64],
    ) {
        if !knows.contains(&true) {
            return;
        }
        let grid = CellGrid::of(blocks.blocks[0].film.resolution());
        let side = largest_square(blocks.blocks).div_ceil(grid.side());
        let size = (grid.size(), side);
        let coarse = coarse_bias(estimates, size, luminance, (&blocks.folds, knows));
        let total: f64 = blocks.folds.iter().map(|fold| fold.first).sum();
        for (cell, (coarse, estimates)) in coarse.iter().zip(estimates).enumerate() {
            for (fold, FoldWeight { first, .. }) in blocks.folds.iter().enumerate() {
                let share = first / total;
                self.correction[cell] += coarse.mean[fold] * share as f32;
                self.halves[cell][fold] -= luminance_of(coarse.mean[fold]);
                self.variance_change[cell] += share * share * coarse.variance[fold];
            }
            coarse.subtract_from(estimates, &blocks.folds);
        }
    }

    /// Adds the correction of one photon class, with its typical bias at half the radius and the
    /// excess that each fold must have; `None` if that subtracts nothing. Where a cache seems to
    /// have a large bias, its noise is at least that of so many pixels to each side.
    fn add(
        &mut self,
        blocks: &WeightedBlocks,
        estimates: &[[FoldEstimate; FOLDS]],
        (left_at_half, excess, noise_around): (f64, [Option<f64>; FOLDS], Option<u32>),
        luminance: &[f64],
        importance: &[f64],
    ) {
        let total: f64 = blocks.folds.iter().map(|fold| fold.first).sum();
        let relative = |(estimates, weight): (&[FoldEstimate; FOLDS], &f64)| {
            let variance = |fold: usize| {
                weight * estimates[fold].variance / (blocks.folds[fold].first * total)
            };
            [weight * estimates[0].bias2, variance(0), weight * estimates[1].bias2, variance(1)]
        };
        let relative: Vec<_> = estimates.par_iter().zip(importance).map(relative).collect();
        let grid = CellGrid::of(blocks.blocks[0].film.resolution());
        let [width, height] = <[u32; 2]>::from(grid.size()).map(|size| size as usize);
        let mut around = smooth(&relative, width, height);
        if let Some(pixels) = noise_around {
            let radius = pixels.div_ceil(grid.side()) as usize;
            for fold in 0..FOLDS {
                let (bias2, variance) = (2 * fold, 2 * fold + 1);
                let own: Vec<f64> = relative.iter().map(|own| own[variance]).collect();
                let wide = box_means(&own, width, height, radius);
                let large = around.iter_mut().zip(wide).filter(|(own, _)| own[bias2] > LARGE_BIAS2);
                large.for_each(|(own, wide)| own[variance] = own[variance].max(wide));
            }
        }
        let pixels = self.correction.par_iter_mut().zip(&mut self.variance_change);
        let halves = self.halves.par_iter_mut();
        let pixels = pixels.zip(&mut self.bias2).zip(&mut self.bias2_difference).zip(halves);
        pixels.enumerate().for_each(
            |(pixel, ((((correction, variance_change), remaining), difference), halves))| {
                let (around, weight) = (&around[pixel], importance[pixel]);
                for (fold, own) in estimates[pixel].iter().enumerate() {
                    // The factor comes from the other fold
                    let other = 1 - fold;
                    let [bias2, variance] = [around[2 * other], around[2 * other + 1].max(0.0)];
                    let of = |excess| shrinkage(bias2, variance, excess);
                    let factor = excess[other].map_or(0.0, of);
                    *correction += own.sum * (factor / total) as f32;
                    halves[fold] -= luminance_of(own.sum) * factor / blocks.folds[fold].first;
                    *variance_change +=
                        factor * (factor * own.variance - 2.0 * own.covariance) / (total * total);
                    // The luminance at half the radius is not less than its own bias: theory.md
                    // (71e)
                    let annulus = (around[2 * fold].max(0.0) / weight).sqrt();
                    let at_half = (luminance[pixel] - factor * annulus).max(0.0);
                    let left = left_at_half.min(at_half / annulus);
                    let half = 0.5 * (1.0 - factor + left).powi(2) * own.bias2;
                    *remaining += half;
                    *difference += if fold == 0 { half } else { -half };
                }
            },
        );
    }
}

/// Largest side of the squares of suffix paths of some blocks, pixels.
fn largest_square(blocks: &[Block]) -> u32 {
    let side = |own: &Block| square_side(own.film.resolution(), own.counts.light_paths.into());
    blocks.iter().map(side).max().expect("there are blocks")
}

/// Luminance of a radiance.
fn luminance_of(radiance: Rgb) -> f64 {
    luminance(radiance.as_dvec3())
}

/// Fraction of the annulus of photons to subtract, from its squared bias and its variance.
pub fn shrinkage_of_photons(bias2: f64, variance: f64) -> f64 {
    shrinkage(bias2, variance, BIAS_EXCESS)
}

/// Fraction to subtract of what has this squared bias and variance, `excess` being the least ratio
/// of both: theory.md (71d).
pub(super) fn shrinkage(bias2: f64, variance: f64, excess: f64) -> f64 {
    let excess = (bias2 - excess * variance).max(0.0);
    if excess > 0.0 { excess / (excess + variance) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::film::annulus::CLASSES;
    use crate::film::counts::Counts;
    use crate::film::radiance::total;
    use crate::film::statistic::{CurrentIteration, PixelSample};
    use crate::render::RenderConfig;
    use crate::render::accumulators::{IterationSample, SharedStatistics};
    use crate::render::combined_image::CombinedImage;
    use crate::settings::{Bias, Kernel, PartialSettings, Settings, Strategy};
    use glam::DVec3;

    const SIDE: u32 = 24;

    fn typical_left_at_half() -> f64 {
        left_at_half(Kernel::Area, false)[1]
    }

    /// Blocks of an image of luminance 1 with noise 0.3. In the left half, the annulus of the
    /// second class contributes `bias` and `noise`; elsewhere, both classes contribute noise only.
    fn blocks(bias: f64, noise: f64, iterations: &[u64], seed: u64) -> Vec<Block> {
        let gauss = |rng: &mut Rng| (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
        let sample = |rng: &mut Rng, (x, _): (u32, u32), _: u64| {
            let own = if x < SIDE / 2 { bias } else { 0.0 };
            let annulus: [f64; CLASSES] = [0.0, own].map(|bias| bias + noise * gauss(rng));
            (1.0 + 0.3 * gauss(rng) + annulus[0] + annulus[1], annulus)
        };
        blocks_of((SIDE, 10), iterations, seed, sample)
    }

    /// Blocks of a square image of this side, with so many light paths in each iteration. `sample`
    /// gives the value of a pixel and the contributions of the annulus in an iteration.
    fn blocks_of(
        (side, light_paths): (u32, u32),
        iterations: &[u64],
        seed: u64,
        sample: impl Fn(&mut Rng, (u32, u32), u64) -> (f64, [f64; CLASSES]),
    ) -> Vec<Block> {
        let partial = PartialSettings {
            resolution: Some([side, side]),
            bias: Some(Bias::Reduce),
            ..Default::default()
        };
        let settings = Settings::resolve(&partial, &Default::default(), 1.0).unwrap();
        let mut rng = StreamKey::new(seed, Stream::Pilot, 0).rng(0);
        let mut first = 0;
        let block = |&count: &u64| {
            let request = RenderConfig::default().request(&settings);
            let mut block = Block::new(&request, first, Counts::uniform(light_paths, 1));
            let mut shared = SharedStatistics::default();
            for number in first..first + count {
                let iteration = CurrentIteration { number, is_measured: false };
                let (_, mut tiles) = block.begin_iteration(iteration, request, &mut shared);
                for tile in &mut tiles {
                    for index in 0..tile.film.tile.len() as u32 {
                        let pixel = tile.film.tile.pixel(index);
                        let (value, annulus) = sample(&mut rng, pixel, number);
                        let (value, annulus) = (DVec3::splat(value), annulus.map(DVec3::splat));
                        let pixel = PixelSample { value, annulus: Some(annulus), aovs: None };
                        let sample = IterationSample { pixel, ..IterationSample::default() };
                        tile.add_sample(index as usize, &sample);
                    }
                }
                let deviation = tiles.iter().map(|tile| tile.film.deviation).sum();
                block.end_iteration(iteration, deviation);
            }
            first += count;
            block
        };
        iterations.iter().map(block).collect()
    }

    fn mean(values: &[f64]) -> f64 {
        total(values, |value| *value) / values.len() as f64
    }

    #[test]
    fn bias_without_noise_is_subtracted_completely() {
        let blocks = blocks(0.5, 0.0, &[6], 1);
        let image = CombinedImage::new(&blocks, vec![1.0]);
        let merged = blocks[0].film.mean();
        for (index, (corrected, merged)) in image.mean().iter().zip(&merged).enumerate() {
            let subtracted = f64::from(merged.x - corrected.x);
            let expected = if index as u32 % SIDE < SIDE / 2 { 0.5 } else { 0.0 };
            assert!((subtracted - expected).abs() < 1e-5, "{index}: {subtracted}");
        }
        // The bias at half the radius is not measured but assumed.
        let left = mean(&image.bias_correction().unwrap().bias2);
        let expected = 0.5 * (typical_left_at_half() * 0.5).powi(2);
        assert!((left / expected - 1.0).abs() < 1e-3, "{left}");
    }

    #[test]
    fn noise_without_bias_is_not_subtracted() {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for seed in 0..40 {
            let blocks = blocks(0.0, 1.0, &[40], seed);
            let image = CombinedImage::new(&blocks, vec![1.0]);
            for correction in &image.bias_correction().unwrap().correction {
                sum += f64::from(correction.x);
                squares += f64::from(correction.x).powi(2);
                count += 1.0;
            }
        }
        // The factor is independent of the fold that it scales: the expectation is 0. Neighbors
        // have similar factors but independent annuli.
        let error = squares.sqrt() / count;
        assert!(squares > 0.0 && (sum / count).abs() < 3.0 * error, "{} +- {error}", sum / count);
        // Noise of 1 in each of two classes.
        assert!(squares / count < 0.05 * 2.0 / 40.0, "{}", squares / count * 40.0);
    }

    /// Few iterations hardly know the noise of what a cache adds: eight of each fold have to.
    #[test]
    fn nothing_is_subtracted_for_a_cache_after_few_iterations() {
        for (count, expected) in [(6, 0.0), (14, 0.0), (16, 0.5)] {
            let mut blocks = blocks(0.5, 0.01, &[count], 1);
            blocks[0].has_cache = true;
            let image = CombinedImage::new(&blocks, vec![1.0]);
            // Photons of caustics have noise of their own, which is corrected as ever.
            let found = f64::from(image.bias_correction().unwrap().correction[0].x);
            assert!((found - expected).abs() < 0.02, "{count}: {found}");
        }
    }

    /// Noise of 1 without bias: what is subtracted for a cache has a tenth of the variance of what
    /// is subtracted for photons, or less.
    #[test]
    fn noise_is_no_bias_of_a_cache() {
        let squares = [false, true].map(|has_cache| {
            let one = |seed| {
                let mut blocks = blocks(0.0, 1.0, &[40], seed);
                blocks[0].has_cache = has_cache;
                let image = CombinedImage::new(&blocks, vec![1.0]);
                let all = &image.bias_correction().unwrap().correction;
                all.iter().map(|own| f64::from(own.x).powi(2)).sum::<f64>()
            };
            (0..20).map(one).sum::<f64>()
        });
        // The other class has noise of photons in both.
        let [photons, cache] = squares;
        assert!(cache - 0.5 * photons < 0.1 * 0.5 * photons, "{squares:?}");
    }

    /// In a dark room few suffix paths find light: the cache adds it in all squares of pixels that
    /// have none of them, and lacks it in the others. It has no bias.
    #[test]
    fn light_that_few_paths_find_is_no_bias_of_a_cache() {
        const SQUARE: u32 = 12;
        let side = 16 * SQUARE;
        let light_paths = 16 * (side / SQUARE).pow(2);
        assert_eq!(square_side((side, side), light_paths.into()), SQUARE);
        let of_seed = |seed: u64| {
            let rare = |_: &mut Rng, (x, y): (u32, u32), iteration: u64| {
                let square = u64::from(y / SQUARE * side + x / SQUARE);
                let mut rng = StreamKey::new(square, Stream::Test, 100 * seed + iteration).rng(0);
                let added = if rng.next_1d() < 0.02 { -49.0 } else { 1.0 };
                (1.0 + added, [0.0, added])
            };
            let mut blocks = blocks_of((side, light_paths), &[40], 1, rare);
            blocks[0].has_cache = true;
            let image = CombinedImage::new(&blocks, vec![1.0]);
            let all = &image.bias_correction().unwrap().correction;
            all.iter().map(|own| f64::from(own.x).powi(2)).sum::<f64>() / all.len() as f64
        };
        let squares: Vec<f64> = (0..8).map(of_seed).collect();
        assert!(squares.iter().all(|square| *square < 0.01), "{squares:?}");
    }

    #[test]
    fn noise_of_one_image_has_the_variance_as_its_mean() {
        for (parts, weights) in [(&[40][..], vec![1.0]), (&[12, 30], vec![0.4, 1.0])] {
            let (mut squares, mut variances) = (Vec::new(), 0.0);
            for seed in 0..30 {
                let blocks = blocks(0.0, 0.0, parts, 500 + seed);
                let image = CombinedImage::new(&blocks, weights.clone());
                squares.push(mean(&image.bias_correction().unwrap().squared_noise));
                variances += mean(&image.variance_of_mean().unwrap()) / 30.0;
            }
            let squared = mean(&squares);
            // 576 pixels of each of 30 images, each with a relative variance of 2.
            let error = (2.0 / (576.0 * 30.0f64)).sqrt();
            assert!((squared / variances - 1.0).abs() < 4.0 * error, "{squared} {variances}");
        }
    }

    #[test]
    fn estimated_error_matches_true_error() {
        for (bias, parts, weights) in
            [(0.1, &[60][..], vec![1.0]), (0.3, &[60], vec![1.0]), (0.2, &[20, 40], vec![0.3, 1.0])]
        {
            let (mut estimate, mut errors) = (0.0, Vec::new());
            let (runs, half) = (60, typical_left_at_half() * bias);
            for seed in 0..runs {
                let blocks = blocks(bias, 1.0, parts, 1000 + seed);
                let image = CombinedImage::new(&blocks, weights.clone());
                let noise = mean(&image.variance_of_mean().unwrap());
                let bias2 = mean(&image.bias_correction().unwrap().bias2);
                estimate += (noise + bias2) / runs as f64;
                let square = |(index, pixel): (usize, &Rgb)| {
                    // The simulated images lack the bias at half the radius
                    let left = if index as u32 % SIDE < SIDE / 2 { half } else { 0.0 };
                    (f64::from(pixel.x) + left - 1.0).powi(2)
                };
                let error = image.mean().iter().enumerate().map(square).sum::<f64>();
                errors.push(error / f64::from(SIDE * SIDE));
            }
            let true_error = errors.iter().sum::<f64>() / runs as f64;
            let spread = errors.iter().map(|x| (x - true_error).powi(2)).sum::<f64>();
            let spread = spread / (runs - 1) as f64;
            let error = (spread / runs as f64).sqrt();
            assert!(
                (estimate - true_error).abs() < 3.0 * error + 0.03 * true_error,
                "{bias}: {estimate}, not {true_error} +- {error}"
            );
            // Without correction: noise of three terms, and the whole bias
            let merged = 2.09 / 60.0 + 0.5 * (bias + half).powi(2);
            assert!(bias < 0.2 || true_error < 0.9 * merged, "{bias}: {true_error} of {merged}");
        }
    }

    #[test]
    fn correction_needs_two_iterations_of_each_fold() {
        for (count, known) in [(0, false), (3, false), (4, true)] {
            let blocks = blocks(0.1, 0.1, &[count], 3);
            let image = CombinedImage::new(&blocks, vec![1.0]);
            assert_eq!(image.bias_correction().is_some(), known, "{count}");
        }
    }

    #[test]
    fn path_tracing_keeps_no_annulus() {
        for strategy in [Strategy::Single, Strategy::Path] {
            let partial = PartialSettings { resolution: Some([SIDE, SIDE]), ..Default::default() };
            let own = Settings::resolve(&partial, &Default::default(), 1.0).unwrap();
            let settings = Settings { strategy, bias: Bias::Reduce, merge_vertex: 2, ..own };
            let request = RenderConfig::default().request(&settings);
            let block = Block::new(&request, 0, Counts::uniform(10, 1));
            assert_eq!(block.statistics.annulus.is_some(), strategy.has_photons());
            assert!(block.is_consistent(&settings));
        }
    }
}
