//! Blocks: iterations at equal counts, whose sums add; and the image that several of them make.

mod merge;

use super::bias_correction::BiasCorrection;
use super::tiles::{LayerTile, TileSums};
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::base::math::Rgb;
use crate::film::PhaseTimes;
use crate::film::annulus::Annulus;
use crate::film::aov::{AovSelection, FeatureBuffers, LightComponents, Parts};
use crate::film::counts::{CameraCounts, Counts};
use crate::film::radiance::{Film, box_filter, luminance, total};
use crate::noise::film::{BatchGrain, NoiseFilm};
use crate::noise::image::NoiseImage;
use crate::noise::schedule::measured_before;
use crate::noise::{Coefficients, Measure};
use crate::settings::{Bias, Settings};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Iterations at equal counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Number of its first iteration among those of the whole image.
    pub first: u64,
    /// IterationSet of the iterations that it holds: all from the first on, or a part of them.
    pub numbers: IterationSet,
    /// What every iteration took.
    pub counts: Counts,
    /// Sums of all iterations.
    pub film: Film,
    /// Sums of the measuring ones.
    pub noise: Option<NoiseFilm>,
    /// Light by kind, if it is kept: stored as the film's sums are.
    pub light: Option<Vec<LightComponents>>,
    /// Parts of the iterations, if they are kept.
    pub parts: Option<Parts>,
    /// What merges beyond half the radii bring, if that is taken off.
    pub beyond: Option<Annulus>,
    /// Times of the others; not part of the image, nor of its files.
    #[serde(skip)]
    pub clock: PhaseClock,
}

/// Times of production iterations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseClock {
    /// How many.
    pub iterations: u64,
    /// Their sum.
    pub times: PhaseTimes,
}

impl PhaseClock {
    /// Adds an iteration unless it measures.
    pub(super) fn add(&mut self, measure: Measure, times: &PhaseTimes) {
        if measure == Measure::Off {
            self.iterations += 1;
            self.times += *times;
        }
    }
}

impl Block {
    /// No iteration yet; the first will have this number.
    pub fn new(settings: &Settings, first: u64, counts: Counts) -> Self {
        let film = Film::new(settings.width, settings.height);
        let (numbers, light, parts) = (IterationSet::default(), None, None);
        let beyond = (settings.bias == Bias::Reduce).then(|| Annulus::new(film.pixels(), settings));
        let (noise, clock) = (None, PhaseClock::default());
        Self { first, numbers, counts, film, noise, light, parts, beyond, clock }
    }

    /// The same, also keeping this; no iteration yet.
    #[must_use]
    pub(super) fn with_aovs(self, kept: AovSelection) -> Self {
        let pixels = self.film.pixels();
        Self {
            light: kept.light.then(|| vec![LightComponents::default(); pixels]),
            parts: kept.parts.then(|| Parts::new(pixels)),
            ..self
        }
    }

