//! Blocks: iterations at equal path counts, whose sums add up; and noise estimates from several
//! blocks.

use super::accumulators::{BlockStatistics, SharedStatistics};
pub use super::combined_image::CombinedImage;
use super::tiles::TileSums;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::film::PhaseTimes;
use crate::film::cells::CellGrid;
use crate::film::counts::{CameraCounts, Counts};
use crate::film::radiance::{Film, total};
use crate::film::statistic::{BatchGrain, CurrentIteration, StatisticRequest};
use crate::noise::Coefficients;
use crate::noise::film::NoiseFilm;
use crate::noise::image::NoiseImage;
use crate::noise::schedule::measured_before;
use crate::settings::{Kernel, Settings};
use crate::transport::camera_paths::CameraPoints;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Iterations at equal path counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Number of the block's first iteration among those of the whole image.
    pub first: u64,
    /// Numbers of the iterations that the sums contain: all from `first` on, or a part of them.
    pub numbers: IterationSet,
    /// Path counts of every iteration.
    pub counts: Counts,
    /// Kernel of the merges, which determines the bias that remains after correction.
    pub kernel: Kernel,
    /// Camera paths end at a cache, whose bias is corrected instead of that of merges.
    pub has_cache: bool,
    /// Camera paths start from Sobol points, so that iterations are not independent.
    pub starts_from_points: bool,
    /// Sums of the image.
    pub film: Film,
    /// Statistics that are kept beside the image.
    pub statistics: BlockStatistics,
    /// Times of the iterations that were not measured. They are not part of the image or its files.
    #[serde(skip)]
    pub clock: PhaseClock,
}

/// Times of iterations that were not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseClock {
    /// Number of iterations.
    pub iterations: u64,
    /// Sum of their times.
    pub times: PhaseTimes,
}

impl PhaseClock {
    pub(super) fn add(&mut self, times: &PhaseTimes) {
        self.iterations += 1;
        self.times += *times;
    }
}

impl Block {
    /// Sums of no iteration; the first will have the number `first`.
    pub fn new(request: &StatisticRequest, first: u64, counts: Counts) -> Self {
        let (width, height) = request.settings.resolution();
        let mut statistics = BlockStatistics::default();
        statistics.start(request);
        Self {
            first,
            numbers: IterationSet::default(),
            counts,
            kernel: request.settings.kernel,
            has_cache: request.settings.has_cache(),
            starts_from_points: CameraPoints::are_used(request.settings)
                && !request.independent_paths,
            film: Film::new(width, height),
            statistics,
            clock: PhaseClock::default(),
        }
    }