    /// The counts, and all tiles to add another iteration to, of this number among those of all blocks.
    ///
    /// # Panics
    /// If it is to measure with fewer than two light paths.
    pub(super) fn begin_iteration<'a>(
        &'a mut self,
        (iteration, measure): (u64, Measure),
        grain: BatchGrain,
        features: Option<&'a mut FeatureBuffers>,
    ) -> (&'a Counts, Vec<TileSums<'a>>) {
        let Self { first, counts, film, noise, light, parts, beyond, .. } = self;
        let mut noise_tiles = Vec::new();
        if measure != Measure::Off {
            assert!(counts.light_paths >= 2, "measuring takes pairs");
            let begin = || {
                let before = measured_before(iteration - *first);
                NoiseFilm::new(film.tiles(), grain).after(before)
            };
            let noise = noise.get_or_insert_with(begin);
            noise_tiles = noise.tiles_mut(film.tiles());
        }
        let mut noise_tiles = noise_tiles.into_iter();
        let all = film.tiles();
        let features = features.map(|features| features.tiles_mut(all, iteration));
        let parts = parts.as_mut().map(|parts| parts.tiles_mut(film.tiles(), iteration));
        let mut light = light.as_deref_mut();
        let beyond = beyond.as_mut().map(|beyond| beyond.tiles_mut(film.tiles(), iteration));
        let mut beyond = beyond.into_iter().flatten();
        let (mut features, mut parts) =
            (features.into_iter().flatten(), parts.into_iter().flatten());
        let tiles = film.tiles_mut().into_iter().map(|(tile, sums)| TileSums {
            tile,
            sums,
            noise: noise_tiles.next(),
            deviation: 0.0,
            beyond: beyond.next(),
            layers: LayerTile {
                light: light.as_mut().and_then(|light| light.split_off_mut(..tile.len())),
                features: features.next(),
                part: parts.next(),
            },
        });
        (counts, tiles.collect())
    }

    /// Takes note that all tiles have it; `deviations` are those of all their pixels.
    pub(super) fn end_iteration(&mut self, (iteration, measure): (u64, Measure), deviations: f64) {
        if let Some(parts) = &mut self.parts {
            parts.end_iteration(iteration);
        }
        if let Some(beyond) = &mut self.beyond {
            beyond.end_iteration(iteration);
        }
        self.film.deviations.add(deviations, self.film.iterations);
        self.film.iterations += 1;
        self.numbers.add(iteration);
        if let (Some(noise), true) = (&mut self.noise, measure != Measure::Off) {
            noise.end_iteration();
        }
    }

    /// What was measured of each pixel, and statistics of regions.
    ///
    /// # Errors
    /// If fewer than two iterations were measured, or in batches of whole tiles.
    pub fn noise_image(&self) -> Result<NoiseImage> {
        let measured =
            self.noise.as_ref().filter(|noise| noise.iterations >= 2).ok_or_else(|| {
                Error::new("fewer than two iterations were measured", "measure two or more")
            })?;
        if measured.grain() == BatchGrain::Tile {
            let problem = "the noise was measured in batches of whole tiles";
            return Err(Error::new(problem, "measure with batches of single pixels"));
        }
        let counts = (self.counts.light_paths, self.counts.camera_paths.most());
        Ok(NoiseImage::new(&self.film, measured, counts))
    }

    /// Whether all parts fit each other (they may come from a file).
    pub fn is_consistent(&self, settings: &Settings) -> bool {
        let counts_fit = match &self.counts.camera_paths {
            CameraCounts::Uniform(_) => true,
            CameraCounts::PerPixel(counts) => counts.len() == settings.pixels(),
        };
        counts_fit
            && self.numbers.is_consistent()
            && self.numbers.count() == self.film.iterations
            && self.numbers.first().is_none_or(|number| number >= self.first)
            && self.counts.validate(settings).is_ok()
            && self.film.resolution() == (settings.width, settings.height)
            && self.film.is_consistent()
            && self.noise.as_ref().is_none_or(|noise| noise.fits(self.film.tiles()))
            && self.light.as_ref().is_none_or(|light| light.len() == self.film.pixels())
            && self.parts.as_ref().is_none_or(|parts| parts.fits(self.film.pixels()))
            && match &self.beyond {
                Some(beyond) => settings.bias == Bias::Reduce && beyond.fits(self.film.pixels()),
                None => settings.bias == Bias::Keep,
            }
    }
}

/// Coefficients of each pixel, row by row, from what all blocks have measured; `None` if none has.
///
/// They do not depend on the counts, so those of different blocks average. Each is weighted by what
/// an iteration tells about it to first order: `a` by pairs of paths, `b` by camera paths (their
/// sample variance has `N_B - 1` degrees of freedom), `f` by light paths. The weights are the same
/// for all pixels: counts that follow earlier estimates must not decide what these weigh.
pub fn coefficients(blocks: &[Block]) -> Option<Vec<Coefficients>> {
    let mut all = vec![Coefficients::default(); blocks.first()?.film.pixels()];
    let mut weights = Coefficients::default();
    for (block, noise) in measured(blocks) {
        let n_light = f64::from(block.counts.light_paths);
        let n_camera = block.counts.camera_paths.mean().max(2.0);
        // theory.md (72)
        let per_iteration = Coefficients { a: n_light * n_camera, b: n_camera - 1.0, f: n_light };
        weights += per_iteration * noise.iterations as f64;
        let pixels = noise.pixels();
        block.film.zip_pixels(&mut all, |all, at| {
            let sums = pixels[at].coefficients;
            all.a += sums.a * per_iteration.a;
            all.b += sums.b * per_iteration.b;
            all.f += sums.f * per_iteration.f;
        });
    }
    all.par_iter_mut().for_each(|all| {
        *all = Coefficients { a: all.a / weights.a, b: all.b / weights.b, f: all.f / weights.f };
    });
    (weights.a > 0.0).then_some(all)
}

/// Degrees of freedom of the measured `b` of each pixel, row by row: camera paths less one in each
/// measuring iteration.
/// theory.md (87), `nu.
pub fn degrees_of_freedom(blocks: &[Block]) -> Vec<f64> {
    let mut all = vec![0.0; blocks.first().map_or(0, |block| block.film.pixels())];
    for (block, noise) in measured(blocks) {
        for (pixel, all) in all.iter_mut().enumerate() {
            let traced = block.counts.camera_paths.at(pixel).max(2);
            *all += f64::from(traced - 1) * noise.iterations as f64;
        }
    }
    all
}