    /// Path counts, and all tiles to add `iteration` to.
    ///
    /// # Panics
    /// If the iteration is measured with fewer than two light paths.
    pub(super) fn begin_iteration<'a>(
        &'a mut self,
        iteration: CurrentIteration,
        request: StatisticRequest,
        shared: &'a mut SharedStatistics,
    ) -> (&'a Counts, Vec<TileSums<'a>>) {
        assert!(!iteration.is_measured || self.counts.light_paths >= 2, "measuring takes pairs");
        let before = || measured_before(iteration.number - self.first);
        let measured_before = iteration.is_measured.then(before);
        self.statistics.start(&StatisticRequest { measured_before, ..request });
        let statistics = self.statistics.tiles_mut(iteration).zip(shared.tiles_mut(iteration));
        let tiles = self.film.tiles_mut().zip(statistics);
        let tiles = tiles.map(|(film, (block, shared))| TileSums { film, block, shared });
        (&self.counts, tiles.collect())
    }

    /// Counts an iteration that all tiles have added; `deviation` is the sum of
    /// [`FilmTile::deviation`](crate::film::radiance::FilmTile::deviation).
    pub(super) fn end_iteration(&mut self, iteration: CurrentIteration, deviation: f64) {
        self.film.end_iteration(deviation);
        self.statistics.end_iteration(iteration);
        self.numbers.add(iteration.number);
    }

    /// Noise estimates of each pixel.
    ///
    /// # Errors
    /// If fewer than two iterations were measured, or in batches of whole tiles.
    pub fn noise_image(&self) -> Result<NoiseImage> {
        let noise = self.statistics.noise.as_ref().filter(|noise| noise.iterations >= 2);
        let noise = noise.ok_or_else(|| {
            Error::new("fewer than two iterations were measured", "measure two or more")
        })?;
        if noise.grain() == BatchGrain::Tile {
            let problem = "the noise was measured in batches of whole tiles";
            return Err(Error::new(problem, "measure with batches of single pixels"));
        }
        let counts = (self.counts.light_paths, self.counts.camera_paths.most());
        Ok(NoiseImage::new(&self.film, noise, counts))
    }

    /// Whether all parts belong to an image with these settings. They may come from a file.
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
            && self.kernel == settings.kernel
            && self.has_cache == settings.has_cache()
            && self.film.sums.fits(settings.resolution())
            && self.statistics.fits(settings)
    }

    /// Adds the iterations of another part of the same block.
    ///
    /// All sums equal those of a single run, except for the order of additions and for the terms
    /// that estimate the error of the variance.
    ///
    /// # Errors
    /// If both contain the same iteration, have different counts, or keep different statistics.
    pub fn merge(&mut self, other: &Self) -> Result<()> {
        self.check_counts(&other.counts)?;
        let both = self.numbers.within(&other.numbers);
        if !both.is_empty() {
            return Err(Error::new(
                format!("iterations {both} are in both"),
                "give every part once, all with the same number of parts",
            ));
        }
        if !self.statistics.can_merge(&other.statistics) {
            return Err(different_statistics());
        }
        self.film.merge(&other.film);
        self.statistics.merge(&other.statistics);
        self.numbers = self.numbers.with(&other.numbers);
        self.clock.iterations += other.clock.iterations;
        self.clock.times += other.clock.times;
        Ok(())
    }

    /// Refuses other path counts than those of the block.
    pub(super) fn check_counts(&self, counts: &Counts) -> Result<()> {
        if self.counts == *counts {
            return Ok(());
        }
        Err(Error::new(
            format!("the numbers of paths from iteration {} on differ", self.first),
            "render all parts with the same numbers of paths, or the same plan",
        ))
    }
}

/// Error for parts of an image that keep different statistics.
pub(super) fn different_statistics() -> Error {
    Error::new(
        "one part keeps other layers or noise estimates than the others",
        "render all parts with the same layers, noise measurement and denoising",
    )
}