fn measured(blocks: &[Block]) -> impl Iterator<Item = (&Block, &NoiseFilm)> {
    blocks.iter().filter_map(|block| Some((block, block.noise.as_ref()?)))
}

/// Pooled variance of one iteration at `counts`, by formula (1).
/// theory.md (2), pooled.
pub fn pooled_variance(coefficients: &[Coefficients], counts: &Counts) -> f64 {
    let n_light = f64::from(counts.light_paths);
    let variance = |(pixel, c): (usize, &Coefficients)| {
        c.variance(n_light, f64::from(counts.camera_paths.at(pixel)))
    };
    coefficients.iter().enumerate().map(variance).sum::<f64>() / coefficients.len() as f64
}

/// The same with a weight for each pixel.
pub fn weighted_variance(coefficients: &[Coefficients], counts: &Counts, weights: &[f64]) -> f64 {
    let n_light = f64::from(counts.light_paths);
    let variance = |(pixel, (c, weight)): (usize, (&Coefficients, &f64))| {
        weight * c.variance(n_light, f64::from(counts.camera_paths.at(pixel)))
    };
    let all = coefficients.par_iter().zip(weights).enumerate();
    let terms: Vec<f64> = all.map(variance).collect();
    total(&terms, |term| *term) / coefficients.len() as f64
}

/// Weight of an iteration of each block: the reciprocal of its mean variance over pixels of such
/// importance, the greatest being 1.
///
/// One number for the whole image, and by formula (1) from the coefficients that all blocks share:
/// weights per pixel, or from a block's own samples, would favor blocks that happened to miss rare
/// bright paths, and the image would be too dark.
/// theory.md (73).
pub fn weights(blocks: &[Block], importance: &[f64]) -> Vec<f64> {
    let equal = vec![1.0; blocks.len()];
    if blocks.len() == 1 {
        return equal;
    }
    let Some(coefficients) = coefficients(blocks) else { return equal };
    let variance = |block: &Block| weighted_variance(&coefficients, &block.counts, importance);
    let variances: Vec<f64> = blocks.iter().map(variance).collect();
    if variances.iter().any(|&variance| variance <= 0.0 || !variance.is_finite()) {
        return equal;
    }
    let least = variances.iter().copied().fold(f64::INFINITY, f64::min);
    variances.into_iter().map(|variance| least / variance).collect()
}

/// The image that some blocks make together.
#[derive(Clone, Debug)]
pub struct CombinedImage<'a> {
    blocks: &'a [Block],
    weights: Vec<f64>,
    /// Worked out when it is asked for.
    reduction: OnceLock<Option<BiasCorrection>>,
}

impl<'a> CombinedImage<'a> {
    /// All blocks, with the given weight for each of their iterations.
    ///
    /// # Panics
    /// Unless there is a positive weight for each block, and at least one block.
    pub fn new(blocks: &'a [Block], weights: Vec<f64>) -> Self {
        assert!(!blocks.is_empty() && blocks.len() == weights.len());
        assert!(weights.iter().all(|&weight| weight > 0.0 && weight.is_finite()));
        Self { blocks, weights, reduction: OnceLock::new() }
    }