/// Coefficients of each [cell](CellGrid) in row order, from the measured iterations of all blocks;
/// `None` if there are none. Cells are single pixels except in large images.
///
/// Coefficients do not depend on the counts, so that those of several blocks are averaged. The
/// weights are their precisions to first order: pairs of paths for `a`, camera paths for `b` (the
/// sample variance has `N_B - 1` degrees of freedom), light paths for `f`. All pixels have equal
/// weights: counts that follow earlier estimates must not decide how these are weighted.
pub fn coefficients(blocks: &[Block]) -> Option<Vec<Coefficients>> {
    let grid = CellGrid::of(blocks.first()?.film.resolution());
    let mut all = vec![Coefficients::default(); grid.len()];
    let mut weights = Coefficients::default();
    for (block, noise) in measured(blocks) {
        let n_light = f64::from(block.counts.light_paths);
        let n_camera = block.counts.camera_paths.mean().max(2.0);
        // theory.md (72)
        let per_iteration = Coefficients { a: n_light * n_camera, b: n_camera - 1.0, f: n_light };
        weights += per_iteration * noise.iterations as f64;
        all.par_iter_mut().zip(noise.cell_coefficients(grid)).for_each(|(all, sums)| {
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

/// Degrees of freedom of the measured `b` of each cell in row order: camera paths less one in each
/// pixel and measured iteration. theory.md (87), `nu`.
pub fn degrees_of_freedom(blocks: &[Block]) -> Vec<f64> {
    let Some(first) = blocks.first() else { return Vec::new() };
    let grid = CellGrid::of(first.film.resolution());
    let mut all = vec![0.0; grid.len()];
    for (block, noise) in measured(blocks) {
        let iterations = grid.pixels_per_cell() * noise.iterations as f64;
        for (cell, all) in all.iter_mut().enumerate() {
            let traced = block.counts.camera_paths.at(grid.first_pixel(cell)).max(2);
            *all += f64::from(traced - 1) * iterations;
        }
    }
    all
}

fn measured(blocks: &[Block]) -> impl Iterator<Item = (&Block, &NoiseFilm)> {
    blocks.iter().filter_map(|block| Some((block, block.statistics.noise.as_ref()?)))
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

/// The variance of each cell of an image, of one iteration at `counts`, by formula (1), with a
/// weight for each cell. The camera paths are those of the first pixel of a cell.
fn weighted_variances(
    coefficients: &[Coefficients],
    counts: &Counts,
    weights: &[f64],
    grid: CellGrid,
) -> Vec<f64> {
    let n_light = f64::from(counts.light_paths);
    let variance = |(cell, (c, weight)): (usize, (&Coefficients, &f64))| {
        weight * c.variance(n_light, f64::from(counts.camera_paths.at(grid.first_pixel(cell))))
    };
    coefficients.par_iter().zip(weights).enumerate().map(variance).collect()
}

/// Iterations below which the noisiest cells do not decide about the weights of blocks.
const FEW_ITERATIONS: u64 = 32;

/// Share of those cells.
const NOISIEST: f64 = 0.02;

/// The largest variance, at the counts of the first block, of the cells that decide about the
/// weights of blocks. After few iterations rare bright paths were seen in a few cells, which then
/// have many camera paths, and are as likely to be seen elsewhere: three iterations of
/// `caustic-sphere` weighed 27 times less than a fourth.
fn deciding(iterations: u64, variances: &[f64]) -> f64 {
    let index = ((1.0 - NOISIEST) * variances.len() as f64) as usize;
    if iterations >= FEW_ITERATIONS || index >= variances.len() {
        return f64::INFINITY;
    }
    let mut sorted = variances.to_vec();
    *sorted.select_nth_unstable_by(index, f64::total_cmp).1
}

/// Weights by the variances of the cells in each block, the first one before the others.
fn weights_of(iterations: u64, variances: &[Vec<f64>]) -> Vec<f64> {
    let first = &variances[0];
    let most = deciding(iterations, first);
    let sum = |own: &Vec<f64>| {
        let terms = own.iter().zip(first);
        let counted = terms.map(|(own, first)| if *first <= most { *own } else { 0.0 });
        total(&counted.collect::<Vec<f64>>(), |term| *term)
    };
    let sums: Vec<f64> = variances.iter().map(sum).collect();
    if sums.iter().any(|&sum| sum <= 0.0 || !sum.is_finite()) {
        return vec![1.0; variances.len()];
    }
    let least = sums.iter().copied().fold(f64::INFINITY, f64::min);
    sums.into_iter().map(|sum| least / sum).collect()
}

/// Weight of an iteration of each block: the reciprocal of its mean variance over cells weighted by
/// `importance`. The maximum is 1.
///
/// Each block has one weight for the whole image, by formula (1) from the coefficients of all
/// blocks. Weights per pixel, or from a block's own samples, would favor blocks that happened to
/// miss rare bright paths, and the image would be too dark. theory.md (73).
pub fn weights(blocks: &[Block], importance: &[f64]) -> Vec<f64> {
    let equal = vec![1.0; blocks.len()];
    if blocks.len() == 1 {
        return equal;
    }
    let Some(coefficients) = coefficients(blocks) else { return equal };
    let grid = CellGrid::of(blocks[0].film.resolution());
    let of_block =
        |block: &Block| weighted_variances(&coefficients, &block.counts, importance, grid);
    let variances: Vec<Vec<f64>> = blocks.iter().map(of_block).collect();
    weights_of(blocks.iter().map(|block| block.film.iterations).sum(), &variances)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hundredth of the cells, where rare paths were seen, has many more camera paths in the
    /// second block. All others have as many.
    #[test]
    fn few_noisy_cells_do_not_decide_after_few_iterations() {
        let cells =
            |noisy: f64| (0..1000).map(|i| if i % 100 == 0 { noisy } else { 1.0 }).collect();
        let variances = [cells(1e4), cells(1e2)];
        assert_eq!(weights_of(4, &variances), [1.0, 1.0]);
        let [first, second] = weights_of(FEW_ITERATIONS, &variances)[..] else { panic!() };
        assert!(first < 0.03 && second == 1.0, "{first}");
        // Where all cells gain, the weights say so, and equal ones have the same weight.
        let all = [vec![2.0; 1000], vec![1.0; 1000]];
        assert_eq!([4, 1000].map(|own| weights_of(own, &all)[0]), [0.5, 0.5]);
        assert_eq!(weights_of(4, &[vec![0.0; 4], vec![1.0; 4]]), [1.0, 1.0]);
    }
}