    /// The weight of each block's iterations.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The blocks.
    pub fn blocks(&self) -> &'a [Block] {
        self.blocks
    }

    /// The weights alone.
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

    /// What is taken off for its bias, if that is asked for and known.
    pub fn reduction(&self) -> Option<&BiasCorrection> {
        if self.blocks.iter().any(|block| block.beyond.is_none()) {
            return None;
        }
        let reduction = || {
            let (width, height) = self.resolution();
            let own = |value: Rgb| [luminance(value.as_dvec3())];
            let own: Vec<_> = self.uncorrected_mean().into_par_iter().map(own).collect();
            let around: Vec<f64> =
                box_filter(&own, width, height).into_iter().map(|[l]| l).collect();
            BiasCorrection::new(self.blocks, &self.weights, &around)
        };
        self.reduction.get_or_init(reduction).as_ref()
    }

    /// The image, row by row: the mean over iterations, less what is taken off for its bias; black before the first.
    pub fn mean(&self) -> Vec<Rgb> {
        let mut mean = self.uncorrected_mean();
        if let Some(reduction) = self.reduction() {
            mean.par_iter_mut().zip(&reduction.amount).for_each(|(mean, off)| *mean -= *off);
        }
        mean
    }

    /// Weighted mean over iterations, row by row; black before the first.
    /// theory.md (74).
    pub fn uncorrected_mean(&self) -> Vec<Rgb> {
        let mut sums = vec![DVec3::ZERO; self.blocks[0].film.pixels()];
        for (block, weight) in self.pairs() {
            let pixels = block.film.sums();
            block.film.zip_pixels(&mut sums, |sum, at| *sum += pixels[at].radiance * weight);
        }
        let scale = self.total().recip();
        sums.into_par_iter().map(|sum| (sum * scale).as_vec3()).collect()
    }

    /// The same of light by kind, if it is kept in all blocks.
    pub fn light(&self) -> Option<Vec<LightComponents>> {
        let mut sums = vec![LightComponents::default(); self.blocks[0].film.pixels()];
        let scale = self.total().recip();
        for (block, weight) in self.pairs() {
            let light = block.light.as_ref()?;
            block.film.zip_pixels(&mut sums, |sum, at| sum.add(&light[at], weight * scale));
        }
        Some(sums)
    }

    /// Mean luminance of the image, W/(m^2 sr).
    pub fn mean_luminance(&self) -> f64 {
        let of = |(block, weight): (&Block, f64)| {
            weight * total(block.film.sums(), |pixel| luminance(pixel.radiance))
        };
        let sum: f64 = self.pairs().map(of).sum();
        sum / (self.total() * self.blocks[0].film.pixels() as f64)
    }

    /// Coefficients of the blocks' sample variances of one iteration in the variance of the mean;
    /// `None` before the second iteration of any block.
    ///
    /// Block `k` of `N` iterations of weight `w` adds `w^2 N V_k` over the squared total weight. A
    /// single iteration has no sample variance; since the weights are reciprocals of variances, the
    /// mean of the other blocks' `w V` stands for its own.
    /// theory.md (75).
    fn shares(&self) -> Option<Vec<(&'a Block, f64)>> {
        let total2 = self.total().powi(2);
        let added = |block: &Block, w: f64| w * w * block.film.iterations as f64 / total2;
        let (known, single): (Vec<_>, Vec<_>) =
            self.pairs().partition(|(block, _)| block.film.iterations >= 2);
        let known_iterations: u64 = known.iter().map(|(block, _)| block.film.iterations).sum();
        let unknown: f64 = single.iter().map(|&(block, w)| added(block, w) / w).sum();
        let share = |(block, w): (&'a Block, f64)| {
            let part = block.film.iterations as f64 / known_iterations as f64;
            (block, added(block, w) + unknown * w * part)
        };
        (!known.is_empty()).then(|| known.into_iter().map(share).collect())
    }

    /// Estimate of the variance of the luminance of [`Self::mean`] in each pixel, row by row; `None` before the second
    /// iteration of any block. Unbiased but for what is taken off for the bias: shares of that count as known.
    pub fn variance_of_mean(&self) -> Option<Vec<f64>> {
        let mut variance = self.uncorrected_variance()?;
        if let Some(reduction) = self.reduction() {
            let both = variance.par_iter_mut().zip(&reduction.variance);
            both.for_each(|(variance, change)| *variance += change);
        }
        Some(variance)
    }

    /// The same before anything is taken off; unbiased.
    pub fn uncorrected_variance(&self) -> Option<Vec<f64>> {
        let mut variance = vec![0.0; self.blocks[0].film.pixels()];
        for (block, share) in self.shares()? {
            let scale = share * block.film.iterations as f64;
            let own = block.film.variance_of_mean()?;
            variance.par_iter_mut().zip(own).for_each(|(all, own)| *all += scale * own);
        }
        Some(variance)
    }

    /// RMS of the noise that the image still has, W/(m^2 sr), row by row: the root of the variance
    /// of the mean, pooled over 5 by 5 pixels. `None` before the second iteration of any block.
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
        for (block, share) in self.shares()? {
            let (own, error) = block.film.pooled_variance()?;
            variance += share * own;
            error2 += (share * error).powi(2);
        }
        let error = error2.sqrt();
        let Some(reduction) = self.reduction() else { return Some((variance, error)) };
        let change = total(&reduction.variance, |change| *change) / reduction.variance.len() as f64;
        let reduced = (variance + change).max(0.0);
        // Of the same samples: known as well as that of the image as it was merged.
        let scale = if variance > 0.0 { reduced / variance } else { 1.0 };
        Some((reduced, scale * error))
    }
}
